"""Variations of tasks: what they vary, and the command that judges policies on all of them."""

import json
import re

import numpy as np
import pytest
from cases import looped
from evaluations import call, random_network

from crowd_env.agents.evaluation.robustness import make_trials
from crowd_env.agents.tasks import PRESETS, TASKS, Task
from crowd_env.agents.tasks.variations import AS_IT_STANDS, VARIATIONS, variations
from crowd_env.agents.trained import LearnedController
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.routing.batch import RoutingBatch

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
ALWAYS = ["slow", "unfollowing", "turned", "mirrored", "noise", "delay"]
SMALL = Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, runs=3, frozen="")


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setitem(TASKS, "small", SMALL)


@pytest.mark.more
@looped("name", TASKS)
def test_every_variation_of_a_task_can_be_drawn_and_is_another_place(name):
    task = TASKS[name]
    asked = variations(task)
    assert asked[0] is AS_IT_STANDS and len({one.name for one in asked}) == len(asked)
    assert (
        len(asked) in range(9, 12)
        and {one.learned_share for one in asked} >= {None, 0.7}
        and any(one.scheme for one in asked)
    )
    for one in asked:
        place = one.place(task)
        assert place.population.people == round(one.people * task.people)
        assert one.scheme != task.scheme
        if one.options and name in PRESETS:
            trained = {**task.options, **PRESETS[name].options}
            assert any(trained[key] != value for key, value in one.options.items())
    people = [one.place(task) for one in asked if one.people > 1.0 and task.people < 200]
    for place in people:
        bodies, _ = place.population.draw(np.random.default_rng(0), place.geometry)
        assert len(bodies.radius) == place.population.people


@pytest.mark.more
@looped("name", TASKS)
def test_people_of_every_task_start_and_get_out_where_it_is_turned_and_mirrored(name):
    """A few of them, by the shortest way, about as late as in the place as it stands: they start elsewhere."""
    task = TASKS[name]
    place, options = task.place(4), {**task.arguments(), "routing": "shortest"}
    times = []
    for angle, mirrored in ((0.0, False), (2.4, False), (0.0, True)):
        found = run_episodes(place.turned(angle, mirrored), 4, **options)
        assert not any(one.metrics.unfinished or one.metrics.escaped for one in found), (angle, mirrored)
        times.append(np.mean([one.metrics.mean_exit_time for one in found]))
    np.testing.assert_allclose(times[1:], times[0], rtol=0.35)


def test_variations_change_no_task():
    assert set(VARIATIONS) == set(TASKS)
    slow = next(one for one in VARIATIONS["narrow-door"] if one.name == "slow").place(TASKS["narrow-door"])
    assert (
        slow.population.desired_speed.high == 1.5 and TASKS["narrow-door"].place().population.desired_speed.high == 2.0
    )
    assert TASKS["narrow-door"].digest() == TASKS["narrow-door"].frozen


@pytest.mark.more
def test_rows_carry_the_variation_and_the_first_are_those_of_the_task(small):
    code, out, _ = call(
        "--task", "small", "--policies", "rule", "follow", "headway", "--robustness", "--runs", 2, "--json"
    )
    assert code == 0
    told = json.loads(out)
    names = [one["variation"] for one in told["variations"]]
    assert names == ["task", "twice", *ALWAYS]
    assert (
        len({one["digest"] for one in told["variations"]}) == 5
    )  # a mixed or hindered crowd walks in the place of the task
    policies = {name: [row["policy"] for row in told["rows"] if row["variation"] == name] for name in names}
    assert policies["twice"] == ["rule", "follow", "headway"] and policies["unfollowing"] == ["rule", "follow"]
    assert [row["people"] for row in told["rows"]][:6] == [4, 4, 4, 8, 8, 8]
    assert {row["variation"]: row["learned_share"] for row in told["rows"]} == {
        **dict.fromkeys(["task", "twice", *ALWAYS], 1.0), "unfollowing": 0.75,
    }  # fmt: skip
    code, out, _ = call("--task", "small", "--policies", "rule", "follow", "headway", "--runs", 2, "--json")
    plain = json.loads(out)["rows"]
    for row, expected in zip(told["rows"], plain, strict=False):
        assert row == {**expected, "variation": "task"}
    clearing = {(row["variation"], row["policy"]): row["mean_exit"]["mean"] for row in told["rows"]}
    for name in ("noise", "delay"):  # the rule of the environment is not hindered
        assert clearing[name, "rule"] == clearing["task", "rule"]
        assert clearing[name, "follow"] != clearing["task", "follow"]


@pytest.mark.more
def test_an_interrupted_one_goes_on_in_its_folder_and_says_what_it_left_out(small, tmp_path):
    asked = ("--task", "small", "--policies", "rule", "headway", "--robustness", "--runs", 2, "--out", tmp_path)
    code, out, _ = call(*asked)
    assert code == 0 and "unfollowing: left out" in out and "headway" in out
    assert {path.name for path in tmp_path.iterdir()} >= {"task", "twice", "robustness.json"}
    first = (tmp_path / "twice/kept/rule-nsm2.npz").stat().st_mtime_ns
    assert call(*asked)[1] == out
    assert (tmp_path / "twice/kept/rule-nsm2.npz").stat().st_mtime_ns == first


@pytest.mark.more
def test_a_controller_is_left_out_where_its_regions_are_others(tmp_path):
    task, path, options = TASKS["two-exit-hall"], str(tmp_path / "lead.safetensors"), {"grid": (6, 6)}
    batch = RoutingBatch(task.place(), **options)
    network = random_network(batch.layout.size, int(batch.choices.sum()))
    LearnedController(network, batch.choices, {"scenario": task.scenario, **options}).save(path)
    left_out = {one.variation.name: one.left_out for one in make_trials(task, ["rule", path])}
    assert left_out["turned"] == left_out["unfollowing"] == [path]
    assert not left_out["task"] and not left_out["mirrored"]
    with pytest.raises(ValueError, match="was trained for"):
        make_trials(TASKS["room"], [path])


@looped(
    ("arguments", "message"),
    [
        ((), "--robustness varies a task; name one by --task"),
        (("--task", "small", "--people", "5"), "--robustness says itself what it varies, --people among it"),
        (("--task", "small", "--scheme", "dem"), "says itself what it varies, --scheme among it"),
        (("--task", "small", "--set", "learned=0.2"), "--set learned among it"),
        (("--task", "small", "--policies", "dance"), "unknown policy 'dance'"),
        (("--task", "small", "--runs", "0"), "--runs is 0"),
    ],
)
def test_mistakes_are_said_in_one_line(small, arguments, message):
    code, out, err = call("--robustness", *arguments)
    assert code == 2 and out == ""
    assert re.search(message, err) and len(err.strip().splitlines()) == 1 and err.startswith("error: ")
