"""Whether a result can be believed: bodies that pass through each other, runners, leaks and impossible flows are caught."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import call, hall, run

from crowd_env import Uniform, make_scheme
from crowd_env.agents import POLICIES
from crowd_env.agents.evaluation import credible
from crowd_env.agents.evaluation.protocol import credible_lines, task_rows
from crowd_env.agents.rules import ShortestPath
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.agents.tasks.lower_bounds import exit_widths, touching_flow

ROOM = {"scenario": "room-v0", "options": {"side": 5.0, "door_width": 0.8}, "people": 20, "scheme": "dem", "dt": 0.01}
SMALL = Task("small", "a door", **ROOM, time_limit=30.0, blocked_after=20.0, runs=4, frozen="")


def credibility(result, results, place):
    return credible.credibility(result.row(), [one.row() for one in results], place)


class Ghosts(ShortestPath):
    """Bodies so soft that they pass through each other: a hole in the physics, named as if it were a policy."""

    name = "ghosts"

    def __init__(self):
        self.env_options = {"scheme": make_scheme({"name": "dem", "stiffness": 600.0})}


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setitem(TASKS, "small", SMALL)
    monkeypatch.setitem(POLICIES, "ghosts", Ghosts)


def test_bodies_that_pass_through_each_other_are_caught(small):
    code, out, _ = call("--task", "small", "--policies", "rule", "follow", "ghosts", "--json")
    assert code == 0
    rows = {row["policy"]: row for row in json.loads(out)["rows"]}
    assert rows["ghosts"]["clearing_time"]["mean"] < rows["rule"]["clearing_time"]["mean"]  # it would have won
    assert rows["rule"]["credible"] == rows["follow"]["credible"] == {"ok": True, "reasons": []}
    verdict = rows["ghosts"]["credible"]
    assert verdict["ok"] is False and any("deepest overlap" in reason for reason in verdict["reasons"])


@pytest.mark.more
def test_a_table_says_who_is_not_credible(small):
    _, out, _ = call("--task", "small", "--policies", "rule", "follow", "ghosts")
    text = " ".join(out.split())
    assert "Credible, held against the rule: rule, follow." in text and "NOT CREDIBLE: ghosts: the deepest" in text


def test_without_the_rule_nothing_is_held_against_it(small):
    code, out, _ = call("--task", "small", "--policies", "follow", "--runs", 2, "--json")
    (row,) = json.loads(out)["rows"]
    assert code == 0 and row["credible"]["ok"] is None and "add rule" in row["credible"]["reasons"][0]


@pytest.fixture(scope="module")
def crowd():
    """Return the place, what the rule does there, and a function that changes its figures."""
    place = hall()
    rule = replace(run("west", place, runs=4), policy="rule")

    def other(*, hurry=None, **figures):
        episodes = [one._replace(**figures) for one in rule.episodes]
        measured = rule.measured if hurry is None else rule.measured._replace(hurry=np.full(4, hurry))
        return replace(rule, policy="other", episodes=episodes, measured=measured)

    return place, rule, other


@looped(
    ("figures", "reason"),
    [
        ({"escaped": 1}, "4 people were outside of the walls"),
        ({"max_speed": 9.0}, "the largest speed is 9 m/s, more than"),
        ({"hurry": 1.3}, "someone's mean speed over the desired is 1.3, more than"),
        ({"max_overlap": 0.3}, "the deepest overlap is 300 mm, more than"),
        (
            {"flow": 12.0},
            "the flow is 12 /s, more than 9.24 /s: a tenth more than the largest recorded through 3 m of exits",
        ),
    ],
)
def test_each_figure_is_held_against_its_bound(crowd, figures, reason):
    place, rule, other = crowd
    assert credibility(other(), [rule, other()], place) == {"ok": True, "reasons": []}
    verdict = credibility(other(**figures), [rule, other()], place)
    assert verdict["ok"] is False and len(verdict["reasons"]) == 1 and reason in verdict["reasons"][0]


def test_who_escapes_is_told_without_the_rule(crowd):
    place, _, other = crowd
    assert credibility(other(escaped=2), [other()], place)["ok"] is False


def test_a_rule_that_gets_stuck_bounds_no_flow(crowd):
    place, rule, other = crowd
    wide = touching_flow(place)
    assert wide > 2.8 * exit_widths(place).sum()
    stuck = replace(rule, episodes=[one._replace(unfinished=3) for one in rule.episodes])
    flow = other(flow=0.9 * wide)
    assert credibility(flow, [stuck, flow], place)["ok"] and not credibility(flow, [rule, flow], place)["ok"]
    faster = other(flow=1.2 * wide)
    (reason,) = credibility(faster, [stuck, faster], place)["reasons"]
    assert "touching, at full speed (the rule gets stuck)" in reason


def test_only_the_rule_under_the_same_scheme_counts(crowd):
    place, rule, other = crowd
    elsewhere = replace(rule, scheme="dem")
    assert credibility(other(), [elsewhere, other()], place)["ok"] is None
    assert "add rule: other under nsm2" in credible_lines(task_rows(SMALL, place, [elsewhere, other()]))[1]


def test_people_one_behind_the_other():
    place = hall(speed=1.5)  # exits of 1 m and 2 m, bodies of 0.4 m: two and five abreast
    assert exit_widths(place).tolist() == [1.0, 2.0]
    assert touching_flow(place) == pytest.approx(7 * 1.5 / 0.4)
    fat = replace(place, population=place.population.changed(radius=Uniform(0.3, 0.3)))
    assert touching_flow(fat) == pytest.approx((1 + 3) * 1.5 / 0.6)
    assert touching_flow(TASKS["competitive-door"].place()) == pytest.approx(2.0 / 0.6, rel=0.01)
