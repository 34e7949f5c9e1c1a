"""Normalization by the rows of people inside."""

import numpy as np
import pytest
from late import late

from crowd_env import CrowdEnv, GeneratedCrowds

PPO = late("stable_baselines3", "PPO")
VecMonitor, DummyVecEnv = late("stable_baselines3.common.vec_env", "VecMonitor", "DummyVecEnv")
MixedEnv = late("crowd_env.agents.mixed", "MixedEnv")
CrowdVecEnv, MaskedRolloutBuffer, MaskedVecNormalize, VectorVecEnv = late(
    "crowd_env.envs.adapters.sb3", "CrowdVecEnv", "MaskedRolloutBuffer", "MaskedVecNormalize", "VectorVecEnv"
)
GAMMA = 0.9
ROOM = {"num_envs": 2, "people": 6, "time_limit": 4.0, "physics": "dem", "autoreset": True}
BATCHES = {
    "arrays": lambda: CrowdEnv("room-v0", **ROOM),
    "shared": lambda: CrowdEnv("room-v0", **ROOM, reward={"weights": {"time": 1.0}, "team_share": 0.5}),
    "mixed": lambda: MixedEnv("room-v0", **ROOM, share=0.5),
    "generated": lambda: GeneratedCrowds(2, people=40, seeds=1000),
}


def normalized(name="arrays", **settings):
    return MaskedVecNormalize(VecMonitor(CrowdVecEnv(BATCHES[name]())), gamma=GAMMA, **settings)


def act(venv, rng):
    return rng.uniform((0.2, -0.5), (1.0, 0.5), (venv.num_envs, 2)).astype(np.float32)


@pytest.mark.parametrize("name", [*list(BATCHES)[:3], pytest.param("generated", marks=pytest.mark.more)])
def test_mean_and_deviation_are_of_people_inside(name):
    venv, rng = normalized(name, clip_obs=1e9, clip_reward=1e9), np.random.default_rng(0)
    env = venv.unwrapped.env
    venv.seed(0)
    venv.reset()
    rows = [venv.get_original_obs()[env.active & env.learned]]
    returns, counted, out = np.zeros(venv.num_envs), [], 0
    for _ in range(60):
        acted = env.active & env.learned
        _, _, done, _ = venv.step(act(venv, rng))
        inside = env.active & env.learned
        rows.append(venv.get_original_obs()[inside])
        returns = GAMMA * returns + np.asarray(venv.get_original_reward())
        counted.append(returns[acted])
        returns[done] = 0.0
        out += (~inside).sum()
    every, earned = np.concatenate(rows), np.concatenate(counted)
    assert out > 100
    np.testing.assert_allclose(venv.obs_rms.mean, every.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(venv.obs_rms.var, every.var(axis=0), atol=1e-5)
    np.testing.assert_allclose([venv.ret_rms.mean, venv.ret_rms.var], [earned.mean(), earned.var()], atol=1e-5)
    seen = venv.normalize_obs(every)
    constant = every.std(axis=0) < 1e-3  # nothing to scale
    np.testing.assert_allclose(seen[:, ~constant].mean(axis=0), 0.0, atol=1e-2)
    np.testing.assert_allclose(seen[:, ~constant].std(axis=0), 1.0, atol=1e-2)


def test_it_is_saved_and_loaded_as_any_other(tmp_path):
    venv = normalized()
    venv.seed(0)
    venv.reset()
    for _ in range(5):
        venv.step(np.ones((12, 2), np.float32))
    venv.save(tmp_path / "statistics.pkl")
    again = MaskedVecNormalize.load(tmp_path / "statistics.pkl", CrowdVecEnv(BATCHES["arrays"]()))
    assert isinstance(again, MaskedVecNormalize)
    np.testing.assert_array_equal(again.obs_rms.mean, venv.obs_rms.mean)
    again.training = False
    again.reset()
    again.step(np.ones((12, 2), np.float32))
    assert again.obs_rms.count == venv.obs_rms.count and again.ret_rms.count == venv.ret_rms.count


def test_a_policy_learns_on_it():
    model = PPO("MlpPolicy", normalized(), n_steps=8, batch_size=48, rollout_buffer_class=MaskedRolloutBuffer)
    model.learn(2 * 12 * 8)
    assert 12 < model.env.obs_rms.count < 192 + 13


def test_it_goes_back_to_a_checkpoint():
    venv, rng = normalized(), np.random.default_rng(0)
    venv.seed(0)
    venv.reset()
    venv.step(act(venv, rng))
    moment, actions = venv.checkpoint(), [act(venv, rng) for _ in range(50)]
    told = [venv.step(action)[:3] for action in actions]
    venv.restore(moment)
    for action, expected in zip(actions, told, strict=True):
        for one, other in zip(venv.step(action)[:3], expected, strict=True):
            np.testing.assert_array_equal(one, other)


def test_another_environment_is_refused():
    import gymnasium

    with pytest.raises(ValueError, match=r"^MaskedVecNormalize needs a CrowdVecEnv, not DummyVecEnv$"):
        MaskedVecNormalize(DummyVecEnv([lambda: gymnasium.make("CartPole-v1")]))


def test_options_of_a_reset_are_refused_where_they_mean_nothing():
    venv = CrowdVecEnv(BATCHES["arrays"]())
    venv.set_options([{}] * 12)
    for options in ({"scenario": "room-v0"}, [{"scenario": "room-v0"}] * 12):
        with pytest.raises(ValueError, match=r"^unknown reset option 'scenario'; known: none"):
            venv.set_options(options)
