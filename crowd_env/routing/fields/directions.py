"""Directions from travel times on a grid: their slope, and how to look up between the nodes.

Steps that NumPy does as fast are not compiled: a first start waits for every kernel.

Arrays over nodes have shape (rows, cols); node (i, j) lies at ``origin + spacing * (j, i)``.
"""

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.kernels.jit import allocating_kernel, inner_kernel, kernel
from crowd_env.routing.fields.grid import ANTIDIAGONAL, DIAGONAL, RIGHT, UP
from crowd_env.routing.fields.lookup import ALONE, BLEND

_KINK = 0.95  # a gradient shorter than this (1 = smooth) averages two ways of equal length that part by over 36 degrees


def descend(time: Floats, spacing: float) -> Floats:
    """Return the unit vector (rows, cols, 2) of steepest descent of ``time`` at all known nodes; 0 elsewhere.

    Known nodes lie at least two spacings from every wall, so neighbors are never on different sides of one.
    """
    direction = np.zeros((*time.shape, 2))
    _descend(time, spacing, direction)
    return direction


@kernel
def _descend(time: Floats, spacing: float, direction: Floats) -> None:
    rows, cols = time.shape
    for i in range(rows):
        for j in range(cols):
            if np.isnan(time[i, j]):
                continue
            norm, ex, ey = 0.0, 0.0, 0.0
            for upwind in (False, True):
                for along_x in (True, False):
                    slope = -_slope(time, i, j, along_x, spacing, upwind)
                    ex, ey = (slope, ey) if along_x else (ex, slope)
                norm = np.sqrt(ex * ex + ey * ey)
                if norm > _KINK:
                    break
            if norm > 1e-6:
                direction[i, j, 0], direction[i, j, 1] = ex / norm, ey / norm


@inner_kernel
def _time_at(time: Floats, i: int, j: int) -> float:
    return time[i, j] if 0 <= i < time.shape[0] and 0 <= j < time.shape[1] else np.nan


@inner_kernel
def _slope(time: Floats, i: int, j: int, along_x: bool, spacing: float, upwind: bool) -> float:
    """Return the derivative of ``time`` along one axis, over known nodes only; 0 if there is no neighbor.

    Central if both neighbors are known, else one-sided of second order where there are two nodes, else of first.
    ``upwind`` looks only to the side of the smaller neighbor (the upper one on a tie).
    """
    di, dj = (0, 1) if along_x else (1, 0)
    here, low, high = time[i, j], _time_at(time, i - di, j - dj), _time_at(time, i + di, j + dj)
    if upwind:
        if high < here and not low < high:
            return (high - here) / spacing
        return (here - low) / spacing if low < here else 0.0
    if not np.isnan(low) and not np.isnan(high):
        return (high - low) / (2.0 * spacing)
    if not np.isnan(high):
        next_high = _time_at(time, i + 2 * di, j + 2 * dj)
        slope = (4.0 * high - 3.0 * here - next_high) / (2.0 * spacing)
        return (high - here) / spacing if np.isnan(slope) else slope
    if not np.isnan(low):
        next_low = _time_at(time, i - 2 * di, j - 2 * dj)
        slope = (3.0 * here - 4.0 * low + next_low) / (2.0 * spacing)
        return (here - low) / spacing if np.isnan(slope) else slope
    return 0.0


def cell_kinds(time: Floats, direct: Ints, blocked: NDArray[np.uint8]) -> Ints:
    """Return for the cell right of and above every node how to look up in it: an exit, `BLEND` or `ALONE`.

    It is an exit if all walkable corners reach that exit in a straight line.
    """
    walkable = ~np.isnan(time)
    nowhere = np.iinfo(np.int32).max
    least = _over_corners(np.minimum, np.where(walkable, direct, nowhere).astype(np.int32))
    most = _over_corners(np.maximum, np.where(walkable, direct, -1).astype(np.int32))
    kind = np.full(time.shape, ALONE, dtype=np.int64)
    kind[:-1, :-1] = np.where(least == most, most, np.where(least == nowhere, ALONE, BLEND))
    i, j = np.nonzero(blocked[:-1, :-1] | blocked[:-1, 1:] | blocked[1:, :-1])
    a, b, c, d = walkable[i, j], walkable[i, j + 1], walkable[i + 1, j], walkable[i + 1, j + 1]
    lines, right, above = blocked[i, j], blocked[i, j + 1], blocked[i + 1, j]
    split = ((lines & RIGHT) > 0) & a & b | ((lines & UP) > 0) & a & c
    split |= ((right & UP) > 0) & b & d | ((above & RIGHT) > 0) & c & d
    split |= ((lines & DIAGONAL) > 0) & a & d | ((lines & ANTIDIAGONAL) > 0) & b & c
    kind[i[split], j[split]] = ALONE
    return kind


def _over_corners(combine: np.ufunc, values: np.ndarray) -> np.ndarray:
    """Return ``combine`` (minimum, maximum) over the corners of every cell; ``values`` are (rows, cols)."""
    beside = combine(values[:, :-1], values[:, 1:])
    return np.asarray(combine(beside[:-1], beside[1:]))


@allocating_kernel
def regions_on_the_way(time: Floats, direction: Floats, region: Ints) -> Ints:
    """Return for every node the regions (bits of ``region``) that the way from it leads through, its own included.

    The way is walked for 16 spacings along the directions, then goes on as from the node it has come nearest to; where that
    one is not reached sooner, as from the neighbor that is reached soonest.
    """
    rows, cols = time.shape
    through = region.copy()
    order = np.argsort(time.ravel())  # nan last
    for n in order:
        i, j = n // cols, n % cols
        if np.isnan(time[i, j]):
            break
        y, x, p, q = float(i), float(j), i, j
        for _ in range(16):
            ex, ey = _direction_between(direction, x, y)
            if ex == 0.0 and ey == 0.0:
                break
            x, y = min(max(x + ex, 0.0), cols - 1.0), min(max(y + ey, 0.0), rows - 1.0)
            k, m = int(y + 0.5), int(x + 0.5)
            if np.isnan(time[k, m]):
                break
            p, q = k, m
            through[i, j] |= region[p, q]
        if not time[p, q] < time[i, j]:
            least, p, q = time[i, j], i, j
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, cols)):
                    if time[k, m] < least:
                        least, p, q = time[k, m], k, m
        through[i, j] |= through[p, q]
    return through


@inner_kernel
def _direction_between(direction: Floats, x: float, y: float) -> tuple[float, float]:
    """Return the direction at column ``x`` and row ``y``, between the nodes; (0, 0) where there is none."""
    rows, cols = direction.shape[0], direction.shape[1]
    i, j = min(int(y), rows - 2), min(int(x), cols - 2)
    v, u = y - i, x - j
    ex, ey = 0.0, 0.0
    for c in range(4):
        weight = (u if c & 1 else 1.0 - u) * (v if c >> 1 else 1.0 - v)
        ex += weight * direction[i + (c >> 1), j + (c & 1), 0]
        ey += weight * direction[i + (c >> 1), j + (c & 1), 1]
    norm = np.sqrt(ex * ex + ey * ey)
    return (ex / norm, ey / norm) if norm > 1e-3 else (0.0, 0.0)
