"""Variations of tasks: what they vary, and the command that judges policies on all of them."""

import json
import re

import numpy as np
import pytest
from cases import looped
from evaluations import call

from crowd_env.agents.tasks import PRESETS, TASKS, Task
from crowd_env.agents.tasks.variations import AS_IT_STANDS, VARIATIONS, variations

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
SMALL = Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, runs=3, frozen="")


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setitem(TASKS, "small", SMALL)


@pytest.mark.more
@looped("name", TASKS)
def test_every_variation_of_a_task_can_be_drawn_and_is_another_place(name):
    task = TASKS[name]
    asked = variations(task)
    assert asked[0] is AS_IT_STANDS and len({one.name for one in asked}) == len(asked) > 4
    assert {one.learned_share for one in asked} >= {None, 0.5} and any(one.scheme for one in asked)
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
    assert names == ["task", "twice", "slow", "half-learned", "half-hurried"]
    assert len({one["digest"] for one in told["variations"]}) == 4  # a mixed crowd walks in the place of the task
    policies = {name: [row["policy"] for row in told["rows"] if row["variation"] == name] for name in names}
    assert policies["twice"] == ["rule", "follow", "headway"] and policies["half-learned"] == ["rule", "follow"]
    assert [row["people"] for row in told["rows"]][:6] == [4, 4, 4, 8, 8, 8]
    assert {row["variation"]: row["learned_share"] for row in told["rows"]} == {
        "task": 1.0, "twice": 1.0, "slow": 1.0, "half-learned": 0.5, "half-hurried": 0.5,
    }  # fmt: skip
    code, out, _ = call("--task", "small", "--policies", "rule", "follow", "headway", "--runs", 2, "--json")
    plain = json.loads(out)["rows"]
    for row, expected in zip(told["rows"], plain, strict=False):
        assert row == {**expected, "variation": "task"}


@pytest.mark.more
def test_an_interrupted_one_goes_on_in_its_folder_and_says_what_it_left_out(small, tmp_path):
    asked = ("--task", "small", "--policies", "rule", "headway", "--robustness", "--runs", 2, "--out", tmp_path)
    code, out, _ = call(*asked)
    assert code == 0 and "half-learned: left out" in out and "headway" in out
    assert {path.name for path in tmp_path.iterdir()} >= {"task", "twice", "robustness.json"}
    first = (tmp_path / "twice/kept/rule-nsm2.npz").stat().st_mtime_ns
    assert call(*asked)[1] == out
    assert (tmp_path / "twice/kept/rule-nsm2.npz").stat().st_mtime_ns == first


@looped(
    ("arguments", "message"),
    [
        ((), "--robustness varies a task; name one by --task"),
        (("--task", "small", "--people", "5"), "--robustness says itself what it varies, --people among it"),
        (("--task", "small", "--physics", "dem"), "says itself what it varies, --physics among it"),
        (("--task", "small", "--set", "learned=0.2"), "--set learned among it"),
        (("--task", "small", "--policies", "dance"), "unknown policy 'dance'"),
        (("--task", "small", "--runs", "0"), "--runs is 0"),
    ],
)
def test_mistakes_are_said_in_one_line(small, arguments, message):
    code, out, err = call("--robustness", *arguments)
    assert code == 2 and out == ""
    assert re.search(message, err) and len(err.strip().splitlines()) == 1 and err.startswith("error: ")
