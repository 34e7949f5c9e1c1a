"""What a finished evacuation is judged by, and the mean of many with its interval."""

from typing import NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.state import Floats


class EpisodeMetrics(NamedTuple):
    """One evacuation of one crowd."""

    evacuation_time: float  # s    when the last person got out; nan if someone did not
    mean_exit_time: float  # s    over those who got out
    unfinished: int  # people still inside at the time limit, or when the exits were found blocked
    blocked_since: float  # s    when the last one got out before the exits blocked for good; nan if they did not
    flow: float  # 1/s  least-squares slope of the number out against time; nan with fewer than 3 exits
    contact_impulse: float  # N s  contact impulse magnitudes per person, summed over the episode
    max_overlap: float  # m
    mean_overlap: float  # m    over all overlapping contacts of all steps
    max_outside: float  # m    furthest reach of a body beyond a wall
    max_speed: float  # m/s  of anyone, after any physics step
    escaped: (
        int  # people found outside of the walkable area after any decision, by position; 0 unless something is wrong
    )
    residual: float  # m/s  worst solver residual
    unconverged: int  # physics steps that ended above the solver's tolerance


class Exits(NamedTuple):
    """When the people of one crowd got out."""

    last: float  # s    nan if someone did not get out
    mean: float  # s    over those who did; nan if nobody
    missing: int  # people who did not get out
    flow: float  # 1/s  see `flow_slope`


@kernel
def summarise_exits(times: Floats) -> Exits:
    """Return what there is to say of the ascending ``times`` of exit [s], those of people still inside, nan, at the end."""
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
    """Mean of a sample with its spread and the 95 % bootstrap interval of the mean."""

    mean: float
    sd: float
    ci95: tuple[float, float]


def summarise(values: Floats | list[float], resamples: int = 2000) -> Summary:
    """Return mean, sample standard deviation and percentile-bootstrap interval of the finite ``values``; nan if none."""
    sample = np.asarray(values, dtype=np.float64)
    sample = sample[np.isfinite(sample)]
    nan = float("nan")
    if len(sample) == 0:
        return Summary(nan, nan, (nan, nan))
    if len(sample) == 1:
        return Summary(float(sample[0]), nan, (nan, nan))
    rng = np.random.default_rng(0)  # the interval of the same sample is always the same
    means = rng.choice(sample, (resamples, len(sample))).mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return Summary(float(sample.mean()), float(sample.std(ddof=1)), (float(low), float(high)))
