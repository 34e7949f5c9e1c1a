"""Groups of pedestrians that walk together: neighbors at the start."""

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.behaviors.pulls import ALONE
from crowd_env.scenarios.distributions import Distribution


def draw_groups(rng: np.random.Generator, sizes: Distribution, position: Floats) -> Ints:
    """Return the number of the group of each person at ``position`` (N, 2) [m], -1 for people alone.

    The sizes are drawn and rounded; the last group takes the remaining people.  A group is a run of successive people in
    strips to and fro, about as wide as a group.
    """
    count = len(position)
    drawn = np.maximum(np.rint(sizes.sample(rng, count)), 1.0)
    rank = np.searchsorted(np.cumsum(drawn), np.arange(count), side="right")
    number = np.empty(count, dtype=np.int64)
    number[_in_strips(position, float(drawn.mean()) / count)] = rank
    return np.where(np.bincount(number, minlength=count)[number] > 1, number, ALONE)


def _in_strips(position: Floats, share: float) -> Ints:
    """Return the people (N,) strip by strip, each strip as wide as a square that is this share of the area around them."""
    x, y = (position - position.min(axis=0)).T
    width = max(float(np.sqrt(share * x.max() * y.max())), 1e-9)
    strip = np.floor(y / width)
    return np.lexsort([np.where(strip % 2.0 == 0.0, x, -x), strip])


def same_route(route: Ints, group: Ints) -> Ints:
    """Return the routes (N,) with one route a group: that of its first member."""
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return np.where(group == ALONE, route, route[first][number])
