"""Routing policies compared on the same draws: that they are the same, and the command."""

import io
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import NAMES, RULED, SMALL, call, made_up, run
from repository import ROOT
from rich.console import Console

from crowd_env import CrowdEnv, Physics
from crowd_env.agents.controllers import FixedSplit, RandomController
from crowd_env.agents.drivers import drive
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate, evaluate_crowd
from crowd_env.agents.evaluation.folder import _curves
from crowd_env.agents.evaluation.report import crowding_table, exits_table, left_table, times_table
from crowd_env.agents.training_config import check_config, default_config, make_env, task_of
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.tasks.task import HELD_OUT_SEED


def test_an_evaluation_of_another_number_of_people_and_what_it_sets_by_itself():
    result = evaluate("shortest", "room-v0", runs=2, people=8)
    assert all(len(times) == 8 for times in result.exit_times)
    for name, value in (("autoreset", True), ("num_envs", 4)):
        with pytest.raises(ValueError, match=f"an evaluation sets {name} by itself"):
            evaluate("shortest", "room-v0", runs=2, **{name: value})


# ------------------------------------------------------------------------------------------------------- the same draws


@looped("scheme", ["nsm2", "hertz"])
def test_all_policies_start_from_the_same_people_in_the_same_places(scheme):
    seeds = [HELD_OUT_SEED, HELD_OUT_SEED + 1]
    reference = CrowdEnv(SMALL, num_envs=2)
    reference.reset(seeds)
    for entry in make_entries(NAMES, SMALL):
        driver = entry.driver(SMALL, physics=scheme)(2)
        driver.reset(seeds)
        np.testing.assert_array_equal(driver.env.simulation.state.position, reference.simulation.state.position)
        for ours, theirs in zip(driver.env.simulation.bodies, reference.simulation.bodies, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@looped("name", ["fastest", "shortest"], quick=1)
def test_a_run_does_not_depend_on_what_was_run_beside_and_before_it(name, monkeypatch):
    many = run(name, runs=7)
    monkeypatch.setattr("crowd_env.envs.rollout._PEOPLE_AT_ONCE", 2 * 14)  # two at once: environments are used again
    few = run(name, runs=5)
    assert repr(many.episodes[:5]) == repr(few.episodes)
    np.testing.assert_array_equal(many.exit_times[:5], few.exit_times)
    for what in ("exit_index", "walked", "max_density", "max_pressure"):
        np.testing.assert_array_equal(getattr(many.measured, what)[:5], getattr(few.measured, what))


def test_measuring_changes_nothing():
    assert repr(run("fastest").episodes) == repr(run("fastest", measure=False).episodes)


def test_rules_are_in_force_for_rules_alone():
    free, ruled = run("shortest", RULED), run("rules", RULED)
    assert repr(free.episodes) == repr(run("shortest", SMALL).episodes)
    assert repr(free.episodes) != repr(ruled.episodes)
    by_east = [result.row()["exits"]["east"]["people"]["mean"] for result in (free, ruled)]
    assert by_east[0] == 0 < by_east[1]
    assert repr(run("rules", SMALL).episodes) == repr(run("shortest", SMALL).episodes)


@looped("name", NAMES)
def test_all_walk_in_the_same_place(name):
    (entry,) = make_entries([name], RULED)
    assert bool(entry.driver(RULED)(1).env.route_set[0].plan.rules) == (name == "rules")


def test_the_name_of_an_exit_sends_everyone_there():
    exits = run("east").row()["exits"]
    assert exits["east"]["people"]["mean"] == 14 and exits["west"]["people"]["mean"] == 0
    assert exits["west"]["mean_exit_time"] is None and exits["west"]["last_exit"]["mean"] is None


class Balancing:
    """Send everyone to the exit by which fewer people have left since the last decision."""

    name, options = "balancing", {"grid": (4, 1), "interval": 1.0}

    def act(self, observation, batch, rng):
        choice = observation[:, batch.layout["flow"]].argmin(axis=1)
        return np.repeat(choice[:, None], len(batch.choices), axis=1)


@pytest.mark.more
@looped("kind", [FixedSplit, RandomController, lambda options: Balancing()])
def test_a_controller_sampled_between_its_decisions_is_the_controller(kind):
    options = {"grid": (4, 1), "interval": 1.0}
    controller = kind(options)
    ours = evaluate_crowd(replace(drive(controller, SMALL), name="controller"), runs=3, measure=True)
    batch, seeds = RoutingBatch(SMALL, num_envs=3, **options), [HELD_OUT_SEED + k for k in range(3)]
    observation, rng = batch.reset(seeds), np.random.default_rng(HELD_OUT_SEED)
    while not batch.env.finished.all():
        observation = batch.step(controller.act(observation, batch, rng))[0]
    theirs = [batch.env.metrics(e) for e in range(3)]
    for one, other in zip(ours.episodes, theirs, strict=True):  # sums of overlaps are rounded otherwise
        assert repr((one.evacuation_time, one.mean_exit_time)) == repr((other.evacuation_time, other.mean_exit_time))
        assert one == pytest.approx(other, rel=1e-12, nan_ok=True)
    judged = evaluate(controller, SMALL, runs=3)
    assert repr(judged.episodes) == repr(ours.episodes)


# ---------------------------------------------------------------------------------------------------------- the command


def printed(*tables):
    console = Console(width=100, record=True, file=io.StringIO())
    for table in tables:
        console.print(table)
    return console.export_text()


@pytest.mark.more
def test_one_json_object_with_a_row_for_each_policy_and_scheme(small):
    asked = ("--scenario", "hall", "--policies", "shortest", "east", "--scheme", "dem", "nsm1", "--runs", 3, "--json")
    code, out, _ = call(*asked)
    assert code == 0
    told = json.loads(out)
    assert {"scenario", "runs", "seed", "people", "time_limit", "rows", "ranking", "versions"} <= set(told)
    assert [(row["policy"], row["scheme"]) for row in told["rows"]] == [
        ("shortest", "dem"),
        ("east", "dem"),
        ("shortest", "nsm1"),
        ("east", "nsm1"),
    ]
    figures = {"mean_exit_time", "exit_time_95", "flow", "walked", "max_density", "max_pressure", "contact_impulse"}
    numbers = {"runs", "unfinished", "unfinished_runs", "blocked_runs", "last_exit", "max_overlap", "computing_seconds"}
    for row in told["rows"]:
        assert set(row["evacuation_time"]) == {"mean", "sd", "ci95"} and figures | numbers <= set(row)
        assert {"replanning_per_simulated_second", "physics_per_simulated_second", "exits", "minus_first"} <= set(row)
        assert row["pressure_is_force"] == (row["scheme"] != "nsm1")
    assert told["rows"][0]["minus_first"]["evacuation_time"] == {
        "mean": 0.0, "ci95": [0.0, 0.0], "faster": 0.5, "draws": 3, "more_left": 0,
    }  # fmt: skip
    expected = run("east", scheme="dem").column("evacuation_time") - run("shortest", scheme="dem").column(
        "evacuation_time"
    )
    assert told["rows"][1]["minus_first"]["evacuation_time"]["mean"] == pytest.approx(expected.mean())
    assert set(told["ranking"]) == {"last", "mean"}


def test_who_is_left_inside_has_no_time_and_is_counted():
    results = [made_up("quick", "dem", [30.0, 31.0, 32.0]), made_up("slow", "dem", [40.0, 50.0, 60.0], unfinished=True)]
    slow = next(line for line in printed(times_table(results, "title")).splitlines() if "slow" in line)
    assert " ".join(slow.split()) == "slow never – – +3 never – – 3"


def test_policies_that_do_the_same_share_a_curve():
    results = [made_up("a", "dem", [30.0]), made_up("b", "dem", [31.0]), made_up("c", "dem", [30.0])]
    assert list(_curves(results)) == ["a = c", "b"]


@looped(("interval", "dt"), [(0.25, 0.01), (0.3, 0.03)])
def test_a_controller_may_decide_at_times_at_which_no_sample_fits(interval, dt):
    judged = evaluate(
        FixedSplit({"grid": (4, 1), "interval": interval}), SMALL, runs=1, first_seed=0, physics=Physics(dt=dt)
    )
    assert judged.column("unfinished").tolist() == [0.0]


def test_shares_of_runs_are_shown_with_their_intervals():
    results = [made_up("quick", "dem", [30.0] * 20), made_up("slow", "dem", [40.0] * 20, unfinished=True)]
    results[1] = replace(results[1], episodes=[e._replace(blocked_since=9.0) for e in results[1].episodes])
    assert results[0].row()["unfinished_share"] == {"mean": 0.0, "ci95": pytest.approx([0.0, 0.1611], abs=1e-4)}
    assert results[1].row()["blocked_share"] == {"mean": 1.0, "ci95": pytest.approx([0.8389, 1.0], abs=1e-4)}
    lines = {
        line.split()[0]: " ".join(line.split()) for line in printed(left_table(results)).splitlines() if line.strip()
    }
    assert lines["quick"] == "quick 0 0 of 20 0 (0..16) 0 of 20 0 (0..16)"
    assert lines["slow"] == "slow 20 20 of 20 100 (84..100) 20 of 20 100 (84..100)"


def test_who_is_found_outside_of_the_walls_makes_a_run_void():
    result = run("stand-still", runs=2)
    assert result.row()["escaped"] == 0 and result.row()["max_speed"] == result.column("max_speed").max()
    odd = replace(result, policy="odd", episodes=[e._replace(escaped=3, max_speed=12.3) for e in result.episodes])
    assert odd.row()["escaped"] == 6 and odd.row()["max_speed"] == 12.3
    for results, told in (([result], False), ([result, odd], True)):
        assert ("VOID: 6 people were outside" in printed(crowding_table(results))) == told


@pytest.mark.more
def test_a_law_of_ones_own_is_judged_and_trained_with(tmp_path):
    """Of a user's file, named as for ``crowd-env run``."""
    (tmp_path / "law_of_ones_own.py").write_text(
        """from dataclasses import dataclass, replace
from crowd_env.physics import Hertz

@dataclass(frozen=True)
class Soft(Hertz):
    @property
    def info(self):
        return replace(super().info, name="soft")
"""
    )
    law, out = f"{tmp_path}/law_of_ones_own.py:Soft", tmp_path / "out"
    words = ("--scenario", "room-v0", "--people", 6, "--policies", "shortest", "--runs", 1, "--json", "--scheme", law)
    code, told, error = call(*words, "hertz", "--out", out)
    assert code == 0, error
    own, usual = json.loads(told)["rows"]
    assert (own["scheme"], usual["scheme"]) == ("soft", "hertz")
    assert own["evacuation_time"] == usual["evacuation_time"]
    assert call(*words, "hertz", "--out", out)[1] == told  # from what is kept there
    config = default_config("room-v0", law, seed=0, envs=1, steps=1, minutes=1.0, people=6)
    check_config(config)
    assert make_env(config).simulation.scheme.info.name == task_of(config).scheme == "soft"
    with pytest.raises(ValueError, match=r"--scheme .*:Hard: .* has no Hard"):
        default_config("room-v0", law.replace("Soft", "Hard"), seed=0, envs=1, steps=1, minutes=1.0)


@pytest.mark.more
def test_tables_fit_into_a_hundred_columns():
    results = [run(name, scheme=scheme, runs=2) for scheme in ("nsm2", "nsm1") for name in NAMES]
    text = printed(times_table(results, "title"), left_table(results), exits_table(results), crowding_table(results))
    assert "…" not in text and "nan" not in text and "None" not in text
    assert all(text.count(name) >= 8 for name in NAMES)
    assert max(map(len, text.splitlines())) <= 100


@looped(
    ("arguments", "message"),
    [
        (("--policies", "dance"), r"unknown policy 'dance'; known: shortest.*rules.*door.*stand-still"),
        (("--policies", "shortest", "shortest"), "'shortest' is named twice"),
        (("--policies", "none.safetensors"), r"cannot read the network none\.safetensors"),
        (("--scheme", "glue"), "unknown contact scheme 'glue'; known: dem"),
        (("--scenario", "moon-v0"), "unknown scenario 'moon-v0'; known: room-v0"),
        (("--runs", "0"), "--runs is 0"),
        (("--runs", "1000000"), "--runs is 1000000; it must be 1 to 999999"),
        (("--seed", "-1"), "--seed is -1"),
        (("--set", "threads=0"), "--set threads is 0"),
    ],
)
def test_mistakes_are_said_in_one_line(arguments, message):
    code, out, err = call("--runs", 1, *arguments)
    assert code == 2 and out == ""
    assert re.search(message, err) and len(err.strip().splitlines()) == 1 and err.startswith("error: ")


def test_a_folder_that_cannot_be_written_is_said_in_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "evaluation.json").write_text("[1]")
    for name, words in (("file", "file"), ("file/x", "file"), ("odd", "does not say what decided")):
        code, out, err = call("--runs", 1, "--out", tmp_path / name)
        assert code == 2 and out == "" and err.startswith("error: ") and len(err.strip().splitlines()) == 1
        assert words in err


@pytest.mark.nightly
def test_the_command_as_it_is_written(tmp_path):
    words = (
        f"--scenario room-v0 --policies shortest fastest stand-still --scheme dem nsm2 --runs 2 --out {tmp_path}/out"
    )
    program = [sys.executable, "-m", "crowd_env", "evaluate", *words.split()]
    result = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "fastest" in result.stdout and "The order is" in result.stdout
