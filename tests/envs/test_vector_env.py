"""Many environments in one array, as Gymnasium's own batches are: infos, restarts and what is refused."""

import warnings

import gymnasium
import numpy as np
import pytest
from cases import looped
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

from crowd_env import FULL_SPEED, TABLE_4, CrowdGymEnv, CrowdVectorEnv, EpisodeMetrics, Geometry, Population, Scenario
from crowd_env.envs.routing.env import RoutingEnv, RoutingVectorEnv
from crowd_env.geometry.geometry import box

MODES = list(AutoresetMode)
ROOMS = 3


def hall():
    """8 x 6 m with an exit of 1 m in each short wall, 6 people."""
    exits = {"west": [(0, 2.5), (0, 3.5)], "east": [(8, 2.5), (8, 3.5)]}
    geometry = Geometry.from_polygon(box(0, 0, 8, 6), exits=exits)
    return Scenario("hall", geometry, Population(6, **TABLE_4), 8.0, **FULL_SPEED)


def room(**options):
    return {"scenario": "room-v0", "people": 5, "time_limit": 4.0, **options}


def one(kind):
    """Return an environment of its own and the way to make a batch of them."""
    if kind == "crowd":
        return CrowdGymEnv(**room()), lambda count, **options: CrowdVectorEnv(num_envs=count, **room(**options))
    scenario = hall()
    return (
        RoutingEnv(scenario, interval=1.0, grid=(2, 1)),
        lambda count, **options: RoutingVectorEnv(scenario, num_envs=count, interval=1.0, grid=(2, 1), **options),
    )


def actions(kind, rng, count=ROOMS):
    """Return random actions; the first environment ends before the others."""
    if kind == "crowd":
        chosen = rng.uniform((0, -0.4), (1, 0.4), (count, 5, 2)).astype(np.float32)
        chosen[0] = (1.0, 0.0)
    else:
        chosen = rng.integers(0, 2, (count, 2))
        chosen[0] = (0, 1)
    return chosen


def told(env, info):
    """Return the infos of each environment as Gymnasium reads them."""
    return wrappers.DictInfoToList(env)._convert_info_to_list(info)


def assert_same(one, other, where=""):
    assert type(one) is type(other) or np.isscalar(one), where
    if isinstance(one, dict):
        assert set(one) == set(other), where
        for name in one:
            assert_same(one[name], other[name], f"{where} {name}")
    elif isinstance(one, list):
        for a, b in zip(one, other, strict=True):
            assert_same(a, b, where)
    else:
        np.testing.assert_array_equal(one, other, err_msg=where)


# ------------------------------------------------------------------------------------------------------------- infos


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_it_says_what_gymnasiums_own_batch_says(kind, mode):
    """Row by row, until a row draws new people by itself; without that, over several episodes."""
    env = one(kind)[1](ROOMS, autoreset_mode=mode)
    other = SyncVectorEnv([lambda: one(kind)[0]] * ROOMS, autoreset_mode=mode)
    assert env.metadata["autoreset_mode"] is other.metadata["autoreset_mode"] is mode
    (rows, info), (other_rows, other_info) = env.reset(seed=[4, 5, 6]), other.reset(seed=[4, 5, 6])
    np.testing.assert_array_equal(rows, other_rows)
    assert_same(told(env, info), told(other, other_info))
    rng, alike, ended = np.random.default_rng(0), np.ones(ROOMS, bool), np.zeros(ROOMS, int)
    while alike.any() and ended.min() < 3:
        action = actions(kind, rng)
        answers, others = env.step(action), other.step(action)
        over = answers[2] | answers[3]
        again = over & (mode is AutoresetMode.SAME_STEP)
        for mine, yours in zip(answers[:4], others[:4], strict=True):
            assert mine.shape == yours.shape
            same = alike & ~again if mine.ndim > 1 else alike
            np.testing.assert_array_equal(mine[same], yours[same])
        for e in np.flatnonzero(alike):
            assert_same(told(env, answers[4])[e], told(other, others[4])[e], f"row {e}")
        ended += over
        if mode is AutoresetMode.DISABLED and over.any():
            seeds = [10 + e + ROOMS * int(ended[e]) for e in range(ROOMS)]
            fresh, others = (batch.reset(seed=seeds, options={"reset_mask": over.copy()}) for batch in (env, other))
            np.testing.assert_array_equal(fresh[0], others[0])
            assert_same(told(env, fresh[1]), told(other, others[1]))
        elif mode is not AutoresetMode.DISABLED:
            alike &= ~over
            if mode is AutoresetMode.NEXT_STEP and over.any():
                break
    assert ended.any()


