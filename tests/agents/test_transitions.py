"""Runs as arrays: they are what happened, whole or not at all."""

import json

import numpy as np
import pytest

from crowd_env import CrowdEnv
from crowd_env.agents import Follow, transitions
from crowd_env.agents.rules import ShortestPath
from crowd_env.agents.tasks import Task
from crowd_env.agents.transitions import RunArrays, runs_of, write_runs

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
SMALL = Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, frozen="")


def read(path):
    with np.load(path, allow_pickle=False) as file:
        facts = json.loads(str(file["facts"]))
        return facts, [RunArrays(*(file[f"{k}/{name}"] for name in RunArrays._fields)) for k in range(facts["runs"])]


def test_the_arrays_lead_through_the_same_evacuation(tmp_path):
    """Actions that are played again bring the same observations, rewards and ends."""
    path, policy = tmp_path / "runs.npz", Follow()
    assert write_runs(path, policy, SMALL, 2, seed=5) == 2
    facts, runs = read(path)
    assert facts["task"] == SMALL.identity() and facts["policy"] == "follow" and facts["seeds"] == [5, 6]
    env = CrowdEnv(SMALL.place(), **{**SMALL.arguments("nsm2"), **policy.env_options})
    assert facts["columns"] == {name: [env.layout[name].start, env.layout[name].stop] for name in env.layout.names}
    for seed, run in zip(facts["seeds"], runs, strict=True):
        observation, _ = env.reset([seed])
        for t, action in enumerate(run.action):
            np.testing.assert_array_equal(run.observation[t], observation)
            np.testing.assert_array_equal(run.mask[t], env.active)
            step = env.step(action)
            observation = step.observation
            np.testing.assert_array_equal(run.terminated[t], step.terminated)
            np.testing.assert_array_equal(run.truncated[t], step.truncated)
            np.testing.assert_allclose(run.reward[t], step.reward, rtol=1e-6)
        assert env.finished.all()
        np.testing.assert_array_equal(run.observation[-1], observation)
        ends = (run.terminated | run.truncated).sum(axis=0)
        assert (ends == 1).all() and not run.reward[~run.mask].any()


def test_the_rule_acts_neutrally():
    (_, run), *_ = runs_of(ShortestPath(), SMALL, 1)
    assert (run.action == [1.0, 0.0]).all()


def test_no_held_out_draw_is_given_away():
    with pytest.raises(ValueError, match="held out"):
        next(runs_of(ShortestPath(), SMALL, 2, seed=999_999))


def test_what_had_ended_is_kept_at_ctrl_c_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "runs.npz"

    def stops(after):
        def few(*arguments):
            for k, one in enumerate(runs_of(*arguments)):
                if k == after:
                    raise KeyboardInterrupt
                yield one

        return few

    monkeypatch.setattr(transitions, "runs_of", stops(0))
    with pytest.raises(KeyboardInterrupt):
        write_runs(path, ShortestPath(), SMALL, 3)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(transitions, "runs_of", stops(2))
    with pytest.raises(KeyboardInterrupt):
        write_runs(path, ShortestPath(), SMALL, 3)
    facts, runs = read(path)
    assert facts["seeds"] == [0, 1] and len(runs) == 2
