"""The march itself: travel times on free nodes, and through doors that are passed one way only."""

from typing import NamedTuple

import numpy as np
import skfmm

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.extension import carried_along

# A one-way door is a strip of nodes that the march does not enter: thick enough that side-by-side neighbors never skip it.
_STRIP = 1.5  # spacings, on either side of the line


class Gate(NamedTuple):
    """A one-way door on the nodes of a grid, all (rows, cols)."""

    strip: Bools  # the doorway
    front: Bools  # next to it, on the side of entry
    back: Bools  # next to it, on the far side
    depth: Floats  # m, from the nodes of the strip to the far side
    normal: Floats  # (2,)  unit vector of passing


def march(time: Floats, level: Floats, free: Bools, speed: Floats, spacing: float, start: float) -> Floats:
    """Return the travel times [s] of all free nodes that can be reached, nan elsewhere.

    Parameters
    ----------
    time : (rows, cols) s, of the nodes that the march starts from; nan elsewhere.
    level : m, its zero line starts the march.
    speed : speed relative to plain floor.
    start : s, travel time at that line.
    """
    time = time.copy()
    known = ~np.isnan(time)
    if (free & ~known).any():
        marched = skfmm.travel_time(np.ma.MaskedArray(level, ~free), speed, dx=spacing, order=2)
        far = free & ~known & ~np.ma.getmaskarray(marched)
        time[far] = np.ma.getdata(marched)[far] + start
    return time


def march_on(time: Floats, free: Bools, speed: Floats, spacing: float) -> Floats:
    """Return ``time`` [s] (rows, cols) with the travel times of the ``free`` nodes beyond the known ones (not nan)."""
    known = ~np.isnan(time)
    edge = grid.with_fringe(free & ~known, known) & known
    beyond = march(
        np.where(edge, 0.0, np.nan), np.where(edge, -0.5, 0.5) * spacing, edge | (free & ~known), speed, spacing, 0.0
    )
    arrival = np.where(edge, time, 0.0)
    return np.where(known, time, beyond + carried_along(beyond, arrival))


def gate(line: Floats, free: Bools, points: Floats, spacing: float) -> Gate:
    """Return the one-way door on ``line`` (2, 2) [m], passed from its right to its left; nodes lie at ``points``."""
    x, y = points[..., 0], points[..., 1]
    along = line[1] - line[0]
    length = float(np.hypot(*along))
    normal = np.array([-along[1], along[0]]) / length
    side = (x - line[0, 0]) * normal[0] + (y - line[0, 1]) * normal[1]
    place = ((x - line[0, 0]) * along[0] + (y - line[0, 1]) * along[1]) / length
    beside = free & (place > -spacing) & (place < length + spacing)
    width = _STRIP * spacing
    return Gate(
        strip=beside & (np.abs(side) <= width),
        front=beside & (side < -width) & (side >= -2.0 * width),
        back=beside & (side > width) & (side <= 2.0 * width),
        depth=np.maximum(width - side, 0.0),
        normal=normal,
    )


def march_through(
    time: Floats, level: Floats, free: Bools, speed: Floats, spacing: float, start: float, gates: list[Gate]
) -> Floats:
    """Return the travel times as `march` does, where ``gates`` are passed one way only; nan in their strips.

    The way through a gate is the way to its front plus the time from its back; with several gates this is found by relaxation.
    """
    open_floor = free & ~np.any([g.strip for g in gates], axis=0)
    total = march(time, level, open_floor, speed, spacing, start)
    to_front = []
    for g in gates:
        front = g.front & open_floor
        level_of_front = np.where(front, -0.5, 0.5) * spacing
        if not front.any():
            to_front.append(np.full(time.shape, np.nan))
            continue
        to_front.append(march(np.where(front, 0.0, np.nan), level_of_front, open_floor, speed, spacing, 0.0))
    for _ in gates:
        for g, reach in zip(gates, to_front, strict=True):
            out = total[g.back & open_floor]
            if len(out) and not np.isnan(out).all():
                total = np.fmin(total, reach + (float(np.nanmin(out)) + 3.0 * _STRIP * spacing))
    return total


def lead_through(time: Floats, direction: Floats, gates: list[Gate]) -> None:
    """Let the strips of the gates be walked forwards, in place."""
    for g in gates:
        out = time[g.back]
        if len(out) and not np.isnan(out).all():
            time[g.strip] = float(np.nanmin(out)) + g.depth[g.strip]
            direction[g.strip] = g.normal
