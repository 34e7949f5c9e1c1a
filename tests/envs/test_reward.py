"""Rewards as laws over whole episodes, and what an evacuation is judged by."""

from dataclasses import replace

import numpy as np
import pytest
from evacuations import evacuated

from crowd_env import (
    Cohorts,
    CrowdEnv,
    EpisodeMetrics,
    Geometry,
    Population,
    RewardWeights,
    Scenario,
    Uniform,
    make_scenario,
)
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.envs.metrics import flow_slope, summarise
from crowd_env.envs.reward import REWARDS, RewardFunction, Transition
from crowd_env.geometry.geometry import box

TERMS = tuple(REWARDS)
# Fields of a `Transition` that no term reads.
OF_EPISODE = dict.fromkeys(
    ("truncated", "impulse", "step_start", "time_limit", "blocked_after", "last_exit", "finished", "ended", "coming"),
    np.zeros(1),
)


def episodes(policy, reward=None, *, num_envs=4, **options):
    """Play to the end with actions ``policy(rng, P)``; returns the environment, the steps, and all rewards (T, P)."""
    env = CrowdEnv("room-v0", num_envs=num_envs, reward=reward, **{"time_limit": 12.0, **options})
    env.reset(seed=2)
    rng = np.random.default_rng(0)
    first = env.observer.view.travel_time.copy()
    steps = []
    while not env.finished.all():
        inside = env.active.copy()
        step = env.step(policy(rng, env.num_people))
        steps.append((inside, step, env.simulation.results.impulse_magnitude.copy()))
    return env, first, steps


def reset(env):
    env.reset(seed=0)
    return env


def drunk(rng, people):
    return rng.uniform((-0.3, -0.9), (1.0, 0.9), (people, 2))


def rule(rng, people):
    return None


def backwards(rng, people):
    return np.tile([-0.5, 0.2], (people, 1))


def total(steps, term):
    return sum(step.info[f"reward/{term}"] for _, step, _ in steps)


# ------------------------------------------------------------------------------------------------------------- terms


@pytest.mark.parametrize("scheme", ["dem", "nsm2"])
@pytest.mark.parametrize("policy", [rule, drunk])
def test_progress_sums_to_the_travel_time_from_the_start_whatever_the_way(policy, scheme):
    env, first, steps = episodes(policy, physics=scheme)
    out = np.isfinite(env.simulation.state.exit_time)
    assert out.sum() > 5 and (policy is rule or not out.all())
    np.testing.assert_allclose(total(steps, "progress")[out], first[out], atol=1e-9)
    left = env.observer.view.travel_time[~out]
    np.testing.assert_allclose(total(steps, "progress")[~out], first[~out] - left, atol=1e-9)


def test_the_first_travel_time_is_the_length_of_the_way_over_the_own_speed():
    env = CrowdEnv("room-v0", action={"name": "continuous", "frame": "world"})
    observation, _ = env.reset(seed=0)
    seen = observation[:, env.layout["travel_time"]][:, 0].astype(float)
    time = 5.0 * seen / (1.0 - seen)
    distance = np.hypot(5.0 - env.simulation.state.position[:, 0], 0.0)
    assert (time * env.simulation.bodies.desired_speed > distance - 0.05).all()
    np.testing.assert_allclose(time, env.observer.view.travel_time, rtol=1e-5)


@pytest.mark.parametrize("scheme", ["dem", "nsm2", "hertz"])
@pytest.mark.parametrize("policy", [rule, drunk])
def test_heads_of_queues_are_charged_for_the_time_until_the_last_is_out(policy, scheme):
    """One at a time: together they pay for the clearing time, but for the rest of the steps in which a head gets out."""
    env, _, steps = episodes(policy, physics=scheme, reward={"head": 1.0, "time": 0.0})
    charged = np.array([step.info["reward/head"] for _, step, _ in steps])
    np.testing.assert_allclose([step.reward for _, step, _ in steps], charged)
    for e in range(env.num_envs):
        people = env.people(e)
        times = env.simulation.state.exit_time[people]
        cleared = np.nanmax(times) if np.isfinite(times).all() else env.simulation.state.time[e]
        assert ((charged[:, people] < 0).sum(axis=1) <= 1).all()
        left = np.array([step.terminated[people] for _, step, _ in steps])
        heads_left = (left & (charged[:, people] < 0)).sum()
        assert heads_left > 5 or policy is drunk
        assert cleared - env.decision_dt * heads_left <= -charged[:, people].sum() <= cleared + 1e-9
        stayed = (charged[:, people] < 0) & ~left
        np.testing.assert_allclose(charged[:, people][stayed], -env.decision_dt, atol=1e-9)


