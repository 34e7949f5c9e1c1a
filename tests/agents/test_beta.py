"""Beta distributions of actions: densities by another library, a mode that can be the bound, and what is learned there."""

import numpy as np
import pytest
from cases import looped
from late import late

from crowd_env import CrowdEnv
from crowd_env.agents.networks import BetaMLP
from crowd_env.agents.networks.network import LEAST
from crowd_env.agents.trained import LearnedPolicy

stats, torch = late("scipy.stats"), late("torch")
PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
BetaActions, bias_at = late("crowd_env.agents.learned.beta", "BetaActions", "bias_at")
network_of = late("crowd_env.agents.learned.actor_critic", "network_of")
env_options_of = late("crowd_env.agents.learned.training", "env_options_of")

RNG = np.random.default_rng(0)


def parameters(raw):
    return LEAST + np.logaddexp(0.0, np.asarray(raw, dtype=float))


def at(action):
    return torch.tensor(bias_at(np.array(action)))[None]


def test_density_and_entropy_are_those_of_scipy():
    raw = RNG.normal(0.0, 2.0, (50, 4))
    actions = RNG.uniform(-0.99, 0.99, (50, 2))
    taken = BetaActions().proba_distribution(torch.tensor(raw))
    alpha, beta = np.split(parameters(raw), 2, axis=1)
    other = stats.beta(alpha, beta, loc=-1.0, scale=2.0)
    np.testing.assert_allclose(taken.log_prob(torch.tensor(actions)), other.logpdf(actions).sum(axis=1), rtol=1e-6)
    np.testing.assert_allclose(taken.entropy(), other.entropy().sum(axis=1), rtol=1e-6, atol=1e-6)


def test_the_mode_is_where_the_density_is_largest_and_can_be_a_bound():
    raw = np.vstack([RNG.normal(0.0, 3.0, (300, 2)), [[3.0, -5.0], [-5.0, 3.0]]])
    taken = BetaActions().proba_distribution(torch.tensor(raw))
    mode = taken.mode().numpy()[:, 0]
    grid = torch.linspace(-1.0, 1.0, 2001, dtype=torch.float64)
    best = grid[torch.stack([taken.log_prob(one.expand(len(raw), 1)) for one in grid]).argmax(dim=0)].numpy()
    np.testing.assert_allclose(mode, best, atol=1e-3)
    assert mode[-2] == 1.0 and mode[-1] == -1.0 and (np.abs(mode) < 1.0).any()
    network = BetaMLP((np.eye(2),), (np.zeros(2),))
    np.testing.assert_allclose(network(raw)[:, 0], mode, atol=1e-6)


@looped("action", [[1.0, 0.0], [-1.0, 1.0], [0.3, -0.7]])
def test_the_likeliest_action_at_first_is_the_one_that_is_wanted(action):
    np.testing.assert_allclose(BetaActions().proba_distribution(at(action)).mode()[0], action, atol=1e-12)


def slope(distribution_of, raw, clipped):
    """Return how fast the mean of what is executed falls along the gradient, estimated from draws as PPO does."""
    torch.manual_seed(0)
    raw = raw.clone().requires_grad_()
    taken = distribution_of(raw.expand(20_000, -1))
    with torch.no_grad():
        drawn = taken.sample()
        done = drawn.clamp(-1.0, 1.0) if clipped else drawn
        advantage = -(done - done.mean()).sum(dim=-1)  # slower is better
    log_prob = taken.log_prob(drawn)
    (advantage * (log_prob.sum(dim=-1) if log_prob.ndim > 1 else log_prob)).mean().backward()
    return float(raw.grad.norm())


def test_at_the_bound_there_is_something_to_learn_where_a_clipped_gaussian_learns_nothing():
    """The forward action of a Gaussian that has run 2.3 standard deviations past the bound, as seen in training."""
    gaussian = slope(lambda raw: torch.distributions.Normal(raw, 0.3), torch.tensor([1.69]), clipped=True)
    beta = slope(BetaActions().proba_distribution, at([1.0]), clipped=False)
    assert gaussian < 0.02 < 0.08 < beta
    pressed = slope(BetaActions().proba_distribution, at([1.0]) + torch.tensor([[0.0, -5.0]]), clipped=False)
    assert pressed > 2.0 * gaussian  # as far towards the bound as it goes


@pytest.mark.more
def test_ppo_with_a_beta_distribution_starts_at_the_rule_learns_and_is_saved_as_it_acts(tmp_path):
    env = CrowdEnv("room-v0", num_envs=2, autoreset=True)
    settings = PPOSettings(distribution="beta", n_steps=16, batch_size=128, n_epochs=1, hidden=16)
    model = make_ppo(env, settings, 0)
    observation, _ = env.reset(seed=0)
    first = LearnedPolicy(network_of(model), env_options_of(env))
    np.testing.assert_allclose(first.act(observation, env.layout, RNG), np.tile([1.0, 0.0], (40, 1)), atol=0.05)
    model.learn(2 * 16 * 40)
    policy = LearnedPolicy(network_of(model), env_options_of(env))
    done = policy.act(observation, env.layout, RNG)
    np.testing.assert_allclose(done, model.predict(observation, deterministic=True)[0], atol=1e-5)
    assert not np.array_equal(done, first.act(observation, env.layout, RNG))
    policy.save(tmp_path / "beta.safetensors")
    again = LearnedPolicy.load(tmp_path / "beta.safetensors")
    assert isinstance(again.network, BetaMLP)
    np.testing.assert_allclose(again.act(observation, env.layout, RNG), done, atol=1e-6)


def test_what_beta_cannot_do_is_refused():
    with pytest.raises(ValueError, match="unknown distribution 'cauchy'"):
        PPOSettings(distribution="cauchy")
    with pytest.raises(ValueError, match="a Beta distribution is of continuous actions, not of Discrete"):
        make_ppo(CrowdEnv("room-v0", autoreset=True, action="speeds"), PPOSettings(distribution="beta"), 0)
    with pytest.raises(ValueError, match="end in 3 numbers"):
        BetaMLP((np.zeros((3, 2)),), (np.zeros(3),))
