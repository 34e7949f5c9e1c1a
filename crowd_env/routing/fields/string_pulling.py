"""String pulling: the shortest way as straight lines to an exit, and arcs around the corners in between.

A disc keeps its radius from every wall.  The shortest way of its center is made of straight lines and of arcs around wall ends.
These are exact, at any angle of the place to the axes of the grid.  The march selects the ones to look at.

A *target* is the end of a straight line, by number.  Exits have the numbers 0 ... X-1.  The circle around wall end c has
two: the way turns around it counterclockwise (X + 2c) or clockwise (X + 2c + 1).  ``spin`` is 1 and -1 then::

    node (x, y) ---- (ex, ey) ----> (tx, ty)     along a tangent of the circle, ``offset`` = spin * radius to its left
                                        ) o      around the wall end ``targets.corner[c]``, by the angle `_turn`
                     exit <------------          along ``targets.leave``; ``targets.rest`` is left to walk
"""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.routing.fields.grid import distance_to_segment, nearest_nodes
from crowd_env.routing.fields.lookup import crosses, exit_frame, nearest_on_exit, through_exit

_GET_AWAY = 0.25  # sine of the least angle between a straight line and a wall with its start in the band
_MARCH = 2.0  # spacings that the march is wrong by, beside ...
_SHARE = 0.03  # ... this share
_TOUCH = 1e-6  # m


class Targets(NamedTuple):
    """Targets of straight lines: X exits, and C wall ends that a way may bend around."""

    exits: Floats  # (X, 2, 2)  m
    corner: Floats  # (C, 2)  m
    leave: Floats  # (2C, 2)  unit vector along which the way leaves the circle
    rest: Floats  # (2C,)  m   of the way from there; inf = there is none
    radius: float  # m   of the disc, and of the circles
    walls: Floats  # (W, 2, 2)  m   that no straight line crosses
    start: Floats  # (X,)  m   of the way from each exit on: seams to another sheet


@inner_kernel
def passes(walls: Floats, x: float, y: float, tx: float, ty: float, radius: float) -> bool:
    """Return whether a disc of ``radius`` can go straight from (x, y) to (tx, ty).

    It must keep off every wall; from a wall that it overlaps at the start it must get away at once.  (The distance to
    a segment is convex along a line: once it grows, it keeps growing.)
    """
    length = np.sqrt((tx - x) ** 2 + (ty - y) ** 2)
    first = min(0.05 * radius, length)
    share = first / length if length > 0.0 else 0.0
    for w in range(len(walls)):
        ax, ay, bx, by = walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]
        if (
            min(ax, bx) > max(x, tx) + radius
            or max(ax, bx) < min(x, tx) - radius
            or min(ay, by) > max(y, ty) + radius
            or max(ay, by) < min(y, ty) - radius
        ):
            continue
        if crosses(x, y, tx, ty, ax, ay, bx, by):
            return False
        start = distance_to_segment(x, y, ax, ay, bx, by)
        enough = min(radius, start) - _TOUCH
        if start < radius - _TOUCH:
            grown = min(radius, start + _GET_AWAY * first) - _TOUCH
            if distance_to_segment(x + share * (tx - x), y + share * (ty - y), ax, ay, bx, by) < grown:
                return False
        if (
            distance_to_segment(ax, ay, x, y, tx, ty) < enough
            or distance_to_segment(bx, by, x, y, tx, ty) < enough
            or distance_to_segment(tx, ty, ax, ay, bx, by) < enough
        ):
            return False
    return True


@inner_kernel
def _tangent(dx: float, dy: float, offset: float) -> tuple[float, float]:
    """Return the unit vector of a straight line that has the place (dx, dy) from its start ``offset`` to its left [m]."""
    square = max(dx * dx + dy * dy, offset * offset)
    along = np.sqrt(square - offset * offset)
    ex, ey = (dx * along + dy * offset) / square, (dy * along - dx * offset) / square
    norm = np.sqrt(ex * ex + ey * ey)
    return ex / norm, ey / norm


