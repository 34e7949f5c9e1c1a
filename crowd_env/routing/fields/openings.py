"""The narrowest opening on the way ahead, from every node of a travel-time field: how wide it is, and how far.

The width at a node is the shortest line through it from wall to wall, of those within 45 degrees of the normal to the way; at
the end of the way it is that of the exit.  So a door is as wide as it is, from wherever one comes, and a passage as its walls
are apart.  Openings wider than `WIDEST` count as that wide.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.geometry.geometry import Geometry, nearest_among

if TYPE_CHECKING:  # no part of what kernels are made of
    from crowd_env.routing.fields.field import NavigationField

WIDEST = 5.0  # m
_SPACING, _NODES = 0.1, 40_000  # m between nodes, more in large places, of which so many are enough
_ANGLES = np.linspace(-0.25 * np.pi, 0.25 * np.pi, 5)  # rad  of the lines from wall to wall, to the normal
_ROOM = 0.5  # m2
_TURN = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])


class Openings(NamedTuple):
    """What kernels read: the nodes of F fields lie one behind the other; fields without openings have none."""

    start: Ints  # (F+1,)  first node of each field; nodes run row by row
    shape: Ints  # (F, 2)  rows (y), columns (x)
    origin: Floats  # (F, 2)  m   place of node [0, 0]
    spacing: Floats  # (F,)    m   between nodes
    width: Floats  # (M,)    m   of the narrowest opening ahead; nan outside
    rest: Floats  # (M,)    s   from there to the end of the way, at 1 m/s


def no_openings() -> Openings:
    """Return the openings of no field."""
    nothing, none = np.zeros(0), np.zeros((0, 2), dtype=np.int64)
    return Openings(np.zeros(1, dtype=np.int64), none, np.zeros((0, 2)), nothing, nothing.copy(), nothing.copy())


def openings_of(fields: "list[NavigationField | None]", geometries: list[Geometry]) -> Openings:
    """Return the openings of some fields, each of its geometry."""
    every = [_openings(field, geometry) for field, geometry in zip(fields, geometries, strict=True)]
    return Openings(
        start=row_starts([width.size for _, _, width, _ in every]),
        shape=np.array([width.shape for _, _, width, _ in every], dtype=np.int64),
        origin=np.array([origin for origin, _, _, _ in every]),
        spacing=np.array([spacing for _, spacing, _, _ in every]),
        width=np.concatenate([width.ravel() for _, _, width, _ in every]),
        rest=np.concatenate([rest.ravel() for _, _, _, rest in every]),
    )


@lru_cache(maxsize=16)
def _openings(field: "NavigationField | None", geometry: Geometry) -> tuple[Floats, float, Floats, Floats]:
    """Return origin [m] and spacing [m] of a grid, and width [m] and rest [s] of its nodes (rows, cols)."""
    if field is None:
        return np.zeros(2), 1.0, np.zeros((0, 0)), np.zeros((0, 0))
    known = int((~np.isnan(field.travel_time)).sum())
    stride = max(1, int(_SPACING / field.spacing + 1e-9), int(np.sqrt(known / _NODES)))
    nodes, spacing = np.s_[::stride, ::stride], stride * field.spacing
    time, direction = field.travel_time[nodes].copy(), field.direction[nodes].copy()
    width, rest = np.full(time.shape, np.nan), np.zeros(time.shape)
    _narrowest(
        time, direction, np.argsort(time, axis=None, kind="stable"), geometry.walls_when()[0], field.origin, spacing,
        _widths_at_the_end(time.shape, field.origin, spacing, geometry), _TURN, np.zeros((2, len(_TURN))),
        np.zeros(time.shape, dtype=np.int64), np.ones(time.shape, dtype=np.int64), width, rest,
    )  # fmt: skip
    return field.origin, spacing, width, rest


def _widths_at_the_end(shape: tuple[int, ...], origin: Floats, spacing: float, geometry: Geometry) -> Floats:
    """Return the width [m] of the exit that is nearest to every node (rows, cols): the way of the last ones ends there."""
    i, j = np.indices(shape)
    places = np.asarray(origin + spacing * np.stack([j, i], axis=-1).reshape(-1, 2), dtype=np.float64)
    widths = np.array([min(geometry.exit_widths[name], WIDEST) for name in geometry.exit_names])
    return np.asarray(widths[nearest_among(geometry.exits)(places)].reshape(shape))


@kernel
def _narrowest(
    time: Floats, direction: Floats, order: Ints, walls: Floats, origin: Floats, spacing: float, at_end: Floats,
    turn: Floats, reach: Floats, down: Ints, behind: Ints, width: Floats, rest: Floats,
) -> None:  # fmt: skip
    """Write ``width`` and ``rest`` of all nodes, in the ``order`` of their times, ``nan`` last.

    ``down`` and ``behind`` (rows, cols) are scratch, the latter 1: the node that the way comes to next, how many come to it.
    """
    rows, cols = time.shape
    for n in order:
        i, j = n // cols, n % cols
        ex, ey, least, down[i, j] = direction[i, j, 0], direction[i, j, 1], time[i, j], n
        soonest, lower = time[i, j], n
        for k in range(max(i - 1, 0), min(i + 2, rows)):
            for m in range(max(j - 1, 0), min(j + 2, cols)):
                along = ex * (m - j) + ey * (k - i)  # a neighbor to which the way leads, and not one behind a wall
                if time[k, m] < least and along > 0.5:
                    least, down[i, j] = time[k, m], k * cols + m
                if time[k, m] < soonest:
                    soonest, lower = time[k, m], k * cols + m
        if down[i, j] == n:  # at a corner, and beside an exit
            down[i, j] = lower
    for n in order[::-1]:
        i, j = n // cols, n % cols
        if down[i, j] != n:
            behind[down[i, j] // cols, down[i, j] % cols] += behind[i, j]
    for n in order:
        i, j = n // cols, n % cols
        if np.isnan(time[i, j]):
            break
        p, q = down[i, j] // cols, down[i, j] % cols
        width[i, j], rest[i, j] = at_end[i, j], 0.0
        if down[i, j] != n:
            width[i, j], rest[i, j] = width[p, q], rest[p, q]
        chord = shortest_chord(
            origin[0] + spacing * j, origin[1] + spacing * i, direction[i, j, 0], direction[i, j, 1], walls, turn, reach
        )
        most = 0
        for k in range(max(i - 1, 0), min(i + 2, rows)):
            for m in range(max(j - 1, 0), min(j + 2, cols)):
                most = max(most, behind[k, m])
        # A line that cuts off a corner is no opening: there must be more floor behind it than its square, and room for people.
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
            # The normal to the left is (-ey, ex).
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
def opening_at(known: Openings, f: int, x: float, y: float) -> tuple[float, float]:
    """Return width [m] and rest [s] at the known node of field ``f`` nearest to (x, y), of the four around; (nan, 0) = none."""
    rows, cols, first = known.shape[f, 0], known.shape[f, 1], known.start[f]
    u, v = (x - known.origin[f, 0]) / known.spacing[f], (y - known.origin[f, 1]) / known.spacing[f]
    j, i = min(max(int(np.floor(u)), 0), cols - 2), min(max(int(np.floor(v)), 0), rows - 2)
    best, least = -1, np.inf
    for c in range(4):
        k, m = i + (c >> 1), j + (c & 1)
        square = (u - m) * (u - m) + (v - k) * (v - k)
        if k >= 0 and m >= 0 and square < least and known.width[first + k * cols + m] > 0.0:
            best, least = first + k * cols + m, square
    if best < 0:
        return np.nan, 0.0
    return known.width[best], known.rest[best]
