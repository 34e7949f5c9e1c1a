"""Tasks: what is frozen, and what the command says of policies on them."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import call, made_up, random_network, random_policy, run
from rich.console import Console

from crowd_env import CrowdEnv, Uniform, make_scenario, make_scheme
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.evaluation.protocol import task_rows
from crowd_env.agents.evaluation.report import task_table
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.agents.tasks import probe as probing
from crowd_env.agents.tasks.probe import probe
from crowd_env.agents.trained import LearnedController
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.settings import physics_step
from crowd_env.envs.tasks import task as module
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics.settings import Physics

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
SMALL = Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, runs=3, frozen="")
KEYS = ["task", "policy", "scheme", "people", "runs", "blocked", "unfinished"]
KEYS += ["median_time", "clearing_time", "mean_exit", "flow", "max_speed", "escaped"]
CHEAP = ("room", "hertz-room", "literal-room")  # one for each contact law of the tasks


@pytest.fixture
def small_task(monkeypatch):
    """Let the name "small" stand for the small task."""
    monkeypatch.setitem(TASKS, "small", SMALL)


# --------------------------------------------------------------------------------------------------------- what is frozen


@looped("name", TASKS)
def test_a_task_is_what_it_was_when_it_was_frozen(name):
    task = TASKS[name]
    assert task.digest() == task.frozen, (
        f"the task {name} has changed: a default of the package is another now, or the task itself.  Write the old value into "
        "the task; if it must change, raise its version and freeze the new digest.  If no evacuation of it changes (a field "
        "was added whose default does nothing), freeze the new digest alone."
    )
    assert task.digest_learned() == task.frozen_learned, (
        f"{name}: what learners see, do or are paid for; raise its version"
    )


@looped("name", sorted(TASKS, key=lambda name: name not in CHEAP), quick=len(CHEAP))
def test_a_task_does_what_it_did_when_it_was_frozen(name):
    task = TASKS[name]
    assert probe(task) == pytest.approx(task.probe, rel=1e-5), (
        f"physics, ways or observation do something else in the task {name} than when it was frozen.  If that is meant, raise "
        "its version, freeze it anew (crowd-env freeze), and judge everything again.  If a term of the "
        "observation was added that nobody reads, freeze it anew alone."
    )


@pytest.fixture
def probed():
    """Return what the small task does: four numbers."""
    return probe(SMALL)


def test_a_probe_is_always_the_same_and_another_where_physics_ways_or_observation_are(probed, monkeypatch):
    assert len(probed) == 4 and probe(SMALL) == probed
    stiff = replace(SMALL, scheme="hertz", dt=0.005)
    assert probe(stiff)[:1] == probed[:1] and probe(stiff)[1:] != probed[1:]
    with monkeypatch.context() as patch:  # the same forces, seen otherwise
        patch.setattr(CrowdEnv, "step", lambda self, action, step=CrowdEnv.step: _dimmer(step(self, action)))
        dim = probe(SMALL)
    assert dim[:2] == probed[:2] and dim[2] != pytest.approx(probed[2], rel=1e-5) and dim[3] < probed[3]
    with monkeypatch.context() as patch:  # the same people, a little elsewhere at the start
        reset = CrowdEnv.reset
        patch.setattr(CrowdEnv, "reset", lambda self, seed: reset(self, [one + 1 for one in seed]))
        assert probe(SMALL)[0] != pytest.approx(probed[0], rel=1e-5)
    assert probe(replace(SMALL, decides="routing")) == probed[:2]


def _dimmer(step):
    """Return a step of which everything is seen a little less."""
    return step._replace(observation=0.999 * step.observation)


def test_freezing_writes_digests_and_probes_and_nothing_else(monkeypatch, tmp_path):
    text = module.FILE.read_text(encoding="utf-8")
    file = tmp_path / "tasks.toml"
    file.write_text(re.sub(r"probe = .*\n", "", text, count=3).replace('frozen = "', 'frozen = "0', 5))
    monkeypatch.setattr(probing, "FILE", file)
    monkeypatch.setattr(probing, "probe", lambda task: task.probe)
    probing.freeze()
    assert file.read_text() == text


@looped("name", TASKS)
def test_a_task_says_what_the_package_would_say(name):
    task = TASKS[name]
    assert task.name == name and task.version >= 1 and task.seeds.start >= HELD_OUT_SEED
    place = task.place()
    assert task.dt == physics_step(Physics(task.scheme), place, within=task.decision_dt)
    assert place.population.people == task.people and place.time_limit == task.time_limit
    assert place.blocked_after == task.blocked_after < task.time_limit
    assert [entry.name for entry in make_entries(["rule"], place, task)] == ["rule"]


@looped(
    "change",
    [
        {"options": {"side": 4.0, "door_width": 1.25}},
        {"people": 5},
        {"scheme": "dem"},
        {"dt": 0.005},
        {"time_limit": 30.0},
        {"blocked_after": 6.0},
        {"manner": "calm"},
        {"rule": "fastest"},
        {"decision_dt": 0.2},
        {"runs": 4},
    ],
    ids=lambda change: next(iter(change)),
)
def test_whatever_makes_another_task_changes_the_digest(change):
    assert replace(SMALL, **change).digest() != SMALL.digest()
    assert replace(SMALL, about="other words").digest() == SMALL.digest()


def test_a_change_of_a_default_of_the_package_changes_the_digest(monkeypatch):
    before = SMALL.digest()
    wide = replace(make_scenario("room-v0").population, radius=Uniform(0.2, 0.26))

    def other(name, **options):
        return make_scenario(name, **{"population": wide, **options})

    monkeypatch.setattr(module, "make_scenario", other)
    assert SMALL.digest() != before


def test_more_people_have_as_much_time_each_and_keep_their_cohorts():
    task = TASKS["counter-flow"]
    twice, half = task.place(2 * task.people), task.place(task.people // 2 + 1)
    assert (twice.time_limit, half.time_limit) == (2 * task.time_limit, task.time_limit)
    assert [part.people for part in twice.population.parts] == [30, 30]
    assert [part.people for part in half.population.parts] == [8, 8]


def test_everyone_walks_along_the_ways_of_the_rule_and_decides_as_often_as_the_task_says():
    task = replace(TASKS["two-exit-hall"], decision_dt=0.2, dt=0.005)
    place = task.place(6)
    strategies = {}
    for name in ("rule", "fastest", "follow", "shortest"):
        (entry,) = make_entries([name], place, task)
        env = entry.driver(place, physics="nsm2")(1).env
        assert (env.decision_dt, env.simulation.dt) == (0.2, 0.005)
        strategies[name] = env.routing.strategy
        other = entry.driver(place, physics="hertz")(1).env
        assert other.simulation.dt == make_scheme("hertz").info.default_dt
    assert strategies == {"rule": "fastest", "fastest": "fastest", "follow": "fastest", "shortest": "shortest"}


@pytest.mark.more
def test_learned_networks_walk_and_route_under_the_steps_of_a_task(tmp_path):
    task = replace(TASKS["two-exit-hall"], dt=0.005, decision_dt=0.2)
    place, options = task.place(6), {"grid": (2, 1), "interval": 1.0}
    random_policy(0).save(tmp_path / "walk.safetensors")
    batch = RoutingBatch(place, **options)
    network = random_network(batch.layout.size, int(batch.choices.sum()))
    LearnedController(network, batch.choices, {"scenario": task.scenario, **options}).save(
        tmp_path / "lead.safetensors"
    )
    for name, decision_dt in (("walk", 0.2), ("lead", 0.1)):  # a controller has an interval of its own
        (entry,) = make_entries([str(tmp_path / f"{name}.safetensors")], place, task)
        env = entry.driver(place, physics="nsm2")(1).env
        assert (entry.name, env.simulation.dt, env.decision_dt) == (name, 0.005, decision_dt)


# ---------------------------------------------------------------------------------------------------------- the protocol


def test_runs_are_counted_and_no_time_limit_counts_as_a_time():
    quick = made_up("quick", "dem", [30.0, 31.0, 32.0])
    stuck = made_up("stuck", "dem", [40.0, 50.0, 60.0], unfinished=True)
    stuck = replace(
        stuck, episodes=[stuck.episodes[0], *(one._replace(blocked_since=9.0) for one in stuck.episodes[1:])]
    )
    place = SMALL.place()
    rows = task_rows(SMALL, place, [quick, stuck])
    assert [(row["blocked"], row["unfinished"], row["left"]) for row in rows] == [(0, 0, 0), (2, 3, 3)]
    assert [row["mean_exit"]["mean"] for row in rows] == [pytest.approx(16.0), None]
    assert [row["median_time"] for row in rows] == [31.0, None]
    assert rows[1]["blocked_share"]["ci95"] == pytest.approx([0.2077, 0.9385], abs=1e-4)


def test_a_task_is_a_named_set_of_options(small_task):
    """The command on a task gives what the evaluation of its scenario gives: the same draws and the same figures."""
    code, out, _ = call("--task", "small", "--policies", "rule", "follow", "random", "--json")
    assert code == 0
    told = json.loads(out)
    assert told["task"] == {"name": "small", "version": 1, "digest": SMALL.digest()}
    assert [row["policy"] for row in told["rows"]] == ["rule", "follow", "random"]
    for row in told["rows"]:
        assert list(row)[: len(KEYS)] == KEYS
        assert (row["task"], row["scheme"], row["people"], row["runs"]) == ("small", "nsm2", 4, 3)
        for name in ("blocked", "unfinished"):
            low, high = row[f"{name}_share"]["ci95"]
            assert row[f"{name}_share"]["mean"] == row[name] / 3 and low <= row[name] / 3 <= high and high - low > 0.5
        assert {"contact_impulse", "max_pressure", "crushed_share", "crushed_time", "pressure_is_force"} <= set(row)
        assert set(row["clearing_time"]) == set(row["mean_exit"]) == {"mean", "ci95"}
    for row, name in zip(told["rows"], ("shortest", "follow", "random"), strict=True):
        expected = run(name, SMALL.place(), runs=3)
        assert row["clearing_time"]["mean"] == expected.row()["evacuation_time"]["mean"]
        assert row["unfinished"] == (expected.column("unfinished") > 0).sum()
        assert row["blocked"] == np.isfinite(expected.column("blocked_since")).sum()
        assert row["flow"] == expected.row()["flow"]["mean"]
    assert told["rows"][0]["clearing_time"]["mean"] < 10.0 and told["rows"][0]["blocked"] == 0


def test_people_runs_and_scheme_of_a_task_can_be_others(small_task):
    code, out, _ = call("--task", "small", "--people", 6, "--runs", 1, "--scheme", "dem", "--json")
    assert code == 0
    told = json.loads(out)
    (row,) = told["rows"]
    assert (row["policy"], row["people"], row["runs"], row["scheme"]) == ("rule", 6, 1, "dem")
    assert row["clearing_time"]["ci95"] == [None, None] and told["time_limit"] == 30.0


def test_another_number_of_people_needs_no_task():
    code, out, _ = call("--scenario", "room-v0", "--people", 3, "--runs", 1, "--policies", "shortest", "--json")
    assert code == 0 and json.loads(out)["people"] == 3


def test_the_table_fits_into_a_hundred_columns(small_task):
    code, out, _ = call("--task", "small", "--policies", "rule", "follow", "--runs", 2)
    assert code == 0 and "small, version 1: room-v0: 4 people, 2 runs each" in out and "0 of 2" in out
    console = Console(width=100, record=True)
    hundreds = made_up("rule-best-speed", "hertz-literal", [986.4, 512.9], unfinished=False)
    console.print(task_table({"": [hundreds]}, "title"))
    assert "…" not in console.export_text()


def test_a_folder_holds_one_task_of_one_version(tmp_path):
    place = SMALL.place()
    EvaluationFolder(tmp_path, settings_of(place, 3, 0, SMALL)).keep("anything", {"figure": 1.0})
    EvaluationFolder(tmp_path, settings_of(place, 3, 0, SMALL))
    for other in (replace(SMALL, version=2), replace(SMALL, dt=0.005), None):
        with pytest.raises(ValueError, match="holds results of another command"):
            EvaluationFolder(tmp_path, settings_of(place, 3, 0, other))


@looped(
    ("arguments", "message"),
    [
        (("--task", "moon"), r"unknown task 'moon'; known: competitive-door"),
        (
            ("--task", "small", "--policies", "evolve"),
            r"unknown policy 'evolve'; known: rule, .*zipper, .*or the path of",
        ),
        (("--policies", "rule"), "'rule' is the strategy of a task; give --task"),
        (("--task", "small", "--people", "2000"), "task small cannot have 2000 people: 2000 people do not fit"),
        (("--task", "theatre", "--people", "102"), "task theatre cannot have 102 people: "),
        (("--task", "small", "--runs", "0"), "--runs is 0"),
    ],
)
def test_mistakes_are_said_in_one_line(small_task, arguments, message):
    code, out, err = call(*arguments)
    assert code == 2 and out == ""
    assert re.search(message, err) and len(err.strip().splitlines()) == 1 and err.startswith("error: ")