@inner_kernel
def aim(targets: Targets, n: int, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Return the unit vector from (x, y) to target ``n``, the length of the way out [m], and where its straight line ends [m].

    The length is inf if there is no such way: from behind an exit, within a circle, or where the way is not bent around it.
    """
    radius, nowhere = targets.radius, (0.0, 0.0, np.inf, x, y)
    if n < len(targets.exits):
        frame = exit_frame(targets.exits, n)
        ax, ay, _, _, _, nx, ny = frame
        if (ax - x) * nx + (ay - y) * ny < -_TOUCH:
            return nowhere
        tx, ty = nearest_on_exit(frame, x, y, radius)
        ex, ey = through_exit(frame, x, y, radius, radius)
        return ex, ey, np.sqrt((tx - x) ** 2 + (ty - y) ** 2) + targets.start[n], tx, ty
    bend = n - len(targets.exits)
    spin = 1.0 - 2.0 * (bend & 1)
    dx, dy = targets.corner[bend >> 1, 0] - x, targets.corner[bend >> 1, 1] - y
    square = dx * dx + dy * dy
    if targets.rest[bend] == np.inf or square < (radius - _TOUCH) ** 2:
        return nowhere
    ex, ey = _tangent(dx, dy, spin * radius)
    length, turn = np.sqrt(max(square - radius * radius, 0.0)), _turn(ex, ey, targets.leave[bend], spin)
    if turn < -_TOUCH:
        return nowhere
    return ex, ey, length + radius * turn + targets.rest[bend], x + length * ex, y + length * ey


@inner_kernel
def _turn(ex: float, ey: float, to: Floats, spin: float) -> float:
    """Return the angle [rad] from the unit vector (ex, ey) ``to`` another, counterclockwise for ``spin`` 1, else clockwise."""
    angle = spin * np.arctan2(ex * to[1] - ey * to[0], ex * to[0] + ey * to[1])
    return angle if angle > -3.0 else angle + 2.0 * np.pi


@inner_kernel
def _is_flanked(target: Ints, i: int, j: int, n: int, ex: float, ey: float) -> bool:
    """Return whether the line from a node along (ex, ey) to target ``n`` runs between the lines of two neighbors.

    Then the line is free: any obstacle to a disc is wider than the two spacings in between.
    """
    left, right = False, False
    for p in range(max(i - 1, 0), min(i + 2, target.shape[0])):
        for q in range(max(j - 1, 0), min(j + 2, target.shape[1])):
            if target[p, q] == n and ex * (q - j) + ey * (p - i) > 0.0:
                side = ex * (p - i) - ey * (q - j)
                left, right = left or side >= 0.0, right or side <= 0.0
    return left and right


@inner_kernel
def _is_plain(plain: Bools, origin: Floats, spacing: float, x: float, y: float, tx: float, ty: float) -> bool:
    """Return whether a line runs over nodes (rows, cols) of ``plain`` floor alone; without nodes all of it is."""
    steps = int(np.sqrt((tx - x) ** 2 + (ty - y) ** 2) / spacing) + 1 if len(plain) else -1
    for step in range(steps + 1):
        row = int((y + step / steps * (ty - y) - origin[1]) / spacing + 0.5)
        col = int((x + step / steps * (tx - x) - origin[0]) / spacing + 0.5)
        if not plain[min(max(row, 0), plain.shape[0] - 1), min(max(col, 0), plain.shape[1] - 1)]:
            return False
    return True


def make_targets(
    exits: Floats, walls: Floats, time: Floats, origin: Floats, spacing: float, radius: float
) -> tuple[Targets, Floats]:
    """Return the targets, no way around a corner known yet, and the least and greatest ``time`` [s] (2C, 2) at each."""
    corner = np.unique(np.round(walls.reshape(-1, 2), 9), axis=0)
    angle = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    places = corner[:, None] + (radius + spacing / 2) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    row, col = nearest_nodes(places, origin, spacing, time.shape)
    off = origin + spacing * np.stack([col, row], axis=-1) - corner[:, None]
    near = np.where(np.hypot(off[..., 0], off[..., 1]) > radius + spacing, np.nan, time[row, col])
    open_floor = ~np.isnan(near).all(axis=1)  # no way bends around an end in a concave corner
    corner, around = corner[open_floor], np.stack([np.fmin.reduce(near, 1), np.fmax.reduce(near, 1)], 1)[open_floor]
    leave, rest = np.zeros((2 * len(corner), 2)), np.full(2 * len(corner), np.inf)
    return Targets(exits, corner, leave, rest, radius, walls, np.zeros(len(exits))), np.repeat(around, 2, axis=0)


@inner_kernel
def _find_ways_around(targets: Targets, around: Floats, plain: Bools, origin: Floats, spacing: float) -> None:
    """Write how the ways around corners continue, by Dijkstra's algorithm from the exits; ``around`` is used up."""
    exits, corner, leave, rest, radius, walls, start = targets
    first = len(exits)
    for turn in range(first + len(rest)):
        n = turn
        if turn >= first:
            n, least = -1, np.inf
            for k in range(len(rest)):
                if rest[k] < least and around[k, 1] > 0.0:
                    n, least = first + k, rest[k]
            if n < 0:
                break
            around[n - first, 1] = -np.inf  # settled: no other is as short
        b, other = (n - first) >> 1, 1.0 - 2.0 * ((n - first) & 1)
        reach = rest[n - first] if n >= first else start[n]
        for k in range(len(rest)):
            low, high = around[k, 0], around[k, 1]
            cx, cy, spin = corner[k >> 1, 0], corner[k >> 1, 1], 1.0 - 2.0 * (k & 1)
            if n < first:
                frame = exit_frame(exits, n)
                px, py = nearest_on_exit(frame, cx + spin * radius * frame[6], cy - spin * radius * frame[5], radius)
                dx, dy, offset = px - cx, py - cy, -spin * radius
            else:
                dx, dy, offset = corner[b, 0] - cx, corner[b, 1] - cy, (other - spin) * radius
            square, near, far = dx * dx + dy * dy, low - reach - np.pi * radius, high - reach + 2.0 * radius
            if not (far > 0.0 and square <= far * far and (near <= 0.0 or square >= near * near)):
                continue
            if square == 0.0 or square < (abs(offset) - _TOUCH) ** 2:
                continue
            gx, gy = _tangent(dx, dy, offset)
            x, y = cx + spin * radius * gy, cy - spin * radius * gx
            _, _, total, tx, ty = aim(targets, n, x, y)
            if not low <= total <= high or total - radius * _turn(gx, gy, leave[k], spin) >= rest[k]:
                continue
            if _is_plain(plain, origin, spacing, x, y, tx, ty) and passes(walls, x, y, tx, ty, radius):
                leave[k, 0], leave[k, 1], rest[k] = gx, gy, total


@kernel
def pull_strings(
    time: Floats, direction: Floats, target: Ints, order: Ints, clear: Bools, targets: Targets, around: Floats,
    plain: Bools, origin: Floats, spacing: float,
) -> None:  # fmt: skip
    """Find the ways around the corners, and write into ``target`` (-1 everywhere) which target a straight line leads to.

    There ``time`` and ``direction`` become exact.  Straight lines run over ``plain`` floor alone (no nodes = all is plain).
    A way is taken only if its length agrees with the time found so far: otherwise fast ground or a one-way door offers another.
    ``order`` holds the nodes, soonest first, unknown ones last.  Nodes not ``clear`` of the walls try only the targets of
    their neighbors.
    """
    (rows, cols), first, rest, radius = time.shape, len(targets.exits), targets.rest, targets.radius
    more = 1.0 if len(plain) else 1.0 + _SHARE  # where fast ground may lie, the march alone knows whether it pays
    for k in range(len(rest)):
        around[k, 0] = around[k, 0] * (1.0 - _SHARE) - _MARCH * spacing
        around[k, 1] = around[k, 1] * more + _MARCH * spacing
    _find_ways_around(targets, around, plain, origin, spacing)
    for node in order:
        i, j = node // cols, node % cols
        x, y, before = origin[0] + j * spacing, origin[1] + i * spacing, time[i, j]
        if np.isnan(before):
            break
        low, best, tried = before * (1.0 - _SHARE) - _MARCH * spacing, before * more + _MARCH * spacing, -1
        for trial in range(9 + first + len(rest)):
            if trial < 9:  # targets of the nodes around it
                p, q = i + trial // 3 - 1, j + trial % 3 - 1
                n = target[p, q] if 0 <= p < rows and 0 <= q < cols else -1
            else:
                likely = target[i, j] >= 0 and best < 1.01 * before + 0.5 * _MARCH * spacing
                if trial == 9 and (likely or not clear[i, j]):
                    break
                n, k = trial - 9, trial - 9 - first
                if k >= 0:
                    away = np.sqrt((targets.corner[k >> 1, 0] - x) ** 2 + (targets.corner[k >> 1, 1] - y) ** 2)
                    if not low - np.pi * radius < rest[k] + away < best + radius:
                        continue
            if n < 0 or n == tried:
                continue
            tried = n
            ex, ey, total, tx, ty = aim(targets, n, x, y)
            if not low <= total < best or not _is_plain(plain, origin, spacing, x, y, tx, ty):
                continue
            flanked = clear[i, j] and _is_flanked(target, i, j, n, ex, ey)
            if flanked or passes(targets.walls, x, y, tx, ty, radius):
                best, target[i, j], time[i, j] = total, n, total
                direction[i, j, 0], direction[i, j, 1] = ex, ey
