"""Stable-baselines3: a slot per pedestrian, one end per episode, and nobody who is out in the loss."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor

from agents.learned import PPOSettings, make_ppo
from crowd_env import CrowdEnv, make_scenario
from crowd_env.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer

SMALL = {"count": 6, "time_limit": 4.0}


def make(num_envs=3, **options):
    return CrowdVecEnv(CrowdEnv("room-v0", num_envs=num_envs, autoreset=True, **{**SMALL, **options}))


def walk(rng, slots):
    """Return actions with which some get out before the limit and some do not."""
    return rng.uniform((-0.1, -0.6), (1.0, 0.6), (slots, 2)).astype(np.float32)


# ------------------------------------------------------------------------------------------------------------- slots


def test_every_slot_ends_exactly_once_an_episode():
    venv, batch = make(), CrowdEnv("room-v0", num_envs=3, autoreset=True, **SMALL)
    venv.seed(3)
    np.testing.assert_array_equal(venv.reset(), batch.reset(seed=3)[0])
    rng = np.random.default_rng(0)
    open_, ends, got_out, cut_off = np.ones(18, bool), np.zeros(18, int), 0, 0
    earned, lasted = np.zeros(18), np.zeros(18, int)
    for _ in range(130):
        action = walk(rng, 18)
        observation, reward, done, infos = venv.step(action)
        step = batch.step(action)
        np.testing.assert_array_equal(venv.acted, open_)
        np.testing.assert_array_equal(observation, step.observation)
        np.testing.assert_array_equal(done, step.terminated | step.truncated)
        assert not done[~open_].any() and not reward[~open_].any()
        earned += reward
        lasted += open_
        final = step.info.get("final_observation", step.observation)
        for i in range(18):
            assert ("terminal_observation" in infos[i]) == done[i]
            if done[i]:
                np.testing.assert_array_equal(infos[i]["terminal_observation"], final[i])
                assert infos[i]["terminal_observation"].any()
                assert infos[i]["TimeLimit.truncated"] == step.truncated[i]
                assert infos[i]["episode"]["l"] == lasted[i]
                assert infos[i]["episode"]["r"] == pytest.approx(earned[i], abs=1e-4)
                earned[i], lasted[i] = 0.0, 0
        ends += done
        got_out += step.terminated.sum()
        cut_off += step.truncated.sum()
        open_ = (open_ & ~done) | step.info["finished"][batch.env_of_person]
    assert (ends >= 3).all() and got_out > 10 and cut_off > 3
    assert len(venv.take_finished()) == len(set(batch.env_of_person)) * (ends.min()) and venv.take_finished() == []


def test_a_seed_of_its_own():
    venv = make()
    venv.seed(5)
    first, second = venv.reset(), venv.reset()
    assert not np.array_equal(first, second)
    venv.seed(5)
    np.testing.assert_array_equal(venv.reset(), first)
    np.testing.assert_array_equal(venv.reset(), second)


def test_it_is_a_vecenv_of_one_slot_per_pedestrian():
    env = CrowdEnv([make_scenario("room-v0", count=4), make_scenario("room-v0", count=7)], num_envs=2, autoreset=True)
    venv = CrowdVecEnv(env)
    assert venv.num_envs == 11 and venv.reset().shape == (11, env.layout.size)
    assert venv.get_attr("decision_dt", [0, 3]) == [0.1, 0.1]
    assert len(venv.env_is_wrapped(VecMonitor)) == 11 and not any(venv.env_is_wrapped(VecMonitor))
    assert venv.env_method("people", 1, indices=0) == [slice(4, 11)]
    with pytest.raises(ValueError, match="autoreset"):
        CrowdVecEnv(CrowdEnv("room-v0"))


def test_the_monitor_of_stable_baselines3_counts_the_same_episodes():
    venv = VecMonitor(make())
    venv.reset()
    rng = np.random.default_rng(0)
    counted = 0
    for _ in range(45):
        _, _, done, infos = venv.step(walk(rng, 18))
        counted += sum("episode" in info for info in infos) - done.sum()
    assert counted == 0 and venv.episode_count >= 18


# ------------------------------------------------------------------------------------------------------- the buffer


class Acting:
    """Stands in for the VecEnv: says who was inside."""

    acted = np.zeros(0, bool)


@pytest.mark.parametrize("batch_size", [None, 7, 16, 1000])
def test_minibatches_hold_each_sample_of_those_inside_once_and_no_other(batch_size):
    steps, slots = 9, 11
    env, acting = make().env, Acting()
    space = env.single_observation_space
    buffer = MaskedRolloutBuffer(steps, space, env.single_action_space, device="cpu", n_envs=slots, venv=acting)
    rng = np.random.default_rng(0)
    for _ in range(2):  # a rollout leaves nothing behind for the next
        buffer.reset()
        mask = rng.random((steps, slots)) < 0.4
        number = np.arange(steps * slots, dtype=float).reshape(steps, slots)
        for t in range(steps):
            acting.acted = mask[t]
            observation = np.zeros((slots, *space.shape))
            observation[:, 0] = number[t]
            values, logs = torch.tensor(number[t] + 0.25), torch.tensor(number[t] + 0.5)
            buffer.add(observation, np.tile(number[t][:, None], 2), number[t], np.zeros(slots), values, logs)
        for _ in range(2):  # epochs
            batches = list(buffer.get(batch_size))
            seen = np.concatenate([batch.observations[:, 0].numpy() for batch in batches])
            np.testing.assert_array_equal(np.sort(seen), np.sort(number[mask]))
            for batch in batches:  # and each sample is still in one piece
                np.testing.assert_array_equal(batch.actions[:, 1], batch.observations[:, 0])
                np.testing.assert_array_equal(batch.old_values, batch.observations[:, 0] + 0.25)
                np.testing.assert_array_equal(batch.old_log_prob, batch.observations[:, 0] + 0.5)
            sizes = [len(batch.observations) for batch in batches]
            assert max(sizes) - min(sizes) <= 1
            assert batch_size is None or max(sizes) <= 1.5 * batch_size
            assert len(set(seen)) < 4 or not np.array_equal(seen, np.sort(seen))  # shuffled


class Witness(BaseCallback):
    """Keeps every rollout as it was before the gradient steps take it to pieces."""

    def __init__(self):
        super().__init__()
        self.rollouts, self.told = [], []

    def _on_rollout_start(self):
        self.told = []

    def _on_step(self):
        names = ("rewards", "dones", "infos", "new_obs")
        self.told.append({name: np.array(self.locals[name], copy=True) for name in names})
        return True

    def _on_rollout_end(self):
        buffer = self.model.rollout_buffer
        kept = {name: getattr(buffer, name).copy() for name in ("observations", "advantages", "returns", "mask")}
        predict = self.model.policy.predict_values
        with torch.no_grad():
            kept["values"] = np.array([predict(torch.as_tensor(row))[:, 0].numpy() for row in buffer.observations])
            kept["last"] = predict(torch.as_tensor(self.told[-1]["new_obs"]))[:, 0].numpy()
            kept["terminal"] = np.zeros_like(kept["values"])
            for t, told in enumerate(self.told):
                for i, info in enumerate(told["infos"]):
                    if "terminal_observation" in info:
                        row = torch.as_tensor(info["terminal_observation"])[None]
                        kept["terminal"][t, i] = predict(row)[0, 0]
        self.rollouts.append((kept, self.told))


def test_advantages_are_those_of_hand_made_gae():
    """Value 0 after getting out, value of the last observation after the time limit, next value in between."""
    gamma, lam = 0.9, 0.8
    settings = PPOSettings(n_steps=40, batch_size=64, n_epochs=1, gamma=gamma, gae_lambda=lam, log_std_init=-1.0)
    env = CrowdEnv("room-v0", num_envs=3, autoreset=True, count=6, time_limit=2.9)
    model = make_ppo(env, settings, seed=0)
    with torch.no_grad():
        model.policy.value_net.bias += 3.0  # so that every bootstrap counts
    witness = Witness()
    model.learn(40 * 18 * 4, callback=witness)
    out, cut, masked = 0, 0, 0
    assert len(witness.rollouts) == 4
    for kept, told in witness.rollouts:
        mask, values = kept["mask"], kept["values"]
        for i in range(18):
            after, value_after = 0.0, kept["last"][i]
            for t in reversed(range(40)):
                info = told[t]["infos"][i]
                if told[t]["dones"][i]:
                    late = info["TimeLimit.truncated"]
                    after, value_after = 0.0, kept["terminal"][t, i] if late else 0.0
                    out, cut = out + (not late), cut + late
                delta = told[t]["rewards"][i] + gamma * value_after - values[t, i]
                after = delta + gamma * lam * after
                value_after = values[t, i]
                if mask[t, i]:
                    assert kept["advantages"][t, i] == pytest.approx(after, abs=2e-4)
                    assert kept["returns"][t, i] == pytest.approx(after + values[t, i], abs=2e-4)
                else:
                    masked += 1
                    assert not kept["observations"][t, i].any() or told[t - 1]["dones"][i]
    assert out > 5 and cut > 5 and masked > 20


# ----------------------------------------------------------------------------------------------------------- learning


def learned(seed, steps=1000):
    settings = PPOSettings(n_steps=16, batch_size=64, n_epochs=2)
    env = CrowdEnv("room-v0", num_envs=2, autoreset=True, **SMALL)
    return make_ppo(env, settings, seed).learn(steps)


def parameters(model):
    return np.concatenate([value.detach().numpy().ravel() for value in model.policy.parameters()])


def test_the_same_seed_learns_the_same_and_another_something_else():
    first = parameters(learned(1))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, parameters(learned(1)))
    assert not np.array_equal(first, parameters(learned(2)))
    assert not np.array_equal(first, parameters(learned(1, steps=1)))


def test_learning_starts_from_the_rule():
    env = CrowdEnv("room-v0", num_envs=1, autoreset=True)
    model = make_ppo(env, PPOSettings(), seed=0)
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    np.testing.assert_allclose(action, np.tile([1.0, 0.0], (20, 1)), atol=0.1)


def test_plain_ppo_with_discrete_actions_runs_on_it():
    venv = make(action="discrete")
    kwargs = {"rollout_buffer_class": MaskedRolloutBuffer, "rollout_buffer_kwargs": {"venv": venv}}
    PPO("MlpPolicy", venv, n_steps=16, batch_size=64, n_epochs=1, seed=0, device="cpu", **kwargs).learn(600)


def test_it_learns_not_to_stand_still():
    """A policy that starts at standing still finds the way within seconds: signs and masks are right."""
    env = CrowdEnv("room-v0", num_envs=8, autoreset=True, count=4, time_limit=5.0)
    model = make_ppo(env, PPOSettings(n_steps=32, batch_size=512, n_epochs=5, learning_rate=3e-3), seed=0)
    with torch.no_grad():
        model.policy.action_net.bias.zero_()
    observation = CrowdEnv("room-v0").reset(seed=9)[0]
    before = model.predict(observation, deterministic=True)[0][:, 0].mean()
    model.learn(40_000)
    after = model.predict(observation, deterministic=True)[0][:, 0].mean()
    assert before < 0.2 and after > 0.6
