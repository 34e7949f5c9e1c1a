"""Tasks for learners of other libraries: their rooms, and figures of any function of observations."""

import numpy as np
import pytest
from cases import looped

from crowd_env import CrowdEnv, parallel_env
from crowd_env.agents import load
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.outside import Outside, judge_outside, line_of, training_options
from crowd_env.agents.tasks import PRESETS, TASKS
from crowd_env.agents.training_config import make_env, task_config


@looped("task", ["room", "counter-flow"])
def test_the_room_is_the_one_that_presets_train_in(task):
    ours = make_env(task_config(task, start="rule"), envs=1)
    env = CrowdEnv(**training_options(task), autoreset=True)
    assert (env.layout, env.action_kind.name, env.reward_weights) == (
        ours.layout,
        ours.action_kind.name,
        ours.reward_weights,
    )
    seen, there = env.reset([3])[0], ours.reset([3])[0]
    np.testing.assert_array_equal(seen, there)
    for _ in range(5):
        one, other = env.step(None), ours.step(None)
        np.testing.assert_array_equal(one.observation, other.observation)
        np.testing.assert_array_equal(one.reward, other.reward)
    assert parallel_env(**training_options(task)).possible_agents == [f"pedestrian_{k}" for k in range(env.num_people)]


def test_a_function_of_observations_is_judged_as_its_policy_is():
    found = load("literal-room/ppo")
    assert found.env_options["observation"] == Outside("x", "literal-room", len).env_options["observation"]
    outside = Outside("mine", "literal-room", lambda seen: found.network(seen).argmax(axis=1))
    row, task = judge_outside(outside, runs=2), TASKS["literal-room"]
    same = evaluate(found, task.place(), runs=2, **task.arguments())
    assert row["median_time"] == same.row()["median_time"] and row["policy"] == "mine"
    assert line_of(row).startswith("mine: left inside in")


def test_tasks_without_a_room_to_train_in_are_named():
    with pytest.raises(ValueError, match="task with a training preset"):
        training_options("theatre")
    assert "theatre" not in PRESETS
