"""The network that PPO trains: its two halves, and rows that are computed once."""

import numpy as np
import pytest
from cases import looped
from late import late

from crowd_env import CrowdEnv
from crowd_env.agents import load

torch = late("torch")
PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
policy_of = late("crowd_env.agents.learned", "policy_of")
PPO = late("stable_baselines3", "PPO")
VecMonitor = late("stable_baselines3.common.vec_env", "VecMonitor")
CrowdVecEnv = late("crowd_env.envs.adapters.sb3", "CrowdVecEnv")
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
    assert {name.rpartition(".")[0] for name in moved} == {
        "mlp_extractor.critic.0",
        "mlp_extractor.critic.2",
        "value_net",
    }


@looped("action", ["speeds", "continuous"])
def test_what_is_recorded_while_acting_is_what_is_learned_from(action):
    found, rows = policy(action)
    rows[[2, 5, 19]] = 0.0  # of people who are out
    actions, values, logs = found(rows)
    again = found.evaluate_actions(rows, actions)
    np.testing.assert_allclose(values.detach(), again[0].detach(), atol=1e-6)
    np.testing.assert_allclose(values.detach(), found.predict_values(rows).detach(), atol=1e-6)
    assert len(values.unique()) == 18  # the critic sees what the actor sees
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


@looped("activation", ["Tanh", "ReLU"])
def test_what_plain_ppo_learned_acts_without_torch(activation, tmp_path):
    """As the model itself, from the file that is judged and filmed."""
    venv = CrowdVecEnv("narrow-door", num_envs=1)
    kind = {"activation_fn": getattr(torch.nn, activation), "net_arch": [16, 8]}
    for env in (venv, VecMonitor(venv)):
        model = PPO("MlpPolicy", env, n_steps=4, batch_size=160, policy_kwargs=kind, device="cpu", seed=0)
        policy_of(model).save(tmp_path / "mine.safetensors")
        rows = venv.reset()
        found = load(str(tmp_path / "mine.safetensors")).act(rows, venv.env.layout, np.random.default_rng(0))
        np.testing.assert_array_equal(found, model.predict(rows, deterministic=True)[0])


def test_what_has_no_file_is_refused():
    venv = CrowdVecEnv("room-v0")
    for options, said in (
        ({"policy_kwargs": {"activation_fn": torch.nn.ELU}}, "no MlpPolicy of tanh or ReLU"),
        ({"env": "CartPole-v1"}, "not in a CrowdVecEnv"),
    ):
        with pytest.raises(ValueError, match=said):
            policy_of(PPO("MlpPolicy", **{"env": venv, "n_steps": 4, "batch_size": 4, "device": "cpu", **options}))
