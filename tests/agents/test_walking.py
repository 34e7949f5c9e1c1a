"""Rules of walking as policies: their laws, and that all people at once decide as each of them would alone."""

import json

import numpy as np
import pytest
from cases import looped
from evaluations import call, hall, run

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.agents import POLICIES, DensityCap, Evolved, Follow, HeadwayRule, RuleAtShare, YieldWhenStuck, Zipper
from crowd_env.agents.drivers import DrivenCrowd, PolicyDriver, best_share
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.evaluation.plans import judge_plan
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.settings import arguments_of

RULES = (RuleAtShare(1.0), DensityCap(), HeadwayRule(), Follow(), Evolved(), YieldWhenStuck(), Zipper())
FOLLOWING = (Follow(), Zipper())
RNG = np.random.default_rng(0)


def observed(policy, scenario, steps=0, seeds=(0,)):
    """Return an environment in which people have walked by a rule for so many steps, and what is observed then."""
    env = CrowdEnv(scenario, num_envs=len(seeds), **arguments_of(policy.env_options))
    observation, _ = env.reset(list(seeds))
    for _ in range(steps):
        observation = env.step(policy.act(observation, env.layout, RNG)).observation
    return env, observation


def decided(policy, scenario, steps=0, seeds=(0,)):
    """Return the environment, and what people in it decide."""
    env, observation = observed(policy, scenario, steps, seeds)
    return env, policy.act(observation, env.layout, RNG)


def ids(policy):
    return policy.name


# ------------------------------------------------------------------------------------------------------------- the laws


@looped("policy", RULES, ids=ids)
def test_who_is_alone_walks_the_way_at_full_speed(policy):
    _, action = decided(policy, hall(1), steps=5)
    np.testing.assert_array_equal(action, [[1.0, 0.0]])


@looped("policy", RULES, ids=ids)
def test_nobody_wants_to_be_faster_than_the_own_desired_speed(policy):
    env, observation = observed(policy, hall(30, speed=1.8), seeds=(0, 1))
    slowest = 1.0
    for _ in range(40):
        action = policy.act(observation, env.layout, RNG)
        size = np.hypot(*action.T)[env.active]
        assert (size <= 1.0 + 1e-12).all()
        slowest = min(slowest, size.min())
        observation = env.step(action).observation
    assert policy.name in ("rule-best-speed", "headway") or slowest < 0.9


@looped("policy", FOLLOWING, ids=ids)
def test_the_first_of_a_row_walks_freely_and_the_others_do_not_walk_into_it(policy):
    scenario = hall(starts=[(1.0 + 0.45 * k, 3.0) for k in range(6)], speed=1.5)
    _, action = decided(policy, scenario)
    np.testing.assert_allclose(action[0], [1.0, 0.0], atol=1e-6)
    assert (action[1:, 0] < 0.3).all()
    result = evaluate(policy, scenario, runs=1)
    assert np.argsort(result.exit_times[0]).tolist() == list(range(6)) and result.column("contact_impulse")[0] == 0.0


def test_who_is_stuck_walks_as_evolved_and_the_others_at_full_speed():
    rule = YieldWhenStuck(patience=1.0)
    env, _ = observed(rule, hall(30, speed=1.8))
    walk = np.column_stack([np.arange(env.num_people) % 3 == 0, np.zeros(env.num_people)])
    for _ in range(15):  # two in three stand
        observation = env.step(walk).observation
    stood = observation[:, env.layout["stood"]][:, 0]
    stuck = stood > 1.0 / 6.0
    assert 5 < stuck.sum() < env.active.sum()
    evolved, action = Evolved().act(observation, env.layout, RNG), rule.act(observation, env.layout, RNG)
    np.testing.assert_array_equal(action[stuck], evolved[stuck])
    np.testing.assert_array_equal(action[~stuck], np.tile([1.0, 0.0], (int((~stuck).sum()), 1)))


@pytest.mark.more
@looped("seed", [37, 44])
def test_streams_that_lock_at_full_speed_come_loose_when_those_who_are_stuck_yield(seed):
    rule, yielding = (judge_plan(name, 1_000_000 + seed) for name in ("rule", YieldWhenStuck.name))
    assert rule.left > 30 and yielding.left == 0


@looped("scheme", ["dem", "nsm2"])
def test_the_headway_policy_is_the_manner_bit_by_bit(scheme):
    place, shared = hall(30, speed=1.8), {"physics": scheme, "runs": 2}
    policy = evaluate(HeadwayRule(), place, **shared)
    manner = run_episodes(place, 2, seed=1_000_000, scheme=scheme, manner="hurried")
    assert repr(policy.episodes) == repr([episode.metrics for episode in manner])
    assert repr(policy.episodes) != repr(evaluate(HeadwayRule("calm"), place, **shared).episodes)
    # Whatever the manner of the run, and of the other policies in it.
    assert repr(policy.episodes) == repr(evaluate(HeadwayRule(), hall(30, speed=1.8, manner="calm"), **shared).episodes)


