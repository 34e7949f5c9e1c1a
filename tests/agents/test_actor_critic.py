"""The network that PPO trains: what its two halves share, and rows that are computed once."""

import numpy as np
import pytest
from cases import looped
from late import late

from crowd_env import CrowdEnv

torch = late("torch")
PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
Choices = late("crowd_env.agents.learned.actor_critic", "Choices")


def policy(action="speeds"):
    """Return an untrained policy that is sure of nothing, and observations of 20 people."""
    env = CrowdEnv("room-v0", autoreset=True, action=action)
    model = make_ppo(env, PPOSettings(rule_logit=0.0), seed=0)
    return model.policy, torch.as_tensor(env.reset(seed=1)[0])


def test_a_critic_that_learns_leaves_the_actions_as_they_are():
    found, rows = policy()
    found.predict_values(rows).sum().backward()
    moved = {name for name, one in found.named_parameters() if one.grad is not None and one.grad.any()}
    assert moved == {
        f"{layer}.{array}" for layer in ("mlp_extractor.critic", "value_net") for array in ("weight", "bias")
    }


@looped("action", ["speeds", "continuous"])
def test_what_is_recorded_while_acting_is_what_is_learned_from(action):
    found, rows = policy(action)
    rows[[2, 5, 19]] = 0.0  # of people who are out
    actions, values, logs = found(rows)
    again = found.evaluate_actions(rows, actions)
    np.testing.assert_allclose(values.detach(), again[0].detach(), atol=1e-6)
    np.testing.assert_allclose(logs.detach(), again[1].detach(), atol=1e-5)
    assert actions.shape[0] == 20 and (actions[2] == actions[5]).all() and (actions[5] == actions[19]).all()
    certain = [found(rows, deterministic=True)[0] for _ in range(2)]
    assert (certain[0] == certain[1]).all()


def test_choices_are_those_of_a_categorical_distribution():
    logits = torch.randn(4, 5, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    mine, theirs = Choices(5).proba_distribution(logits), torch.distributions.Categorical(logits=logits)
    actions = torch.tensor([0, 4, 2, 2])
    np.testing.assert_allclose(mine.log_prob(actions), theirs.log_prob(actions))
    np.testing.assert_allclose(mine.entropy(), theirs.entropy())
    assert (mine.mode() == logits.argmax(dim=1)).all()
    torch.manual_seed(0)
    drawn = Choices(5).proba_distribution(logits[:1].expand(20_000, 5)).sample()
    shares = torch.bincount(drawn, minlength=5) / 20_000
    assert shares.numpy() == pytest.approx(theirs.probs[0].numpy(), abs=0.015)  # 4 standard errors