@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_every_entry_has_a_row_for_each_environment_and_a_mask(kind):
    _, make = one(kind)
    env = make(ROOMS)

    def check(info):
        for name, values in info.items():
            mask = values if name.startswith("_") else info[f"_{name}"]
            assert isinstance(mask, np.ndarray) and mask.shape == (ROOMS,) and mask.dtype == bool, name
            if isinstance(values, dict):
                check(values)
            else:
                assert len(values) == ROOMS, name

    check(env.reset(seed=1)[1])
    rng, ends = np.random.default_rng(0), 0
    while ends < 5:
        observation, _, terminated, truncated, info = env.step(actions(kind, rng))
        check(info)
        over = terminated | truncated
        assert ("final_obs" in info) == ("final_info" in info) == bool(over.any())
        if over.any():
            ends += over.sum()
            np.testing.assert_array_equal(info["_final_obs"], over)
            np.testing.assert_array_equal(info["_final_info"], over)
            metrics = info["final_info"]["metrics"]
            assert [name for name in metrics if not name.startswith("_")] == list(EpisodeMetrics._fields)
            np.testing.assert_array_equal(metrics["_unfinished"], over)
            assert metrics["unfinished"].dtype == int and metrics["max_overlap"].dtype == np.float64
            for e in np.flatnonzero(over):
                assert info["final_obs"][e].shape == observation[e].shape
                assert metrics["unfinished"][e] == 0 or truncated[e]
                assert not np.array_equal(observation[e], info["final_obs"][e])  # the next episode has begun
            if kind == "crowd":
                assert info["active"][over].all()
            else:
                shown = {name: observation[over][:, env.layout[name]] for name in ("time", "inside", "flow")}
                assert (info["inside"][over] == 6).all() and (shown["inside"] == 1).all()
                assert not shown["time"].any() and not shown["flow"].any()
            assert not info["_reward/time" if kind == "crowd" else "_reward/last"][over].any()


# ---------------------------------------------------------------------------------------------- wrappers and clients


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_gymnasiums_episode_statistics_and_lists_of_infos_work(kind, mode):
    _, make = one(kind)
    env = wrappers.DictInfoToList(wrappers.RecordEpisodeStatistics(make(ROOMS, autoreset_mode=mode)))
    env.reset(seed=1)
    rng, total, length, seen = np.random.default_rng(0), np.zeros(ROOMS), np.zeros(ROOMS, int), 0
    waiting = np.zeros(ROOMS, bool)
    while seen < 7:
        _, reward, terminated, truncated, infos = env.step(actions(kind, rng))
        assert not reward[waiting].any() and not (terminated | truncated)[waiting].any()
        total, length = total + reward, length + ~waiting
        over = terminated | truncated
        for e in range(ROOMS):
            assert ("episode" in infos[e]) == over[e]
            if over[e]:
                assert infos[e]["episode"]["r"] == pytest.approx(total[e]) and infos[e]["episode"]["l"] == length[e]
                told_at_the_end = infos[e]["final_info"] if mode is AutoresetMode.SAME_STEP else infos[e]
                assert told_at_the_end["metrics"]["unfinished"] >= 0
        total[over], length[over], seen = 0.0, 0, seen + over.sum()
        if mode is AutoresetMode.DISABLED and over.any():
            infos = env.reset(options={"reset_mask": over.copy()})[1]
            assert [bool(info) for info in infos] == over.tolist()
        waiting = over if mode is AutoresetMode.NEXT_STEP else waiting


@pytest.mark.parametrize("kind", ["crowd", "routing"])
@pytest.mark.parametrize("wrapper", ["NormalizeObservation", "FlattenObservation", "NormalizeReward"])
def test_gymnasiums_transforming_wrappers_work(kind, wrapper):
    env = getattr(wrappers, wrapper)(one(kind)[1](ROOMS, autoreset_mode="NextStep"))
    env.reset(seed=0)
    rng, ends = np.random.default_rng(0), 0
    while ends < 4:
        observation, reward, terminated, truncated, _ = env.step(actions(kind, rng))
        assert env.observation_space.contains(observation) and np.isfinite(reward).all()
        ends += (terminated | truncated).sum()
    assert observation.ndim == (2 if wrapper == "FlattenObservation" or kind == "routing" else 3)


