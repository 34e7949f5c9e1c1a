"""Stable-baselines3: a slot per pedestrian, whose episode is that of its room; and PPO that learns on them."""

import sys
from types import ModuleType

import numpy as np
import pytest
from late import late

from crowd_env import CrowdEnv, GeneratedCrowds, RewardWeights, make_scenario
from crowd_env.envs.routing.env import RoutingVectorEnv

torch = late("torch")
PPO = late("stable_baselines3", "PPO")
VecMonitor, VecVideoRecorder = late("stable_baselines3.common.vec_env", "VecMonitor", "VecVideoRecorder")
PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
CrowdVecEnv, VectorVecEnv, MaskedRolloutBuffer, vec_env = late(
    "crowd_env.envs.adapters.sb3", "CrowdVecEnv", "VectorVecEnv", "MaskedRolloutBuffer", "vec_env"
)

SMALL = {"people": 6, "time_limit": 4.0}


def make(num_envs=3, **options):
    return CrowdVecEnv(CrowdEnv("room-v0", num_envs=num_envs, autoreset=True, **{**SMALL, **options}))


def walk(rng, slots):
    """Return actions with which some get out before the limit and some do not."""
    return rng.uniform((-0.1, -0.6), (1.0, 0.6), (slots, 2)).astype(np.float32)


# ------------------------------------------------------------------------------------------------------------- slots


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_the_episode_of_a_slot_is_that_of_its_room(share):
    options = {"num_envs": 3, "autoreset": True, "reward": RewardWeights(team_share=share), **SMALL}
    batch = CrowdEnv("room-v0", **options)
    venv = CrowdVecEnv(CrowdEnv("room-v0", **options))
    venv.seed(3)
    np.testing.assert_array_equal(venv.reset(), batch.reset(seed=3)[0])
    rng = np.random.default_rng(0)
    inside, ends, got_out, cut_off, later = np.ones(18, bool), np.zeros(18, int), 0, 0, 0.0
    earned, lasted, stayed = np.zeros(18), np.zeros(18, int), np.zeros(18, int)
    for _ in range(130):
        action = walk(rng, 18)
        observation, reward, done, infos = venv.step(action)
        step = batch.step(action)
        np.testing.assert_array_equal(venv.acted, inside)
        np.testing.assert_array_equal(observation, step.observation)
        np.testing.assert_array_equal(done, step.info["finished"][batch.env_of_person])
        np.testing.assert_array_equal(reward, step.reward.astype(np.float32))
        later += np.abs(reward[~inside]).sum()
        earned += reward
        lasted += 1
        stayed += inside
        final = step.info.get("final_observation", step.observation)
        for i in range(18):
            assert bool(infos[i]) == done[i]
            if done[i]:
                np.testing.assert_array_equal(infos[i]["terminal_observation"], final[i])
                assert infos[i]["terminal_observation"].any() == inside[i]
                assert infos[i]["TimeLimit.truncated"] == step.truncated[i] != infos[i]["is_success"]
                assert infos[i]["episode"] == {"r": pytest.approx(earned[i], abs=1e-4), "l": lasted[i]}
                assert infos[i]["steps_inside"] == stayed[i]
        earned[done], lasted[done], stayed[done] = 0.0, 0, 0
        ends += done
        got_out += step.terminated.sum()
        cut_off += step.truncated.sum()
        inside = (inside & ~step.terminated & ~step.truncated) | done
    assert (ends >= 3).all() and got_out > 10 and cut_off > 3 and (later > 0) == (share > 0)
    assert len(venv.take_finished()) == ends.reshape(3, 6)[:, 0].sum() and venv.take_finished() == []


def test_infos_are_shared_by_nobody():
    venv = make()
    venv.reset()
    infos = venv.step(np.zeros((18, 2)))[3]
    infos[0]["mine"] = True
    assert infos[1:] == [{}] * 17 and venv.step(np.zeros((18, 2)))[3] == [{}] * 18


def test_metrics_that_nobody_takes_are_not_kept_for_ever(monkeypatch):
    monkeypatch.setattr(vec_env, "KEPT_EPISODES", 4)
    venv = make(2, time_limit=0.2)
    venv.reset()
    for _ in range(20):
        venv.step(np.zeros((12, 2)))
    assert len(venv.finished_episodes) == 4 == len(venv.take_finished()) and not venv.finished_episodes


def test_a_seed_of_its_own():
    venv = make()
    venv.seed(5)
    first, second = venv.reset(), venv.reset()
    assert not np.array_equal(first, second)
    venv.seed(5)
    np.testing.assert_array_equal(venv.reset(), first)
    np.testing.assert_array_equal(venv.reset(), second)


def test_it_is_a_vecenv_of_one_slot_per_pedestrian():
    env = CrowdEnv([make_scenario("room-v0", people=4), make_scenario("room-v0", people=7)], num_envs=2, autoreset=True)
    venv = CrowdVecEnv(env)
    assert venv.num_envs == 11 and venv.reset().shape == (11, env.layout.size)
    assert venv.get_attr("decision_dt", [0, 3]) == [0.1, 0.1]
    assert len(venv.env_is_wrapped(VecMonitor)) == 11 and not any(venv.env_is_wrapped(VecMonitor))
    assert venv.env_method("people", 1, indices=0) == [slice(4, 11)]
    with pytest.raises(ValueError, match="autoreset"):
        CrowdVecEnv(CrowdEnv("room-v0"))


