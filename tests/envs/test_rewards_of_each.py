"""The reward of each pedestrian in batches: those of the people are those of the arrays, and the team's is their mean."""

import numpy as np
import pytest
from crowds import every_scheme

from crowd_env import CrowdEnv, GeneratedCrowds, RewardWeights, make_vec
from crowd_env.envs.reward import REWARDS

WEIGHTS = {"progress": 1.0, "exit": 2.0, "time": 0.5, "contact": 0.1, "head": 0.3}


@pytest.mark.parametrize("share", [0.0, 0.4])
@every_scheme
def test_the_reward_of_a_room_is_the_mean_of_its_people_and_theirs_the_sum_of_their_terms(name, share):
    """In every step of a batch whose rooms end and restart: that of the last step is in the info of the end."""
    made = {"people": 6, "time_limit": 2.0, "physics": name, "reward": RewardWeights(WEIGHTS, team_share=share)}
    rooms, arrays = make_vec("room-v0", 2, **made), CrowdEnv("room-v0", num_envs=2, autoreset=True, **made)
    rooms.reset(seed=3)
    arrays.reset(seed=3)
    rng, ended = np.random.default_rng(0), 0
    for _ in range(26):
        action = rng.uniform((0.3, -0.4), (1.0, 0.4), (2, 6, 2))
        _, reward, terminated, truncated, info = rooms.step(action)
        step = arrays.step(action.reshape(12, 2))
        over = terminated | truncated
        ended += over.sum()
        of_each = info["reward"].copy()
        assert (info["_reward"] == ~over).all()
        terms = {term: info[f"reward/{term}"].copy() for term in REWARDS}
        if over.any():
            of_each[over] = info["final_info"]["reward"][over]
            for term, values in terms.items():
                values[over] = info["final_info"][f"reward/{term}"][over]
        np.testing.assert_array_equal(of_each.ravel(), step.reward)
        np.testing.assert_allclose(reward, of_each.mean(axis=1), rtol=1e-12)
        own = sum(weight * terms[term] for term, weight in WEIGHTS.items())
        np.testing.assert_allclose(of_each, (1 - share) * own + share * own.mean(axis=1, keepdims=True), atol=1e-12)
        np.testing.assert_allclose(reward, own.mean(axis=1), atol=1e-12)  # whatever the share
    assert ended == 2


def test_generated_crowds_give_the_terms_of_each():
    env = GeneratedCrowds(3, people=20, seeds=200, reward=WEIGHTS)
    env.reset(seed=1)
    for _ in range(6):
        step = env.step(None)
        inside = np.abs(step.info["reward/time"]) > 0.0
        own = sum(weight * step.info[f"reward/{term}"] for term, weight in WEIGHTS.items())
        np.testing.assert_allclose(step.reward, own, atol=1e-12)
    assert 3 < inside.sum() <= env.num_people
