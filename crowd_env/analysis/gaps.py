"""How wide a passage is between walls, measured on the walls themselves."""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats

_ROUNDS = 30
_CLOSE = 1e-9  # m


class Gap(NamedTuple):
    """The narrowest line across a passage."""

    width: float  # m
    line: Floats  # (2, 2)  m   its ends on the walls


def distances(points: Floats, segments: Floats) -> Floats:
    """Return the distance (K,) of points (K, 2) to the nearest of ``segments`` (W, 2, 2) [m]; inf without any."""
    found = np.full(len(points), np.inf)
    if len(segments):
        for k, point in enumerate(points):
            found[k] = np.hypot(*(_nearest(point, segments) - point).T).min()
    return found


def _nearest(point: Floats, segments: Floats) -> Floats:
    """Return the point (W, 2) of each segment that is nearest to ``point`` (2,)."""
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    s = np.clip(((point - a) * along).sum(axis=1) / square, 0.0, 1.0)
    return a + s[:, None] * along


def gap_at(walls: Floats, at: Floats, half: float, reach: float) -> Gap | None:
    """Return the gap whose middle lies near ``at`` (2,), where the nearest wall is ``half`` [m] away.

    From both sides the walls are followed to where they are nearest to each other.  None if that leads further away than
    ``reach`` allows (half the width of the gap is at most ``half + reach``), for example into a corner.
    """
    walls = _within(walls, at, 3.0 * (half + reach) + 1e-6)
    if not len(walls):
        return None
    middle, gap = at, Gap(0.0, np.stack([at, at]))
    for _ in range(_ROUNDS):
        points = _nearest(middle, walls)
        away = points - middle
        length = np.hypot(*away.T)
        near = int(np.argmin(length))
        opposite = np.where(away @ away[near] < 0, length, np.inf)
        far = int(np.argmin(opposite))
        if not np.isfinite(opposite[far]):
            return None
        a, b = points[near], points[far]
        for _ in range(_ROUNDS):
            b = _nearest(a, walls[far : far + 1])[0]
            a = _nearest(b, walls[near : near + 1])[0]
        gap = Gap(float(np.hypot(*(b - a))), np.stack([a, b]))
        moved = float(np.hypot(*(0.5 * (a + b) - middle)))
        middle = 0.5 * (a + b)
        if moved < _CLOSE:
            break
    clear = float(np.hypot(*(_nearest(middle, walls) - middle).T).min())
    is_gap = abs(2.0 * clear - gap.width) < 1e-6 and gap.width > 0.0
    return gap if is_gap and 2.0 * half - 1e-6 <= gap.width <= 2.0 * (half + reach) + 1e-6 else None


def _within(walls: Floats, at: Floats, reach: float) -> Floats:
    """Return the walls whose box comes within ``reach`` of a point."""
    near = np.ones(len(walls), dtype=np.bool_)
    for k in (0, 1):
        near &= np.minimum(walls[:, 0, k], walls[:, 1, k]) <= at[k] + reach
        near &= np.maximum(walls[:, 0, k], walls[:, 1, k]) >= at[k] - reach
    return np.asarray(walls[near])


def across(walls: Floats, at: Floats) -> Gap:
    """Return the line through ``at`` (2,) from the nearest wall to as far on the other side."""
    if not len(walls):
        return Gap(np.inf, np.stack([at, at]))
    points = _nearest(at, walls)
    a = points[int(np.argmin(np.hypot(*(points - at).T)))]
    return Gap(2.0 * float(np.hypot(*(a - at))), np.stack([a, 2.0 * at - a]))