def test_the_monitor_of_stable_baselines3_counts_the_same_episodes():
    """Return and length of the second and third episode too: nobody's waiting is counted into the next one."""
    venv, alone = VecMonitor(make(), info_keywords=("steps_inside",)), make()
    for env in (venv, alone):
        env.seed(1)
        env.reset()
    rng = np.random.default_rng(0)
    lengths, inside = [], []
    for _ in range(130):
        action = walk(rng, 18)
        monitored, own = venv.step(action)[3], alone.step(action)[3]
        for one, other in zip(monitored, own, strict=True):
            assert ("episode" in one) == ("episode" in other)
            if "episode" in one:
                assert one["episode"]["l"] == other["episode"]["l"]
                assert one["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-4)
                lengths.append(one["episode"]["l"])
                inside.append(one["episode"]["steps_inside"])
    assert venv.episode_count == len(lengths) >= 3 * 18 and max(lengths) == 40
    assert 10 < np.mean(inside) < np.mean(lengths)


# ----------------------------------------------------------------------------------------------------------- learning


def learned(seed, steps=1000):
    settings = PPOSettings(n_steps=16, batch_size=64, n_epochs=2)
    env = CrowdEnv("room-v0", num_envs=2, autoreset=True, **SMALL)
    return make_ppo(env, settings, seed).learn(steps)


def parameters(model):
    return np.concatenate([value.detach().numpy().ravel() for value in model.policy.parameters()])


@pytest.mark.more
def test_the_same_seed_learns_the_same_and_another_something_else():
    first = parameters(learned(1))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, parameters(learned(1)))
    assert not np.array_equal(first, parameters(learned(2)))
    assert not np.array_equal(first, parameters(learned(1, steps=1)))


@pytest.mark.parametrize(("field", "named"), [("observation", "observations"), ("reward", "advantages")])
def test_what_is_not_finite_is_not_learned_from(field, named, monkeypatch):
    env = CrowdEnv("room-v0", autoreset=True, action="speeds", **SMALL)
    model, step = make_ppo(env, PPOSettings(n_steps=8), seed=0), env.step

    def spoiled(action):
        done = step(action)
        getattr(done, field)[0] = np.nan
        return done

    monkeypatch.setattr(env, "step", spoiled)
    with pytest.raises(ValueError, match=f"{named} of this rollout are not all finite"):
        model.learn(48)
    assert all(torch.isfinite(one).all() for one in model.policy.parameters())


def test_learning_starts_from_the_rule():
    env = CrowdEnv("room-v0", num_envs=1, autoreset=True)
    model = make_ppo(env, PPOSettings(), seed=0)
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    np.testing.assert_allclose(action, np.tile([1.0, 0.0], (20, 1)), atol=0.1)


@pytest.mark.parametrize("action", ["speeds", "speeds-directions", "speeds-exits"])
def test_training_with_choices_of_speed_starts_near_the_rule_and_runs(action):
    venv = make(action=action)
    model = make_ppo(venv.env, PPOSettings(n_steps=16, batch_size=64, n_epochs=1), seed=0)
    rows = torch.as_tensor(venv.reset())
    shares = model.policy.get_distribution(rows).logits.exp().detach().numpy()
    rule = venv.env.action_kind.neutral
    assert (shares.argmax(axis=1) == rule).all()
    others = np.delete(shares, rule, axis=1)
    np.testing.assert_allclose(shares[:, [rule]] / others, np.exp(2.0), rtol=0.2)  # and the others are all tried
    model.learn(600)


def test_plain_ppo_with_discrete_actions_runs_on_it():
    kwargs = {"rollout_buffer_class": MaskedRolloutBuffer, "n_steps": 16, "batch_size": 64, "n_epochs": 1}
    PPO("MlpPolicy", make(action="discrete"), seed=0, device="cpu", **kwargs).learn(600)


@pytest.mark.more
def test_it_learns_not_to_stand_still():
    """A policy that starts at standing still finds the way within seconds: signs and masks are right."""
    env = CrowdEnv("room-v0", num_envs=8, autoreset=True, people=4, time_limit=5.0)
    model = make_ppo(env, PPOSettings(n_steps=32, batch_size=512, n_epochs=5, learning_rate=3e-3), seed=0)
    with torch.no_grad():
        model.policy.action_net.bias.zero_()
    observation = CrowdEnv("room-v0").reset(seed=9)[0]
    before = model.predict(observation, deterministic=True)[0][:, 0].mean()
    model.learn(40_000)
    after = model.predict(observation, deterministic=True)[0][:, 0].mean()
    assert before < 0.2 and after > 0.6


def test_a_recorder_films_all_rooms_side_by_side(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "moviepy", ModuleType("moviepy"))  # writes the file, which this test does without
    env = CrowdVecEnv("room-v0", num_envs=2, people=3, render_mode="rgb_array")
    film = VecVideoRecorder(env, str(tmp_path), lambda step: step == 0, video_length=9)
    film.reset()
    film.step(np.zeros((6, 2), np.float32))
    shown, (one, other) = film.recorded_frames[-1], env.get_images()
    assert shown.shape in ((2 * one.shape[0], one.shape[1], 3), (one.shape[0], 2 * one.shape[1], 3))
    assert film.frames_per_sec == 10 and not np.array_equal(one, other)
    film.recorded_frames.clear()


def test_frames_are_of_a_batch_that_can_be_drawn():
    assert CrowdVecEnv("room-v0", people=3).render_mode is None
    with pytest.raises(ValueError, match="unknown render_mode 'human'"):
        CrowdVecEnv("room-v0", people=3, render_mode="human")
    with pytest.raises(ValueError, match="env is 'GeneratedCrowds'; it must be a CrowdEnv"):
        CrowdVecEnv(GeneratedCrowds(1, people=10), render_mode="rgb_array")
    halls = RoutingVectorEnv("two-exit-hall-v0", 2, people=6, render_mode="rgb_array")
    rooms = VectorVecEnv(halls)
    rooms.reset()
    assert len(rooms.get_images()) == 2 and rooms.metadata["render_fps"] == halls.metadata["render_fps"]
