"""N(t): how many people are inside, over time, in one run and in many."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_MOST_ROWS = 1000
_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # s


class Egress(NamedTuple):
    """How many are inside at T times, over runs; a run that has ended stays as it ended."""

    time: Floats  # (T,)  s
    mean: Floats  # (T,)
    quantiles: Floats  # (T, Q)  of `QUANTILES`


def inside(exit_time: Floats, time: Floats) -> np.ndarray:
    """Return how many people are inside at ``time`` (T,) [s]; ``exit_time`` (N,) [s] is nan for those who did not get out."""
    return len(exit_time) - np.searchsorted(np.sort(exit_time), time, side="right")


def egress(exit_times: Sequence[Floats]) -> Egress:
    """Return N(t) over runs from the exit times (N,) [s] of each, at round times up to the last exit of all."""
    known = np.concatenate([times[np.isfinite(times)] for times in exit_times])
    end = float(known.max(initial=0.0))
    step = next((step for step in _STEPS if end / step < _MOST_ROWS), _STEPS[-1])
    # whole multiples over whole parts: 0.3, not 0.30000000000000004
    time = np.round(np.arange(np.ceil(end / step - 1e-9) + 1) * step, 1)
    counts = np.array([inside(times, time) for times in exit_times])
    return Egress(time, counts.mean(axis=0), np.quantile(counts, QUANTILES, axis=0).T)
