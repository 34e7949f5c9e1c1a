"""Observations: named terms of fixed width, each one function over arrays, laid side by side.

Vectors are given in the frame of the actions: along and to the left of the shortest path ("path"), or along x and y
("world"); `direction` is always along x and y.  Every value lies in [-1, 1].
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.geometry import Boundary
from crowd_env.navigation import FieldArrays, direction_at, travel_time_at
from crowd_env.physics.neighbors import NeighbourList, sort_into_cells
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

SIGHT = 3.0  # m     how far neighbours and walls are seen
SPEED_SCALE = 2.0  # m/s
TIME_SCALE = 5.0  # s     a travel time of 5 s is observed as 1/2
DENSITY_RADIUS = 1.0  # m
DENSITY_SCALE = 8.0  # 1/m2
KICK_SCALE = 1.0  # m/s   an impulse that changes the own speed by this much is observed as 1
MOST_NEIGHBOURS = 32


class View(NamedTuple):
    """What an observation is made from."""

    boundary: Boundary
    door_open: Bools  # (E, D)
    geometry_of_env: Ints  # (E,)
    bodies: Bodies
    state: CrowdState
    near: NeighbourList  # only its cells, as scratch
    push: Floats  # (P, 2) N s  contact impulse since the last decision
    crush: Floats  # (P,)   N s  sum of its magnitudes
    seen: Bools  # (P,)    whose observation is wanted; the rest stays zero
    axis: Floats  # (P, 2)  first axis of the frame
    direction: Floats  # (P, 2)  of the shortest path
    travel_time: Floats  # (P,)    s, at the own desired speed; 0 for those who are out


@kernel
def look_ahead(
    field: FieldArrays,
    boundary: Boundary,
    field_of_route: Ints,
    followed: Ints,
    bodies: Bodies,
    state: CrowdState,
    seen: Bools,
    direction: Floats,
    travel_time: Floats,
) -> None:
    """Write direction (P, 2) and travel time (P,) of the followed route of everyone who is seen."""
    for e in range(len(state.time)):
        for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
            if not seen[i]:
                continue
            f = field_of_route[e, followed[i]]
            x, y, r = state.position[i, 0], state.position[i, 1], bodies.radius[i]
            direction[i, 0], direction[i, 1] = direction_at(field, boundary, f, x, y, r)
            travel_time[i] = 0.0
            if state.active[i]:
                # Someone who does not want to move would need for ever: the time at a slow walk stands in.
                travel_time[i] = travel_time_at(field, boundary, f, x, y, r) / max(bodies.desired_speed[i], 0.1)


def _in_frame(view: View, vectors: Floats) -> Floats:
    """Return the components (P, 2) along and to the left of everyone's axis."""
    along = (vectors * view.axis).sum(axis=1)
    across = vectors[:, 1] * view.axis[:, 0] - vectors[:, 0] * view.axis[:, 1]
    return np.column_stack([along, across])


def velocity(view: View, out: Floats) -> None:
    """Own velocity / 2 m/s, in the frame."""
    out[:] = _in_frame(view, view.state.velocity) / SPEED_SCALE


def desired_speed(view: View, out: Floats) -> None:
    """Own desired speed / 2 m/s."""
    out[:, 0] = view.bodies.desired_speed / SPEED_SCALE


def direction(view: View, out: Floats) -> None:
    """Direction of the shortest path to an exit, along x and y."""
    out[:] = view.direction


def travel_time(view: View, out: Floats) -> None:
    """Time t the rest of the shortest path takes at the own desired speed, as t / (t + 5 s)."""
    out[:, 0] = view.travel_time / (view.travel_time + TIME_SCALE)


def push(view: View, out: Floats) -> None:
    """Sum of the contact impulses since the last decision / (own mass * 1 m/s), in the frame."""
    out[:] = _in_frame(view, view.push) / (view.bodies.mass[:, None] * KICK_SCALE)


def crush(view: View, out: Floats) -> None:
    """Sum of the magnitudes of these impulses / (own mass * 1 m/s): large between two who push from both sides."""
    out[:, 0] = view.crush / (view.bodies.mass * KICK_SCALE)


def density(view: View, out: Floats) -> None:
    """People within 1 m of the own centre, oneself included, / (pi m2 * 8 /m2)."""
    _count_within(view.bodies.env_start, view.state, view.near, view.seen, DENSITY_RADIUS, out[:, 0])
    out /= np.pi * DENSITY_RADIUS**2 * DENSITY_SCALE


