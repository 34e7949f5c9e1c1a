"""Seams of the interfaces: seeds over places, frames a second, limits in steps, seeds that leave some out."""

import gymnasium
import numpy as np
import pytest

from crowd_env import CrowdEnv, make_scenario, make_vec, parallel_env
from crowd_env.envs.footbridge.env import FootbridgeEnv
from crowd_env.envs.parallel import env as aec

PLACE = {"name": "generated-v0", "seed": 1, "people": 12}


@pytest.mark.parametrize("kind", ["parallel", "aec", "gymnasium"])
def test_one_seed_fixes_a_series_that_changes_place(kind):
    seen = []
    for _ in range(2):
        if kind == "gymnasium":
            env = gymnasium.make("crowd_env/room-v0", people=12, physics="dem").unwrapped
        elif kind == "parallel":
            env = parallel_env("room-v0", people=12, physics="dem")
        else:
            env = aec("room-v0", people=12, physics="dem")
        env.reset(seed=5)
        env.reset(options={"scenario": PLACE})
        env.reset()
        inner = env.env if kind != "aec" else env.unwrapped.env
        inner = inner if isinstance(inner, CrowdEnv) else inner.env
        seen.append(inner.simulation.state.position.copy())
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize(("dt", "rate"), [(0.1, 10), (0.5, 2), (2.0, 0.5), (0.3, 1 / 0.3)])
def test_films_run_in_real_time_whatever_the_decision_step(dt, rate):
    for env in (
        parallel_env("room-v0", people=2, decision_dt=dt),
        gymnasium.make("crowd_env/room-v0", people=2, decision_dt=dt),
        gymnasium.make("crowd_env/routing-v0", people=4, interval=dt),
    ):
        assert env.metadata["render_fps"] == pytest.approx(rate) and env.metadata["render_fps"] > 0


@pytest.mark.parametrize("limit", [0.04, 0.21, 0.24, 0.25, 0.3, 1.23])
def test_max_cycles_is_the_number_of_decisions_until_the_limit(limit):
    env = parallel_env({"name": "room-v0", "side": 20.0}, people=2, physics="dem", time_limit=limit)
    env.reset(seed=0)
    cycles = 0
    while env.agents:
        env.step({})
        cycles += 1
    assert env.max_cycles == cycles


def test_max_cycles_that_were_set_hold_in_another_place():
    env = parallel_env("room-v0", people=12)
    env.max_cycles = 7
    env.reset(seed=0, options={"scenario": PLACE})
    assert env.max_cycles == 7


@pytest.mark.parametrize("name", ["room-v0", "routing-v0"])
def test_a_batch_takes_a_limit_in_steps(name):
    env = gymnasium.make_vec(f"crowd_env/{name}", num_envs=2, max_episode_steps=3)
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[3].all() for _ in range(3)]
    assert ends == [False, False, True]
    with pytest.raises(ValueError, match="max_episode_steps is 0"):
        gymnasium.make_vec(f"crowd_env/{name}", num_envs=2, max_episode_steps=0)


def test_a_seed_of_none_goes_on_drawing():
    env, other = make_vec("room-v0", 3, people=5), make_vec("room-v0", 3, people=5)
    for one in (env, other):
        one.reset(seed=[1, 2, 3])
    first, _ = env.reset(seed=[7, None, 9])
    then, _ = other.reset()
    again, _ = other.reset(seed=[7, 8, 9])
    np.testing.assert_array_equal(first[1], then[1])
    np.testing.assert_array_equal(first[[0, 2]], again[[0, 2]])
    assert env.np_random_seed == (7, None, 9)
    env.reset(seed=4)
    assert env.np_random_seed == 4


@pytest.mark.parametrize("name", ["room-v0", "routing-v0"])
@pytest.mark.parametrize("odd", [-1.0, 7.0, np.nan])
def test_the_action_of_a_row_that_restarts_is_not_looked_at(name, odd):
    env = gymnasium.make_vec(f"crowd_env/{name}", num_envs=2, max_episode_steps=2, autoreset_mode="NextStep")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.reset(options={"reset_mask": np.array([False, True])})
    fair = env.action_space.sample()
    assert env.step(fair)[3].tolist() == [True, False]
    any_action = fair.astype(float)
    any_action[0] = odd
    assert env.step(any_action)[3].tolist() == [False, True]
    if name == "routing-v0" or np.isnan(odd):
        any_action[1] = odd
        with pytest.raises(ValueError, match=f"action .*is .*{odd:g}"):
            env.step(any_action)


ONE = {
    "parallel": parallel_env,
    "aec": aec,
    "gymnasium": lambda places: gymnasium.make("crowd_env/room-v0", scenario=places),
    "routing": lambda places: gymnasium.make("crowd_env/routing-v0", scenario=places),
    "arrays": CrowdEnv,
    "make_vec": make_vec,
}


@pytest.mark.parametrize("door", ONE)
def test_places_that_would_never_be_used_are_refused(door):
    places = ["two-exit-hall-v0", {"name": "two-exit-hall-v0"}]
    with pytest.raises(ValueError, match=r"^2 scenarios for 1 environment: two-exit-hall-v0 would never be used"):
        ONE[door](places)
    ONE[door](places[:1])
    if door in ("parallel", "gymnasium"):
        env = ONE[door]([make_scenario("room-v0", people=5)]).unwrapped
        with pytest.raises(ValueError, match="would never be used"):
            env.reset(options={"scenario": places})


def test_wrappers_find_a_generator_of_the_seed():
    env, other = parallel_env("room-v0", people=3), parallel_env("room-v0", people=3)
    env.reset(seed=4)
    other.reset(seed=4)
    first = env.np_random.integers(100, size=5)
    np.testing.assert_array_equal(first, other.np_random.integers(100, size=5))
    env.np_random.random(9)  # of no effect on the crowd
    np.testing.assert_array_equal(*(next(iter(one.reset()[0].values())) for one in (env, other)))


@pytest.mark.parametrize("size", [1.0, 1e200, 1.7e308])
def test_a_long_action_is_shortened_however_long(size):
    env = CrowdEnv({"name": "room-v0", "side": 9.0}, people=3)
    seen = []
    for action in ([1.0, 1.0], [size, size]):
        env.reset(seed=0)
        env.step(np.tile(action, (3, 1)))
        seen.append(env.simulation.state.velocity.copy())
    np.testing.assert_allclose(*seen, rtol=1e-12)
    assert np.hypot(*seen[0].T).min() > 0.1


def test_a_footbridge_is_not_drawn():
    with pytest.raises(ValueError, match=r"unknown render_mode 'rgb_array'; known: None"):
        FootbridgeEnv(20, render_mode="rgb_array")
    assert FootbridgeEnv(20, render_mode=None).render_mode is None
