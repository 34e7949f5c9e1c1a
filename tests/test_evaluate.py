"""Routing policies compared on the same draws: what is measured on the way, the statistics, the command and its folder."""

import csv
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from agents import evaluate as command
from agents.candidates import make_candidates, of_controller
from agents.comparison import kendall_tau, last_times, paired, ranking
from agents.evaluation import HELD_OUT_SEED, Evaluation, evacuate
from agents.evaluation_files import EvaluationFolder, _curves, settings_of
from agents.measurements import CELL, REACH, Recorder, most_within
from agents.report import crowding_table, exits_table, ranking_lines, times_table
from agents.routing import FixedSplit, RandomController, judge
from crowd_env import ControlRule, CrowdEnv, Geometry, Population, Scenario, Uniform, make_scenario
from crowd_env.geometry import box
from crowd_env.rendering.heat import HeatMap, heat_figure, heat_maps

ROOT = Path(__file__).parents[1]
NAMES = ("shortest", "nearest", "fastest", "west", "rules", "random", "stand-still")


def hall(count=14, time_limit=25.0, *, starts=None, speed=None, **more):
    """10 x 6 m, a narrow exit in the west, a wide one in the east; everyone starts in the left half."""
    exits = {"west": [(0, 2.5), (0, 3.5)], "east": [(10, 2), (10, 4)]}
    regions = {"left": box(0, 0, 5, 6), "west door": box(0, 1.5, 2, 4.5)}
    geometry = Geometry.from_polygon(box(0, 0, 10, 6), exits=exits, regions=regions)
    people = {"start_region": "left"} if starts is None else {"starts": np.array(starts, dtype=np.float64)}
    if speed is not None:
        people["desired_speed"] = Uniform(speed, speed)
    number = count if starts is None else len(starts)
    population = Population(number, radius=Uniform(0.2, 0.2), **people)
    return Scenario("hall", geometry, population, time_limit, **more)


SMALL = hall()
RULED = hall(rules=(ControlRule("west door", at_least=3, route="east"),))


def run(name, scenario=SMALL, scheme="nsm2", runs=3, **options):
    (candidate,) = make_candidates([name], scenario)
    return evacuate(
        lambda count: candidate.lead(scenario, scheme, count, 1),
        scenario,
        candidate.name,
        scheme,
        **{"runs": runs, "measure": True, **options},
    )


def recorded(scenario, steps=0, scheme="nsm2"):
    """Return environment and recorder of one evacuation after so many steps."""
    env, recorder = CrowdEnv(scenario, scheme=scheme), Recorder(scenario.geometry)
    env.reset([0])
    recorder.begin(env)
    for _ in range(steps):
        recorder.add(env, env.step(None))
    return env, recorder


def made_up(policy, scheme, last, *, unfinished=False):
    """Return an evaluation of runs of two people, of whom the second gets out at ``last``."""
    times = [np.array([1.0, np.nan if unfinished else time]) for time in last]
    result = run("stand-still", hall(time_limit=0.2), runs=len(last), measure=False)
    return replace(result, policy=policy, scheme=scheme, exit_times=times, time_limit=100.0)


# ------------------------------------------------------------------------------------------------------ the same draws


