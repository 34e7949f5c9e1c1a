"""Teams: who belongs to which cohort, in arrays and by the names of agents."""

from itertools import chain

import numpy as np
import pytest

from crowd_env import CrowdEnv, Population, make_scenario, parallel_env
from crowd_env.envs.parallel import env as aec_env

TWO = ("counter-flow-v0", "crossing-v0")


@pytest.mark.parametrize("place", TWO)
def test_agents_of_a_cohort_start_in_its_region_and_leave_by_its_route(place):
    """Also where another number of people shares the cohorts out."""
    env = parallel_env(place, people=13, physics="dem", time_limit=40.0)
    env.reset(seed=0)
    scenario, crowd = env.env.scenarios[0], env.env.simulation
    parts = {part.name: part for part in scenario.population.parts}
    assert list(env.cohorts) == list(parts) and [*chain(*env.cohorts.values())] == env.possible_agents
    for name, agents in env.cohorts.items():
        slots = [int(agent.removeprefix("pedestrian_")) for agent in agents]
        assert scenario.geometry.contains(crowd.state.position[slots], parts[name].start_region).all()
    while env.agents:
        env.step({})
    for name, agents in env.cohorts.items():
        taken = crowd.state.exit_index[[int(agent.removeprefix("pedestrian_")) for agent in agents]]
        assert {scenario.geometry.exit_names[k] for k in taken} == {parts[name].route}


def test_a_batch_has_each_cohort_in_all_its_rooms():
    env = CrowdEnv(["counter-flow-v0", make_scenario("crossing-v0", people=5), "room-v0"], num_envs=4)
    cohorts = env.cohorts
    assert list(cohorts) == ["eastwards", "westwards", "northwards", "pedestrian"]
    np.testing.assert_array_equal(sum(cohorts.values()), 1)  # everyone is in one
    east = cohorts["eastwards"]
    assert [int(east[env.people(e)].sum()) for e in range(4)] == [15, 3, 0, 15]
    env.reset(seed=0)
    np.testing.assert_array_equal(env.cohorts["eastwards"], east)


def test_cohorts_without_a_name_are_numbered_and_one_alone_has_the_name_of_the_agents():
    assert list(CrowdEnv("room-v0").cohorts) == ["pedestrian"]
    people = [Population(2), Population(3, name="slow"), Population(1)]
    env = parallel_env({"name": "room-v0", "population": people})
    assert {name: len(agents) for name, agents in env.cohorts.items()} == {
        "cohort 0": 2,
        "slow": 3,
        "cohort 2": 1,
    }


def test_agents_in_turn_and_another_place_have_them():
    env = aec_env("counter-flow-v0", people=4)
    assert env.unwrapped.cohorts == {
        "eastwards": ["pedestrian_0", "pedestrian_1"],
        "westwards": ["pedestrian_2", "pedestrian_3"],
    }
    env = parallel_env({"name": "counter-flow-v0", "people": 4})
    env.reset(options={"scenario": make_scenario("crossing-v0", people=2)})
    assert env.cohorts == {"eastwards": ["pedestrian_0"], "northwards": ["pedestrian_1"]}
