"""Exits: a pedestrian is out as soon as the center crosses an exit line outwards, at the moment of the crossing."""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.physics.dem_lanes.lanes import PARKED, Lanes, park
from crowd_env.physics.neighbors.lists import Places
from crowd_env.physics.step import list_active
from crowd_env.physics.workspace import Batch
from crowd_env.state import Bools, Floats, Ints


@inner_kernel
def leave(e: int, rank_stop: int, batch: Batch, dt: float) -> int:
    """Make everyone inactive whose center crossed an exit line outwards during this step.

    `Workspace.inside` lists the active people up to ``rank_stop``; returns where the list ends now.  Of several exits that a
    person crosses in one step the first counts.
    """
    state, boundary, g = batch.state, batch.world.boundary, batch.world.geometry_of_env[e]
    exit_start, exit_stop, exit_line = boundary.exit_start[g], boundary.exit_start[g + 1], boundary.exit
    inside, previous, position = batch.workspace.inside, batch.workspace.previous_position, state.position
    active, exit_time, exit_index, time = state.active, state.exit_time, state.exit_index, state.time[e]
    slot_start, left = batch.bodies.env_start[e], False
    for k in range(exit_start, exit_stop):
        for rank in range(index(slot_start), index(rank_stop)):
            i = inside[rank]
            part = _crossing(exit_line, k, previous[i, 0], previous[i, 1], position[i, 0], position[i, 1])
            if part <= 1.0 and _is_first(active[i], exit_time[i], time, time + part * dt):
                left = True
                active[i] = False
                exit_time[i] = time + part * dt
                exit_index[i] = k - exit_start
    return list_active(e, batch) if left else rank_stop


@inner_kernel
def leave_lanes_by_list(
    first: int,
    last: int,
    owner: Places,
    partner: Places,
    exit_line: Floats,
    exit_start: int,
    x: Floats,
    y: Floats,
    vx: Floats,
    vy: Floats,
    time: float,
    dt: float,
    active: Bools,
    exit_time: Floats,
    exit_index: Ints,
) -> int:
    """Mark who crossed an exit, of the people near one (entries ``first:last``); returns how many."""
    left = 0
    for entry in range(first, last):
        i, number = owner[entry], partner[entry]
        k = exit_start + np.int64(number)
        part = _crossing(exit_line, k, x[i] - dt * vx[i], y[i] - dt * vy[i], x[i], y[i])
        if part <= 1.0 and _is_first(active[i], exit_time[i], time, time + part * dt):
            left += active[i]
            active[i] = False
            exit_time[i] = time + part * dt
            exit_index[i] = number
    return left


@inner_kernel
def leave_lanes_anywhere(
    begin: int,
    end: int,
    exit_line: Floats,
    exit_start: int,
    exit_stop: int,
    x: Floats,
    y: Floats,
    vx: Floats,
    vy: Floats,
    time: float,
    dt: float,
    active: Bools,
    exit_time: Floats,
    exit_index: Ints,
) -> int:
    """The same for all people ``begin:end``: when someone has gone further than the list allows for."""
    left = 0
    for k in range(exit_start, exit_stop):
        for i in range(index(begin), index(end)):
            part = _crossing(exit_line, k, x[i] - dt * vx[i], y[i] - dt * vy[i], x[i], y[i])
            if part <= 1.0 and _is_first(active[i], exit_time[i], time, time + part * dt):
                left += active[i]
                active[i] = False
                exit_time[i] = time + part * dt
                exit_index[i] = k - exit_start
    return left


@inner_kernel
def _crossing(exit_line: Floats, k: int, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return which part of the way from 0 to 1 lies before exit ``k``; infinite if it is not crossed outwards."""
    ax, ay = exit_line[k, 0, 0], exit_line[k, 0, 1]
    tx, ty = exit_line[k, 1, 0] - ax, exit_line[k, 1, 1] - ay
    side1 = tx * (y1 - ay) - ty * (x1 - ax)  # > 0: inside
    if side1 >= 0.0:
        return np.inf
    side0 = tx * (y0 - ay) - ty * (x0 - ax)
    if side0 < 0.0:
        return np.inf
    part = side0 / (side0 - side1)
    along = tx * (x0 + part * (x1 - x0) - ax) + ty * (y0 + part * (y1 - y0) - ay)
    return part if 0.0 <= along <= tx * tx + ty * ty else np.inf


@inner_kernel
def _is_first(inside: bool, exit_time: float, begin: float, moment: float) -> bool:
    """Whether a crossing counts: of someone inside, or one before that of another exit in the same step."""
    return inside or (exit_time > moment and exit_time > begin)


@inner_kernel
def take_out_of_lanes(
    begin: int,
    end: int,
    active: Bools,
    lanes: Lanes,
    origin_x: Floats,
    origin_y: Floats,
    position: Floats,
    velocity: Floats,
) -> None:
    """Leave those who have just gone out where they are, for all to see, and park them."""
    for i in range(index(begin), index(end)):
        if not active[i] and lanes.x[i] < PARKED:
            position[i, 0], position[i, 1] = lanes.x[i], lanes.y[i]
            velocity[i, 0], velocity[i, 1] = lanes.vx[i], lanes.vy[i]
            park(i, lanes, origin_x, origin_y)
