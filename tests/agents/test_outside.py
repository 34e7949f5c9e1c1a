"""Tasks for learners of other libraries: their rooms, and figures of any function of observations."""

from crowd_env.agents import load
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.outside import Outside, judge_outside, line_of
from crowd_env.agents.tasks import TASKS


def test_a_function_of_observations_is_judged_as_its_policy_is():
    found = load("literal-room/ppo")
    assert found.env_options["observation"] == Outside("x", "literal-room", len).env_options["observation"]
    outside = Outside("mine", "literal-room", lambda seen: found.network(seen).argmax(axis=1))
    row, task = judge_outside(outside, runs=2), TASKS["literal-room"]
    same = evaluate(found, task.place(), runs=2, **task.arguments())
    assert row["median_time"] == same.row()["median_time"] and row["policy"] == "mine"
    assert line_of(row).startswith("mine: left inside in")
