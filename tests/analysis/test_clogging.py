"""Clogging statistics: samples counted by hand, laws of known exponent, and a command that says what it could not see."""

import json
import sys

import numpy as np
import pytest
from cases import looped
from clogging_samples import needs_powerlaw, pareto
from typer.testing import CliRunner

from crowd_env.analysis.clogging import (
    FEWEST_GAPS,
    FEWEST_IN_TAIL,
    Gaps,
    burst_sizes,
    clogging,
    exit_gaps,
    exits_of_run,
    fit_tail,
    survival,
)
from crowd_env.cli.main import app

NONE = np.empty(0)


def run_of(gaps, until=np.nan, begin=3.0):
    """A run whose people leave with the given gaps between them; with ``until``, one stays inside."""
    times = begin + np.concatenate([[0.0], np.cumsum(gaps)])
    return exits_of_run([*times, np.nan], until) if np.isfinite(until) else exits_of_run(times)


# ---------------------------------------------------------------------------------------------------- gaps, by hand


def test_gaps_lie_between_successive_exits_in_any_order():
    gaps = exit_gaps(exits_of_run([7.0, 2.0, 3.5, 2.0]))
    assert gaps.closed.tolist() == [0.0, 1.5, 3.5]
    assert gaps.open.size == 0


def test_the_last_gap_of_a_run_that_was_not_over_is_open_and_as_long_as_it_was_watched():
    gaps = exit_gaps(exits_of_run([2.0, np.nan, 5.0, np.nan], until=125.5))
    assert gaps.closed.tolist() == [3.0] and gaps.open.tolist() == [120.5]
    nobody = exit_gaps(exits_of_run([np.nan, np.nan], until=60.0))
    assert nobody.closed.size == 0 and nobody.open.size == 0  # no gap begins before the first exit


def test_gaps_per_exit_are_those_of_people_who_took_the_same_one():
    run = exits_of_run([1.0, 2.0, 4.0, 4.5, np.nan], 10.0, ["a", "b", "a", "b", ""])
    assert exit_gaps(run).closed.tolist() == [1.0, 2.0, 0.5]
    assert exit_gaps(run).open.tolist() == [5.5]
    assert exit_gaps(run, per_exit=True).closed.tolist() == [3.0, 2.5]
    assert exit_gaps(run, per_exit=True).open.tolist() == [6.0, 5.5]


@looped(
    ("times", "until", "words"),
    [
        ([1.0, np.nan], np.nan, "say when"),
        ([1.0, 5.0, np.nan], 4.0, "after the last exit"),
        ([np.inf], 1.0, "infinite"),
    ],
)
def test_a_run_that_cannot_be_is_refused(times, until, words):
    with pytest.raises(ValueError, match=words):
        exits_of_run(times, until)


def test_bursts_by_hand():
    assert burst_sizes([0.1, 0.2, 5.0, 0.1, 2.0, 9.0], 2.0).tolist() == [3, 2, 1, 1]
    assert burst_sizes([0.1, 0.2], 2.0).tolist() == [3]
    assert burst_sizes([], 2.0).tolist() == [1]
    found = clogging([run_of([0.1, 5.0]), run_of([3.0], until=40.0), exits_of_run([np.nan], 9.0)], pause=1.0)
    assert found.bursts.tolist() == [1, 1, 1, 2] and found.bursts.sum() == found.exits == 5
    assert found.as_json()["bursts"] == {
        "pause": 1.0, "count": 4, "mean_size": 1.25, "max_size": 2, "sizes": {"1": 3, "2": 1},
    }  # fmt: skip


def test_survival_by_hand():
    t, share = survival(Gaps(np.array([4.0, 1.0, 2.0, 2.0]), NONE))
    assert t.tolist() == [1.0, 2.0, 4.0]
    assert share == pytest.approx([0.75, 0.25, 0.0], abs=1e-15)


def test_survival_knows_that_open_gaps_are_longer():
    # Kaplan and Meier: 4/5 outlast 1, of the four still seen at 2 two end, of the one seen at 4 one ends.
    _, share = survival(Gaps(np.array([1.0, 2.0, 2.0, 4.0]), np.array([3.0])))
    assert share == pytest.approx([4 / 5, 4 / 5 * 2 / 4, 0.0], abs=1e-15)
    _, share = survival(Gaps(np.array([1.0, 2.0, 2.0, 4.0]), np.array([120.0])))
    assert share[-1] == pytest.approx(1 / 5)


def test_figures_of_a_small_sample_by_hand():
    told = clogging([run_of([1.0, 3.0]), run_of([2.0, 2.0], until=200.0)]).as_json()
    assert told["gaps"] == {
        "count": 4, "mean": 2.0, "cv": pytest.approx(np.sqrt(0.5) / 2.0), "q90": pytest.approx(2.7), "max": 3.0, "open": 1,
        "longest_open": pytest.approx(193.0),
    }  # fmt: skip
    assert (told["runs"], told["exits"], told["unfinished_runs"], told["blocked_runs"]) == (2, 6, 1, 1)
    assert told["tail"] is None and told["clogged"] is None and "4 gaps" in told["no_tail"]


