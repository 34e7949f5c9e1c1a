"""The masked rollout buffer: nobody who is out in the loss, what leaving is worth, and whose rewards they are."""

import warnings

import numpy as np
import pytest
from late import late

from crowd_env import CrowdEnv, Physics, RewardWeights

torch = late("torch")
PPO = late("stable_baselines3", "PPO")
BaseCallback = late("stable_baselines3.common.callbacks", "BaseCallback")
VecEnvWrapper, VecMonitor, VecNormalize = late(
    "stable_baselines3.common.vec_env", "VecEnvWrapper", "VecMonitor", "VecNormalize"
)
PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
sb3 = late("crowd_env.envs.adapters.sb3")
CrowdVecEnv, MaskedRolloutBuffer, SlotRewards, Slots = late(
    "crowd_env.envs.adapters.sb3", "CrowdVecEnv", "MaskedRolloutBuffer", "SlotRewards", "Slots"
)

SMALL = {"people": 6, "time_limit": 4.0}


def make(num_envs=3, **options):
    return CrowdVecEnv(CrowdEnv("room-v0", num_envs=num_envs, autoreset=True, **{**SMALL, **options}))


def make_model(venv, **options):
    settings = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "seed": 0, "device": "cpu", **options}
    kept = sb3.MaskedRolloutBuffer  # itself, since it is saved with the model
    return PPO("MlpPolicy", venv, rollout_buffer_class=kept, **settings)


def rewards(reward, acted, inside=None, cut_off=None, environment=None, share=0.0):
    """Return rewards of a step as `CrowdVecEnv` does."""
    nobody = np.zeros(len(acted), bool)
    room = np.zeros(len(acted), int) if environment is None else np.array(environment)
    slots = Slots(acted, acted if inside is None else inside, nobody if cut_off is None else cut_off, room, share)
    return SlotRewards.of(reward, slots)


@pytest.mark.parametrize("batch_size", [None, 7, 16, 1000])
def test_minibatches_hold_each_sample_of_those_inside_once_and_no_other(batch_size):
    steps, slots = 9, 11
    env = make().env
    space = env.single_observation_space
    buffer = MaskedRolloutBuffer(steps, space, env.single_action_space, device="cpu", n_envs=slots)
    rng = np.random.default_rng(0)
    for _ in range(2):  # a rollout leaves nothing behind for the next
        buffer.reset()
        mask = rng.random((steps, slots)) < 0.4
        number = np.arange(steps * slots, dtype=float).reshape(steps, slots)
        for t in range(steps):
            observation = np.zeros((slots, *space.shape))
            observation[:, 0] = number[t]
            values, logs = torch.tensor(number[t] + 0.25), torch.tensor(number[t] + 0.5)
            reward = rewards(number[t], mask[t])
            buffer.add(observation, np.tile(number[t][:, None], 2), reward, np.zeros(slots), values, logs)
        for _ in range(2):  # epochs
            batches = list(buffer.get(batch_size))
            seen = np.concatenate([batch.observations[:, 0].numpy() for batch in batches])
            np.testing.assert_array_equal(np.sort(seen), np.sort(number[mask]))
            assert len(buffer.values) == len(buffer.returns) == mask.sum()  # what the explained variance is taken of
            for batch in batches:  # and each sample is still in one piece
                np.testing.assert_array_equal(batch.actions[:, 1], batch.observations[:, 0])
                np.testing.assert_array_equal(batch.old_values, batch.observations[:, 0] + 0.25)
                np.testing.assert_array_equal(batch.old_log_prob, batch.observations[:, 0] + 0.5)
            sizes = [len(batch.observations) for batch in batches]
            assert max(sizes) - min(sizes) <= 1
            assert batch_size is None or max(sizes) <= 1.5 * batch_size
            assert len(set(seen)) < 4 or not np.array_equal(seen, np.sort(seen))  # shuffled


def make_buffer(steps, slots, **options):
    env = make().env
    return MaskedRolloutBuffer(
        steps, env.single_observation_space, env.single_action_space, device="cpu", n_envs=slots, **options
    )


def fill(buffer, given, values, starts):
    """Add steps with these rewards and values; what is seen and done does not matter."""
    for reward, value, start in zip(given, values, starts, strict=True):
        slots = len(value)
        zeros = torch.zeros(slots)
        observation = np.zeros((slots, *buffer.obs_shape))
        buffer.add(observation, np.zeros((slots, 2)), reward, start, torch.tensor(value), zeros)


# ------------------------------------------------------------------------------------------- what having left is worth


