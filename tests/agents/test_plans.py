"""Policies in generated places: figures against closed forms, outcomes against an evaluation, and a judgement that goes on."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crowd_env import make_scenario
from crowd_env.agents.evaluation import plans
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.plans import Outcomes, figures, hindsight, interquartile_mean, judge_plan, judge_plans
from crowd_env.agents.rules import StrategyPolicy
from crowd_env.scenarios.generated import conditions_of, draw_place


def outcomes(times, pressure=0.0):
    times = np.asarray(times, dtype=float)
    return Outcomes(
        times, np.isinf(times).astype(float), np.zeros(len(times)), np.full(len(times), pressure), np.zeros(len(times))
    )


def test_interquartile_mean_is_that_of_the_middle_half():
    assert interquartile_mean(np.arange(8.0)) == 3.5
    assert interquartile_mean(np.array([1.0, 2.0, 3.0, np.inf])) == 2.5
    assert interquartile_mean(np.array([1.0, 2.0, np.inf, np.inf])) == np.inf


def test_hindsight_takes_the_best_rule_of_each_plan_and_no_learned_policy():
    found = {
        "rule": outcomes([10.0, np.inf, 30.0]),
        "follow": outcomes([20.0, 40.0, 25.0]),
        "learned": outcomes([1.0, 1.0, 1.0], 2000.0),
    }
    assert hindsight(found).tolist() == [10.0, 40.0, 25.0]
    rows = {row["policy"]: row for row in figures(found)}
    assert rows["rule"]["left_in"] == 1 and rows["rule"]["out"] == pytest.approx(2 / 3)
    assert rows["learned"]["pressed"] == 1.0 and rows["follow"]["pressed"] == 0.0
    assert rows["learned"]["over_hindsight"] == pytest.approx(np.median([0.1, 0.025, 0.04]))
    assert rows[plans.HINDSIGHT]["left_in"] == 0


def test_who_strayed_is_neither_inside_nor_out():
    found = {
        "rule": outcomes([10.0, np.inf, np.inf])._replace(
            left=np.array([0.0, 0.0, 3.0]), strayed=np.array([0.0, 2.0, 0.0])
        )
    }
    rule, best = figures(found)
    assert (rule["left_in"], rule["elsewhere"], rule["out"]) == (1, 1, pytest.approx(1 / 3))
    assert (best["left_in"], best["elsewhere"]) == (1, 1)


@cache
def small_seed():
    """Return a seed whose place is small and cleared by full speed, with forces and without noise."""
    return next(
        seed
        for seed in range(1000)
        if draw_place(seed=seed).population.people <= 12
        and conditions_of(seed)[:2] == ("dem", "competitive")
        and conditions_of(seed).noise == 0.0
    )


def test_an_outcome_is_what_an_evaluation_of_the_place_finds():
    seed = small_seed()
    place = draw_place(seed=seed)
    rule = StrategyPolicy(plans.routing_of(place))
    result = evaluate(rule, place, physics="dem", runs=1, first_seed=seed, measure=True)
    found = judge_plan("rule", seed)
    assert found.time == result.column("evacuation_time")[0] and found.left == 0
    assert found.pressure == pytest.approx(result.measured.max_pressure[0], rel=1e-12)
    assert found.impulse == result.column("contact_impulse")[0]


def test_noise_disturbs_what_a_policy_sees(monkeypatch):
    seed = small_seed()
    calm = judge_plan("evolution", seed)
    monkeypatch.setattr(plans, "conditions_of", lambda seed: conditions_of(seed)._replace(noise=0.2))
    assert judge_plan("evolution", seed) != calm


def test_a_judgement_goes_on_and_takes_what_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(plans, "BLOCK", 2)
    walked = []

    def judged(policy, seed, most, stopped):
        walked.append((policy, seed))
        return plans.Outcome(float(seed), 0.0, float(seed == 103), 0.0, 0.0)  # in one place somebody strays

    monkeypatch.setattr(plans, "judge_plan", judged)
    first = judge_plans(("rule",), 3, first=100, folder=tmp_path)
    assert first["rule"].time.tolist() == [100.0, 101.0, 102.0]
    walked.clear()
    both = judge_plans(("rule", "follow"), 4, first=100, folder=tmp_path)
    assert walked == [("follow", seed) for seed in range(100, 104)]
    assert both["follow"].time.tolist() == [100.0, 101.0, 102.0, np.inf]
    with pytest.raises(ValueError, match="first"):
        judge_plans(("rule",), 4, first=200, folder=tmp_path)


def test_places_of_more_people_are_not_walked():
    seed = next(seed for seed in range(100) if draw_place(seed=seed).population.people > 100)
    assert np.isnan(judge_plan("rule", seed, 100).time)


def test_everyone_walks_the_fastest_way_where_there_are_several_exits():
    assert plans.routing_of(make_scenario("two-exit-hall-v0")) == "fastest"
    assert plans.routing_of(make_scenario("room-v0")) == "shortest"
    assert plans.routing_of(replace(make_scenario("room-v0"), name="x")) == "shortest"