def test_a_run_is_blocked_when_nobody_got_out_for_long_also_when_nobody_did_at_all():
    runs = [run_of([1.0], until=100.0), run_of([1.0], until=125.0), exits_of_run([np.nan], 121.0), run_of([1.0])]
    found = clogging(runs)
    assert (found.unfinished, found.blocked) == (3, 2)
    assert clogging(runs, blocked_after=50.0).blocked == 3
    assert "2 of 4 runs blocked" in found.statement()


@looped("bad", [{"pause": 0.0}, {"blocked_after": -1.0}, {"runs": []}])
def test_nonsense_is_refused(bad):
    with pytest.raises(ValueError):
        clogging(**{"runs": [run_of([1.0])], **bad})


# ------------------------------------------------------------------------------------------------------ the exponent


@needs_powerlaw
@looped("alpha", [2.5, 6.0, 1.5, 3.5], quick=2)  # powerlaw by itself stops at 3
def test_gaps_of_a_known_power_law_give_its_exponent(alpha):
    tail, reason = fit_tail(Gaps(pareto(alpha, 400, 1), NONE))
    assert reason == ""
    assert abs(tail.alpha - alpha) < 3.0 * tail.error
    assert tail.error == pytest.approx((tail.alpha - 1.0) / np.sqrt(tail.n))
    if alpha < 3:  # from 4 on an exponential is hard to tell apart
        assert tail.ratio > 0 and tail.p < 0.05


@needs_powerlaw
def test_the_fit_is_that_of_its_formulas():
    gaps = pareto(2.7, 400, 5) + 0.4 * np.random.default_rng(6).uniform(size=400)
    tail, _ = fit_tail(Gaps(gaps, NONE))
    above = np.sort(gaps[gaps >= tail.x_min])
    logs = np.log(above / tail.x_min)
    assert tail.n == len(above)
    assert tail.alpha == pytest.approx(1.0 + len(above) / logs.sum(), rel=1e-6)  # Clauset et al. eq 3.1
    assert tail.rate == pytest.approx(1.0 / (above.mean() - tail.x_min), rel=1e-3)
    law = np.log((tail.alpha - 1.0) / tail.x_min) - tail.alpha * logs
    other = np.log(tail.rate) - tail.rate * (above - tail.x_min)
    assert tail.ratio == pytest.approx((law - other).sum(), abs=1e-3)
    rank = np.arange(len(above)) / len(above)
    assert tail.distance == pytest.approx(np.abs(1.0 - np.exp((1.0 - tail.alpha) * logs) - rank).max(), abs=1e-6)


@needs_powerlaw
def test_exponential_gaps_are_told_apart():
    found = clogging([run_of(np.random.default_rng(1).exponential(1.0, 1500))])
    assert found.tail.ratio < 0
    assert "exponential" in found.statement()


@needs_powerlaw
def test_the_clogged_state_is_named():
    clogged, free = clogging([run_of(pareto(1.6, 300, 1))]), clogging([run_of(pareto(3.0, 300, 1))])
    assert clogged.as_json()["clogged"] is True and "diverges" in clogged.statement()
    assert free.as_json()["clogged"] is False and "finite" in free.statement()
    near = clogging([run_of(pareto(2.0, 400, 4))])
    assert "within two standard errors" in near.statement()


@needs_powerlaw
def test_open_gaps_are_counted_and_do_not_touch_the_plain_exponent():
    gaps = pareto(3.0, 300, 7)
    plain, censored = clogging([run_of(gaps)]), clogging([run_of(gaps, until=1e4)])
    assert (len(plain.gaps.open), len(censored.gaps.open)) == (0, 1)
    assert censored.gaps.closed.tolist() == plain.gaps.closed.tolist()
    assert censored.tail.alpha == plain.tail.alpha and np.isnan(plain.tail.alpha_open)
    assert censored.tail.alpha_open < plain.tail.alpha
    assert plain.as_json()["tail"]["alpha_open"] is None


@needs_powerlaw
def test_an_open_gap_that_is_shorter_than_the_tail_says_nothing_of_its_exponent():
    closed = np.sort(np.concatenate([np.full(80, 0.1), pareto(3.0, 150, 7, x_min=2.0)]))
    alone, short, both = (fit_tail(Gaps(closed, np.array(seen)))[0] for seen in ([50.0], [0.05], [0.05, 50.0]))
    assert alone.x_min > 1.0 and np.isnan(short.alpha_open)
    assert both.alpha_open == alone.alpha_open


@needs_powerlaw
def test_blocked_runs_are_never_called_free():
    found = clogging([run_of(pareto(3.0, 300, 7), until=1e4), run_of([1.0])])
    assert found.tail.alpha > 2 and "no clogged state" not in found.statement()
    assert "1 of 2 runs blocked" in found.statement()
    assert f"alpha = {found.tail.alpha_open:.2f} if these count as longer" in found.statement()