def test_a_loop_in_the_manner_of_cleanrl_finds_the_ends_of_episodes():
    """Values of last observations are bootstrapped from `final_obs`, returns are logged from `final_info` or `episode`."""
    envs = wrappers.RecordEpisodeStatistics(gymnasium.make_vec("crowd_env/room-v0", num_envs=4, **room()))
    envs.reset(seed=1)
    returns, times, bootstrapped = [], [], 0
    for _ in range(90):
        action = np.tile(np.float32([1.0, 0.0]), (4, 5, 1))
        next_observation, _, terminations, truncations, infos = envs.step(action)
        real_next_observation = next_observation.copy()
        for k, truncated in enumerate(truncations):
            if truncated:
                real_next_observation[k] = infos["final_obs"][k]
                bootstrapped += 1
        if "final_info" in infos:
            done = infos["_final_info"]
            np.testing.assert_array_equal(done, terminations | truncations)
            times += infos["final_info"]["metrics"]["mean_exit_time"][done].tolist()
        if "episode" in infos:
            returns += infos["episode"]["r"][infos["_episode"]].tolist()
    assert len(returns) == len(times) >= 8 and np.isfinite(times).all() and np.isfinite(returns).all()


# ----------------------------------------------------------------------------------------------------------- restarts


@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_next_step_restarts_a_row_one_step_later_and_disturbs_no_other(kind):
    _, make = one(kind)
    env, twin = make(ROOMS, autoreset_mode="NextStep"), make(ROOMS)
    np.testing.assert_array_equal(env.reset(seed=2)[0], twin.reset(seed=2)[0])
    rng, over = np.random.default_rng(0), np.zeros(ROOMS, bool)
    while not over.any():
        action = actions(kind, rng)
        rows, reward, terminated, truncated, info = env.step(action)
        twins = twin.step(action)
        over = terminated | truncated
    assert not over.all()  # or there is no other
    first = twins[0]
    for e in np.flatnonzero(over):
        np.testing.assert_array_equal(rows[e], twins[4]["final_obs"][e])
    rows, reward, terminated, truncated, info = env.step(actions(kind, rng))
    np.testing.assert_array_equal(rows[over], first[over])  # the same draw
    assert not reward[over].any() and not terminated[over].any() and not truncated[over].any()
    assert "final_obs" not in info and not info["_diagnostics" if kind == "crowd" else "_reward/last"][over].any()


@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_without_autoreset_a_row_that_has_ended_must_be_reset_by_mask(kind):
    _, make = one(kind)
    env = make(ROOMS, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=2)
    rng, over = np.random.default_rng(0), np.zeros(ROOMS, bool)
    while not over.any():
        rows, _, terminated, truncated, info = env.step(actions(kind, rng))
        over = terminated | truncated
    assert (info["_metrics"] == over).all() and "final_obs" not in info
    e = int(np.flatnonzero(over)[0])
    with pytest.raises(ValueError, match=f"environment {e} has ended; reset it first.*reset_mask"):
        env.step(actions(kind, rng))
    options = {"reset_mask": over}
    fresh, _ = env.reset(options=options)
    assert options == {"reset_mask": over}
    np.testing.assert_array_equal(fresh[~over], rows[~over])
    assert not (fresh[over] == rows[over]).all()
    env.step(actions(kind, rng))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_a_partial_reset_leaves_the_others_as_they_are(kind, mode):
    _, make = one(kind)
    env, untouched = make(ROOMS, autoreset_mode=mode), make(ROOMS, autoreset_mode=mode)
    rng = np.random.default_rng(0)
    for batch in (env, untouched):
        batch.reset(seed=3)
    for _ in range(2):
        action = actions(kind, rng)
        rows, _, _, _, _ = env.step(action)
        untouched.step(action)
    mask = np.array([False, True, False])
    fresh, info = env.reset(seed=[7, 8, 9], options={"reset_mask": mask})
    np.testing.assert_array_equal(fresh[[0, 2]], rows[[0, 2]])
    single = one(kind)[0]
    np.testing.assert_array_equal(fresh[1], single.reset(seed=8)[0])
    assert all((info[name] == mask).all() for name in info if name.startswith("_"))
    assert set(info) == ({"active", "_active"} if kind == "crowd" else {"inside", "_inside"})
    fresh[:] = 0.0  # what was returned is the caller's
    action = actions(kind, rng)
    rows, reward, *_ = env.step(action)
    others, other_reward, *_ = untouched.step(action)
    np.testing.assert_array_equal(rows[[0, 2]], others[[0, 2]])
    np.testing.assert_array_equal(reward[[0, 2]], other_reward[[0, 2]])
    np.testing.assert_array_equal(rows[1], single.step(action[1])[0])


