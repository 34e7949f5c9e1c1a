"""Intervals say 95 % and mean it: against scipy, and by simulation."""

import sys

import numpy as np
import pytest
from cases import looped

from crowd_env.envs.metrics import share_interval, summarise, t_quantile


def test_the_interval_of_a_mean_is_that_of_scipy():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(0)
    for count in (2, 3, 7, 30, 200):
        sample = rng.gamma(4.0, 2.0, count)
        expected = stats.t.interval(0.95, count - 1, sample.mean(), stats.sem(sample))
        assert summarise(sample).ci95 == pytest.approx(expected, rel=1e-9)


@looped("count", [2, 3, 5, 10, 20, 50])
def test_the_interval_of_few_runs_covers_the_true_mean_as_often_as_it_says(count):
    """4000 trials: a share of 0.95 has a standard error of 0.0034."""
    samples = np.random.default_rng(count).normal(3.0, 2.0, (4000, count))
    covered = [low < 3.0 < high for low, high in (summarise(sample).ci95 for sample in samples)]
    assert 0.938 < np.mean(covered) < 0.962


@looped(("count", "least"), [(5, 0.90), (10, 0.915), (50, 0.93)])
def test_skewed_times_are_covered_nearly_as_often(count, least):
    samples = np.random.default_rng(1).gamma(4.0, 2.0, (3000, count))  # mean 8, skewness 1: times of evacuations
    covered = [low < 8.0 < high for low, high in (summarise(sample).ci95 for sample in samples)]
    assert least < np.mean(covered) < 0.965


def test_there_is_no_interval_of_one_value_and_none_of_equal_ones():
    assert np.isnan([*summarise([4.0]).ci95, summarise([4.0]).sd]).all() and summarise([4.0]).mean == 4.0
    assert summarise([2.0, 2.0, 2.0]).ci95 == (2.0, 2.0)


def test_intervals_need_no_scipy(monkeypatch):
    for name in ("scipy", "scipy.special", "scipy.stats"):
        monkeypatch.setitem(sys.modules, name, None)
    t_quantile.cache_clear()
    mean, sd, (low, high) = summarise([1.0, 2.0, 3.0])
    assert (mean, sd) == (2.0, 1.0) and high - mean == mean - low == pytest.approx(4.302652730 / np.sqrt(3.0))  # tables
    assert t_quantile(9) == pytest.approx(2.262157163) and t_quantile(10**6) == pytest.approx(1.959966, abs=1e-6)


@looped("freedom", [1, 2, 3, 4, 7, 30, 60, 199, 5000, 10**6])
def test_the_quantile_of_student_is_that_of_scipy(freedom):
    stats = pytest.importorskip("scipy.stats")
    assert t_quantile(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=3e-9)


@looped(("count", "of"), [(0, 1), (0, 20), (1, 8), (9, 40), (14, 50), (50, 50), (3, 1000)])
def test_the_interval_of_a_share_is_wilsons_of_scipy(count, of):
    stats = pytest.importorskip("scipy.stats")
    expected = stats.binomtest(count, of).proportion_ci(0.95, method="wilson")
    assert share_interval(count, of) == pytest.approx((expected.low, expected.high), abs=1e-12)


@looped("share", [0.05, 0.2, 0.5, 0.9])
def test_the_interval_of_a_share_covers_it_about_as_often_as_it_says(share):
    seen = np.random.default_rng(3).binomial(20, share, 4000)
    intervals = {count: share_interval(int(count), 20) for count in np.unique(seen)}
    assert 0.91 < np.mean([intervals[count][0] <= share <= intervals[count][1] for count in seen]) < 0.99


def test_what_is_no_share_is_refused():
    assert np.isnan(share_interval(0, 0)).all()
    for count, of in ((3, 2), (-1, 2)):
        with pytest.raises(ValueError, match="is no share"):
            share_interval(count, of)