@pytest.mark.more
@needs_powerlaw
def test_the_censored_exponent_is_right_where_the_plain_one_is_not():
    # Every gap above 4 s is broken off there: the closed ones alone look steeper than they are.
    gaps = pareto(2.0, 1200, 0, x_min=1.0)
    seen = Gaps(np.sort(gaps[gaps < 4.0]), np.full((gaps >= 4.0).sum(), 4.0))
    tail, _ = fit_tail(seen)
    assert tail.alpha > 2.2
    assert abs(tail.alpha_open - 2.0) < 3.0 * (2.0 - 1.0) / np.sqrt(tail.n)


@needs_powerlaw
def test_nothing_depends_on_the_order_of_runs():
    runs = [run_of(pareto(2.5, 40, seed), until=500.0 if seed % 2 else np.nan) for seed in range(6)]
    one, other = clogging(runs), clogging(runs[::-1])
    assert one.as_json() == other.as_json()
    assert one.gaps.closed.tolist() == other.gaps.closed.tolist()
    assert one.exits == sum(len(run.time) for run in runs)


def test_too_few_gaps_give_no_exponent_but_the_reason():
    tail, reason = fit_tail(Gaps(np.linspace(1.0, 2.0, FEWEST_GAPS - 1), NONE))
    assert tail is None and f"{FEWEST_GAPS - 1} gaps" in reason and str(FEWEST_GAPS) in reason
    tail, reason = fit_tail(Gaps(np.repeat([0.04, 0.08, 0.12], 40), NONE))  # frames of a camera
    assert tail is None and "3 lengths" in reason
    assert fit_tail(Gaps(np.zeros(100), NONE))[0] is None
    assert "no exponent: 1 gaps" in clogging([run_of([1.0])]).statement()


@needs_powerlaw
def test_too_few_gaps_in_the_tail_give_no_exponent():
    rng = np.random.default_rng(0)
    for seed in range(40):  # most of a narrow bulk: where the law fits best the tail is short
        gaps = np.concatenate([rng.normal(1.0, 0.01, 60), 5.0 * rng.uniform(size=7) ** -0.5])
        tail, reason = fit_tail(Gaps(gaps, NONE))
        if tail is None:
            assert "in the tail" in reason and str(FEWEST_IN_TAIL) in reason
            return
        assert tail.n >= FEWEST_IN_TAIL, seed
    pytest.fail("no sample had a short tail")


@needs_powerlaw
def test_the_fit_says_nothing(capfd):
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit_tail(Gaps(np.concatenate([[0.0], pareto(4.0, 300, 1)]), NONE))
    assert capfd.readouterr() == ("", "")


def test_without_the_library_there_is_no_exponent_and_all_else(monkeypatch, tmp_path):
    """A file of times alone, as people have them, and an installation without powerlaw."""
    gaps = pareto(2.0, 100, 1)
    (tmp_path / "a.csv").write_text("time\n" + "".join(f"{time}\n" for time in np.cumsum([1.0, *gaps])))
    monkeypatch.setitem(sys.modules, "powerlaw", None)
    tail, reason = fit_tail(Gaps(gaps, NONE))
    assert tail is None and reason == "it needs powerlaw, which is not installed: pip install powerlaw"
    result = CliRunner().invoke(app, ["clogging", str(tmp_path / "a.csv")])
    assert result.exit_code == 0, result.stderr
    rows = [line.split() for line in result.stdout.splitlines()]
    assert ["gaps", "100"] in rows and ["exponent", "of", "the", "tail", "-"] in rows
    assert f"no exponent: {reason}." in result.stdout
    told = CliRunner().invoke(app, ["clogging", str(tmp_path / "a.csv"), "--json", "--out", str(tmp_path / "out")])
    (found,) = json.loads(told.stdout)["sets"]
    assert (found["runs"], found["tail"], found["gaps"]["count"]) == (1, None, 100) and found["bursts"]["count"] > 1
    assert len((tmp_path / "out" / "gaps.csv").read_text().splitlines()) == 101


# ------------------------------------------------------------------------------------------------------------ picture


@needs_powerlaw
def test_the_picture_shows_curve_law_and_exponential():
    pytest.importorskip("matplotlib")
    from crowd_env.rendering.survival import survival_curves

    found = clogging([run_of(pareto(2.2, 300, 1), until=1e5)])
    (axes,) = survival_curves({"sheep": found}).axes
    assert axes.get_xscale() == axes.get_yscale() == "log"
    lines = {line.get_label(): np.array(line.get_data()) for line in axes.get_lines()}
    (law,) = (line for label, line in lines.items() if label.startswith("power law"))
    slope = np.diff(np.log(law[1])) / np.diff(np.log(law[0]))
    assert slope == pytest.approx(np.full(len(slope), 1.0 - found.tail.alpha))
    assert law[0, 0] == pytest.approx(found.tail.x_min)
    t, share = survival(found.gaps)
    above = np.concatenate([[1.0], share])[np.searchsorted(t, found.tail.x_min)]
    assert law[1, 0] == pytest.approx(above)
    assert "sheep: 300 gaps, 1 open" in lines and "exponential, same tail" in lines
    with pytest.raises(ValueError, match="no gap to draw"):
        survival_curves({"nothing": clogging([exits_of_run([1.0])])})