@pytest.mark.parametrize("scheme", ["nsm2", "hertz"])
def test_all_policies_start_from_the_same_people_in_the_same_places(scheme):
    seeds = [HELD_OUT_SEED, HELD_OUT_SEED + 1]
    reference = CrowdEnv(SMALL, num_envs=2)
    reference.reset(seeds)
    for candidate in make_candidates(NAMES, SMALL):
        led = candidate.lead(SMALL, scheme, 2, 1)
        led.reset(seeds)
        np.testing.assert_array_equal(led.env.simulation.state.position, reference.simulation.state.position)
        for ours, theirs in zip(led.env.simulation.bodies, reference.simulation.bodies, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("name", ["shortest", "fastest"])
def test_a_run_does_not_depend_on_what_was_run_beside_and_before_it(name, monkeypatch):
    many = run(name, runs=7)
    monkeypatch.setattr("agents.evaluation._PEOPLE_AT_ONCE", 2 * 14)  # two at once: environments are used again
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


@pytest.mark.parametrize("name", NAMES)
def test_all_walk_in_the_same_place(name):
    (candidate,) = make_candidates([name], RULED)
    assert bool(candidate.lead(RULED, "nsm2", 1, 1).env.ways[0].rules) == (name == "rules")


def test_the_name_of_an_exit_sends_everyone_there():
    exits = run("east").row()["exits"]
    assert exits["east"]["people"]["mean"] == 14 and exits["west"]["people"]["mean"] == 0
    assert exits["west"]["mean_exit_time"] is None and exits["west"]["last_exit"]["mean"] is None


class Balancing:
    """Send everyone to the exit by which fewer people have left since the last decision."""

    name = "balancing"

    def act(self, observation, batch, rng):
        choice = observation[:, batch.layout["flow"]].argmin(axis=1)
        return np.repeat(choice[:, None], len(batch.choices), axis=1)


@pytest.mark.parametrize("controller", [FixedSplit(2.5), RandomController(), Balancing()], ids=lambda one: one.name)
def test_a_controller_sampled_between_its_decisions_is_the_controller(controller):
    options = {"grid": (4, 1), "interval": 1.0}
    candidate = of_controller(controller, SMALL, {**options, "scenario": "hall", "scheme": "dem"})
    ours = evacuate(lambda n: candidate.lead(SMALL, "nsm2", n, 1), SMALL, "led", "nsm2", runs=3, measure=True)
    theirs = judge(controller, SMALL, runs=3, first_seed=HELD_OUT_SEED, scheme="nsm2", **options)
    for one, other in zip(ours.episodes, theirs.episodes, strict=True):  # sums of overlaps are rounded otherwise
        assert (one.evacuation_time, one.mean_exit_time) == (other.evacuation_time, other.mean_exit_time)
        assert one == pytest.approx(other, rel=1e-12, nan_ok=True)
    if isinstance(controller, FixedSplit):
        assert 0 < ours.row()["exits"]["west"]["people"]["mean"] < 14


# ------------------------------------------------------------------------------------------------- what is measured


@pytest.mark.parametrize("scheme", ["dem", "nsm1", "nsm2", "hertz"])
def test_a_lone_walker_walks_the_length_of_the_way(scheme):
    result = run("shortest", hall(starts=[(4.0, 3.0)], speed=1.5), scheme, runs=2)
    assert result.measured.walked == pytest.approx(np.full((2, 1), 4.0), abs=1e-3)
    assert result.row()["walked"]["mean"] == pytest.approx(4.0, abs=1e-3)


def test_who_stays_has_walked_nowhere_and_presses_nobody():
    result = run("stand-still", hall(time_limit=1.0))
    assert result.measured.walked == pytest.approx(np.zeros((3, 14)), abs=1e-9)
    assert result.measured.max_pressure == pytest.approx(np.zeros(3))
    assert (result.measured.exit_index == -1).all()
    assert result.measured.simulated == pytest.approx(3.0)


def test_the_greatest_density_of_people_placed_by_hand():
    # Of five, the first four have each other within 1 m; the fifth has only the fourth.
    starts = [(2.0, 3.0), (2.5, 3.0), (2.0, 3.5), (2.5, 3.5), (3.4, 3.5)]
    _, recorder = recorded(hall(starts=starts, speed=0.0), steps=3)
    assert recorder._max_density == pytest.approx([5 / np.pi])
    _, recorder = recorded(hall(starts=[*starts[:4], (3.55, 3.5)], speed=0.0))
    assert recorder._max_density == pytest.approx([4 / np.pi])


def test_people_are_counted_as_by_all_pairs():
    rng = np.random.default_rng(3)
    position, inside = rng.uniform(90.0, 95.0, (4, 30, 2)), rng.random((4, 30)) < 0.6
    inside[3] = False
    expected = []
    for place, active in zip(position, inside, strict=True):
        apart = np.hypot(*(place[active][:, None] - place[active]).transpose(2, 0, 1))
        expected.append((apart < REACH).sum(axis=1).max(initial=0))
    assert most_within(position, inside, REACH).tolist() == expected


def test_one_standing_person_is_one_person_on_the_map():
    env, recorder = recorded(hall(starts=[(3.1, 2.3)], speed=0.0), steps=4)
    recorder.end(env)
    maps = recorder.measured(0.0, 0.0).maps
    for density in (maps.density_mean, maps.density_max):
        assert density.sum() * CELL**2 == pytest.approx(1.0)
        assert density.max() == pytest.approx(1 / np.pi, rel=1e-3)
        row, column = np.nonzero(density)
        middle = np.array(recorder.grid.origin) + CELL * (np.array([column.mean(), row.mean()]) + 0.5)
        assert middle == pytest.approx([3.1, 2.3], abs=CELL / 2)
    assert not maps.pressure_max.any()


def test_even_in_a_corner_a_person_is_one_person_on_the_map():
    env, recorder = recorded(hall(starts=[(0.2, 5.8)], speed=0.0))
    recorder.end(env)
    assert recorder.measured(0.0, 0.0).maps.density_mean.sum() * CELL**2 == pytest.approx(1.0)


def test_pressure_is_force_over_circumference_where_the_person_stands():
    env, recorder = recorded(hall(starts=[(3.1, 2.3), (7.1, 4.3)], speed=0.0))
    step = env.step(None)
    env.simulation.memory.crush[:] = 50.0, 20.0  # N s in 0.1 s: 500 N and 200 N
    recorder.add(env, step)
    env.simulation.memory.crush[:] = 10.0, 0.0
    recorder.add(env, step)
    recorder.end(env)
    found = recorder.measured(0.0, 0.0)
    circumference = 2 * np.pi * 0.2
    assert found.max_pressure == pytest.approx([500.0 / circumference])
    at = {place: recorder.grid.cell_of(np.array([place]))[0] for place in ((3.1, 2.3), (7.1, 4.3), (5.0, 1.0))}
    most, mean = found.maps.pressure_max.ravel(), found.maps.pressure_mean.ravel()
    assert [most[cell] for cell in at.values()] == pytest.approx([500 / circumference, 200 / circumference, 0.0])
    # Three samples: the start, when nobody is pressed yet, and two steps.
    assert [mean[cell] for cell in at.values()] == pytest.approx([200 / circumference, 200 / 3 / circumference, 0.0])
    assert (most > 0).sum() == 2 * 5  # the cell and its neighbours


def test_a_jam_at_a_narrow_door_is_denser_there_and_presses():
    result = run("west", hall(count=40, time_limit=40.0), runs=2)
    maps, grid = result.measured.maps, result.measured.grid
    row, column = np.unravel_index(maps.density_mean.argmax(), maps.density_mean.shape)
    x, y = grid.origin[0] + CELL * column, grid.origin[1] + CELL * row
    assert 0 < x < 2 and 2 < y < 4
    assert 2 < result.measured.max_density.max() == pytest.approx(maps.density_max.max(), rel=0.2)
    assert result.measured.max_pressure.max() == pytest.approx(maps.pressure_max.max())


def test_the_figures_of_exits_add_up():
    row = run("fastest").row()
    by_exit = row["exits"]
    assert sum(found["people"]["mean"] for found in by_exit.values()) == 14
    total = sum(found["people"]["mean"] * (found["mean_exit_time"] or 0.0) for found in by_exit.values())
    assert total / 14 == pytest.approx(row["mean_exit_time"]["mean"])


def test_when_95_percent_are_out():
    times = [np.arange(1.0, 41.0), np.where(np.arange(40) < 37, np.arange(1.0, 41.0), np.nan)]
    result = Evaluation("x", "dem", [], times, 100.0)
    assert result.exit_time_95()[0] == 38.0 and np.isnan(result.exit_time_95()[1])
    assert result.times_of_all()[1, 37:].tolist() == [100.0] * 3


def test_replanning_is_counted_where_there_is_some():
    replanning, physics = (
        {name: run(name).row()[f"{key}_per_simulated_second"] for name in ("shortest", "fastest")}
        for key in ("replanning", "physics")
    )
    assert replanning["fastest"] > 20 * replanning["shortest"] and min(physics.values()) > 0


# --------------------------------------------------------------------------------------------------------- statistics


def test_paired_differences_by_hand():
    # Differences 0 and 1: of the four resamples one has the mean 0, two 0.5 and one 1.
    found = paired(np.array([3.0, 6.0]), np.array([3.0, 5.0]))
    assert found == {"mean": 0.5, "ci95": [0.0, 1.0], "faster": 0.25}
    constant = paired(np.array([3.0, 9.0, 7.0]), np.array([5.0, 11.0, 9.0]))
    assert constant == {"mean": -2.0, "ci95": [-2.0, -2.0], "faster": 1.0}


def test_the_paired_interval_is_that_of_the_t_distribution_for_many_runs():
    rng = np.random.default_rng(0)
    shared = rng.normal(30.0, 5.0, 400)  # what both policies share drops out
    one, other = shared + rng.normal(0.0, 1.0, 400), shared + rng.normal(0.5, 1.0, 400)
    difference = one - other
    half = 1.966 * difference.std(ddof=1) / np.sqrt(400)
    found = paired(one, other)
    assert found["ci95"] == pytest.approx([difference.mean() - half, difference.mean() + half], abs=0.015)
    assert found["faster"] == (difference < 0).mean()


def test_runs_that_cannot_be_paired_are_refused():
    with pytest.raises(ValueError, match="2 and 3 runs"):
        paired(np.zeros(2), np.zeros(3))


def test_who_does_not_get_out_counts_at_the_time_limit():
    result = made_up("a", "dem", [30.0, 40.0], unfinished=True)
    assert last_times(result).tolist() == [100.0, 100.0]


def test_kendalls_tau_is_that_of_scipy():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.integers(0, 4, (2, 6)).astype(float)
        expected = stats.kendalltau(a, b).statistic
        assert kendall_tau(a, b) == (None if np.isnan(expected) else pytest.approx(expected))


def test_the_order_and_what_contradicts_it():
    times = {
        "dem": {"a": [10.0, 11.0, 12.0], "b": [12.0, 13.0, 14.5], "c": [20.0, 21.0, 22.0]},
        "nsm2": {"a": [15.0, 16.0, 17.0], "b": [12.0, 13.5, 14.0], "c": [20.0, 21.0, 22.0]},
    }
    results = [made_up(name, scheme, last) for scheme, row in times.items() for name, last in row.items()]
    found = ranking(results)
    assert found["schemes"]["dem"]["order"] == ["a", "b", "c"] and found["schemes"]["nsm2"]["order"] == ["b", "a", "c"]
    assert found["schemes"]["dem"]["times"]["a"] == 11.0
    assert not found["same"] and found["tau"] == {"dem nsm2": pytest.approx(1 / 3)}
    assert found["contradictions"] == [
        {"policies": ["a", "b"], "first_faster_under": ["dem"], "second_faster_under": ["nsm2"]}
    ]
    told = "\n".join(ranking_lines(results))
    assert "a < b < c" in told and "b < a < c" in told and "not the same" in told
    assert "a is clearly faster than b under dem, clearly slower under nsm2" in told
    agreeing = ranking(results[:3])
    assert agreeing["same"] and agreeing["tau"] == {} and agreeing["contradictions"] == []


def test_an_order_that_differs_by_chance_is_no_contradiction():
    times = {"dem": {"a": [10.0, 14.0], "b": [12.0, 11.0]}, "nsm2": {"a": [10.0, 14.0], "b": [13.0, 12.0]}}
    results = [made_up(name, scheme, last) for scheme, row in times.items() for name, last in row.items()]
    found = ranking(results)
    assert not found["same"] and found["contradictions"] == []
    assert "No two schemes contradict" in ranking_lines(results)[-1]
    times["nsm2"] = {"a": [13.0, 14.0], "b": [12.0, 11.0]}  # clear under nsm2, by chance under dem
    results = [made_up(name, scheme, last) for scheme, row in times.items() for name, last in row.items()]
    assert ranking(results)["contradictions"] == []


# -------------------------------------------------------------------------------------------------------- the command


def call(capsys, *arguments):
    """Return exit code, standard output and standard error."""
    code = command.main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def small(monkeypatch):
    """Let the name "hall" stand for the small hall."""
    monkeypatch.setattr(command, "make_scenario", lambda name: SMALL if name == "hall" else make_scenario(name))


def test_one_json_object_with_a_row_for_each_policy_and_scheme(capsys, small):
    asked = ("--scenario", "hall", "--policies", "shortest", "east", "--schemes", "dem", "nsm1", "--runs", 3, "--json")
    code, out, _ = call(capsys, *asked)
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
    assert told["rows"][0]["minus_first"]["evacuation_time"] == {"mean": 0.0, "ci95": [0.0, 0.0], "faster": 0.5}
    expected = run("east", scheme="dem").column("evacuation_time") - run("shortest", scheme="dem").column(
        "evacuation_time"
    )
    assert told["rows"][1]["minus_first"]["evacuation_time"]["mean"] == pytest.approx(expected.mean())
    assert set(told["ranking"]) == {"last", "mean"}


def test_who_is_left_inside_makes_times_lower_bounds():
    results = [made_up("quick", "dem", [30.0, 31.0, 32.0]), made_up("slow", "dem", [40.0, 50.0, 60.0], unfinished=True)]
    results = [replace(result, episodes=[e._replace(unfinished=k) for e in result.episodes])
               for k, result in enumerate(results)]  # fmt: skip
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(times_table(results, "title"))
    slow = next(line for line in console.export_text().splitlines() if "slow" in line)
    # 100 s is the time limit; the first of two people was out after 1 s.
    assert " ".join(slow.split()) == "slow ≥100 +69.0 (+68.0..+70.0) 0 % ≥100 ≥50.5 +34.5 (+34.0..+35.0) 3"


def test_policies_that_do_the_same_share_a_curve():
    results = [made_up("a", "dem", [30.0]), made_up("b", "dem", [31.0]), made_up("c", "dem", [30.0])]
    assert list(_curves(results)) == ["a = c", "b"]


def test_tables_fit_into_a_hundred_columns():
    results = [run(name, scheme=scheme, runs=2) for scheme in ("nsm2", "nsm1") for name in NAMES]
    console = Console(width=100, record=True, file=io.StringIO())
    for table in (times_table(results, "title"), exits_table(results), crowding_table(results)):
        console.print(table)
    text = console.export_text()
    assert "…" not in text and "nan" not in text and "None" not in text
    assert all(text.count(name) >= 6 for name in NAMES)
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--policies", "dance"), r"unknown policy 'dance'; known: shortest.*rules.*door.*stand-still"),
        (("--policies", "shortest", "shortest"), "'shortest' is named twice"),
        (("--policies", "none.zip"), r"none\.zip is not a learned network"),
        (("--schemes", "glue"), "unknown contact scheme 'glue'; known: dem"),
        (("--scenario", "moon-v0"), "unknown scenario 'moon-v0'; known: room-v0"),
        (("--runs", "0"), "--runs is 0"),
        (("--seed", "-1"), "--seed is -1"),
        (("--threads", "0"), "--threads is 0"),
    ],
)
def test_mistakes_are_said_in_one_line(capsys, arguments, message):
    code, out, err = call(capsys, "--runs", 1, *arguments)
    assert code == 2 and out == ""
    assert re.search(message, err) and len(err.strip().splitlines()) == 1 and err.startswith("error: ")