def test_the_head_is_nearest_by_its_route_and_every_route_has_one():
    hall = make_scenario("two-exit-hall-v0")
    everywhere = replace(hall, population=replace(hall.population, start_region=None))
    env = CrowdEnv(everywhere, routing="nearest", num_envs=2)
    env.reset(seed=0)
    rng, routes = np.random.default_rng(0), set()
    for _ in range(20):
        inside, before = env.active.copy(), env.observer.view.potential * env.simulation.bodies.desired_speed
        step = env.step(drunk(rng, env.num_people))
        for e in range(2):
            people = np.arange(env.num_people)[env.people(e)]
            for route in np.unique(env.simulation.state.route[people]):
                those = people[inside[people] & (env.simulation.state.route[people] == route)]
                charged = those[step.info["reward/head"][those] < 0]
                assert charged.tolist() == [those[before[those].argmin()]]
                routes.add(int(route))
    assert len(routes) == 2


@pytest.mark.parametrize("slow", [1.0, 0.05, 0.0])
def test_who_hardly_wants_to_walk_is_head_by_the_distance_too(slow):
    """The one 3 m from the exit is the head, whatever the other, 1.5 m behind, wants."""
    place = Geometry.from_polygon(box(0, 0, 12, 4), exits={"e": [(12, 1.5), (12, 2.5)]})
    crowd = Cohorts(
        [Population(1, desired_speed=Uniform(v, v), starts=np.array([[x, 2.0]])) for v, x in ((1.5, 9.0), (slow, 7.5))]
    )
    env = CrowdEnv(Scenario("two", place, crowd, 60.0), physics="dem")
    env.reset(0)
    assert env.step(None).info["reward/head"].tolist() == pytest.approx([-0.1, 0.0])


def test_walking_away_costs_progress():
    _, _, steps = episodes(backwards, time_limit=1.0)
    assert (total(steps, "progress") < 0.1).all() and total(steps, "progress").mean() < -0.1


@pytest.mark.parametrize("policy", [rule, drunk])
def test_time_sums_to_minus_the_time_inside(policy):
    env, _, steps = episodes(policy)
    exit_time = env.simulation.state.exit_time
    np.testing.assert_allclose(total(steps, "time"), -np.where(np.isfinite(exit_time), exit_time, 12.0), atol=1e-9)


def test_the_exit_pays_once_and_only_those_who_get_out():
    env, _, steps = episodes(drunk)
    np.testing.assert_array_equal(total(steps, "exit"), np.isfinite(env.simulation.state.exit_time).astype(float))
    for _, step, _ in steps:
        np.testing.assert_array_equal(step.info["reward/exit"] == 1.0, step.terminated)


def test_contact_is_minus_the_contact_impulse_over_the_mass():
    env, _, steps = episodes(rule)
    for inside, step, crush in steps:
        expected = np.where(inside, -crush / env.simulation.bodies.mass, 0.0)
        np.testing.assert_array_equal(step.info["reward/contact"], expected)
    assert (total(steps, "contact") < -0.5).any()


# ------------------------------------------------------------------------------------------------------ weighted sum


def test_the_reward_is_the_weighted_sum_of_the_terms_reported():
    weights = {"progress": 0.7, "exit": 3.0, "time": 0.2, "contact": 0.01}
    _, _, steps = episodes(drunk, RewardWeights(weights))
    for inside, step, _ in steps:
        expected = sum(weight * step.info[f"reward/{name}"] for name, weight in weights.items())
        np.testing.assert_allclose(step.reward, expected, atol=1e-12)
        assert not step.reward[~inside].any()
        assert {name for name in step.info if name.startswith("reward/")} == {f"reward/{name}" for name in TERMS}


@pytest.mark.parametrize("term", TERMS)
def test_a_term_alone_is_the_reward_and_the_others_are_still_reported(term):
    _, _, steps = episodes(drunk, RewardWeights({term: 1.0}), num_envs=1, time_limit=5.0)
    for _, step, _ in steps:
        np.testing.assert_array_equal(step.reward, step.info[f"reward/{term}"])
        assert all(f"reward/{name}" in step.info for name in TERMS)


def test_sharing_moves_reward_within_the_room_and_makes_none():
    """Everyone, those who have left too, gets their share of the mean over all N."""
    weights = {"progress": 1.0, "exit": 1.0, "time": 0.5, "contact": 0.01}
    (env, _, selfish), *shared = (episodes(drunk, RewardWeights(weights, share)) for share in (0.0, 0.3, 1.0))
    for share, (_, _, steps) in zip((0.3, 1.0), shared, strict=True):
        for (inside, own, _), (also_inside, step, _) in zip(selfish, steps, strict=True):
            np.testing.assert_array_equal(inside, also_inside)
            assert not own.reward[~inside].any()
            for e in range(env.num_envs):
                rows = env.people(e)
                expected = (1 - share) * own.reward[rows] + share * own.reward[rows].mean()
                np.testing.assert_allclose(step.reward[rows], expected, atol=1e-12)
                assert step.reward[rows].sum() == pytest.approx(own.reward[rows].sum(), abs=1e-9)


