"""Many evacuations led by one controller each, and what a controller's environment refuses."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
import routing_places
from cases import looped
from gymnasium.vector import AutoresetMode

from crowd_env import CrowdEnv, CrowdVectorEnv, Uniform
from crowd_env.envs.routing.env import RoutingEnv, RoutingVectorEnv


def hall(**options):
    return routing_places.hall(12, 30.0, radius=Uniform(0.2, 0.22), **options)


SMALL = hall()


def test_make_vec_gives_the_native_batch():
    mode = "vector_entry_point"
    env = gymnasium.make_vec("crowd_env/routing-v0", num_envs=3, vectorization_mode=mode, scenario=SMALL)
    assert isinstance(env.unwrapped, RoutingVectorEnv)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.action_space.shape == (3, 8) and env.single_action_space.nvec.tolist() == [2] * 8
    observation, info = env.reset(seed=1)
    assert env.observation_space.contains(observation) and info["inside"].tolist() == [12] * 3
    crowd = CrowdEnv(SMALL, num_envs=3)
    crowd.reset(1)
    np.testing.assert_array_equal(env.unwrapped.batch.env.simulation.state.position, crowd.simulation.state.position)


def test_episodes_go_on_after_a_restart_with_other_draws():
    env = RoutingVectorEnv(SMALL, num_envs=2)
    env.reset(seed=0)
    first = env.batch.env.simulation.state.position.copy()
    ended, flows = np.zeros(2, dtype=int), []
    while (ended < 2).any():
        rows, _, terminated, truncated, info = env.step([[0, 0, 1, 1, 0, 0, 1, 1], [1] * 8])
        assert not truncated.any() and env.observation_space.contains(rows)
        ended += terminated
        if terminated.tolist() == [True, False]:  # the other row goes on as if nothing had happened
            assert info["_final_obs"].tolist() == [True, False] and not info["final_obs"][1].any()
            flows.append(rows[1, env.layout["flow"]].max())
    assert max(flows) > 0
    assert not np.array_equal(env.batch.env.simulation.state.position, first)


@pytest.mark.more
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize(
    "make",
    [
        lambda: RoutingEnv(SMALL),
        lambda: RoutingEnv(SMALL, regions=["start"]),
        lambda: RoutingVectorEnv(SMALL, num_envs=2),
        lambda: CrowdVectorEnv("room-v0", num_envs=2, people=5),
    ],
)
def test_a_copy_goes_on_alike(make, copied):
    env = make()
    env.reset(seed=1)
    env.action_space.seed(0)
    env.step(env.action_space.sample())
    other = copied(env)
    for _ in range(3):
        action = env.action_space.sample()
        np.testing.assert_array_equal(env.step(action)[0], other.step(action)[0])


# -------------------------------------------------------------------------------------------------------------- errors


@looped(
    "options,words",
    [
        ({"regions": ["lobby"]}, "unknown region 'lobby'; known: start"),
        ({"regions": ["start", "start"]}, "region 'start' is named twice"),
        ({"routes": ["north"]}, "unknown route 'north'; known: west, east"),
        ({"doors": ["gate"]}, "unknown door 'gate'; known: none"),
        ({"grid": (0, 2)}, r"grid is \(0, 2\); it must be two whole numbers >= 1, columns and rows"),
        ({"grid": 3}, "grid is 3; it must be two whole numbers >= 1, columns and rows"),
        ({"grid": "42"}, "grid is '42'; it must be two whole numbers"),
        ({"grid": (4,)}, r"grid is \(4,\); it must be two whole numbers"),
        ({"grid": (4, 2, 1)}, r"grid is \(4, 2, 1\); it must be two whole numbers"),
        ({"grid": (4, 2.5)}, r"grid is \(4, 2.5\); it must be two whole numbers"),
        ({"grid": (True, 2)}, r"grid is \(True, 2\); it must be two whole numbers"),
        ({"grid": (200, 200)}, r"no cell of a grid of 200 x 200 has 0.1 m2 of floor: one measures 0.1 x 0.06 m"),
        ({"grid": (10**9, 10**9)}, "no cell of a grid of 1000000000 x 1000000000 has 0.1 m2 of floor"),
        ({"regions": "start"}, "regions is 'start'; it must be a tuple of names"),
        ({"routes": "west"}, "routes is 'west'; it must be a tuple of names"),
        ({"routes": ["west"]}, r"'hall': there is nothing to choose, with one route \(west\) and no door"),
        ({"doors": None}, "doors is None; it must be a tuple of names"),
        ({"interval": "2"}, "interval between decisions is '2'; it must be a number, > 0 and finite"),
        ({"interval": None}, "interval between decisions is None; it must be a number"),
        ({"reward": "mean"}, "reward is 'mean'; it must be a table of weights such as"),
        ({"reward": {"mean": "1"}}, "weight of reward term 'mean' is '1'; it must be a number"),
        ({"interval": 0.015}, "interval = 0.015 s is not a whole number of physics steps of dt = 0.01 s"),
        ({"interval": 2.0, "physics": {"dt": 0.03}}, "interval = 2 s is not a whole number of physics steps"),
        ({"interval": 0.0}, "interval between decisions is 0.0 s"),
        ({"reward": {"speed": 1.0}}, "unknown reward term 'speed'; known: mean, last"),
        ({"reward": {"mean": float("nan")}}, "weight of reward term 'mean' is nan"),
        ({"render_mode": "human"}, "unknown render_mode 'human'"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(options, words):
    with pytest.raises(ValueError, match=words) as caught:
        RoutingEnv(SMALL, **options)
    assert "\n" not in str(caught.value)


def test_a_place_with_one_way_out_is_refused_for_there_is_nothing_to_choose():
    for make in (RoutingEnv, RoutingVectorEnv):
        with pytest.raises(
            ValueError, match=r"'room-v0': there is nothing to choose, with one route \(door\)"
        ) as caught:
            make("room-v0")
        assert "\n" not in str(caught.value)
        with pytest.raises(ValueError, match=r"nothing to choose, with one route \(west\).*known doors: gate"):
            make(hall(exits=["west"], doors={"gate": "west"}))
    env = RoutingEnv(hall(exits=["west"], doors={"gate": "west"}), grid=(2, 1), doors=["gate"])
    assert env.action_space.nvec.tolist() == [1, 1, 2]


def test_actions_that_are_no_choices_are_refused():
    env = RoutingEnv(hall(doors={"gate": "east"}), grid=(2, 1), doors=["gate"])
    env.reset(seed=0)
    for action, words in [
        ([0, 2, 1], "action for region 'cell-1-0' is 2; it must be a whole number from 0 to 1"),
        ([-1, 0, 1], "region 'cell-0-0' is -1"),
        ([0.5, 0, 1], "region 'cell-0-0' is 0.5"),
        ([0, 0, 2], "door 'gate' is 2"),
        ([0, 0], r"the action has the shape \(2,\); it must be \(3,\)"),
    ]:
        with pytest.raises(ValueError, match=words):
            env.step(action)