@kernel
def _count_within(
    env_start: Ints, state: CrowdState, near: NeighbourList, seen: Bools, radius: float, out: Floats
) -> None:
    position = state.position
    for e in range(len(state.time)):
        begin, end = env_start[e], env_start[e + 1]
        head, columns, rows = sort_into_cells(e, begin, end, state.active, position, near, radius)
        for i in range(begin, end):
            if not (seen[i] and state.active[i]):
                continue
            column, row = near.cell_of[i] % columns, near.cell_of[i] // columns
            count = 0
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                first = head + r * columns + max(column - 1, 0)
                stop = head + r * columns + min(column + 1, columns - 1)
                for item in range(begin + near.cell_start[first], begin + near.cell_start[stop + 1]):
                    j = near.cell_item[item]
                    dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                    count += dx * dx + dy * dy < radius * radius
            out[i] = count


def walls(view: View, out: Floats) -> None:
    """Free distance from the own surface to the nearest wall along rays / 3 m; ray k at k / n of a turn to the left."""
    bodies = view.bodies
    _cast_rays(
        view.boundary,
        view.door_open,
        view.geometry_of_env,
        bodies.env_start,
        bodies.radius,
        view.state.position,
        view.seen,
        view.axis,
        out,
    )
    out /= SIGHT


@kernel
def _cast_rays(
    boundary: Boundary,
    door_open: Bools,
    geometry_of_env: Ints,
    env_start: Ints,
    radius: Floats,
    position: Floats,
    seen: Bools,
    axis: Floats,
    out: Floats,
) -> None:
    rays = out.shape[1]
    for e in range(len(geometry_of_env)):
        g = geometry_of_env[e]
        for i in range(env_start[e], env_start[e + 1]):
            if not seen[i]:
                continue
            x, y = position[i, 0], position[i, 1]
            for k in range(rays):
                turn = 2.0 * np.pi * k / rays
                c, s = np.cos(turn), np.sin(turn)
                dx, dy = c * axis[i, 0] - s * axis[i, 1], s * axis[i, 0] + c * axis[i, 1]
                free = SIGHT + radius[i]
                for w in range(boundary.wall_start[g], boundary.wall_start[g + 1]):
                    if boundary.wall_door[w] >= 0 and door_open[e, boundary.wall_door[w]]:
                        continue
                    ax, ay = boundary.wall[w, 0, 0] - x, boundary.wall[w, 0, 1] - y
                    tx, ty = boundary.wall[w, 1, 0] - x - ax, boundary.wall[w, 1, 1] - y - ay
                    cross = dx * ty - dy * tx
                    if cross == 0.0:
                        continue
                    distance, along = (ax * ty - ay * tx) / cross, (ax * dy - ay * dx) / cross
                    if distance >= 0.0 and 0.0 <= along <= 1.0:
                        free = min(free, distance)
                out[i, k] = max(free - radius[i], 0.0)


def neighbours(view: View, out: Floats) -> None:
    """The k nearest people within 3 m, five values each: offset / 3 m (2), relative velocity / 4 m/s (2), closeness.

    Closeness is 1 - gap / 3 m, 1 at contact; all five are 0 where there is nobody.
    """
    bodies, wanted = view.bodies, out.shape[1] // 5
    found, gaps = np.empty(wanted, dtype=np.int64), np.empty(wanted)
    _look_around(bodies.env_start, bodies.radius, view.state, view.near, view.seen, view.axis, found, gaps, out)


@kernel
def _look_around(
    env_start: Ints,
    radius: Floats,
    state: CrowdState,
    near: NeighbourList,
    seen: Bools,
    axis: Floats,
    found: Ints,
    gaps: Floats,
    out: Floats,
) -> None:
    for e in range(len(state.time)):
        begin, end = env_start[e], env_start[e + 1]
        grid = sort_into_cells(e, begin, end, state.active, state.position, near, SIGHT)
        for i in range(begin, end):
            if not (seen[i] and state.active[i]):
                continue
            ax, ay = axis[i, 0], axis[i, 1]
            for k in range(_nearest(i, begin, radius, state.position, near, grid, found, gaps)):
                j = found[k]
                x, y = state.position[j, 0] - state.position[i, 0], state.position[j, 1] - state.position[i, 1]
                u, v = state.velocity[j, 0] - state.velocity[i, 0], state.velocity[j, 1] - state.velocity[i, 1]
                out[i, 5 * k], out[i, 5 * k + 1] = (x * ax + y * ay) / SIGHT, (y * ax - x * ay) / SIGHT
                out[i, 5 * k + 2] = (u * ax + v * ay) / (2 * SPEED_SCALE)
                out[i, 5 * k + 3] = (v * ax - u * ay) / (2 * SPEED_SCALE)
                out[i, 5 * k + 4] = 1.0 - max(gaps[k], 0.0) / SIGHT


