"""Agents that enter in the middle of an episode, in every interface."""

import warnings

import numpy as np
import pytest
from pettingzoo.test import api_test, parallel_api_test
from stable_baselines3.common.env_checker import check_env

from crowd_env import CrowdEnv, Geometry, Scenario, make_vec, parallel_env
from crowd_env.envs.adapters.sb3 import CrowdVecEnv
from crowd_env.envs.gymnasium_env import CrowdGymEnv
from crowd_env.envs.parallel import env
from crowd_env.geometry.geometry import box

HALL = Geometry.from_polygon(box(0, 0, 5, 3), exits={"east": [(5, 0.5), (5, 2.5)]}, regions={"west": box(0, 0, 2, 3)})
LATE = {"arrivals": {"times": [1.0, 1.2, 2.5, 9.0]}, "start_region": "west"}
PLACE = Scenario("hall", HALL, [{"people": 2}, LATE], time_limit=16.0)
# Nobody is there at the start, and for a while between two people.
EMPTY = Scenario("hall", HALL, LATE, time_limit=16.0)


def test_an_agent_joins_in_the_step_of_its_entry_and_leaves_once():
    world = parallel_env(PLACE)
    observations, _ = world.reset(seed=0)
    assert world.agents == ["pedestrian_0", "pedestrian_1"] == [*observations]
    assert world.possible_agents == [f"pedestrian_{i}" for i in range(6)]
    joined, left = {}, set()
    while world.agents:
        before = set(world.agents)
        observations, rewards, terminations, truncations, infos = world.step({})
        new = set(world.agents) - before
        assert set(observations) == set(rewards) == set(infos) == before | new
        assert not new & left
        for agent in new:
            joined[agent] = float(world.env.simulation.state.time[0])
            assert rewards[agent] == 0.0
            assert observations[agent].any()
        left |= {agent for agent in before if terminations[agent] or truncations[agent]}
    assert joined == pytest.approx({"pedestrian_2": 1.1, "pedestrian_3": 1.3, "pedestrian_4": 2.6, "pedestrian_5": 9.1})
    assert left == set(world.possible_agents)
    assert infos["pedestrian_5"]["metrics"]["unfinished"] == 0


def test_time_passes_until_somebody_is_inside():
    world = parallel_env(EMPTY)
    observations, _ = world.reset(seed=0)
    assert [*observations] == world.agents == ["pedestrian_0"]
    steps = 0
    while world.agents:
        world.step({})
        steps += 1
    assert 50 < steps < 130  # fewer than the 0.1 s that passed
    assert np.isfinite(world.env.simulation.state.exit_time).all()


@pytest.mark.parametrize("place", [PLACE, EMPTY])
def test_pettingzoo_accepts_entries(place):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "No agents present but not all")  # people still to come at the time limit
        parallel_api_test(parallel_env(place), num_cycles=150)
    api_test(env(place), num_cycles=400)


def test_a_mask_says_who_is_inside():
    single = CrowdGymEnv(PLACE)
    _, info = single.reset(seed=0)
    assert info["active"].sum() == 2
    check_env(single)
    rooms = make_vec(PLACE, num_envs=2)
    _, info = rooms.reset(seed=0)
    seen = [info["active"].sum()]
    for _ in range(15):
        info = rooms.step(rooms.action_space.sample() * 0.0)[4]
        seen.append(info["active"].sum())
    assert seen[0] == 4
    assert max(seen) == 8


def test_slots_of_people_who_have_not_come_are_not_learned_from():
    rooms = CrowdVecEnv(CrowdEnv(PLACE, num_envs=2, autoreset=True))
    observation = rooms.reset()
    assert (observation[2:6] == 0.0).all()
    done = np.zeros(12, dtype=bool)
    while not done.any():
        observation, reward, done, infos = rooms.step(np.tile([1.0, 0.0], (12, 1)).astype(np.float32))
        assert (reward[~rooms.acted] == 0.0).all()
    ended = np.flatnonzero(done)
    assert {len(infos[i]["terminal_observation"]) for i in ended} == {observation.shape[1]}
    assert all(infos[i]["is_success"] for i in ended)
    assert min(infos[i]["steps_inside"] for i in ended) < infos[ended[0]]["episode"]["l"]


def test_rewards_begin_with_the_first_decision_after_the_entry():
    crowd = CrowdEnv(PLACE, reward={"time": 1.0})
    crowd.reset(seed=0)
    total = np.zeros(6)
    while not crowd.finished.all():
        total += crowd.step(None).reward
    entry, out = crowd.simulation.entrances.entry_time, crowd.simulation.state.exit_time
    assert total == pytest.approx(-(out - entry), abs=0.101)