@looped("kind", ["crowd", "routing"])
@looped(
    ("options", "words"),
    [
        ({"reset_mask": [True, False, True]}, r"reset_mask is \[True.*NumPy array of 3 booleans"),
        ({"reset_mask": np.array([1, 0, 1])}, r"reset_mask is an array.*NumPy array of 3 booleans"),
        ({"reset_mask": np.ones(4, bool)}, "reset_mask is an array.*NumPy array of 3 booleans"),
        ({"reset_mask": np.zeros(3, bool)}, "reset_mask is an array.*at least one True"),
        ({"people": 5}, "unknown reset option 'people'; known: reset_mask"),
        ("all", "options is 'all'; it must be a dictionary"),
    ],
)
def test_options_that_make_no_sense_are_refused(kind, options, words):
    env = one(kind)[1](ROOMS)
    rows, _ = env.reset(seed=1)
    with pytest.raises(ValueError, match=words) as caught:
        env.reset(seed=2, options=options)
    assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(env.reset(seed=1, options={})[0], rows)


@pytest.mark.parametrize(("kind", "known"), [("crowd", "scenario"), ("routing", "none")])
def test_one_environment_knows_few_options(kind, known):
    env = one(kind)[0]
    env.reset(seed=1, options={})
    for name in ("count", "reset_mask"):
        with pytest.raises(ValueError, match=f"unknown reset option '{name}'; known: {known}"):
            env.reset(seed=1, options={name: 1})


@pytest.mark.parametrize("kind", ["crowd", "routing"])
def test_all_are_reset_before_some_are_and_before_a_step(kind):
    env = one(kind)[1](ROOMS)
    with pytest.raises(ValueError, match="reset all environments before some of them"):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(ValueError, match="call reset before the first step"):
        env.step(env.action_space.sample())


@looped("kind", ["crowd", "routing"])
def test_an_unknown_way_of_restarting_is_refused(kind):
    with pytest.raises(ValueError, match="unknown autoreset_mode 'later'; known: NextStep, SameStep, Disabled"):
        one(kind)[1](2, autoreset_mode="later")
    made = {"scenario": hall()} if kind == "routing" else room()
    name = "crowd_env/routing-v0" if kind == "routing" else "crowd_env/room-v0"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make_vec(name, num_envs=2, autoreset_mode="Disabled", **made)
    assert env.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    assert type(env.unwrapped).metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


# ------------------------------------------------------------------------------------------------------------ actions


@looped(
    ("kind", "action", "words"),
    [
        ("crowd", None, r"is None; it must be an array of real numbers of the shape \(3, 5, 2\)"),
        ("crowd", np.zeros((5, 3, 2)), r"has the shape \(5, 3, 2\); it must be \(3, 5, 2\)"),
        ("crowd", np.zeros((15, 2)), r"has the shape \(15, 2\); it must be \(3, 5, 2\)"),
        ("crowd", np.zeros((5, 2)), r"has the shape \(5, 2\)"),
        ("crowd", np.zeros(30), r"has the shape \(30,\)"),
        ("crowd", np.zeros((3, 5, 2), complex), "is an array.*real numbers"),
        ("crowd", [[[0.0, 0.0]] * 5, [[0.0]]], "is .*real numbers"),
        ("crowd", "ahead", "is 'ahead'.*real numbers"),
        ("crowd", {"a": 1}, "is {'a': 1}.*real numbers"),
        ("crowd", np.full((3, 5, 2), np.nan), "must be finite"),
        ("routing", None, r"is None; it must be an array of real numbers of the shape \(3, 2\)"),
        ("routing", np.zeros((2, 3), int), r"has the shape \(2, 3\); it must be \(3, 2\)"),
        ("routing", np.zeros(6, int), r"has the shape \(6,\)"),
        ("routing", np.zeros((3, 2), complex), "is an array.*real numbers"),
        ("routing", np.full((3, 2), "0"), "is an array.*real numbers"),
        ("routing", np.full((3, 2), np.nan), "for region 'cell-0-0' is nan; it must be a whole number from 0 to 1"),
    ],
)
def test_actions_of_a_batch_are_taken_in_their_shape_alone(kind, action, words):
    env = one(kind)[1](3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=rf"actions? .*{words}") as caught:
        env.step(action)
    assert "\n" not in str(caught.value)
    assert ((env.env if kind == "crowd" else env.batch.env).simulation.state.time == 0.0).all()


def test_the_action_of_one_environment_is_taken_in_its_shape_alone():
    env = CrowdGymEnv(**room())
    env.reset(seed=0)
    for action in (np.zeros((2, 5)), np.zeros(10), np.zeros((5, 2), complex), "ahead"):
        with pytest.raises(ValueError, match=r"the action (has the shape|is) .*\(5, 2\)"):
            env.step(action)
    env = one("routing")[0]
    env.reset(seed=0)
    for action in (None, [[0, 0]], [0, 0, 0], 0, [1j, 0]):
        with pytest.raises(ValueError, match=r"the action (has the shape|is) .*\(2,\)"):
            env.step(action)
