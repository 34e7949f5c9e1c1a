"""MAPPO: a critic that sees the crowd, and an actor that does not."""

import numpy as np
import pytest
from late import late

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.agents.training_config import PPOSettings

CentralPolicy, CentralVecEnv = late("crowd_env.agents.learned.mappo", "CentralPolicy", "CentralVecEnv")
make_ppo = late("crowd_env.agents.learned.ppo", "make_ppo")
train_ppo = late("crowd_env.agents.learned.training", "train_ppo")
network_of = late("crowd_env.agents.learned.actor_critic", "network_of")
SEEN = ObservationLayout(terms=("velocity", "travel_time", "ahead"))


SETTINGS = PPOSettings(n_steps=8, batch_size=128, n_epochs=1, hidden=8)


def room(num_envs=2, **options):
    return CrowdEnv("room-v0", num_envs=num_envs, autoreset=True, action="speeds", observation=SEEN, **options)


def test_the_critic_is_told_of_those_inside_alone_in_no_order():
    env = room()
    venv = CentralVecEnv(env)
    venv.seed(0)
    first = venv.reset()
    assert first.shape == (env.num_people, 2 * SEEN.size + 1) and venv.observation_space.contains(first[0])
    inside = np.ones(env.num_people, dtype=bool)
    inside[[1, 4, 25]] = False
    observation = np.random.default_rng(0).uniform(-1, 1, (env.num_people, SEEN.size)).astype(np.float32)
    crowd = venv.widened(observation, inside)[:, SEEN.size :]
    for people in (slice(0, 20), slice(20, 40)):
        rows = inside[people]
        mean = observation[people][rows].mean(axis=0)
        np.testing.assert_allclose(
            crowd[people], np.tile([*mean, rows.sum() / (rows.sum() + 50.0)], (20, 1)), rtol=1e-5
        )
    turned = np.array([*np.random.default_rng(1).permutation(20), *range(20, 40)])
    np.testing.assert_allclose(venv.widened(observation[turned], inside[turned])[:, SEEN.size :], crowd, atol=1e-6)
    nobody = venv.widened(observation, np.zeros_like(inside))
    assert np.isfinite(nobody).all() and not nobody[:, SEEN.size :].any()


class Counted:
    """A callback that ends a training after so many updates and keeps the policies."""

    progress, stopped = 0.5, False

    def __init__(self, questions):
        self.left, self.policies, self.steps = questions, [], []

    def on_update(self, steps, policy, returns):
        self.policies.append(policy())
        self.steps.append(steps)
        self.left -= 1
        return self.left > 0


def test_training_begins_at_the_rule_and_moves_from_it_and_what_is_kept_does_not_move():
    callback = Counted(3)
    train_ppo(room(), SETTINGS, 0, callback, central=True)
    env = room()
    observation, _ = env.reset(seed=1)
    first, *_, last = callback.policies
    assert (first.act(observation, env.layout, None) == 4).all()
    assert not np.array_equal(first.network(observation), last.network(observation))
    assert callback.steps[0] == 0 < callback.steps[1] <= 8 * 40 and callback.steps[1] < callback.steps[2]


def test_the_actor_does_not_see_the_crowd():
    model = make_ppo(room(), SETTINGS, 0, central=True)
    policy = model.policy
    assert isinstance(policy, CentralPolicy)
    import torch

    rows = torch.rand(6, 2 * SEEN.size + 1)
    logits = policy.get_distribution(rows).logits.detach().numpy()
    there = network_of(model)(rows[:, : SEEN.size].numpy())
    np.testing.assert_allclose(there - there.mean(axis=1)[:, None], logits - logits.mean(axis=1)[:, None], atol=1e-5)
    other = rows.clone()
    other[:, SEEN.size :] = torch.rand(6, SEEN.size + 1)
    assert not torch.allclose(policy.predict_values(rows), policy.predict_values(other))
    assert torch.equal(policy.get_distribution(other).logits, policy.get_distribution(rows).logits)


def test_actions_that_are_not_discrete_are_refused():
    with pytest.raises(ValueError, match="action 'continuous' is not discrete; take one such as 'speeds'"):
        make_ppo(CrowdEnv("room-v0", autoreset=True), SETTINGS, 0, central=True)
