"""An environment goes on in another place: ``reset(options={"scenario": ...})``."""

import numpy as np
import pytest
from cases import looped
from pettingzoo.test import parallel_api_test

from crowd_env import parallel_env
from crowd_env.envs.gymnasium_env import CrowdGymEnv
from crowd_env.envs.parallel import env as aec_env


def place(seed, **options):
    return {"scenario": {"name": "generated-v0", "seed": seed, **options}}


@looped("make", [parallel_env, CrowdGymEnv])
def test_what_follows_is_what_an_environment_made_for_the_place_does(make):
    moved, made = make("room-v0", people=20, physics="dem"), make(place(7)["scenario"], people=20, physics="dem")
    moved.reset(seed=1)
    one, other = moved.reset(seed=3, options=place(7))[0], made.reset(seed=3)[0]
    for _ in range(5):
        np.testing.assert_array_equal(np.array([*one.values()]) if isinstance(one, dict) else one,
                                      np.array([*other.values()]) if isinstance(other, dict) else other)  # fmt: skip
        one, other = (env.step({} if make is parallel_env else None)[0] for env in (moved, made))
    assert moved.env.scenarios[0].title == made.env.scenarios[0].title
    moved.reset(seed=4)
    assert moved.env.scenarios[0].name == "generated-v0"  # until it is sent elsewhere


def test_spaces_and_cycles_stay():
    env = parallel_env("two-exit-hall-v0", people=20, action={"name": "speeds-exits", "speeds": [1.0]}, max_cycles=9)
    with pytest.raises(ValueError, match=r"scenario is 'room-v0'; .*a place in which a person's space stays"):
        env.reset(options={"scenario": "room-v0"})
    env.reset(seed=0, options={"scenario": {"name": "two-exit-hall-v0", "length": 30.0}})
    assert env.max_cycles == 9 and env.env.scenarios[0].geometry.bounds[2] == 30.0


def test_agents_are_as_many_as_the_place_has():
    env = parallel_env({"name": "generated-v0", "seed": 0, "people": 30}, physics="dem")
    observations, _ = env.reset(seed=0, options=place(1, people=12))
    assert list(observations) == env.agents == env.possible_agents[:12]
    assert env.state().shape == env.state_space.shape == (env.state_layout.size,)
    assert set(env.step({})[0]) == set(observations)
    with pytest.raises(ValueError, match="a place of at most 30 people, not 31"):
        env.reset(options=place(1, people=31))
    with pytest.raises(ValueError, match="unknown reset option 'place'; known: scenario"):
        env.reset(options={"place": 3})
    assert len(env.reset(seed=0)[0]) == 12


def test_a_controller_of_all_keeps_its_number_of_people():
    env = CrowdGymEnv({"name": "generated-v0", "seed": 0, "people": 30}, physics="dem")
    with pytest.raises(ValueError, match="a place of 30 people"):
        env.reset(options=place(1, people=12))
    assert env.reset(options=place(1, people=30))[0].shape == env.observation_space.shape


@pytest.mark.more
def test_checkers_pass_with_places_of_their_own():
    env = parallel_env({"name": "generated-v0", "seed": 4}, people=10, physics="dem")
    parallel_api_test(env, num_cycles=20)
    turns = aec_env("room-v0", people=5)
    turns.reset(seed=0, options=place(3))
    assert len(turns.agents) == 5 and turns.unwrapped.env.scenarios[0].name == "generated-v0"