@kernel
def _nearest(
    i: int,
    begin: int,
    radius: Floats,
    position: Floats,
    near: NeighbourList,
    grid: tuple[int, int, int],
    found: Ints,
    gaps: Floats,
) -> int:
    """Write up to len(found) nearest active people, nearest first (ties by slot); returns how many."""
    head, columns, rows = grid
    count = 0
    column, row = near.cell_of[i] % columns, near.cell_of[i] // columns
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        first = head + r * columns + max(column - 1, 0)
        stop = head + r * columns + min(column + 1, columns - 1)
        for item in range(begin + near.cell_start[first], begin + near.cell_start[stop + 1]):
            j = near.cell_item[item]
            dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            square = dx * dx + dy * dy
            if j == i or square >= SIGHT * SIGHT:
                continue
            gap = np.sqrt(square) - radius[i] - radius[j]
            last = count - 1
            if count == len(found) and (gap > gaps[last] or (gap == gaps[last] and j > found[last])):
                continue
            k = min(count, len(found) - 1)
            while k > 0 and (gaps[k - 1] > gap or (gaps[k - 1] == gap and found[k - 1] > j)):
                found[k], gaps[k] = found[k - 1], gaps[k - 1]
                k -= 1
            found[k], gaps[k] = j, gap
            count = min(count + 1, len(found))
    return count


# Name -> (function, width); "neighbours" and "walls" multiply the width by how many are asked for.
TERMS: dict[str, tuple[Callable[..., Any], int]] = {
    "velocity": (velocity, 2),
    "desired_speed": (desired_speed, 1),
    "direction": (direction, 2),
    "travel_time": (travel_time, 1),
    "push": (push, 2),
    "crush": (crush, 1),
    "density": (density, 1),
    "walls": (walls, 1),
    "neighbours": (neighbours, 5),
}


@dataclass(frozen=True)
class ObservationLayout:
    """Which terms an observation holds, and where: ``layout["direction"]`` is a slice of columns.

    Parameters
    ----------
    terms : names in ``TERMS``, in the order of the columns.
    neighbours : how many nearest people are seen.
    rays : how many directions walls are felt for in.

    Raises
    ------
    ValueError
        If a term is unknown or named twice, or a number is out of range.
    """

    terms: tuple[str, ...] = tuple(TERMS)
    neighbours: int = 6
    rays: int = 8

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        for name in self.terms:
            if name not in TERMS:
                raise ValueError(f"unknown observation term {name!r}; known: {', '.join(TERMS)}")
        if len(set(self.terms)) < len(self.terms) or not self.terms:
            raise ValueError("observation terms must be named at least one, and each only once")
        if not 1 <= self.neighbours <= MOST_NEIGHBOURS:
            raise ValueError(f"neighbours is {self.neighbours}; it must be 1 to {MOST_NEIGHBOURS}")
        if not 1 <= self.rays <= 360:
            raise ValueError(f"rays is {self.rays}; it must be 1 to 360")

    def width(self, term: str) -> int:
        """Return the number of columns of a term."""
        return TERMS[term][1] * {"neighbours": self.neighbours, "walls": self.rays}.get(term, 1)

    @property
    def size(self) -> int:
        """Number of columns in all."""
        return sum(self.width(term) for term in self.terms)

    def __getitem__(self, term: str) -> slice:
        """Return the columns of a term."""
        if term not in self.terms:
            raise KeyError(f"this observation has no term {term!r}; it has: {', '.join(self.terms)}")
        begin = sum(self.width(name) for name in self.terms[: self.terms.index(term)])
        return slice(begin, begin + self.width(term))

    def observe(self, view: View) -> np.ndarray:
        """Return the observation (P, size) float32; rows of those not seen are zero."""
        out = np.zeros((len(view.seen), self.size))
        for term in self.terms:
            TERMS[term][0](view, out[:, self[term]])
        out[~view.seen] = 0.0
        return np.clip(out, -1.0, 1.0, out=out).astype(np.float32)