@pytest.mark.slow
def test_the_command_as_it_is_written(tmp_path):
    words = (
        f"--scenario room-v0 --policies shortest fastest stand-still --schemes dem nsm2 --runs 2 --out {tmp_path}/out"
    )
    program = [sys.executable, "-m", "agents.evaluate", *words.split()]
    result = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "fastest" in result.stdout and "The order is" in result.stdout


# --------------------------------------------------------------------------------------------------------- the folder


def everything(folder):
    """Return what lies in a folder but times of computing."""
    told = json.loads((folder / "rows.json").read_text())
    for row in told["rows"]:
        for name in [name for name in row if "second" in name]:
            del row[name]
    return told, (folder / "runs.csv").read_text()


ASKED = ("--scenario", "hall", "--policies", "shortest", "east", "--schemes", "nsm2", "dem", "--runs", 2)


def test_the_folder_holds_rows_runs_curves_and_maps(capsys, small, tmp_path):
    code, _, _ = call(capsys, *ASKED, "--out", tmp_path / "out")
    assert code == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    maps = {f"heat-{policy}-{scheme}.png" for policy in ("shortest", "east") for scheme in ("nsm2", "dem")}
    assert names == {"rows.json", "runs.csv", "evaluation.json", "kept", "egress-nsm2.png", "egress-dem.png"} | maps
    with (tmp_path / "out/runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8 and rows[0]["seed"] == str(HELD_OUT_SEED)
    result = run("shortest", runs=2)
    assert float(rows[1]["evacuation_time"]) == pytest.approx(result.episodes[1].evacuation_time, rel=1e-5)
    assert float(rows[1]["walked"]) == pytest.approx(result.measured.walked[1].mean(), rel=1e-5)
    assert {rows[2]["out by east"], rows[2]["out by west"]} == {"14", "0"}


def test_an_interrupted_evaluation_goes_on_and_ends_as_if_it_had_not_been(capsys, small, tmp_path, monkeypatch):
    monkeypatch.setattr(EvaluationFolder, "draw", lambda *a: [])  # pictures are another matter
    assert call(capsys, *ASKED, "--out", tmp_path / "whole")[0] == 0
    real, evaluated = command._evaluate, []

    def breaks_at_the_third(candidate, scenario, scheme, *rest):
        if len(evaluated) == 2:
            raise KeyboardInterrupt
        evaluated.append((candidate.name, scheme))
        return real(candidate, scenario, scheme, *rest)

    monkeypatch.setattr(command, "_evaluate", breaks_at_the_third)
    code, _, err = call(capsys, *ASKED, "--out", tmp_path / "broken")
    assert code == 130 and "goes on" in err and not (tmp_path / "broken/rows.json").exists()
    again = []
    monkeypatch.setattr(command, "_evaluate", lambda *a: again.append((a[0].name, a[2])) or real(*a))
    assert call(capsys, *ASKED, "--out", tmp_path / "broken")[0] == 0
    assert evaluated == [("shortest", "nsm2"), ("east", "nsm2")] and again == [("shortest", "dem"), ("east", "dem")]
    assert everything(tmp_path / "broken") == everything(tmp_path / "whole")


def test_a_kept_result_is_the_result(tmp_path):
    (candidate,) = make_candidates(["fastest"], SMALL)
    result, folder = run("fastest"), EvaluationFolder(tmp_path, settings_of(SMALL, 3, 0))
    assert folder.load(candidate, "nsm2") is None
    folder.save(candidate, "nsm2", result)
    read = folder.load(candidate, "nsm2")
    assert read.row() == result.row() and repr(read.episodes) == repr(result.episodes)
    np.testing.assert_array_equal(read.measured.maps.density_mean, result.measured.maps.density_mean)
    np.testing.assert_array_equal(read.exit_times, result.exit_times)
    assert read.measured.grid == result.measured.grid and read.exit_names == result.exit_names
    assert folder.load(candidate, "dem") is None
    for path in (tmp_path / "kept").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert folder.load(candidate, "nsm2") is None


@pytest.mark.parametrize(
    ("scenario", "runs", "seed", "what"),
    [(SMALL, 4, 0, "runs"), (SMALL, 3, 1, "seed"), (hall(count=13), 3, 0, "digest"), (RULED, 3, 0, "digest")],
)
def test_a_folder_does_not_mix_what_cannot_be_compared(tmp_path, scenario, runs, seed, what):
    EvaluationFolder(tmp_path, settings_of(SMALL, 3, 0))
    EvaluationFolder(tmp_path, settings_of(hall(), 3, 0))
    with pytest.raises(ValueError, match=f"another {what} .*take another folder"):
        EvaluationFolder(tmp_path, settings_of(scenario, runs, seed))


# ------------------------------------------------------------------------------------------------------------- learned


def test_a_learned_network_is_a_policy_named_after_its_file(tmp_path):
    pytest.importorskip("stable_baselines3")
    from agents.learned import LearnedPolicy, PPOSettings, make_ppo
    from agents.learned.policy import env_options_of

    env = CrowdEnv(SMALL, autoreset=True)
    path, other = tmp_path / "quick.zip", tmp_path / "more/quick.zip"
    other.parent.mkdir()
    LearnedPolicy(make_ppo(env, PPOSettings(), seed=0), env_options_of(env)).save(path)
    other.write_bytes(path.read_bytes())
    (candidate,) = make_candidates([str(path)], SMALL)
    assert candidate.name == "quick"
    result = run(str(path), runs=2)
    assert result.policy == "quick" and result.row()["walked"]["mean"] > 0
    assert [one.name for one in make_candidates([str(path), str(other)], SMALL)] == [str(path), str(other)]
    folder = EvaluationFolder(tmp_path / "out", settings_of(SMALL, 2, 0))
    folder.save(candidate, "nsm2", result)
    assert folder.load(candidate, "nsm2") is not None
    LearnedPolicy(make_ppo(env, PPOSettings(), seed=1), env_options_of(env)).save(path)
    assert folder.load(candidate, "nsm2") is None  # another network under the same name


def test_a_learned_controller_is_a_policy_for_the_place_it_was_trained_for(tmp_path):
    pytest.importorskip("stable_baselines3")
    from agents.learned.routing import LearnedController, RoutingSettings, make_routing_ppo
    from crowd_env.routing_env import RoutingVectorEnv

    options = {"grid": (2, 1), "interval": 1.0}
    model = make_routing_ppo(RoutingVectorEnv(SMALL, num_envs=2, **options), RoutingSettings(), seed=0)
    path = tmp_path / "leader.zip"
    LearnedController(model, {"scenario": "hall", **options}).save(path)
    result = run(str(path), runs=2)
    theirs = judge(LearnedController.load(path), SMALL, runs=2, first_seed=HELD_OUT_SEED, scheme="nsm2", **options)
    assert result.policy == "leader" and result.column("mean_exit_time") == pytest.approx(theirs.mean)
    with pytest.raises(ValueError, match=r"leader\.zip was trained for hall"):
        make_candidates([str(path)], make_scenario("room-v0"))


# ------------------------------------------------------------------------------------------------------------ pictures


def test_maps_are_drawn_over_the_floor_with_the_colours_asked_for(tmp_path):
    values = np.zeros((24, 40))
    values[10, 5], values[12, 30] = 4.0, 1.0
    maps = [HeatMap(f"map {k}", values, (0.0, 0.0), CELL, "1/m2", kind, full) for k, kind, full in
            ((0, "density", None), (1, "pressure", 2.0))]  # fmt: skip
    figure = heat_figure(SMALL.geometry, maps, title="title", note="note")
    images = [axes.images[0] for axes in figure.axes if axes.images]
    assert len(images) == 2
    assert [image.get_clim() for image in images] == [(0.0, 4.0), (0.0, 2.0)]
    drawn = images[0].get_array()
    assert drawn[10, 5] == 4.0 and drawn.mask.sum() == values.size - 2
    assert images[0].get_extent() == [0.0, 10.0, 0.0, 6.0] and images[0].get_clip_path() is not None
    path = heat_maps(tmp_path / "maps.png", SMALL.geometry, maps)
    assert path.read_bytes().startswith(b"\x89PNG") and [p.name for p in tmp_path.iterdir()] == ["maps.png"]


def test_maps_refuse_what_they_cannot_draw(tmp_path):
    with pytest.raises(ValueError, match="no map"):
        heat_figure(SMALL.geometry, [])
    with pytest.raises(ValueError, match=r"must end in \.png"):
        heat_maps(tmp_path / "a.gif", SMALL.geometry, [HeatMap("", np.ones((2, 2)), (0, 0), 1.0, "", "density")])
