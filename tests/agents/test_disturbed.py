"""Policies whose people see less well than they are told, or are late: what a run disturbs, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import SMALL, hall, random_policy

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.agents import Follow
from crowd_env.agents.drivers import DrivenCrowd, Hindrance, PolicyDriver, Sight
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_crowd
from crowd_env.agents.rules import ShortestPath

FOLLOW, NETWORK = Follow(), random_policy(0)


class Counting(ShortestPath):
    """Notes what it is given, and asks in its k-th decision for k thousandths of full speed."""

    name = "counting"

    def reset(self, env_mask):
        self.given = []

    def act(self, observation, layout, rng):
        self.given.append(observation.copy())
        return np.full((len(observation), 2), 1e-3 * (len(self.given) - 1))


def episodes(policy, runs=3, **hindered):
    return repr(evaluate_crowd(DrivenCrowd(policy, SMALL, hindrance=Hindrance(**hindered)), runs=runs).episodes)


@looped("policy", [FOLLOW, NETWORK], ids=lambda policy: policy.name)
def test_no_noise_and_no_delay_change_nothing(policy):
    assert episodes(policy, noise=0.0, delay=0.0) == episodes(policy)


@looped(
    "hindered",
    [{"noise": 0.05, "delay": 0.3, "unseen": 0.5}, {"noise": 0.05}, {"delay": 0.3}, {"unseen": 0.2}],
    ids=repr,
    quick=1,
)
def test_a_run_is_the_same_in_a_batch_of_any_size_and_another_than_undisturbed(monkeypatch, hindered):
    many = episodes(FOLLOW, **hindered)
    with monkeypatch.context() as patch:
        patch.setattr("crowd_env.envs.rollout._PEOPLE_AT_ONCE", 14)
        assert episodes(FOLLOW, **hindered) == many
    assert many != episodes(FOLLOW)
    assert episodes(ShortestPath(), **hindered) == episodes(ShortestPath())  # the rule of the environment


@looped(("delay", "late"), [(0.0, 0), (0.1, 1), (0.3, 3), (0.5, 5)])
def test_a_decision_takes_effect_so_many_decisions_later(delay, late):
    env, policy, taken = CrowdEnv(hall(4), num_envs=2), Counting(), []
    driver, step = PolicyDriver(policy, env, hindrance=Hindrance(delay=delay)), env.step
    env.step = lambda action: taken.append(action) or step(action)
    for _ in range(2):  # what was decided on before a reset takes no effect behind it
        taken.clear()
        driver.reset([0, 1])
        for _ in range(8):
            driver.step()
        assert [action is None for action in taken] == [k < late for k in range(8)]
        assert [action[0, 0] for action in taken[late:]] == [1e-3 * k for k in range(8 - late)]


def test_noise_is_added_to_what_is_there_and_stays_within_the_bounds():
    env, policy = CrowdEnv(hall(14), num_envs=2), Counting()
    driver = PolicyDriver(policy, env, hindrance=Hindrance(noise=0.05))
    driver.reset([5, 6])
    truth = []
    for _ in range(60):
        truth.append(driver._observation.copy())
        driver.step()
    seen, truth = np.array(policy.given), np.array(truth)
    assert seen.dtype == truth.dtype and seen.shape == truth.shape
    assert (seen[truth == 0.0] == 0.0).all() and (np.abs(seen) <= 1.0).all()
    inner = (truth != 0.0) & (np.abs(truth) < 0.7)
    assert inner.sum() > 1000
    added = (seen - truth)[inner]
    assert added.mean() == pytest.approx(0.0, abs=0.003) and added.std() == pytest.approx(0.05, rel=0.03)


def test_entries_take_all():
    (entry,) = make_entries(["follow"], SMALL)
    hindrance = Hindrance(noise=0.05, delay=0.3, unseen=0.2)
    assert replace(entry, hindrance=hindrance).driver(SMALL) == replace(entry.driver(SMALL), hindrance=hindrance)


SEEN = ObservationLayout(terms=("velocity", "walls", "density", "ahead", "neighbors"), neighbors=8)


def seen_and_there(share, people=120, decisions=30):
    """Return what people see, and what there is to see, of each decision; more people than the kernels take all pairs of."""
    env = CrowdEnv(hall(people), num_envs=2, observation=SEEN)
    sight = Sight(env, share)
    observation, _ = env.reset([3, 4])
    sight.reset([3, 4])
    pairs = []
    for _ in range(decisions):
        pairs.append((sight.observe()[env.active], observation[env.active]))
        observation = env.step(None).observation
    return [np.concatenate(one) for one in zip(*pairs, strict=True)]


@looped("share", [0.2, 0.5])
def test_of_the_others_a_share_is_unseen_and_nothing_else_is(share):
    seen, there = seen_and_there(share)
    for term in ("velocity", "walls"):
        np.testing.assert_array_equal(seen[:, SEEN[term]], there[:, SEEN[term]])
    count = [10.0 * c / (1.0 - c) for c in (one[:, SEEN["ahead"].stop - 1] for one in (seen, there))]
    assert count[1].sum() > 10_000 and (count[0] < count[1] + 1e-3).all()
    assert count[0].sum() / count[1].sum() == pytest.approx(1.0 - share, abs=0.01)
    around = [one[:, SEEN["density"]].ravel() * np.pi * 8.0 - 1.0 for one in (seen, there)]  # but for oneself
    known = there[:, SEEN["density"]].ravel() < 1.0
    assert around[0][known].sum() / around[1][known].sum() == pytest.approx(1.0 - share, abs=0.02)


def test_who_is_seen_is_seen_as_is():
    """Of eight neighbors those who are left move up, and what is beyond them comes in sight."""
    seen, there = (one[:, SEEN["neighbors"]].reshape(-1, 8, 5) for one in seen_and_there(0.2, people=9))
    for mine, all_of_them in zip(seen, there, strict=True):
        rows = mine[mine.any(axis=1)]
        found = (np.abs(rows[:, None] - all_of_them[None]).max(axis=2) < 1e-6).any(axis=1)
        assert found.all()
    assert seen.any(axis=2).sum() / there.any(axis=2).sum() == pytest.approx(0.8, abs=0.03)


@looped("share", [-0.1, 0.3, 0.7, 1.0])
def test_shares_that_cannot_be_are_refused(share):
    with pytest.raises(ValueError, match=r"1 / n of a whole n"):
        Sight(CrowdEnv(hall(2), observation=SEEN), share)