def test_full_push_is_the_shortest_path():
    # The same wishes, turned into velocities at other moments: every 0.05 s.
    pushing, shortest = (evaluate(rule, hall(20), runs=3) for rule in (HeadwayRule({"push": 1.0}), RuleAtShare(1.0)))
    assert pushing.column("mean_exit_time").mean() == pytest.approx(shortest.column("mean_exit_time").mean(), rel=0.05)


def test_all_of_the_speed_is_the_rule_of_the_environment_bit_by_bit():
    place = hall(speed=1.5)
    ours, rule = evaluate(RuleAtShare(1.0), place, runs=3), run_episodes(place, 3, seed=1_000_000)
    assert repr(ours.episodes) == repr([episode.metrics for episode in rule])


def test_speed_is_capped_where_it_is_dense_alone():
    near = [(3.0 + 0.5 * (k % 3), 2.0 + 0.5 * (k // 3)) for k in range(9)]
    _, action = decided(DensityCap(density=2.0, speed=0.6), hall(starts=[(1.0, 5.0), *near], speed=1.5))
    np.testing.assert_array_equal(action[0], [1.0, 0.0])
    np.testing.assert_allclose(action[5], [0.6 / 1.5, 0.0], atol=1e-6)  # the middle: 9 people within 1 m are 2.9 /m2


def test_a_zipper_lets_two_streams_through_a_door_in_turn():
    """Six people come from either side of the door, one side half a step behind the other."""
    left = [(0.8 + 0.6 * k, 3.9 + 0.1 * k) for k in range(6)]
    right = [(0.8 + 0.6 * k + 0.3, 2.1 - 0.1 * k) for k in range(6)]
    result = evaluate(Zipper(), hall(starts=left + right, speed=1.5), runs=3)
    for times in result.exit_times:
        is_left = np.argsort(times) < 6
        assert (is_left[1:] != is_left[:-1]).all()


# --------------------------------------------------------------------------------------- all at once, and one by one


def crowd(policy, steps=25):
    """Return the environment and observation of people who have walked into a jam at a door, in two halls."""
    env = CrowdEnv(hall(40, speed=1.6), num_envs=2, **arguments_of(policy.env_options))
    env.reset([3, 4])
    return env, [env.step(None).observation for _ in range(steps)][-1]


def one_by_one(env, decide):
    """Return what everyone decides (P, 2), zero for who is out; ``decide`` takes a person and the others in the hall."""
    state, found = env.simulation.state, np.zeros((env.num_people, 2))
    for i in np.flatnonzero(state.active):
        mine = env.people(env.env_of_person[i])
        found[i] = decide(i, [j for j in range(mine.start, mine.stop) if j != i and state.active[j]])
    return found


def assert_alike(policy, env, observation, expected):
    inside = env.active
    assert inside.sum() > 20 and (expected[inside, 0] < 0.9).sum() > 5
    np.testing.assert_allclose(policy.act(observation, env.layout, RNG)[inside], expected[inside], atol=2e-5)


@looped("policy", FOLLOWING, ids=ids)
def test_following_of_all_is_the_following_of_each(policy):
    env, observation = crowd(policy)
    state, bodies, ways = env.simulation.state, env.simulation.bodies, env.observer.view.direction
    x, v, way = state.position, state.velocity, env.observer.view.distance_to_go
    route = env.simulation.history.followed

    def decide(i, others):
        nearer = [j for j in others if way[j] < way[i] and route[j] == route[i]]
        if not policy.full_state:
            nearer = [j for j in nearer if (x[j] - x[i]) @ ways[i] > 0 and np.hypot(*(x[j] - x[i])) < 3.0]
        if not nearer:
            return 1.0, 0.0
        j = max(nearer, key=way.__getitem__)
        lead = min(way[i] - way[j], 3.0)
        speed = v[j] @ ways[j] + (lead - policy.spacing) / policy.time
        return np.clip(speed / bodies.desired_speed[i], -policy.back, 1.0), 0.0

    assert_alike(policy, env, observation, one_by_one(env, decide))


@looped("policy", RULES, ids=ids)
def test_what_is_decided_in_one_environment_depends_on_no_other(policy):
    place = hall(20, speed=1.6)
    both, alone = decided(policy, place, 12, seeds=(3, 4))[1], decided(policy, place, 12, seeds=(4,))[1]
    np.testing.assert_array_equal(both[20:], alone)


# ------------------------------------------------------------------------------------------------- what is asked for


@looped(
    ("policy", "words"),
    [
        (Zipper(), "policy 'zipper' needs the full state.*predecessor is not among"),
        (Follow(), "policy 'follow' needs its own observation.*leader is not among"),
    ],
    ids=["zipper", "follow"],
)
def test_a_rule_without_what_it_sees_is_refused(policy, words):
    env = CrowdEnv(hall(3))
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match=words):
        policy.act(observation, env.layout, RNG)


@looped(
    ("rule", "constants", "words"),
    [
        (RuleAtShare, {"share": 1.2}, "share is 1.2"),
        (DensityCap, {"speed": 0.0}, "speed is 0"),
        (HeadwayRule, {"manner": {"push": -0.1}}, "push is -0.1"),
        (HeadwayRule, {"manner": "rude"}, "unknown manner 'rude'"),
        (Follow, {"time": 0.0}, "follow.*time is 0"),
        (Evolved, {"crowd": 110.0}, "evolution.*crowd is 110"),
        (Zipper, {"back": 2.0}, "zipper.*back is 2"),
    ],
)
def test_constants_out_of_range_are_refused(rule, constants, words):
    with pytest.raises(ValueError, match=words):
        rule(**constants)


def test_a_share_that_is_neither_given_nor_searched_for_is_refused():
    with pytest.raises(ValueError, match="has no share of speed"):
        RuleAtShare().act(np.zeros((2, 1)), ObservationLayout(terms=("desired_speed",)), RNG)


def test_the_best_share_is_full_speed_where_nothing_is_in_the_way(monkeypatch):
    monkeypatch.setattr("crowd_env.agents.drivers.SEARCH_RUNS", 2)
    assert best_share(DrivenCrowd(RuleAtShare(), hall(1))) == 1.0


@looped(
    ("outcomes", "best", "tries"),
    [
        # Share -> people left inside in a run of two, and when the other run cleared; all else as 0.5 says.
        ({1.0: (3, 5.0), 0.9: (0, 12.0), 0.8: (0, 11.0), 0.7: (0, 10.0), 0.5: (0, 13.0)}, 0.7, 5),
        (
            {1.0: (1, 5.0), 0.5: (0, 299.0)},
            0.9,
            3,
        ),  # far later than the mean of 5 s and the time limit, but nobody is left
        ({1.0: (9, 5.0), 0.9: (2, 8.0), 0.8: (4, 6.0), 0.5: (2, 9.0)}, 0.9, 9),  # some are always left: the fewest
        (
            {1.0: (1, 5.0), 0.9: (0, 8.0), 0.8: (1, 6.0), 0.5: (0, 9.0)},
            0.9,
            4,
        ),  # a block says nothing of who walks slower
        ({1.0: (9, np.nan), 0.9: (9, 50.0), 0.5: (9, np.nan)}, 0.9, 9),
    ],
)
def test_the_best_share_leaves_the_fewest_inside_and_then_is_the_soonest(monkeypatch, outcomes, best, tries):
    tried, (episode,) = [], run_episodes(hall(1), 1)

    def made_up(scenario, runs, *, seed, driver):
        share = driver.policy.share
        tried.append(share)
        left, last = outcomes.get(share, outcomes[0.5])
        stuck = episode.metrics._replace(evacuation_time=np.nan, unfinished=max(left, 1))
        clear = episode.metrics._replace(evacuation_time=last)
        two = (stuck if left else clear, stuck if np.isnan(last) else clear)
        return [episode._replace(metrics=one, time_limit=300.0) for one in two]

    monkeypatch.setattr("crowd_env.agents.drivers.run_episodes", made_up)
    assert best_share(DrivenCrowd(RuleAtShare(), hall(1))) == best and len(tried) == tries


@pytest.mark.more
def test_the_command_takes_the_rules_by_name_and_tells_their_constants(small):
    names = ["rule-best-speed", "density-cap", "headway", "follow", "zipper"]
    assert set(names) <= set(POLICIES)
    code, out, _ = call("--scenario", "hall", "--policy", *names, "--runs", 2, "--json")
    rows = json.loads(out)["rows"]
    assert code == 0 and [row["policy"] for row in rows] == names
    assert 0.2 <= rows[0]["constants"]["share"] <= 1.0
    assert rows[1]["constants"] == {"density": 2.0, "speed": 1.0} and rows[2]["constants"] == {"manner": "hurried"}
    assert all(row["blocked_share"]["ci95"][1] < 1.0 for row in rows)


def test_a_driver_of_a_rule_goes_on_after_a_reset():
    policy = Zipper()
    driver = PolicyDriver(policy, CrowdEnv(hall(5), num_envs=2, **arguments_of(policy.env_options)))
    first = []
    for _ in range(2):
        driver.reset([1, 2])
        first.append(driver.step().observation)
    np.testing.assert_array_equal(*first)


def test_a_kept_result_holds_the_share_that_was_found(tmp_path):
    place = hall(3)
    (entry,) = make_entries(["rule-best-speed"], place)
    result = run("rule-best-speed", place, runs=1)
    folder = EvaluationFolder(tmp_path / "kept", settings_of(place, 1, 0))
    folder.keep_result(entry, "nsm2", result)
    kept = folder.load_result(entry, "nsm2")
    assert kept.row() == result.row() and kept.constants == result.constants != {}