def test_what_having_left_is_worth_by_hand():
    """A room of 4, half of all is shared; two are inside with values of 3 and 1, so those out expect 0.5 * 4 / 3 = 2/3."""
    buffer = make_buffer(2, 4, gamma=0.9, gae_lambda=1.0)
    acted = np.array([[True, True, True, False], [True, True, False, False]])
    given = [rewards([0.1, 0.2, 1.0, 0.3], acted[0], share=0.5), rewards([0.1, 0.2, 0.4, 0.4], acted[1], share=0.5)]
    fill(buffer, given, [[5.0, 4.0, 2.0, 77.0], [3.0, 1.0, 77.0, 77.0]], np.zeros((2, 4)))
    np.testing.assert_allclose(buffer.values[1], [3.0, 1.0, 2 / 3, 2 / 3])
    # Three inside: 0.5 * 11 / (0.5 * 4 + 0.5 * 3)
    np.testing.assert_allclose(buffer.values[0, 3], 5.5 / 3.5, rtol=1e-6)
    buffer.compute_returns_and_advantage(torch.tensor([2.0, 2.0, 77.0, 77.0]), np.zeros(4))
    last = 2 / 3
    np.testing.assert_allclose(buffer.returns[1], [0.1 + 1.8, 0.2 + 1.8, 0.4 + 0.9 * last, 0.4 + 0.9 * last], rtol=1e-6)
    # The third left in the first step, and is paid what the others earned in the second, and what they expect after.
    assert buffer.returns[0, 2] == pytest.approx(1.0 + 0.9 * (0.4 + 0.9 * last))


def test_those_who_left_before_the_time_limit_expect_what_those_cut_off_do():
    """Two rooms: in the first two of three are cut off, with a value of 2 each; the second goes on."""
    buffer = make_buffer(1, 5, gamma=0.9)
    acted, cut = np.array([True, True, False, True, True]), np.array([True, True, False, False, False])
    given = rewards([0.0, 0.0, 0.5, 0.1, 0.1], acted, ~cut, cut, environment=[0, 0, 0, 1, 1], share=0.5)
    fill(buffer, [given], [[2.0, 2.0, 77.0, 1.0, 1.0]], [np.zeros(5)])
    worth = 0.5 * 4.0 / (0.5 * 3 + 0.5 * 2)
    np.testing.assert_allclose(buffer.rewards[0], [0.0, 0.0, 0.5 + 0.9 * worth, 0.1, 0.1], rtol=1e-6)


def test_without_a_share_having_left_is_worth_nothing():
    buffer = make_buffer(1, 3)
    fill(buffer, [rewards([1.0, 0.0, 0.0], np.array([True, True, False]))], [[2.0, 3.0, 77.0]], [np.zeros(3)])
    np.testing.assert_array_equal(buffer.values[0], [2.0, 3.0, 0.0])


def make_witness():
    """Return a callback that keeps every rollout as it was before the gradient steps take it to pieces."""

    class Witness(BaseCallback):
        def __init__(self):
            super().__init__()
            self.rollouts, self.told = [], []

        def _on_rollout_start(self):
            self.told = []

        def _on_step(self):
            names = ("rewards", "dones", "infos", "new_obs")
            told = {name: np.array(self.locals[name], copy=True) for name in names}
            self.told.append({**told, "slots": self.locals["rewards"].slots})
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

    return Witness()


def test_advantages_are_those_of_hand_made_gae():
    """Value 0 after getting out, value of the last observation after the time limit, next value in between."""
    gamma, lam = 0.9, 0.8
    settings = PPOSettings(n_steps=40, batch_size=64, n_epochs=1, gamma=gamma, gae_lambda=lam, log_std_init=-1.0)
    env = CrowdEnv("room-v0", num_envs=3, autoreset=True, people=6, time_limit=2.9)
    model = make_ppo(env, settings, seed=0)
    with torch.no_grad():
        model.policy.value_net.bias += 3.0  # so that every bootstrap counts
    witness = make_witness()
    model.learn(40 * 18 * 4, callback=witness)
    out, cut, masked = 0, 0, 0
    assert len(witness.rollouts) == 4
    for kept, told in witness.rollouts:
        mask, values = kept["mask"], kept["values"]
        for i in range(18):
            after, value_after = 0.0, kept["last"][i]
            for t in reversed(range(40)):
                if not mask[t, i]:
                    masked += 1
                    assert not kept["observations"][t, i].any() or t == 0 or told[t - 1]["slots"].acted[i]
                    continue
                done, slots = told[t]["dones"][i], told[t]["slots"]
                if done or not slots.inside[i]:
                    late = slots.cut_off[i]
                    after, value_after = 0.0, kept["terminal"][t, i] if late else 0.0
                    out, cut = out + (not late), cut + late
                delta = told[t]["rewards"][i] + gamma * value_after - values[t, i]
                after = delta + gamma * lam * after
                value_after = values[t, i]
                assert kept["advantages"][t, i] == pytest.approx(after, abs=2e-4)
                assert kept["returns"][t, i] == pytest.approx(after + values[t, i], abs=2e-4)
    assert out > 5 and cut > 5 and masked > 20


