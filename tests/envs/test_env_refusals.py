"""What an environment refuses."""

import numpy as np
import pytest

from crowd_env import CrowdEnv, ObservationLayout, make_scenario

# --------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scenario": "rooom"}, ["rooom", "room-v0"]),
        ({"scheme": "dm"}, ["dm", "nsm2", "dem"]),
        ({"frame": "polar"}, ["polar", "path", "world"]),
        ({"action": "both"}, ["both", "continuous", "discrete"]),
        ({"num_envs": 0}, ["num_envs", "at least 1"]),
        ({"time_limit": -1.0}, ["time_limit", "> 0"]),
        ({"time_limit": float("nan")}, ["time_limit", "> 0"]),
        ({"dt": 0.0}, ["dt", "> 0"]),
        ({"dt": 0.03}, ["decision_dt", "whole number"]),
        ({"decision_dt": 0.004}, ["decision_dt", "whole number"]),
        ({"dt": 0.1, "scheme": "dem"}, ["dem", "stable step"]),
        ({"color": "red"}, ["color", "door_width"]),
        ({"door_width": 0.3}, ["0.30 m", "narrower", "0.40 m"]),
        ({"count": 1000}, ["1000", "do not fit"]),
        ({"scenario": make_scenario("room-v0"), "count": 3}, ["count", "scenario name"]),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(options, words):
    with pytest.raises(ValueError) as refused:
        CrowdEnv(**{"scenario": "room-v0", **options})
    for word in words:
        assert word in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("kind", "action", "words"),
    [
        ("continuous", np.zeros((19, 2)), "has the shape (19, 2); it must be (20, 2)"),
        ("continuous", np.zeros((20, 3)), "has the shape (20, 3); it must be (20, 2)"),
        ("continuous", np.zeros(20), "has the shape (20,); it must be (20, 2)"),
        ("continuous", np.full((20, 2), np.nan), "pedestrian 0 is [nan, nan]; it must be finite"),
        ("continuous", np.where(np.arange(20)[:, None] == 7, np.inf, 0.0) + np.zeros((20, 2)), "pedestrian 7"),
        ("discrete", np.full(20, 9), "pedestrian 0 is 9; it must be 0 to 8"),
        ("discrete", np.full(20, -1), "0 to 8"),
        ("discrete", np.full(20, 0.5), "0 to 8"),
        ("discrete", np.full(20, np.nan), "0 to 8"),
        ("discrete", np.zeros((20, 2)), "has the shape (20, 2); it must be (20,)"),
    ],
)
def test_a_malformed_action_is_refused_and_nothing_moves(kind, action, words):
    env = CrowdEnv("room-v0", action=kind)
    env.reset(seed=0)
    before = env.simulation.state.copy()
    with pytest.raises(ValueError) as refused:
        env.step(action)
    assert words in str(refused.value)
    for old, new in zip(before, env.simulation.state, strict=True):
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize(("seed", "words"), [(-1, "at least 0"), ([1], "1 seeds for 2"), ([1, -2], "at least 0")])
def test_a_bad_seed_is_refused(seed, words):
    with pytest.raises(ValueError, match=words):
        CrowdEnv("room-v0", num_envs=2).reset(seed)


def test_a_layout_and_weights_of_ones_own():
    env = CrowdEnv("room-v0", observation=ObservationLayout(terms=("crush", "velocity")))
    assert env.reset(seed=0)[0].shape == (20, 3)
