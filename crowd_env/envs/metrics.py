"""Metrics of a finished evacuation, and the mean of many with its interval."""

import functools
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.kernels.jit import kernel

_STRIPS = 100_000  # of an integral


class EpisodeMetrics(NamedTuple):
    """Metrics of one evacuation of one crowd."""

    evacuation_time: float  #: s, when the last pedestrian got out; nan if one did not
    mean_exit_time: float  #: s, from the start or the entry, over pedestrians that got out
    unfinished: int  #: people inside or waiting to come in at the time limit, or when the exits were found blocked
    blocked_since: float  #: s, last exit before the exits blocked for good, 0 if there was none; nan if they did not
    flow: float  #: 1/s, least-squares slope of the number out against time; nan with fewer than 3 exits
    contact_impulse: float  #: N s, contact impulse magnitudes per person, summed over the episode
    max_overlap: float  #: m
    mean_overlap: float  #: m, over all overlapping contacts of all steps
    max_outside: float  #: m, furthest reach of a body beyond a wall
    max_speed: float  #: m/s, of any pedestrian, after any physics step
    escaped: int  #: people found outside of the walkable area after any decision; 0 unless something is wrong
    residual: float  #: m/s, worst solver residual
    unconverged: int  #: physics steps that ended above the solver's tolerance

    @property
    def score(self) -> float:
        """What tasks are judged by: when the last pedestrian got out [s]; inf if one did not."""
        return math.inf if self.unfinished else self.evacuation_time


class Exits(NamedTuple):
    """Exit times of one crowd, summed up."""

    last: float  # s    nan if a pedestrian did not get out
    mean: float  # s    over pedestrians that got out; nan if none did
    missing: int  # pedestrians that did not get out
    flow: float  # 1/s  see `flow_slope`


@kernel
def summarise_exits(times: Floats) -> Exits:
    """Sum up exit times [s] that ascend, with nan at the end for people still inside."""
    count = len(times)
    while count > 0 and not times[count - 1] < np.inf:
        count -= 1
    total = 0.0
    for k in range(count):
        total += times[k]
    mean = total / count if count > 0 else np.nan
    last = times[count - 1] if 0 < count == len(times) else np.nan
    flow = np.nan
    if count >= 3 and times[count - 1] > times[0]:
        products, squares = 0.0, 0.0
        for k in range(count):
            products += (times[k] - mean) * (k - 0.5 * (count - 1))
            squares += (times[k] - mean) * (times[k] - mean)
        flow = products / squares
    return Exits(last, mean, len(times) - count, flow)


def flow_slope(exit_time: Floats) -> float:
    """Return the least-squares slope [1/s] of the count of people out against time (Pécol et al. 2011, Fig 3).

    ``exit_time`` may hold nan for people still inside; with fewer than 3 exits, or all at once, the slope is nan.
    """
    times = np.asarray(exit_time, dtype=np.float64)
    return float(summarise_exits(np.sort(times[np.isfinite(times)])).flow)


class Summary(NamedTuple):
    """Mean of a sample with its spread and the 95 % confidence interval of the mean."""

    mean: float
    sd: float
    ci95: tuple[float, float]


def summarise(values: Floats | list[float]) -> Summary:
    """Return mean, sample standard deviation and 95 % t interval of the mean of the finite ``values``; nan if none.

    The interval is mean ± t sd / √n with Student's t of n - 1 degrees of freedom: exact for normal values of any number, two
    included.  (Intervals of a bootstrap are too short for few runs: of 5 they hold the true mean in 83 to 86 % of cases.)
    One value has no spread and no interval: nan.
    """
    sample = np.asarray(values, dtype=np.float64)
    sample = sample[np.isfinite(sample)]
    nan = float("nan")
    if len(sample) == 0:
        return Summary(nan, nan, (nan, nan))
    mean = float(sample.mean())
    if len(sample) == 1:
        return Summary(mean, nan, (nan, nan))
    sd = float(sample.std(ddof=1))
    half = t_quantile(len(sample) - 1) * sd / math.sqrt(len(sample))
    return Summary(mean, sd, (mean - half, mean + half))


@functools.cache
def t_quantile(freedom: int) -> float:
    """Return t for which Student's t of these degrees of freedom lies in [-t, t] with a probability of 95 %.

    With ``t = sqrt(n) tan(a)`` it is the share of the integral of ``cos(a)^(n - 1)`` over [0, pi / 2] that lies below a.  It is
    summed up here, to 2e-9 of t: scipy would be a large library for one number.
    """
    # What lies beyond 12 standard deviations is less than is rounded away.
    edges = np.linspace(0.0, min(0.5 * math.pi, 12.0 / math.sqrt(freedom)), _STRIPS + 1)
    strips = np.cos(0.5 * (edges[1:] + edges[:-1])) ** (freedom - 1)
    below = np.concatenate([[0.0], np.cumsum(strips)])
    return math.sqrt(freedom) * math.tan(np.interp(0.95 * below[-1], below, edges))


def share_interval(count: int, of: int, coverage: float = 0.95) -> tuple[float, float]:
    """Return the Wilson interval of a share, from ``count`` cases seen in ``of``; nan if ``of`` is 0.

    It is right near 0 and 1 too: 0 of 20 leaves shares up to 0.16 possible (Wilson 1927; Brown, Cai and DasGupta 2001).

    Raises
    ------
    ValueError
        If the count is not between 0 and ``of``.
    """
    if not 0 <= count <= of:
        raise ValueError(f"{count} of {of} is no share")
    if of == 0:
        return float("nan"), float("nan")
    z = NormalDist().inv_cdf(0.5 + 0.5 * coverage)
    share, weight = count / of, z * z / of
    middle = (share + 0.5 * weight) / (1.0 + weight)
    half = z / (1.0 + weight) * math.sqrt(share * (1.0 - share) / of + 0.25 * weight / of)
    # Rounding must not leave 0 of n, or n of n, outside of its own interval.
    return (0.0 if count == 0 else middle - half), (1.0 if count == of else middle + half)
