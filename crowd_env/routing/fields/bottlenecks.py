"""The narrowest bottleneck on the way ahead, from every node of a travel-time field: how wide it is, and how far.

The width at a node is the shortest chord through it: a line from wall to wall, within 45 degrees of the normal to the way::

    ================  wall
           |            reach to the left, along the normal (-ey, ex)
    ----- node ---->    the way, (ex, ey)
           |            reach to the right
    ================  wall

At the end of the way the width is that of the exit.  It does not depend on the approach.  Bottlenecks wider than `WIDEST` count
as that wide.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts, unit_vectors
from crowd_env.core.kernels.jit import allocating_kernel, inner_kernel
from crowd_env.geometry.geometry import Geometry, nearest_among

if TYPE_CHECKING:  # no part of what kernels are made of
    from crowd_env.routing.fields.field import NavigationField

WIDEST = 5.0  # m
_SPACING, _NODES = 0.1, 40_000  # m between nodes, more in large places, which need about this number of nodes
_ANGLES = np.linspace(-0.25 * np.pi, 0.25 * np.pi, 5)  # rad  of the lines from wall to wall, to the normal
_ROOM = 0.5  # m2
_TURN = unit_vectors(_ANGLES)


class Bottlenecks(NamedTuple):
    """Input of the kernels: the nodes of F fields lie one behind the other; fields without bottlenecks have none."""

    start: Ints  # (F+1,)  first node of each field; nodes run row by row
    shape: Ints  # (F, 2)  rows (y), columns (x)
    origin: Floats  # (F, 2)  m   place of node [0, 0]
    spacing: Floats  # (F,)    m   between nodes
    width: Floats  # (M,)    m   of the narrowest bottleneck ahead; nan outside
    rest: Floats  # (M,)    s   from there to the end of the way, at 1 m/s


def no_bottlenecks() -> Bottlenecks:
    """Return the bottlenecks of no field."""
    nothing, none = np.zeros(0), np.zeros((0, 2), dtype=np.int64)
    return Bottlenecks(np.zeros(1, dtype=np.int64), none, np.zeros((0, 2)), nothing, nothing.copy(), nothing.copy())


def bottlenecks_of(fields: "list[NavigationField | None]", geometries: list[Geometry]) -> Bottlenecks:
    """Return the bottlenecks of some fields, each of its geometry."""
    every = [_bottlenecks(field, geometry) for field, geometry in zip(fields, geometries, strict=True)]
    return Bottlenecks(
        start=row_starts([width.size for _, _, width, _ in every]),
        shape=np.array([width.shape for _, _, width, _ in every], dtype=np.int64),
        origin=np.array([origin for origin, _, _, _ in every]),
        spacing=np.array([spacing for _, spacing, _, _ in every]),
        width=np.concatenate([width.ravel() for _, _, width, _ in every]),
        rest=np.concatenate([rest.ravel() for _, _, _, rest in every]),
    )


@lru_cache(maxsize=16)
def _bottlenecks(field: "NavigationField | None", geometry: Geometry) -> tuple[Floats, float, Floats, Floats]:
    """Return origin [m] and spacing [m] of a grid, and width [m] and rest [s] to the exit line of its nodes (rows, cols)."""
    if field is None:
        return np.zeros(2), 1.0, np.zeros((0, 0)), np.zeros((0, 0))
    known = int((~np.isnan(field.travel_time)).sum())
    stride = max(1, int(_SPACING / field.spacing + 1e-9), int(np.sqrt(known / _NODES)))
    nodes, spacing = np.s_[::stride, ::stride], stride * field.spacing
    time, direction = field.travel_time[nodes].copy(), field.direction[nodes].copy()
    order, walls = np.argsort(time, axis=None, kind="stable"), geometry.walls_when()[0]
    origin = field.origin + np.array(field.shift)
    width, rest = _widths_at_the_end(time.shape, origin, spacing, geometry), np.zeros(time.shape)
    _narrowest(time, direction, order, walls, origin, spacing, _TURN, width, rest)
    return field.origin, spacing, width, np.maximum(rest - field.behind, 0.0)


def _widths_at_the_end(shape: tuple[int, ...], origin: Floats, spacing: float, geometry: Geometry) -> Floats:
    """Return the width [m] of the exit nearest to every node (rows, cols): the way of the last nodes ends there."""
    i, j = np.indices(shape)
    places = np.asarray(origin + spacing * np.stack([j, i], axis=-1).reshape(-1, 2), dtype=np.float64)
    widths = np.array([min(geometry.exit_widths[name], WIDEST) for name in geometry.exit_names])
    return widths[nearest_among(geometry.exits)(places)].reshape(shape)


@allocating_kernel
def _narrowest(
    time: Floats, direction: Floats, order: Ints, walls: Floats, origin: Floats, spacing: float, turn: Floats,
    width: Floats, rest: Floats,
) -> None:  # fmt: skip
    """Write ``width`` and ``rest`` of all nodes, in the ``order`` of their times, ``nan`` last.

    ``width`` holds the width of the way's end at first.
    """
    rows, cols = time.shape
    following = np.zeros((rows, cols), dtype=np.int64)  # the node that the way comes to next
    behind = np.ones((rows, cols), dtype=np.int64)  # how many nodes' ways come to a node, with its own
    reach = np.zeros((2, len(turn)))
    for node in order:
        i, j = node // cols, node % cols
        ex, ey, least, following[i, j] = direction[i, j, 0], direction[i, j, 1], time[i, j], node
        soonest, lower = time[i, j], node
        for row in range(max(i - 1, 0), min(i + 2, rows)):
            for col in range(max(j - 1, 0), min(j + 2, cols)):
                along = ex * (col - j) + ey * (row - i)  # a neighbor to which the way leads, and not one behind a wall
                if time[row, col] < least and along > 0.5:
                    least, following[i, j] = time[row, col], row * cols + col
                if time[row, col] < soonest:
                    soonest, lower = time[row, col], row * cols + col
        if following[i, j] == node:  # at a corner, and beside an exit
            following[i, j] = lower
    for node in order[::-1]:
        i, j = node // cols, node % cols
        if following[i, j] != node:
            behind[following[i, j] // cols, following[i, j] % cols] += behind[i, j]
    for node in order:
        i, j = node // cols, node % cols
        if np.isnan(time[i, j]):
            width[i, j] = np.nan
            continue
        if following[i, j] != node:
            row, col = following[i, j] // cols, following[i, j] % cols
            width[i, j], rest[i, j] = width[row, col], rest[row, col]
        x, y = origin[0] + spacing * j, origin[1] + spacing * i
        chord = shortest_chord(x, y, direction[i, j, 0], direction[i, j, 1], walls, turn, reach)
        most = 0
        for row in range(max(i - 1, 0), min(i + 2, rows)):
            for col in range(max(j - 1, 0), min(j + 2, cols)):
                most = max(most, behind[row, col])
        # A line that cuts off a corner is no bottleneck: behind it must be more floor than its square, and room for people.
        if chord < width[i, j] and most * spacing * spacing > chord * chord + _ROOM:
            width[i, j], rest[i, j] = chord, time[i, j]


@inner_kernel
def shortest_chord(x: float, y: float, ex: float, ey: float, walls: Floats, turn: Floats, reach: Floats) -> float:
    """Return the length [m] of the shortest line through (x, y) from wall to wall about normal to (ex, ey), at most `WIDEST`.

    ``reach`` (2, lines) is scratch: how far each is free to the left and to the right.
    """
    limit = WIDEST
    reach[:] = limit
    for w in range(len(walls)):
        ax, ay = walls[w, 0, 0] - x, walls[w, 0, 1] - y
        tx, ty = walls[w, 1, 0] - walls[w, 0, 0], walls[w, 1, 1] - walls[w, 0, 1]
        across = ax * ty - ay * tx
        if across * across > limit * limit * (tx * tx + ty * ty):
            continue
        for k in range(len(turn)):
            dx, dy = -ey * turn[k, 0] - ex * turn[k, 1], ex * turn[k, 0] - ey * turn[k, 1]
            cross = dx * ty - dy * tx
            if abs(cross) < 1e-12:
                continue
            share, far = (ax * dy - ay * dx) / cross, across / cross
            if 0.0 <= share <= 1.0:
                side = 0 if far >= 0.0 else 1
                reach[side, k] = min(reach[side, k], abs(far))
    shortest = WIDEST
    for k in range(len(turn)):
        shortest = min(shortest, reach[0, k] + reach[1, k])
    return shortest


@inner_kernel
def bottleneck_at(known: Bottlenecks, f: int, x: float, y: float) -> tuple[float, float]:
    """Return width [m] and rest [s] at the node of field ``f`` nearest to (x, y), of the four around; (nan, 0) = not known."""
    rows, cols, first = known.shape[f, 0], known.shape[f, 1], known.start[f]
    across, up = (x - known.origin[f, 0]) / known.spacing[f], (y - known.origin[f, 1]) / known.spacing[f]
    left, below = min(max(int(np.floor(across)), 0), cols - 2), min(max(int(np.floor(up)), 0), rows - 2)
    best, least = -1, np.inf
    for corner in range(4):
        row, col = below + (corner >> 1), left + (corner & 1)
        square = (across - col) * (across - col) + (up - row) * (up - row)
        if row >= 0 and col >= 0 and square < least and known.width[first + row * cols + col] > 0.0:
            best, least = first + row * cols + col, square
    if best < 0:
        return np.nan, 0.0
    return known.width[best], known.rest[best]
