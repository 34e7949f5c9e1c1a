"""What became of everyone in a decision step, compiled: who got out, who has how far to go, and whose episode is over."""

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import inner_kernel, kernel
from crowd_env.geometry import Boundary
from crowd_env.navigation import FieldArrays, direction_at, travel_time_at
from crowd_env.navigation_lookup import (
    BLEND,
    blended_direction,
    exit_frame,
    nearest_on_exit,
    quick_cell,
    through_exit,
)
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints


@kernel
def look_ahead(
    rooms: Ints,
    field: FieldArrays,
    boundary: Boundary,
    field_of_route: Ints,
    followed: Ints,
    bodies: Bodies,
    state: CrowdState,
    seen: Bools,
    row: Ints,
    direction: Floats,
    travel_time: Floats,
    before: Floats,
) -> None:
    """Write direction (P, 2) and travel time (P,) of the followed route of everyone who is seen, for some rooms.

    ``row`` (P,) is the field that was looked at.  ``before`` (P,) becomes the travel time as it was, or, if it was by another
    field, as it is now: another way is no progress.
    """
    cell, directions, times, exit_line = field.cell, field.direction, field.travel_time, boundary.exit
    position, radius, active, speed = state.position, bodies.radius, state.active, bodies.desired_speed
    f, rows, cols, start, margin, left, bottom, spacing = -1, 0, 0, 0, np.nan, 0.0, 0.0, 1.0
    for e in rooms:
        for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
            if not seen[i]:
                before[i] = travel_time[i]
                continue
            mine = field_of_route[e, followed[i]]
            if mine != f:
                f = mine
                rows, cols, margin = field.shape[f, 0], field.shape[f, 1], field.margin[f]
                start, left, bottom, spacing = (
                    field.node_start[f],
                    field.origin[f, 0],
                    field.origin[f, 1],
                    field.spacing[f],
                )
            x, y, r = position[i, 0], position[i, 1], radius[i]
            plain, ex, ey, length = False, 0.0, 0.0, np.nan
            if cols > 0:
                first, u, v = quick_cell(start, rows, cols, left, bottom, spacing, x, y)
                plain, ex, ey, length = quick_way(
                    cell, directions, times, exit_line, first, cols, u, v, margin if margin >= 0.0 else r, x, y, r
                )
            if not plain:
                ex, ey = direction_at(field, boundary, f, x, y, r)
            direction[i, 0], direction[i, 1] = ex, ey
            now = 0.0
            if active[i]:
                if not length >= 0.0:
                    length = travel_time_at(field, boundary, f, x, y, r)
                # Someone who does not want to move would need for ever: the time at a slow walk stands in.
                now = length / max(speed[i], 0.1)
            before[i] = travel_time[i] if row[i] == f else now
            row[i] = f
            travel_time[i] = now


@inner_kernel
def quick_way(
    cell: NDArray[np.int16],
    direction: Floats,
    travel_time: Floats,
    exit_line: Floats,
    first: int,
    cols: int,
    u: float,
    v: float,
    margin: float,
    x: float,
    y: float,
    radius: float,
) -> tuple[bool, float, float, float]:
    """Return what `quick_direction` does, and the length of the way [m] as `travel_time_at` has it, nan if it is not plain."""
    k = cell[first]
    if k >= 0:
        ax, ay, ux, uy, width, nx, ny = exit_frame(exit_line, k)
        tx, ty = nearest_on_exit(ax, ay, ux, uy, width, x, y, margin)
        ex, ey = through_exit(ax, ay, ux, uy, width, nx, ny, x, y, radius, margin)
        return True, ex, ey, np.sqrt((tx - x) ** 2 + (ty - y) ** 2)
    if k != BLEND:
        return False, 0.0, 0.0, np.nan
    plain, ex, ey = blended_direction(direction, first, cols, u, v)
    total, weights = 0.0, 0.0
    for c in range(4):
        time = travel_time[first + (c >> 1) * cols + (c & 1)]
        weight = (u if c & 1 else 1.0 - u) * (v if c >> 1 else 1.0 - v)
        if time < np.inf:  # false for nan
            total += weight * time
            weights += weight
    return plain, ex, ey, total / weights if weights > 1e-3 else np.nan


@kernel
def settle(
    bodies: Bodies,
    state: CrowdState,
    inside: Bools,
    started: Floats,
    time_limit: Floats,
    blocked_after: Floats,
    dt: float,
    crush: Floats,
    last_exit: Floats,
    impulse: Floats,
    finished: Bools,
    duration: Floats,
    left: Bools,
    truncated: Bools,
    ended: Bools,
) -> int:
    """Close the books of a step; return how many environments ended in it.

    Parameters
    ----------
    inside, started : (P,) who was inside at its start, (E,) s when it started.
    time_limit, blocked_after : (E,) s.
    crush : (P,) N s, contact impulses of the step.
    last_exit, impulse, finished : (E,) s, (P,) N s, (E,), of the episode, brought up to date.
    duration, left, truncated, ended : written: (P,) s inside during the step, (P,) who got out, (P,) whom the end of the
        episode found inside, (E,) whose episode ended.  Who is truncated is no longer active.
    """
    env_start, active, exit_time, clock = bodies.env_start, state.active, state.exit_time, state.time
    count = 0
    for e in range(len(clock)):
        now, last, still = clock[e], last_exit[e], 0
        for i in range(env_start[e], env_start[e + 1]):
            left[i] = inside[i] and not active[i]
            truncated[i] = False
            impulse[i] += crush[i]
            duration[i] = now - started[e]
            still += active[i]
            if left[i]:
                duration[i] = exit_time[i] - started[e]
                last = max(last, exit_time[i])
        last_exit[e] = last
        stopped = now > time_limit[e] - 0.5 * dt or now - last > blocked_after[e]
        ended[e] = (stopped or still == 0) and not finished[e]
        count += ended[e]
        finished[e] = finished[e] or ended[e]
        if stopped and still > 0:
            for i in range(env_start[e], env_start[e + 1]):
                truncated[i] = active[i]
                active[i] = False
    return count
