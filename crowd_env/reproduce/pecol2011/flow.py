"""Readings of one flow from many evacuations.

The paper says "linear regression of the 50 simulations" and "the slope allows us to obtain the average flow", but not over
which exits, nor whether the runs are put together first.  Here are the readings that can be meant, side by side.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.envs.metrics import flow_slope, summarise


class Estimate(NamedTuple):
    """A flow [1/s] with its spread; None where there are too few exits."""

    value: float | None
    n: int  # runs or exits that it rests on
    sd: float | None = None  # over runs
    ci95: tuple[float, float] | None = None  # over runs: t; of a pooled line by the jackknife


class Estimator(NamedTuple):
    """One reading of the flow from exit times (R, N)."""

    reading: str
    estimate: Callable[[Floats], Estimate]


def run_slopes(exit_times: Floats, first: int = 1, last: int | None = None) -> Floats:
    """Return the slope [1/s] of the number out against time of every run (R,), exits ``first`` to ``last`` of each.

    nan where fewer than three got out.  ``exit_times`` (R, N) [s] may hold nan for people still inside, in any order.
    """
    ordered = np.sort(exit_times, axis=1)
    return np.array([flow_slope(times[first - 1 : last]) for times in ordered])


def pooled_line(exit_times: Floats, before: float = np.inf) -> tuple[float, float, int]:
    """Return slope [1/s], value at t = 0 and number of exits of one line through the exits of all runs together.

    Every exit is a point (its time, how many of its run are out by then); only exits earlier than ``before`` [s] count.
    """
    time, count, _ = _exits(exit_times, before)
    slope, start = _line(time, count)
    return slope, start, len(time)


def _exits(exit_times: Floats, before: float) -> tuple[Floats, Floats, Ints]:
    """Return for each exit (K,) its time [s], how many of its run are out by then, and its run."""
    ordered = np.sort(exit_times, axis=1)
    run, earlier = np.nonzero(ordered < before)  # false for nan
    return ordered[run, earlier], 1.0 + earlier.astype(np.float64), run.astype(np.int64)


def _line(time: Floats, count: Floats) -> tuple[float, float]:
    """Return slope and start of the line of least squares; nan for fewer than three exits, or all at one time."""
    if len(time) < 3 or np.ptp(time) < 1e-6:
        return np.nan, np.nan
    slope, start = np.polyfit(time, count, 1)
    return float(slope), float(start)


def _pooled(exit_times: Floats, before: float = np.inf) -> Estimate:
    time, count, run = _exits(exit_times, before)
    slope, runs = _line(time, count)[0], len(exit_times)
    if not np.isfinite(slope):
        return Estimate(None, len(time))
    if runs < 2:
        return Estimate(slope, len(time))
    # The jackknife (Tukey 1958), each run left out once: it also corrects what few runs shift the slope by.
    without = np.array([_line(time[run != k], count[run != k])[0] for k in range(runs)])
    known = bool(np.isfinite(without).all())
    return Estimate(slope, len(time), ci95=summarise(runs * slope - (runs - 1) * without).ci95 if known else None)


def mean_of_runs(values: Floats) -> Estimate:
    """Return the mean over the runs (R,) that have a value, not nan, and of two or more its spread."""
    mean, sd, ci95 = summarise(values)
    n = int(np.isfinite(values).sum())
    return Estimate(mean, n, sd, ci95) if n > 1 else Estimate(mean if n else None, n)


def _per_run(exit_times: Floats, first: int = 1, last: int | None = None) -> Estimate:
    return mean_of_runs(run_slopes(exit_times, first, last))


# The first is the one we state as ours; the last three cut in time, which raises a slope.
ESTIMATORS: dict[str, Estimator] = {
    "per run": Estimator("mean of the slopes of the runs", _per_run),
    "pooled": Estimator("one line through all exits of all runs", _pooled),
    "exits 3-17": Estimator("mean slope per run, exits 3 to 17", lambda times: _per_run(times, 3, 17)),
    "exits 1-15": Estimator("mean slope per run, exits 1 to 15", lambda times: _per_run(times, 1, 15)),
    "before 5 s": Estimator("all runs together, exits before 5 s", lambda times: _pooled(times, 5.0)),
    "before 6 s": Estimator("all runs together, exits before 6 s", lambda times: _pooled(times, 6.0)),
    "before 7 s": Estimator("all runs together, exits before 7 s", lambda times: _pooled(times, 7.0)),
}
