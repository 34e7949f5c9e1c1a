"""Policies whose people see less well than they are told, or are late: what a run disturbs, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import SMALL, hall, random_policy

from crowd_env import CrowdEnv
from crowd_env.agents import Follow
from crowd_env.agents.drivers import PolicyDriver, policy_driver
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_driver
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
    driver = policy_driver(policy, SMALL, **hindered)
    return repr(evaluate_driver(driver, SMALL, policy.name, "nsm2", runs=runs).episodes)


@looped("policy", [FOLLOW, NETWORK], ids=lambda policy: policy.name)
def test_no_noise_and_no_delay_change_nothing(policy):
    assert episodes(policy, noise=0.0, delay=0.0) == episodes(policy)


@looped("hindered", [{"noise": 0.05}, {"delay": 0.3}, {"noise": 0.05, "delay": 0.3}], ids=repr)
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
    driver, step = PolicyDriver(policy, env, delay=delay), env.step
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
    driver = PolicyDriver(policy, env, noise=0.05)
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


def test_entries_take_both():
    (entry,) = make_entries(["follow"], SMALL)
    driver = entry.driver(SMALL, "nsm2", 1, noise=0.05, delay=0.3)
    assert driver == replace(entry.driver(SMALL, "nsm2", 1), noise=0.05, delay=0.3)
