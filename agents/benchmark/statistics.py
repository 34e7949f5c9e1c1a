"""Few runs, honestly: interquartile means, stratified bootstrap and performance profiles (Agarwal et al. 2021).

Deep Reinforcement Learning at the Edge of the Statistical Precipice, NeurIPS 2021; the definitions are those of their library
rliable, which cannot be installed beside pandas 3.  With one task to a benchmark there is one stratum.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats

_RESAMPLES = 20_000


def interquartile_mean(values: ArrayLike) -> Floats:
    """Return the mean of the middle half of the values along the last axis: a quarter, rounded down, is cut off at each end."""
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=-1)
    cut = int(0.25 * ordered.shape[-1])
    return np.asarray(ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1))


def bootstrap_interval(
    values: ArrayLike,
    statistic: Callable[[Floats], Floats] = interquartile_mean,
    coverage: float = 0.95,
    resamples: int = _RESAMPLES,
) -> tuple[float, float]:
    """Return the percentile bootstrap interval of a statistic of runs (R,), which draws runs anew with equal chances.

    The draws are always the same ones.  One run has no interval: (nan, nan).
    """
    values = np.asarray(values, dtype=np.float64)
    if len(values) < 2:
        return float("nan"), float("nan")
    drawn = np.random.default_rng(0).integers(0, len(values), (resamples, len(values)))
    low, high = np.quantile(statistic(values[drawn]), [0.5 - coverage / 2, 0.5 + coverage / 2])
    return float(low), float(high)


def performance_profile(times: ArrayLike, thresholds: ArrayLike) -> Floats:
    """Return the share of times that are at most as long as each threshold; nan, of a run that did not clear, never is."""
    found = np.asarray(times, dtype=np.float64).ravel()
    return np.asarray((found[None, :] <= np.asarray(thresholds, dtype=np.float64)[:, None]).mean(axis=1))
