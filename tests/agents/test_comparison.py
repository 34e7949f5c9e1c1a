"""Policies beside each other: paired differences, orders, contradictions, and the tables that show them."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import hall, made_up, run
from rich.console import Console

from crowd_env.agents.controllers import FixedSplit
from crowd_env.agents.evaluation.comparison import (
    clearing_times,
    kendall_tau,
    last_times,
    mean_times,
    minus_first,
    paired,
    ranking,
    ratio,
)
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.report import comparison_table, ranking_lines, times_table
from crowd_env.analysis.figures import median_time


def test_paired_differences_by_hand():
    # Differences 0 and 1: mean 0.5, sd 0.7071, t of one degree of freedom 12.706.
    found = paired(np.array([3.0, 6.0]), np.array([3.0, 5.0]))
    assert found["mean"] == 0.5 and found["faster"] == 0.25
    assert found["ci95"] == pytest.approx([0.5 - 0.5 * 12.7062, 0.5 + 0.5 * 12.7062], rel=1e-5)
    constant = paired(np.array([3.0, 9.0, 7.0]), np.array([5.0, 11.0, 9.0]))
    assert constant == {"mean": -2.0, "ci95": [-2.0, -2.0], "faster": 1.0, "draws": 3, "more_left": 0}
    alone = paired(np.array([3.0]), np.array([4.0]))
    assert alone == {"mean": -1.0, "ci95": [None, None], "faster": 1.0, "draws": 1, "more_left": 0}


def test_only_draws_that_both_clear_are_compared_and_the_others_are_counted():
    nan = np.nan
    found = paired(np.array([3.0, nan, 7.0, nan, 5.0]), np.array([5.0, 4.0, nan, nan, 7.0]))
    assert found == {"mean": -2.0, "ci95": [-2.0, -2.0], "faster": 1.0, "draws": 2, "more_left": 0}
    never = paired(np.array([nan, nan]), np.array([1.0, nan]))
    assert never == {"mean": None, "ci95": [None, None], "faster": None, "draws": 0, "more_left": 1}


@looped("limit", [60.0, 1e6])
def test_no_time_limit_moves_a_median_or_a_difference(limit):
    """Somebody is left in the second of five runs: whatever the limit is, the figures are the same."""
    stuck = made_up("stuck", "dem", [30.0, np.nan, 32.0, 34.0, 36.0])
    stuck, quick = replace(stuck, time_limit=limit), made_up("quick", "dem", [30.0, 31.0, 31.0, 32.0, 35.0])
    row, other = stuck.row(), minus_first(stuck, quick)
    assert (row["median_time"], row["evacuation_time"]["mean"], row["mean_exit"]["mean"]) == (34.0, 33.0, 17.0)
    assert other["evacuation_time"]["mean"] == 1.0 and other["mean_exit_time"]["mean"] == 0.5
    assert (other["evacuation_time"]["draws"], other["evacuation_time"]["more_left"]) == (4, 1)
    found = ranking([stuck, quick])["schemes"]["dem"]
    assert found == {"order": ["quick", "stuck"], "times": {"quick": 31.0, "stuck": 34.0}}
    console = Console(width=104, record=True)
    console.print(times_table([quick, stuck], "title"), comparison_table([quick, stuck], "title"))
    lines = [line.split() for line in console.export_text().splitlines()]
    assert sum(line[:3] == ["stuck", "34.0", "33.0"] or line[:2] == ["stuck", "34.00"] for line in lines) == 2


@looped(("last", "half"), [([1, 2, 3], 2.0), ([1, 2, 3, 4], 2.0), ([1, np.nan], 1.0), ([1, np.nan, np.nan], None)])
def test_half_of_all_runs_are_over_or_there_is_no_median(last, half):
    assert median_time(np.array(last, dtype=float)) == half == made_up("a", "dem", last).row()["median_time"]


def test_who_leaves_people_in_fewer_runs_stands_first():
    nan = np.nan
    times = {"slow": [90.0, 91.0, 92.0], "quick": [30.0, 31.0, nan], "never": [nan] * 3, "also": [nan] * 3}
    results = [made_up(name, "dem", last) for name, last in times.items()]
    found = ranking(results)["schemes"]["dem"]
    assert found["order"] == ["slow", "quick", "never", "also"] and found["times"]["never"] is None
    assert "slow < quick < never = also" in "\n".join(ranking_lines(results))


def test_the_paired_interval_leaves_out_what_policies_share():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(0)
    shared = rng.normal(30.0, 5.0, 8)
    one, other = shared + rng.normal(0.0, 1.0, 8), shared + rng.normal(0.5, 1.0, 8)
    expected = stats.ttest_rel(one, other).confidence_interval(0.95)
    assert paired(one, other)["ci95"] == pytest.approx([expected.low, expected.high])
    assert paired(one, other)["faster"] == (one < other).mean()


def test_runs_that_cannot_be_paired_are_refused():
    with pytest.raises(ValueError, match="2 and 3 runs"):
        paired(np.zeros(2), np.zeros(3))


def test_who_does_not_get_out_counts_until_the_end_of_the_run():
    result = made_up("a", "dem", [30.0, 40.0], unfinished=True)
    assert last_times(result).tolist() == [100.0, 100.0]
    later = replace(result, ended=np.array([100.5, 80.0]))  # the last decision goes beyond the limit; blocked before it
    assert last_times(later).tolist() == [100.5, 100.0]
    assert mean_times(later).tolist() == [50.75, 50.5]
    assert np.isnan(later.exit_time_95()).all() and np.isnan(clearing_times(later)).all()


def test_who_leaves_people_inside_is_never_faster_than_who_does_not():
    """At a limit of 4.05 s runs end at 4.1 s: someone who gets out in the last step is out later than the limit."""
    scenario = hall(count=8, time_limit=4.05)
    result = run("west", scenario, runs=12, measure=False)
    left = result.column("unfinished") > 0
    out = result.times_of_all()[np.isfinite(np.array(result.exit_times))]
    assert left.any() and out.max() > 4.05
    assert last_times(result)[left].min() >= out.max()
    assert last_times(result)[left] == pytest.approx(4.1)


def test_judging_a_controller_counts_them_alike():
    judged = evaluate(FixedSplit({"grid": (4, 2)}), "two-exit-hall-v0", runs=3, first_seed=0, time_limit=25.05)
    left = judged.column("unfinished") > 0
    out = judged.times_of_all()[np.isfinite(np.array(judged.exit_times))]
    assert left.any()
    assert last_times(judged)[left].min() >= out.max() and (mean_times(judged)[left] > 0).all()


def test_a_ratio_is_of_the_same_draws_or_there_is_none():
    quick, slow = made_up("a", "dem", [30.0, 40.0]), made_up("b", "dem", [60.0, 80.0])
    assert ratio(quick, slow) == pytest.approx(0.5)
    stuck = made_up("c", "dem", [30.0, 40.0], unfinished=True)
    assert ratio(stuck, slow) is None and ratio(slow, stuck) is None


def test_kendalls_tau_is_that_of_scipy():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.integers(0, 4, (2, 6)).astype(float)
        expected = stats.kendalltau(a, b).statistic
        assert kendall_tau(a, b) == (None if np.isnan(expected) else pytest.approx(expected))


def test_the_order_and_what_contradicts_it():
    times = {
        "dem": {"a": [10.0, 11.0, 12.0], "b": [12.0, 13.0, 14.5], "c": [20.0, 21.0, 22.0]},
        "nsm2": {"a": [15.0, 16.0, 17.0], "b": [12.0, 13.5, 14.0], "c": [20.0, 21.0, 22.0]},
    }
    results = [made_up(name, scheme, last) for scheme, row in times.items() for name, last in row.items()]
    found = ranking(results)
    assert found["schemes"]["dem"]["order"] == ["a", "b", "c"] and found["schemes"]["nsm2"]["order"] == ["b", "a", "c"]
    assert found["schemes"]["dem"]["times"]["a"] == 11.0
    assert not found["same"] and found["tau"] == {"dem nsm2": pytest.approx(1 / 3)}
    assert found["contradictions"] == [
        {"policies": ["a", "b"], "first_faster_under": ["dem"], "second_faster_under": ["nsm2"]}
    ]
    told = "\n".join(ranking_lines(results))
    assert "a < b < c" in told and "b < a < c" in told and "not the same" in told
    assert "a is clearly faster than b under dem, clearly slower under nsm2" in told
    agreeing = ranking(results[:3])
    assert agreeing["same"] and agreeing["tau"] == {} and agreeing["contradictions"] == []


def test_an_order_that_differs_by_chance_is_no_contradiction():
    times = {"dem": {"a": [12.0, 14.0], "b": [13.0, 11.0]}, "nsm2": {"a": [10.0, 14.0], "b": [13.0, 12.0]}}
    results = [made_up(name, scheme, last) for scheme, row in times.items() for name, last in row.items()]
    found = ranking(results)
    assert not found["same"] and found["contradictions"] == []
    assert "No two schemes contradict" in ranking_lines(results)[-1]
    times["nsm2"] = {"a": [13.0, 14.0], "b": [12.0, 13.0]}  # clear under nsm2, by chance under dem
    results = [made_up(name, scheme, last) for scheme, row in times.items() for name, last in row.items()]
    assert ranking(results)["contradictions"] == []