def test_time_is_shared_with_those_who_have_left():
    """The return of everyone who shares all is minus the mean exit time, whoever is out first."""
    for share in (0.0, 0.25, 1.0):
        env, _, steps = episodes(rule, RewardWeights({"time": 1.0}, share), num_envs=2, people=5, time_limit=30.0)
        exit_time = env.simulation.state.exit_time
        paid = sum(step.reward for _, step, _ in steps)
        mean = exit_time.reshape(2, 5).mean(axis=1)[env.env_of_person]
        np.testing.assert_allclose(paid, -(1 - share) * exit_time - share * mean, atol=1e-9)


def test_one_step_by_hand():
    """Two rooms of four and one: 0.1 s, one has left before, one leaves now; half of everything is shared."""
    step = Transition(
        inside=np.array([True, True, True, False, True]),
        left=np.array([False, True, False, False, False]),
        travel_time_before=np.array([3.0, 0.1, 2.0, 0.0, 1.0]),
        travel_time_after=np.array([2.8, 0.0, 2.1, 0.0, 0.9]),
        duration=np.array([0.1, 0.06, 0.1, 0.1, 0.1]),
        impulse_magnitude=np.array([8.0, 0.0, 0.0, 0.0, 0.0]),
        bodies=make_bodies(np.full(5, 0.2), 80.0, env_start=np.array([0, 4, 5])),
        state=make_state(np.zeros((5, 2)), environments=2),
        **OF_EPISODE,
    )
    weights = RewardWeights({"progress": 1.0, "exit": 2.0, "time": 5.0, "contact": 1.0}, team_share=0.5)
    reward, terms = RewardFunction(weights, 5)(struct_ref(step))
    own = [0.2 - 0.5 - 0.1, 0.1 + 2.0 - 0.3, -0.1 - 0.5, 0.0, 0.1 - 0.5]  # -0.4, 1.8, -0.6, 0, -0.4
    np.testing.assert_allclose(terms["reward/progress"], [0.2, 0.1, -0.1, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(terms["reward/time"], [-0.1, -0.06, -0.1, 0.0, -0.1], atol=1e-12)
    mean = 0.2  # of the first room: 0.8 / 4
    np.testing.assert_allclose(reward, [0.5 * r + 0.5 * mean for r in own[:4]] + [-0.4], atol=1e-12)


# ----------------------------------------------------------------------------------------------------------- metrics


def test_the_flow_is_the_slope_of_the_count_against_time():
    assert flow_slope(np.arange(10) / 2.5 + 3.0) == pytest.approx(2.5)
    times = np.array([1.0, 2.0, 4.0])  # by hand: sum (t - 7/3)(n - 2) / sum (t - 7/3)^2 = 3 / (14/3)
    assert flow_slope(times) == pytest.approx(9.0 / 14.0)
    assert flow_slope(np.array([4.0, np.nan, 1.0, 2.0, np.nan])) == pytest.approx(9.0 / 14.0)
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0, 10, 30))
    assert flow_slope(rng.permutation(times)) == pytest.approx(np.polyfit(times, np.arange(30), 1)[0])


@pytest.mark.parametrize("times", [[], [1.0, 2.0], [1.0, 2.0, np.nan, np.nan], [2.0, 2.0, 2.0]])
def test_there_is_no_flow_of_fewer_than_three_or_all_at_once(times):
    assert np.isnan(flow_slope(np.array(times)))


def test_a_summary_is_mean_and_sample_sd_of_what_is_finite():
    summary = summarise([1.0, 2.0, np.nan, 6.0])
    assert summary.mean == pytest.approx(3.0)
    assert summary.sd == pytest.approx(np.sqrt((4 + 1 + 9) / 2))
    assert summary.ci95[0] < 3.0 < summary.ci95[1]
    assert summarise([1.0, 2.0, np.nan, 6.0]) == summary  # no chance in it
    assert np.isnan([*summarise([])[:2], *summarise([]).ci95]).all()
    assert summarise([4.0]).mean == 4.0 and np.isnan(summarise([4.0]).sd)


def test_who_does_not_get_out_is_counted_and_no_evacuation_time_is_made_up():
    env = CrowdEnv("room-v0", num_envs=2, time_limit=5.0)
    env.reset(seed=0)
    while not env.finished.all():
        env.step(np.where(np.arange(40)[:, None] % 20 < 5, 0.0, (1.0, 0.0)))
    for e in range(2):
        metrics = env.metrics(e)
        left = np.isnan(env.simulation.state.exit_time[env.people(e)])
        assert isinstance(metrics, EpisodeMetrics)
        assert metrics.unfinished == left.sum() >= 4
        assert np.isnan(metrics.evacuation_time) and np.isfinite(metrics.mean_exit_time)


def test_metrics_start_anew_with_every_episode():
    env = evacuated(make_scenario("room-v0"), seed=[1])
    once = env.metrics(0)
    assert once.contact_impulse > 0 and once.max_overlap > 0 and once.mean_overlap > 0
    env.reset([5])
    assert env.metrics(0).contact_impulse == 0 == env.metrics(0).max_overlap and env.metrics(0).unfinished == 20
    env.reset([1])
    while not env.finished.all():
        env.step(None)
    np.testing.assert_equal(env.metrics(0), once)  # knows that nan is nan
