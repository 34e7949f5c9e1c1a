"""Observations as laws: the same bits whichever way they are computed, and terms of one's own beside the compiled ones."""

import numpy as np
import pytest
from crowds import cluttered

from crowd_env import (
    FULL_SPEED,
    TABLE_4,
    CrowdEnv,
    ObservationLayout,
    ObservationTerm,
    Physics,
    Population,
    RewardTerm,
    RewardWeights,
    Scenario,
    make_scenario,
)
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.envs.observation.layout import TERMS

CLUTTERED = Scenario("cluttered", cluttered(), Population(25, **TABLE_4), 60.0, **FULL_SPEED)
HALL = make_scenario("room-v0", people=300, side=16.0)


@pytest.mark.parametrize("neighbors", [1, *(pytest.param(n, marks=pytest.mark.more) for n in (6, 7)), 32])
@pytest.mark.parametrize("terms", [tuple(TERMS), ("density",), ("neighbors",), ("lead",), ("ahead",), ("queues_seen",)])
def test_all_pairs_and_cells_show_the_same_to_the_last_bit(terms, neighbors):
    env = CrowdEnv([HALL, CLUTTERED], num_envs=3, observation=ObservationLayout(terms, neighbors=neighbors))
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    observer, shows = env.observer, []
    for _ in range(25):
        env.step(rng.uniform((0.2, -0.4), (1.0, 0.4), (env.num_people, 2)))
    for most in (0, 20, 10_000):
        observer._plans = [struct_ref(env.layout.plan(env.num_people, all_pairs=most))]
        shows.append(observer.observe(env.active))
    assert shows[0].any() and not env.active.all()
    np.testing.assert_array_equal(shows[0], shows[1])
    np.testing.assert_array_equal(shows[0], shows[2])


def test_observations_and_rewards_are_the_same_for_any_number_of_threads():
    places = ["room-v0", CLUTTERED, make_scenario("room-v0", people=120, side=9.0)]
    options = {"num_envs": 24, "time_limit": 3.0, "autoreset": True}
    alone, *beside = (CrowdEnv(places, physics=Physics(threads=threads), **options) for threads in (1, 2, 5))
    first = alone.reset(seed=3)[0]
    for env in beside:
        np.testing.assert_array_equal(env.reset(seed=3)[0], first)
    for _ in range(35):
        one = alone.step(None)
        for env in beside:
            other = env.step(None)
            np.testing.assert_array_equal(other.observation, one.observation)
            np.testing.assert_array_equal(other.reward, one.reward)
            np.testing.assert_array_equal(other.terminated | other.truncated, one.terminated | one.truncated)
    assert one.observation.any()


@pytest.mark.parametrize("seed", [0, 1])
def test_who_has_just_restarted_sees_what_a_fresh_environment_shows(seed):
    """The second episode of each environment, restarted by itself amid others, against one that is reset twice."""
    env = CrowdEnv("room-v0", num_envs=5, people=8, autoreset=True)
    env.reset(seed=seed)
    waiting = set(range(5))
    while waiting:
        step = env.step(None)
        for e in np.flatnonzero(step.info["finished"]):
            if e in waiting:
                fresh = CrowdEnv("room-v0", num_envs=5, people=8)
                fresh.reset(seed=seed)
                expected, _ = fresh.reset(mask=np.arange(5) == e)
                np.testing.assert_array_equal(step.observation[env.people(e)], expected[env.people(e)])
                waiting.discard(e)


