"""Which environments a reset begins, and that all others stand still and earn nothing."""

import copy
import pickle

import numpy as np
import pytest

from crowd_env import CrowdEnv


def test_environments_that_were_never_reset_are_not_simulated_and_pay_and_end_nothing():
    env = CrowdEnv("room-v0", num_envs=3, physics="dem", autoreset=True, time_limit=6.0)
    observation, _ = env.reset([1, 2, 3], mask=[False, True, False])
    others = np.ones(60, dtype=bool)
    others[env.people(1)] = False
    before = env.simulation.state.copy()
    assert not observation[others].any()
    for _ in range(70):
        step = env.step(None)
        assert not step.reward[others].any()
        assert not step.observation[others].any()
        assert not (step.terminated | step.truncated)[others].any()
        assert not any(values[others].any() for name, values in step.info.items() if name.startswith("reward/"))
        assert not step.info["finished"][[0, 2]].any()
    assert env.finished.tolist() == [True, False, True]
    assert not env.active[others].any()
    np.testing.assert_array_equal(env.simulation.state.position[others], before.position[others])
    assert env.simulation.state.time[[0, 2]].tolist() == [0.0, 0.0]


def test_an_environment_reset_later_is_what_it_would_have_been_at_first():
    late, fresh = (CrowdEnv("room-v0", num_envs=2, physics="dem") for _ in range(2))
    late.reset([1, 2], mask=[True, False])
    for _ in range(5):
        late.step(None)
    late.reset([1, 2], mask=[False, True])
    fresh.reset([1, 2])
    people = fresh.people(1)
    for _ in range(5):
        np.testing.assert_array_equal(late.step(None).observation[people], fresh.step(None).observation[people])


def test_nobody_is_inside_before_the_first_reset():
    env = CrowdEnv("room-v0", num_envs=2)
    assert env.finished.all()
    assert not env.active.any()
    env.reset([1, 2])
    assert env.active.all()
    assert not env.finished.any()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_of_an_environment_that_has_not_begun_draw_crowds_of_their_own(copied):
    """Wrappers that copy one environment many times, as SuperSuit's do, would otherwise step the same room many times over."""
    env = CrowdEnv(people=4)
    one, other = (each.reset()[0] for each in (env, copied(env)))
    assert not np.array_equal(one, other)
    again, same = (each.reset()[0] for each in (env, copied(env)))  # once begun, a copy goes on as the environment does
    np.testing.assert_array_equal(again, same)
