"""Observations: named terms of fixed width, each one function over arrays, laid side by side.

Vectors are given in the frame of the actions: along and to the left of the shortest path ("path"), or along x and y
("world"); `direction` is always along x and y.  Every value lies in [-1, 1].
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.navigation import direction_at, travel_time_at
from crowd_env.physics.neighbors import sort_into_cells
from crowd_env.physics.world import Memory, World
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

    world: World
    bodies: Bodies
    state: CrowdState
    memory: Memory
    seen: Bools  # (P,)    whose observation is wanted; the rest stays zero
    axis: Floats  # (P, 2)  first axis of the frame
    direction: Floats  # (P, 2)  of the shortest path
    travel_time: Floats  # (P,)    s, at the own desired speed; 0 for those who are out


@kernel
def look_ahead(view: View, relative: bool) -> None:
    """Write direction, travel time and axis of everyone who is seen."""
    bodies, state = view.bodies, view.state
    for e in range(len(state.time)):
        g = view.world.geometry_of_env[e]
        for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
            if not view.seen[i]:
                continue
            x, y, r = state.position[i, 0], state.position[i, 1], bodies.radius[i]
            view.direction[i, 0], view.direction[i, 1] = direction_at(view.world.field, view.world.boundary, g, x, y, r)
            view.travel_time[i] = 0.0
            if state.active[i]:
                # Someone who does not want to move would need for ever: the scale of a slow walker stands in.
                speed = max(bodies.desired_speed[i], 0.1)
                view.travel_time[i] = travel_time_at(view.world.field, view.world.boundary, g, x, y, r) / speed
            if relative:
                view.axis[i, 0], view.axis[i, 1] = view.direction[i, 0], view.direction[i, 1]
            else:
                view.axis[i, 0], view.axis[i, 1] = 1.0, 0.0


@kernel
def _clip(x: float) -> float:
    return min(1.0, max(-1.0, x))


@kernel
def _turned(view: View, i: int, x: float, y: float) -> tuple[float, float]:
    """Components of (x, y) along and to the left of the axis of ``i``."""
    ax, ay = view.axis[i, 0], view.axis[i, 1]
    return x * ax + y * ay, y * ax - x * ay


@kernel
def velocity(view: View, out: Floats) -> None:
    """Own velocity / 2 m/s, in the frame."""
    for i in range(len(out)):
        if view.seen[i]:
            a, b = _turned(view, i, view.state.velocity[i, 0], view.state.velocity[i, 1])
            out[i, 0], out[i, 1] = _clip(a / SPEED_SCALE), _clip(b / SPEED_SCALE)


@kernel
def desired_speed(view: View, out: Floats) -> None:
    """Own desired speed / 2 m/s."""
    for i in range(len(out)):
        if view.seen[i]:
            out[i, 0] = _clip(view.bodies.desired_speed[i] / SPEED_SCALE)


@kernel
def direction(view: View, out: Floats) -> None:
    """Direction of the shortest path to an exit, along x and y."""
    for i in range(len(out)):
        if view.seen[i]:
            out[i, 0], out[i, 1] = view.direction[i, 0], view.direction[i, 1]


@kernel
def travel_time(view: View, out: Floats) -> None:
    """Time t the rest of the shortest path takes at the own desired speed, as t / (t + 5 s)."""
    for i in range(len(out)):
        if view.seen[i]:
            out[i, 0] = view.travel_time[i] / (view.travel_time[i] + TIME_SCALE)


@kernel
def push(view: View, out: Floats) -> None:
    """Sum of the contact impulses since the last decision / (own mass * 1 m/s), in the frame."""
    for i in range(len(out)):
        if view.seen[i]:
            a, b = _turned(view, i, view.memory.push[i, 0], view.memory.push[i, 1])
            scale = view.bodies.mass[i] * KICK_SCALE
            out[i, 0], out[i, 1] = _clip(a / scale), _clip(b / scale)


@kernel
def crush(view: View, out: Floats) -> None:
    """Sum of the magnitudes of these impulses / (own mass * 1 m/s): large between two who push from both sides."""
    for i in range(len(out)):
        if view.seen[i]:
            out[i, 0] = _clip(view.memory.crush[i] / (view.bodies.mass[i] * KICK_SCALE))


@kernel
def _nearest(view: View, i: int, begin: int, end: int, grid: tuple[int, int, int], found: Ints, gaps: Floats) -> int:
    """Write up to len(found) nearest active people, nearest first (ties by slot); returns how many."""
    near, position, radius = view.memory.near, view.state.position, view.bodies.radius
    head, columns, rows = grid
    count = 0
    cell = near.cell_of[i]
    column, row = cell % columns, cell // columns
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        first = head + r * columns + max(column - 1, 0)
        stop = head + r * columns + min(column + 1, columns - 1)
        for item in range(begin + near.cell_start[first], begin + near.cell_start[stop + 1]):
            j = near.cell_item[item]
            if j == i:
                continue
            distance = np.hypot(position[i, 0] - position[j, 0], position[i, 1] - position[j, 1])
            if distance >= SIGHT:
                continue
            gap = distance - radius[i] - radius[j]
            if count == len(found) and gap >= gaps[count - 1]:
                continue
            k = min(count, len(found) - 1)
            while k > 0 and (gaps[k - 1] > gap or (gaps[k - 1] == gap and found[k - 1] > j)):
                found[k], gaps[k] = found[k - 1], gaps[k - 1]
                k -= 1
            found[k], gaps[k] = j, gap
            count = min(count + 1, len(found))
    return count


@kernel
def neighbours(view: View, out: Floats) -> None:
    """The k nearest people within 3 m, five values each: offset / 3 m (2), relative velocity / 4 m/s (2), closeness.

    Closeness is 1 - gap / 3 m, 1 at contact; all five are 0 where there is nobody.
    """
    bodies, state, near = view.bodies, view.state, view.memory.near
    wanted = out.shape[1] // 5
    found, gaps = np.empty(wanted, dtype=np.int64), np.empty(wanted)
    for e in range(len(state.time)):
        begin, end = bodies.env_start[e], bodies.env_start[e + 1]
        grid = sort_into_cells(e, begin, end, state.active, state.position, near, SIGHT)
        for i in range(begin, end):
            if not (view.seen[i] and state.active[i]):
                continue
            for k in range(_nearest(view, i, begin, end, grid, found, gaps)):
                j = found[k]
                x, y = state.position[j, 0] - state.position[i, 0], state.position[j, 1] - state.position[i, 1]
                u, v = state.velocity[j, 0] - state.velocity[i, 0], state.velocity[j, 1] - state.velocity[i, 1]
                a, b = _turned(view, i, x, y)
                c, d = _turned(view, i, u, v)
                out[i, 5 * k], out[i, 5 * k + 1] = _clip(a / SIGHT), _clip(b / SIGHT)
                out[i, 5 * k + 2], out[i, 5 * k + 3] = _clip(c / (2 * SPEED_SCALE)), _clip(d / (2 * SPEED_SCALE))
                out[i, 5 * k + 4] = _clip(1.0 - max(gaps[k], 0.0) / SIGHT)


@kernel
def density(view: View, out: Floats) -> None:
    """People within 1 m of the own centre, oneself included, / (pi m2 * 8 /m2)."""
    bodies, state, near = view.bodies, view.state, view.memory.near
    for e in range(len(state.time)):
        begin, end = bodies.env_start[e], bodies.env_start[e + 1]
        head, columns, rows = sort_into_cells(e, begin, end, state.active, state.position, near, DENSITY_RADIUS)
        for i in range(begin, end):
            if not (view.seen[i] and state.active[i]):
                continue
            column, row = near.cell_of[i] % columns, near.cell_of[i] // columns
            count = 0
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                first = head + r * columns + max(column - 1, 0)
                stop = head + r * columns + min(column + 1, columns - 1)
                for item in range(begin + near.cell_start[first], begin + near.cell_start[stop + 1]):
                    j = near.cell_item[item]
                    dx, dy = state.position[i, 0] - state.position[j, 0], state.position[i, 1] - state.position[j, 1]
                    count += dx * dx + dy * dy < DENSITY_RADIUS * DENSITY_RADIUS
            out[i, 0] = _clip(count / (np.pi * DENSITY_RADIUS * DENSITY_RADIUS * DENSITY_SCALE))


@kernel
def walls(view: View, out: Floats) -> None:
    """Free distance from the own surface to the nearest wall along rays / 3 m; ray k at k / n of a turn to the left."""
    bodies, state, boundary = view.bodies, view.state, view.world.boundary
    rays = out.shape[1]
    for e in range(len(state.time)):
        g = view.world.geometry_of_env[e]
        for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
            if not view.seen[i]:
                continue
            x, y = state.position[i, 0], state.position[i, 1]
            for k in range(rays):
                turn = 2.0 * np.pi * k / rays
                c, s = np.cos(turn), np.sin(turn)
                dx = c * view.axis[i, 0] - s * view.axis[i, 1]
                dy = s * view.axis[i, 0] + c * view.axis[i, 1]
                free = SIGHT + bodies.radius[i]
                for w in range(boundary.wall_start[g], boundary.wall_start[g + 1]):
                    ax, ay = boundary.wall[w, 0, 0] - x, boundary.wall[w, 0, 1] - y
                    tx, ty = boundary.wall[w, 1, 0] - x - ax, boundary.wall[w, 1, 1] - y - ay
                    cross = dx * ty - dy * tx
                    if cross == 0.0:
                        continue
                    distance, along = (ax * ty - ay * tx) / cross, (ax * dy - ay * dx) / cross
                    if distance >= 0.0 and 0.0 <= along <= 1.0:
                        free = min(free, distance)
                out[i, k] = _clip(max(free - bodies.radius[i], 0.0) / SIGHT)


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
        return out.astype(np.float32)
