"""One controller for everybody: Gymnasium's Env, and many rooms as its VectorEnv."""

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from cases import looped
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from repository import ROOT

import crowd_env
from crowd_env import CrowdEnv, CrowdGymEnv, CrowdVectorEnv, make_scenario, make_vec
from crowd_env.envs.reward import REWARDS

WORLD = {"name": "continuous", "frame": "world"}
SMALL = {"people": 6, "time_limit": 4.0}


# ---------------------------------------------------------------------------------------------------------- one room


@pytest.mark.parametrize("options", [{}, {"action": "discrete"}, {"action": WORLD}, {"physics": "dem"}])
def test_gymnasium_accepts_it(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*render.*|.*unwrapped.*|.*spec.*")
        check_env(gymnasium.make("crowd_env/room-v0", **SMALL, **options).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("options", [{}, {"action": "discrete"}])
def test_stable_baselines3_accepts_it(options):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(CrowdGymEnv("room-v0", **SMALL, **options))


def test_its_rows_are_those_of_the_batch_environment_and_its_reward_their_mean():
    env, batch = CrowdGymEnv("room-v0", **SMALL), CrowdEnv("room-v0", **SMALL)
    observation, info = env.reset(seed=3)
    np.testing.assert_array_equal(observation, batch.reset([3])[0])
    rng = np.random.default_rng(0)
    done = False
    while not done:
        action = rng.uniform((0, -0.5), (1, 0.5), (6, 2)).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        step = batch.step(action)
        np.testing.assert_array_equal(observation, step.observation)
        np.testing.assert_array_equal(info["active"], batch.active)
        assert reward == pytest.approx(step.reward.mean())
        assert terminated == (step.info["finished"][0] and not step.truncated.any())
        assert truncated == step.truncated.any()
        done = terminated or truncated
    assert type(reward) is float and type(terminated) is type(truncated) is bool


def test_it_ends_terminated_when_all_are_out_and_truncated_at_the_limit():
    def end(action, **options):
        env = CrowdGymEnv("room-v0", **options)
        env.reset(seed=0)
        while True:
            _, _, terminated, truncated, info = env.step(action)
            if terminated or truncated:
                assert not info["active"].any()
                return terminated, truncated

    assert end(None, people=4) == (True, False)
    assert end(np.zeros((4, 2)), people=4, time_limit=1.0) == (False, True)


def test_infos_are_rows_of_the_people_and_numbers():
    env = CrowdGymEnv("room-v0", **SMALL)
    _, info = env.reset(seed=1)
    assert set(info) == {"active"} and info["active"].all()
    over = False
    while not over:
        terms = {f"reward/{name}" for name in REWARDS}
        _, _, terminated, truncated, info = env.step(None)
        over = terminated or truncated
        assert set(info) == {*terms, "reward", "active", "diagnostics", *(["metrics", "score"] if over else [])}
        assert all(info[name].shape == (6,) for name in (*terms, "active"))
        assert {type(value) for value in info["diagnostics"].values()} == {int, float}
    assert repr(info["metrics"]) == repr(env.env.metrics(0)._asdict())


def test_one_seed_fixes_a_whole_series_of_episodes():
    def series(seed):
        env = CrowdGymEnv("room-v0", **SMALL)
        return [env.reset(seed=seed)[0], env.reset()[0], env.reset()[0]]

    first = series(5)
    np.testing.assert_array_equal(first, series(5))
    assert not np.array_equal(first[0], first[1]) and not np.array_equal(first[1], first[2])
    assert not np.array_equal(first[1], series(6)[1])


def test_it_is_registered():
    env = gymnasium.make("crowd_env/room-v0", people=4)
    assert env.observation_space.shape == (4, env.unwrapped.env.layout.size)
    np.testing.assert_array_equal(env.reset(seed=0)[0], CrowdGymEnv("room-v0", people=4).reset(seed=0)[0])


@pytest.mark.more
def test_gymnasium_finds_it_by_itself_from_the_name_of_the_package():
    code = "import gymnasium; print(gymnasium.make('crowd_env:crowd_env/room-v0').reset(seed=0)[0].shape)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert told.stdout.strip() == "(20, 46)"


def test_registering_twice_changes_nothing():
    before = dict(gymnasium.registry)
    crowd_env.register()
    assert dict(gymnasium.registry) == before


def test_names_are_lower_case_and_no_two_look_alike():
    names = [name for name in gymnasium.registry if name.startswith("crowd_env/")]
    assert {"crowd_env/room-v0", "crowd_env/routing-v0", "crowd_env/footbridge-gate-v0"} <= {*names}
    assert [name for name in names if name != name.lower()] == []


@looped(
    "options,words",
    [
        ({"render_mode": "human"}, "human.*rgb_array"),
    ],
)
def test_what_belongs_to_a_batch_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        CrowdGymEnv("room-v0", **options)


# --------------------------------------------------------------------------------------------------------- many rooms


def test_make_vec_gives_the_native_batch():
    env = gymnasium.make_vec("crowd_env/room-v0", num_envs=3, **SMALL)
    assert isinstance(env.unwrapped, CrowdVectorEnv)
    assert isinstance(make_vec("room-v0", 2), CrowdVectorEnv)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.observation_space.shape == (3, 6, 46) and env.action_space.shape == (3, 6, 2)
    observation, info = env.reset(seed=1)
    assert env.observation_space.contains(observation) and info["active"].all()
    np.testing.assert_array_equal(observation.reshape(18, -1), CrowdEnv("room-v0", num_envs=3, **SMALL).reset(1)[0])


def test_rooms_of_different_sizes_do_not_make_a_batch_here():
    with pytest.raises(ValueError, match="same number of people"):
        make_vec([make_scenario("room-v0"), make_scenario("room-v0", people=3)], 2)
    with pytest.raises(ValueError, match="unknown render_mode 'human'; known: None, rgb_array"):
        make_vec("room-v0", 2, render_mode="human")


# --------------------------------------------------------------------------------------------------------- rendering


def test_a_frame_shows_the_room():
    env = gymnasium.make("crowd_env/room-v0", people=3, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.ndim == 3 and frame.shape[2] == 3 and frame.dtype == np.uint8
    for _ in range(10):
        env.step(np.tile(np.float32([1, 0]), (3, 1)))
    assert not np.array_equal(env.render(), frame)
    env.close()


def test_frames_of_a_batch_are_those_of_its_rooms():
    forward = np.tile(np.float32([1, 0]), (3, 1))
    rooms = make_vec("room-v0", 2, people=3, render_mode="rgb_array")
    rooms.reset(seed=[4, 5])
    rooms.step(np.stack([forward, forward]))
    frames = rooms.render()
    for seed, frame in zip((4, 5), frames, strict=True):
        room = gymnasium.make("crowd_env/room-v0", people=3, render_mode="rgb_array")
        room.reset(seed=seed)
        room.step(forward)
        np.testing.assert_array_equal(room.render(), frame)
    assert make_vec("room-v0", 2, people=3).render() is None
    places = make_vec(
        [make_scenario("room-v0", people=3), make_scenario("bottleneck-v0", people=3)], 3, render_mode="rgb_array"
    )
    places.reset(seed=0)
    assert len({frame.shape for frame in places.render()}) == 1
    assert places.metadata["render_fps"] == 10
