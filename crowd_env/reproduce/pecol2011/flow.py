"""Readings of one flow from many evacuations.

The paper says "linear regression of the 50 simulations" and "the slope allows us to obtain the average flow", but not over
which exits, nor whether the runs are put together first.  Here are the readings that can be meant, side by side.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import flow_slope, summarise
from crowd_env.reproduce.result import Estimate, mean_of_runs


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
    Slope and value are nan for fewer than three exits, or all at one time.
    """
    ordered = np.sort(exit_times, axis=1)
    run, earlier = np.nonzero(ordered < before)  # false for nan
    time = ordered[run, earlier]
    if len(time) < 3 or np.ptp(time) < 1e-6:
        return np.nan, np.nan, len(time)
    slope, start = np.polyfit(time, 1.0 + earlier, 1)
    return float(slope), float(start), len(time)


def _pooled(exit_times: Floats, before: float = np.inf) -> Estimate:
    (slope, _, n), runs = pooled_line(exit_times, before), len(exit_times)
    if not np.isfinite(slope):
        return Estimate(None, n)
    if runs < 2:
        return Estimate(slope, n)
    # The jackknife (Tukey 1958), each run left out once: it also corrects what few runs shift the slope by.
    without = np.array([pooled_line(np.delete(exit_times, k, axis=0), before)[0] for k in range(runs)])
    known = bool(np.isfinite(without).all())
    return Estimate(slope, n, ci95=summarise(runs * slope - (runs - 1) * without).ci95 if known else None)


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
