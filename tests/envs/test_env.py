"""The batch environment: who is told what and when, and the same bits whatever runs beside it."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from evacuations import evacuated
from repository import ROOT

from crowd_env import SCHEMES, CrowdEnv, Population, Uniform, make_scenario
from crowd_env.envs.action import DISCRETE

SMALL = {"people": 12, "time_limit": 6.0}  # short enough that some are out and some are not


def play(env, seeds):
    """Play one episode in every environment and return a hash for each of every byte that it showed.

    The actions of an environment follow from its seed alone: towards the door, but drunk.
    """
    observation, _ = env.reset(seeds)
    sums = [hashlib.sha256(observation[env.people(e)].tobytes()) for e in range(env.num_envs)]
    drawn = [np.random.default_rng([int(seed), 99]) for seed in seeds]
    playing = np.ones(env.num_envs, dtype=bool)
    while playing.any():
        action = np.zeros((env.num_people, 2), dtype=np.float32)
        for e in range(env.num_envs):
            people = env.people(e)
            action[people] = drawn[e].uniform((-0.2, -0.8), (1.0, 0.8), (people.stop - people.start, 2))
        step = env.step(action)
        shown = step.info.get("final_observation", step.observation)
        terms = [values for name, values in sorted(step.info.items()) if name.startswith("reward/")]
        for e in np.flatnonzero(playing):
            for values in (shown, step.reward, step.terminated, step.truncated, *terms):
                sums[e].update(np.ascontiguousarray(values[env.people(e)]).tobytes())
            if step.info["finished"][e]:
                sums[e].update(repr(step.info["metrics"][e]).encode())
        playing &= ~step.info["finished"]
    return [total.hexdigest() for total in sums]


def alone(seed, **options):
    return play(CrowdEnv("room-v0", **{**SMALL, **options}), [seed])[0]


def lone_walker(start=(2.5, 2.5), **options):
    """One pedestrian in the room: 1.5 m/s, relaxation time 0.5 s."""
    people = Population(1, desired_speed=Uniform(1.5, 1.5), relaxation_time=Uniform(0.5, 0.5), starts=np.array([start]))
    env = CrowdEnv(make_scenario("room-v0", population=people), **options)
    env.reset(seed=0)
    return env


# ------------------------------------------------------------------------------------------------------- determinism


@pytest.mark.parametrize("scheme", SCHEMES)
def test_an_episode_is_the_same_to_the_last_byte_for_the_same_seed_and_another_for_another(scheme):
    assert alone(3, physics=scheme) == (once := alone(3, physics=scheme))
    assert once != alone(4, physics=scheme)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_an_environment_is_the_same_alone_and_anywhere_in_a_batch(scheme):
    seeds = [7, 3, 11, 0, 3]
    by_itself = {seed: alone(seed, physics=scheme) for seed in set(seeds)}
    assert play(CrowdEnv("room-v0", num_envs=5, physics=scheme, **SMALL), seeds) == [by_itself[s] for s in seeds]
    assert play(CrowdEnv("room-v0", num_envs=2, physics=scheme, **SMALL), seeds[1:3]) == [by_itself[s] for s in (3, 11)]


def test_an_environment_is_the_same_when_others_around_it_restart_by_themselves():
    env = CrowdEnv("room-v0", num_envs=3, autoreset=True, **SMALL)
    assert play(env, [5, 6, 7]) == [alone(seed) for seed in (5, 6, 7)]


def test_an_environment_is_the_same_after_other_episodes():
    env = CrowdEnv("room-v0", num_envs=2, **SMALL)
    play(env, [8, 9])
    for _ in range(5):  # and in the midst of another
        env.step(None)
    assert play(env, [1, 2]) == [alone(1), alone(2)]


def test_people_who_start_where_they_just_stood_touch_their_neighbors_again():
    """Recorded starts shoulder to shoulder, and an episode before in which nobody moved."""
    x, y = np.meshgrid(np.arange(1.0, 3.1, 0.402), np.arange(1.0, 3.1, 0.402))
    starts = np.column_stack([x.ravel(), y.ravel()])
    people = Population(len(starts), radius=Uniform(0.2, 0.2), starts=starts)
    fresh, used = (CrowdEnv(make_scenario("room-v0", population=people)) for _ in range(2))
    used.reset([1])
    used.step(np.zeros((len(starts), 2)))
    for env in (fresh, used):
        env.reset([2])
        for _ in range(3):
            env.step(None)
        assert env.simulation.results.impulse_magnitude.any()
    np.testing.assert_array_equal(used.simulation.state.position, fresh.simulation.state.position)


def test_environments_of_different_places_and_sizes_are_the_same_alone_and_side_by_side():
    places = [make_scenario("room-v0", **SMALL), make_scenario("room-v0", side=4.0, people=5, time_limit=4.0)]
    env = CrowdEnv(places, num_envs=3)
    assert np.diff(env.env_start).tolist() == [12, 5, 12]
    assert play(env, [1, 1, 2]) == [play(CrowdEnv(places[k]), [seed])[0] for k, seed in ((0, 1), (1, 1), (0, 2))]


@pytest.mark.more
def test_another_process_gets_the_same_bytes():
    code = "from test_env import alone; print(alone(3))"
    where = {"PYTHONPATH": os.pathsep.join(str(path) for path in (Path(__file__).parent, ROOT / "tests", ROOT))}
    told = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **where, "PYTHONHASHSEED": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split()[-1] == alone(3)


def test_one_seed_gives_every_environment_its_own_draw_whatever_their_number():
    few, many = (CrowdEnv("room-v0", num_envs=count).reset(seed=5)[0] for count in (3, 6))
    np.testing.assert_array_equal(few, many[:60])
    rooms = few.reshape(3, 20, -1)
    assert not np.array_equal(rooms[0], rooms[1]) and not np.array_equal(rooms[1], rooms[2])
    np.testing.assert_array_equal(rooms[0], CrowdEnv("room-v0").reset([5])[0])


def test_without_a_seed_the_series_goes_on_and_is_fixed_by_the_first_seed():
    def series():
        env = CrowdEnv("room-v0")
        return [env.reset(seed=1)[0], env.reset()[0], env.reset()[0]]

    first, again = series(), series()
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], first[1]) and not np.array_equal(first[1], first[2])


def test_a_mask_restarts_only_where_it_is_true():
    env = CrowdEnv("room-v0", num_envs=3)
    env.reset([1, 2, 3])
    for _ in range(10):
        observation = env.step(None).observation
    masked, _ = env.reset([7, 8, 9], mask=[False, True, False])
    others = env.active & ((np.arange(60) < 20) | (np.arange(60) >= 40))
    assert 20 < others.sum() < 40  # some are out already
    np.testing.assert_array_equal(masked[others], observation[others])
    np.testing.assert_array_equal(masked[20:40], CrowdEnv("room-v0").reset([8])[0])
    np.testing.assert_allclose(env.simulation.state.time, [1.0, 0.0, 1.0])


def test_a_restart_by_itself_is_a_restart_by_hand():
    by_itself = CrowdEnv("room-v0", num_envs=3, autoreset=True, **SMALL)
    by_hand = CrowdEnv("room-v0", num_envs=3, **SMALL)
    np.testing.assert_array_equal(by_itself.reset(seed=4)[0], by_hand.reset(seed=4)[0])
    restarts = 0
    for _ in range(150):
        one, other = by_itself.step(None), by_hand.step(None)
        expected, ended = other.observation, other.info["finished"]
        np.testing.assert_array_equal(one.info["finished"], ended)
        if ended.any():
            np.testing.assert_array_equal(one.info["final_observation"], other.observation)
            fresh, _ = by_hand.reset(mask=ended)
            rows = ended[by_hand.env_of_person]
            expected = np.where(rows[:, None], fresh, other.observation)
            restarts += ended.sum()
        else:
            assert "final_observation" not in one.info
        np.testing.assert_array_equal(one.observation, expected)
        np.testing.assert_array_equal(one.reward, other.reward)
    assert restarts >= 6


# --------------------------------------------------------------------------------------------- beginnings and endings


@pytest.mark.parametrize("scheme", SCHEMES)
def test_everyone_ends_exactly_once_and_observations_stay_in_their_space(scheme):
    env = CrowdEnv("room-v0", num_envs=4, physics=scheme, people=20, time_limit=6.0)
    observation, _ = env.reset(seed=1)
    rng = np.random.default_rng(0)
    terminated, truncated, finished = np.zeros(80, int), np.zeros(80, int), np.zeros(4, int)
    space = env.single_observation_space
    steps = 0
    while not env.finished.all():
        assert observation.dtype == np.float32
        assert all(space.contains(row) for row in observation)
        inside = env.active.copy()
        step = env.step(rng.uniform((-0.2, -0.5), (1.0, 0.5), (80, 2)))
        observation = step.observation
        steps += 1
        assert not (step.terminated & step.truncated).any()
        assert not (step.terminated | step.truncated)[~inside].any()
        assert not observation[~inside].any() and not step.reward[~inside].any()
        assert observation[inside].any(axis=1).all()  # the last one is shown, too
        np.testing.assert_array_equal(env.active, inside & ~step.terminated & ~step.truncated)
        terminated += step.terminated
        truncated += step.truncated
        finished += step.info["finished"]
        for e, metrics in step.info["metrics"].items():
            assert metrics.unfinished == truncated[env.people(e)].sum()
    assert (terminated + truncated == 1).all()
    assert (finished == 1).all()
    assert terminated.any() and truncated.any()
    assert steps == 60
    left = np.isfinite(env.simulation.state.exit_time)
    np.testing.assert_array_equal(left, terminated == 1)


def test_nothing_happens_after_the_end():
    env = evacuated("room-v0", num_envs=2, people=3, time_limit=1.0)
    before = env.simulation.state.copy()
    step = env.step(None)
    assert not step.observation.any() and not step.reward.any()
    assert not step.terminated.any() and not step.truncated.any() and not step.info["finished"].any()
    for old, new in zip(before, env.simulation.state, strict=True):
        np.testing.assert_array_equal(old, new)


def test_the_time_limit_stands_still_people_out():
    env = CrowdEnv("room-v0", num_envs=2, time_limit=1.5)
    env.reset(seed=0)
    for k in range(1, 16):
        step = env.step(np.zeros((40, 2)))
        assert step.truncated.all() == step.truncated.any() == step.info["finished"].all() == (k == 15)
    assert [env.metrics(e).unfinished for e in (0, 1)] == [20, 20]


def test_metrics_are_those_of_the_exit_times_seen():
    env = CrowdEnv("room-v0", num_envs=2)
    env.reset(seed=2)
    clock, crossing, impulse = 0.0, np.full(40, np.nan), np.zeros(40)
    while not env.finished.all():
        step = env.step(None)
        crossing[step.terminated] = clock - step.info["reward/time"][step.terminated]
        impulse -= step.info["reward/contact"] * env.simulation.bodies.mass
        clock += env.decision_dt
    for e in range(2):
        metrics, mine = env.metrics(e), env.people(e)
        assert metrics.evacuation_time == pytest.approx(crossing[mine].max())
        assert metrics.mean_exit_time == pytest.approx(crossing[mine].mean())
        assert metrics.contact_impulse == pytest.approx(impulse[mine].mean())
        assert metrics.unfinished == 0


# ----------------------------------------------------------------------------------------------------------- actions


@pytest.mark.parametrize("scheme", SCHEMES)
def test_no_action_is_the_action_to_walk_the_shortest_path_bit_for_bit(scheme):
    envs = [CrowdEnv("room-v0", num_envs=2, physics=scheme) for _ in range(2)]
    straight = np.tile(np.float32([1, 0]), (40, 1))
    for env in envs:
        env.reset(seed=3)
    for _ in range(60):
        rule, asked = envs[0].step(None), envs[1].step(straight)
        np.testing.assert_array_equal(rule.observation, asked.observation)
        np.testing.assert_array_equal(rule.reward, asked.reward)
    for one, other in zip(*(env.simulation.state for env in envs), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("frame", ["path", "world"])
def test_who_follows_the_rule_need_not_have_an_action(frame):
    envs = [CrowdEnv("room-v0", action={"name": "continuous", "frame": frame}) for _ in range(2)]
    rule = np.arange(20) % 2 == 0
    rng = np.random.default_rng(0)
    for env in envs:
        env.reset(seed=3)
    for _ in range(40):
        action = rng.uniform(-1, 1, (20, 2))
        action[rule] = np.nan
        first = envs[0].step(action, rule)
        # the same by hand: the rule asks for the direction of the path, anew at every physics step
        command = np.where(rule[:, None], (1.0, 0.0), action)
        command /= np.maximum(np.hypot(*command.T), 1.0)[:, None]
        envs[1].simulation.advance(command, relative=rule | (frame == "path"), n_substeps=10)
        np.testing.assert_array_equal(envs[0].simulation.state.position, envs[1].simulation.state.position)
    assert first.observation.any()


@looped("frame", ["path", "world"])
@looped("k", range(9))
def test_each_discrete_action_does_what_it_says(k, frame):
    start = np.array([2.5, 4.0])
    env = lone_walker(start, action={"name": "discrete", "frame": frame}, observation={"terms": ["direction"]})
    ahead = env.reset(seed=0)[0][0, env.layout["direction"]]
    env.step([k])
    moved = env.simulation.state.position[0] - start
    if k == 8:
        np.testing.assert_array_equal(moved, 0.0)
        return
    assert ahead[1] < -0.3  # the shortest path is not along x here
    first_axis = np.arctan2(ahead[1], ahead[0]) if frame == "path" else 0.0
    turn = np.arctan2(moved[1], moved[0]) - first_axis - k * np.pi / 4
    assert abs((turn + np.pi) % (2 * np.pi) - np.pi) < (0.02 if frame == "path" else 1e-9)


def test_the_speed_wanted_is_the_length_of_the_action_times_the_desired_speed():
    """dv/dt = (v_d - v) / tau in steps of dt: v_n = v_d (1 - (1 - dt / tau)^n)."""
    for action, wanted in [((0.5, 0.0), (0.5, 0.0)), ((3.0, -4.0), (0.6, -0.8)), ((0.0, 1.0), (0.0, 1.0))]:
        env = lone_walker(action={"name": "continuous", "frame": "world"})
        env.step([action])
        expected = 1.5 * np.array(wanted) * (1 - (1 - 0.01 / 0.5) ** 10)
        np.testing.assert_allclose(env.simulation.state.velocity[0], expected, atol=1e-12)


def test_discrete_actions_are_eight_directions_and_standing():
    np.testing.assert_allclose(np.hypot(*DISCRETE[:8].T), 1.0)
    np.testing.assert_array_equal(DISCRETE[8], 0.0)


def test_actions_of_those_who_are_out_are_ignored():
    def positions(garbage):
        env = CrowdEnv("room-v0", people=8)
        env.reset(seed=0)
        while not env.finished.all():
            action = np.where(env.active[:, None], (1.0, 0.0), garbage)
            env.step(action)
        return env.simulation.state.position

    np.testing.assert_array_equal(positions(0.0), positions(np.nan))