def test_who_has_left_still_gets_what_the_team_earns_later():
    """With lambda = 1 a return is the discounted sum of one's rewards until the room ends, those after leaving included."""
    gamma, share = 0.9, 0.5
    settings = PPOSettings(n_steps=60, batch_size=64, n_epochs=1, gamma=gamma, gae_lambda=1.0, log_std_init=-1.0)
    reward = RewardWeights({"time": 1.0}, share)
    env = CrowdEnv("room-v0", num_envs=3, autoreset=True, people=6, time_limit=2.9, reward=reward)
    model = make_ppo(env, settings, seed=0)
    with torch.no_grad():
        model.policy.value_net.bias -= 3.0
    witness = make_witness()
    model.learn(60 * 18, callback=witness)
    (kept, told), room = witness.rollouts[0], env.env_of_person

    def left_behind(values, inside, e):
        """What those who have left room ``e`` expect, from the values of those inside."""
        here = inside & (room == e)
        return share * values[here].sum() / ((1 - share) * 6 + share * here.sum())

    went_on, cut, open_ = 0, 0, 0
    for i in range(18):
        last = told[-1]["slots"]
        inside = last.inside[i] and not told[-1]["dones"][i]
        expected = kept["last"][i] if inside else left_behind(kept["last"], last.inside, room[i])
        open_ += 1
        for t in reversed(range(60)):
            slots = told[t]["slots"]
            if told[t]["dones"][i]:
                expected = kept["terminal"][t, i] if slots.cut_off[i] else 0.0
                if slots.cut_off[room == room[i]].any() and not slots.cut_off[i]:
                    expected = left_behind(kept["values"][t], slots.cut_off, room[i])
                    cut += 1
            expected = told[t]["rewards"][i] + gamma * expected
            if kept["mask"][t, i]:
                assert kept["returns"][t, i] == pytest.approx(expected, abs=1e-3)
            else:
                went_on += told[t]["rewards"][i] < 0
    assert went_on > 50 and cut > 3 and open_ == 18


# --------------------------------------------------------------------------------------------------- whose rewards they are


def stepping(env, other=None):
    """Return a callback that steps another environment after every step of the one that is learned in.

    It compares the mask with what was true.
    """

    class Stepping(BaseCallback):
        def __init__(self, env, other=None):
            super().__init__()
            self.env, self.other, self.acted = env, other, []

        def _on_step(self):
            self.acted.append(self.env.acted.copy())
            if self.other is not None:
                self.other.step(np.zeros((self.other.num_envs, 2)))
            return True

        def _on_rollout_end(self):
            np.testing.assert_array_equal(self.model.rollout_buffer.mask, self.acted)
            self.acted = []

    return Stepping(env, other)


def test_a_model_saved_and_loaded_masks_by_the_environment_it_is_given(tmp_path):
    model = make_model(make(2)).learn(40 * 16)  # saved while some are out
    model.save(tmp_path / "model.zip")
    assert (tmp_path / "model.zip").stat().st_size < 400_000  # networks and their optimiser, no environment
    venv, other = make(2), make(2)
    other.reset()
    loaded = PPO.load(tmp_path / "model.zip", env=venv, device="cpu")
    loaded.learn(12 * 16 * 5, callback=stepping(venv, other))
    assert not loaded.rollout_buffer.mask.all()
    moved = make(2)
    loaded.set_env(moved)
    loaded.learn(12 * 16 * 5, callback=stepping(moved, other))
    larger = make(5)
    PPO.load(tmp_path / "model.zip", env=larger, device="cpu").learn(30 * 16 * 5, callback=stepping(larger))


def test_a_model_in_an_environment_of_many_threads_can_be_saved(tmp_path):
    model = make_model(make(4, physics=Physics(threads=2))).learn(24 * 16)
    model.save(tmp_path / "model.zip")
    assert PPO.load(tmp_path / "model.zip", device="cpu").num_timesteps == 24 * 16


@pytest.mark.parametrize("wrap", [VecMonitor, lambda venv: VecNormalize(VecMonitor(venv), norm_obs=False)])
def test_whose_rewards_they_are_is_known_through_wrappers(wrap):
    venv = make(3, reward=RewardWeights(team_share=0.3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        make_model(wrap(venv)).learn(18 * 16 * 3, callback=stepping(venv))


def test_rewards_of_nobody_are_refused():
    class Plain(VecEnvWrapper):
        def reset(self):
            return self.venv.reset()

        def step_wait(self):
            observation, reward, done, infos = self.venv.step_wait()
            return observation, np.array(reward), done, infos

    with pytest.raises(ValueError, match="needs the rewards of a CrowdVecEnv"):
        make_model(Plain(make())).learn(16)
