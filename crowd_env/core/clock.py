"""When something that is done between steps, now and then, is next due: sorting, doors, new routes."""

import math
from collections.abc import Iterable

import numpy as np

from crowd_env.core.arrays.state import Floats


class DueClock:
    """Due times of the environments of a batch, each by its own clock.

    Attributes
    ----------
    due : (E,) s; 0 is at once.
    """

    def __init__(self, environments: int) -> None:
        self.due: Floats = np.zeros(environments)

    def is_due(self, e: int, now: float) -> bool:
        """Whether the time of environment ``e`` has come, but for rounding."""
        return bool(now >= self.due[e] - 1e-9)

    def steps_until_due(self, environments: Iterable[int], time: Floats, dt: float) -> int | None:
        """Return after how many steps of ``dt`` [s], at least one, the first of these is due; None if there are none."""
        waits = (max(1, math.ceil((self.due[e] - time[e]) / dt - 1e-9)) for e in environments)
        return min(waits, default=None)


def next_multiple(interval: float, now: float) -> float:
    """Return the first multiple of ``interval`` [s] after ``now`` [s]."""
    return (math.floor(now / interval + 1e-6) + 1) * interval
