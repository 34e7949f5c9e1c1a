"""Gymnasium: the native batch, its own batches, and its wrappers around them."""

import subprocess
import sys

import numpy as np
import pytest
from client_examples import FOLDER, client_example
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

from crowd_env import CrowdEnv, make_vec

example = client_example("gymnasium")
NATIVE, SYNC = example.Batch.native, example.Batch.sync


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setitem(example.ROOM, "people", 6)


@pytest.mark.more
@pytest.mark.parametrize("patient", [False, True])
def test_all_batches_tell_the_same_of_the_same_seeds(small, patient):
    episodes = [example.first_episodes(example.make_rooms(batch, 3), patient, seed=5) for batch in (NATIVE, SYNC)]
    assert episodes[0] == episodes[1]
    other = example.first_episodes(example.make_rooms(NATIVE, 3), patient, seed=50)
    assert other != episodes[0]


def test_returns_and_lengths_are_those_of_the_crowd(small):
    """`RecordEpisodeStatistics` counts what an own sum over the arrays counts, in each room until it has ended."""
    rooms = 3
    told = example.first_episodes(example.make_rooms(NATIVE, rooms), True, seed=5)
    env = CrowdEnv(num_envs=rooms, **example.ROOM)
    observation, _ = env.reset(seed=[5, 6, 7])
    earned, steps = np.zeros(rooms), np.zeros(rooms, int)
    while not env.finished.all():
        goes_on = ~env.finished
        action = example.speeds(observation.reshape(rooms, 6, -1), True)
        step = env.step(action.reshape(-1, 2))
        observation = step.observation
        earned += step.reward.reshape(rooms, 6).mean(axis=1)
        steps += goes_on
    assert [one["steps"] for one in told] == steps.tolist()
    np.testing.assert_allclose([one["return"] for one in told], earned, rtol=1e-5)
    assert [one["evacuation_time"] for one in told] == [env.metrics(e).evacuation_time for e in range(rooms)]
    assert [one["unfinished"] for one in told] == [0, 0, 0]


def test_one_seed_draws_the_same_first_room_and_others_after_it(small):
    native, others = (example.make_rooms(batch, 3).reset(seed=5)[0] for batch in (NATIVE, SYNC))
    same = [np.array_equal(native[e], others[e]) for e in range(3)]
    assert same == [True, False, False]


@pytest.mark.more
def test_who_waits_for_a_turn_is_not_stuck():
    stuck = [
        sum(one["unfinished"] for one in example.first_episodes(example.make_rooms(NATIVE, 8), patient, seed=0))
        for patient in (False, True)
    ]
    assert stuck[0] > 0 == stuck[1]


@pytest.mark.parametrize("wrapper", ["NormalizeObservation", "FlattenObservation"])
def test_wrappers_of_observations_want_another_way_of_restarting(wrapper):
    same_step = make_vec("room-v0", 2, people=4)
    assert same_step.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    with pytest.raises(ValueError, match="NEXT_STEP or DISABLED"):
        getattr(wrappers, wrapper)(same_step)


@pytest.mark.nightly  # two processes load the compiled kernels
def test_processes_of_their_own_tell_the_same():
    told = [
        subprocess.run(
            [sys.executable, FOLDER / "gymnasium_vector.py", "--batch", batch, "--rooms", "2"],
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for batch in ("native", "async")
    ]
    assert told[0] == told[1] and "wait for a turn" in told[0]