def test_stood_counts_from_when_one_last_got_nearer_and_knows_nothing_of_the_episode_before():
    layout = ObservationLayout(("stood",))
    env = CrowdEnv([HALL, CLUTTERED], num_envs=3, observation=layout, autoreset=True, time_limit=4.0)
    kept, now, rng = env.reset(seed=0)[0], 0.0, np.random.default_rng(0)
    assert not kept.any()
    least, since = env.observer.view.potential.copy(), np.zeros(env.num_people)
    stands = rng.random(env.num_people) < 0.3
    for step in range(75):
        if step == 20:
            checkpoint, before = env.checkpoint(), (since.copy(), now)
        inside = env.active
        shown = env.step(np.where(stands[:, None], 0.0, rng.uniform((-1.0, -0.4), (1.0, 0.4), (env.num_people, 2))))
        now += env.decision_dt
        if shown.info["finished"].any():  # all at once, at the time limit
            assert not shown.observation.any()
            least, since, now = env.observer.view.potential.copy(), np.zeros(env.num_people), 0.0
            continue
        potential = env.observer.view.potential
        got_on = (potential <= least - 0.1) | (potential >= least + 5.0)
        least[got_on], since[got_on] = potential[got_on], now
        expected = (now - since) / (now - since + 5.0)
        np.testing.assert_allclose(shown.observation[inside, 0], expected[inside], atol=1e-6)
    assert shown.observation.max() > 0.3 and now < 4.0
    env.restore(checkpoint)
    (since, now), inside = before, env.active
    shown = env.step(np.zeros((env.num_people, 2))).observation[inside, 0]
    assert (shown >= (now - since[inside]) / (now - since[inside] + 5.0) - 1e-6).mean() > 0.9


def test_stood_begins_anew_where_one_has_been_led_five_seconds_back():
    env = CrowdEnv(make_scenario("room-v0", people=4, side=20.0), observation=ObservationLayout(("stood",)))
    env.reset(seed=0)
    potential = [env.observer.view.potential.copy()]
    stood = [np.zeros(4)]
    for step in range(90):  # to the exit, and back
        stood.append(env.step(np.tile([1.0 if step < 20 else -1.0, 0.0], (4, 1))).observation[:, 0])
        potential.append(env.observer.view.potential.copy())
    way, stood = np.array(potential), np.array(stood)
    lost = way - np.minimum.accumulate(way)
    back = (lost > 5.1).argmax(axis=0)
    assert (back > 20).sum() >= 2  # the others have a wall behind them
    for person in np.flatnonzero(back):
        begun = back[person]
        assert stood[begun - 12 : begun - 3, person].min() > 0.4 and stood[begun, person] < 0.1


def test_what_was_shown_stays_as_it_was():
    env = CrowdEnv("room-v0", num_envs=2, people=6, autoreset=True)
    kept = [env.reset(seed=0)[0]]
    copies = [kept[0].copy()]
    for _ in range(120):
        step = env.step(None)
        for shown in (step.observation, step.info.get("final_observation"), step.observation[3:5]):
            if shown is not None:
                kept.append(shown)
                copies.append(shown.copy())
    for shown, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(shown, copy)


def speed(view, out):
    """Own speed / 1 m/s."""
    out[:, 0] = np.hypot(*view.state.velocity.T)


def heavy(transition):
    """Own mass / 100 kg."""
    return transition.bodies.mass / 100.0


def test_a_term_of_ones_own_stands_beside_the_compiled_ones():
    layout = ObservationLayout(terms=("velocity", ObservationTerm("speed", 1, speed), "crush"))
    env = CrowdEnv("room-v0", num_envs=3, people=8, autoreset=True, observation=layout)
    env.reset(seed=0)
    restarted = 0
    for _ in range(120):
        inside = env.active.copy()
        step = env.step(None)
        shown = step.info.get("final_observation", step.observation)
        expected = np.hypot(*shown[:, :2].T) * 2.0
        np.testing.assert_allclose(shown[:, 2], np.minimum(expected, 1.0), atol=0.02)  # who is faster is clipped
        assert not shown[~inside].any()
        fresh = step.info["finished"][env.env_of_person]
        assert not step.observation[fresh, 2].any()  # at rest
        restarted += fresh.sum()
    assert restarted > 0


def test_a_reward_of_ones_own_stands_beside_the_compiled_ones():
    env = CrowdEnv("room-v0", reward=RewardWeights({RewardTerm("heavy", heavy): 2.0, "exit": 1.0}))
    env.reset(seed=0)
    for _ in range(50):
        inside = env.active.copy()
        step = env.step(None)
        expected = np.where(inside, env.simulation.bodies.mass / 100.0, 0.0)
        np.testing.assert_array_equal(step.info["reward/heavy"], expected)
        np.testing.assert_allclose(step.reward, 2.0 * expected + step.terminated, atol=1e-12)
