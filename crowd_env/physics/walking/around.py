"""What a decision needs to know first: everyone's way, how far others matter, and who stands near whom."""

import numpy as np

from crowd_env.core.arrays.headway import Headway
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.driving_force import asked_of
from crowd_env.physics.neighbors.lists import sort_into_cells
from crowd_env.physics.workspace import Batch

FARTHEST = 8.0  # of the length D: nobody steps aside for a gap that is foreseen larger
_MARGIN = 1e-6  # m    for rounding


@inner_kernel
def look_around(e: int, batch: Batch, params: Headway) -> None:
    """Find everyone's way, and sort people into cells: whoever matters stands in the own cell or beside it."""
    slot_start, slot_stop = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    active, position, radius = batch.state.active, batch.state.position, batch.bodies.radius
    near, walkers = batch.workspace.neighbors, batch.workspace.walkers
    widest, fastest = _find_ways(e, slot_start, slot_stop, batch)
    size = 2.0 * widest + _find_reach(slot_start, slot_stop, fastest, batch, params)
    head, columns, rows = sort_into_cells(e, slot_start, slot_stop, active, position, near, size)
    walkers.columns[e], walkers.rows[e] = columns, rows
    for n in range(index(slot_start), index(slot_start) + index(near.cell_start[head + columns * rows])):
        j = near.cell_item[n]
        walkers.slot[n], walkers.radius[n] = j, radius[j]
        walkers.x[n], walkers.y[n] = position[j, 0], position[j, 1]


@inner_kernel
def _find_ways(e: int, slot_start: int, slot_stop: int, batch: Batch) -> tuple[float, float]:
    """Write the unit vector along everyone's way, and the desired speed; returns the largest radius [m] and speed [m/s]."""
    walkers, local_speed, radius = batch.workspace.walkers, batch.history.local_speed, batch.bodies.radius
    time, response_time, velocity = batch.state.time[e], batch.bodies.response_time, batch.state.velocity
    active, widest, fastest = batch.state.active, 0.0, 0.0
    for i in range(index(slot_start), index(slot_stop)):
        cx, cy = asked_of(i, batch)
        size = np.sqrt(cx * cx + cy * cy)
        if time < response_time[i]:
            size = 0.0  # not on the way yet, and not waiting for anyone either
        walkers.way_x[i] = cx / size if size > 0.0 else 0.0
        walkers.way_y[i] = cy / size if size > 0.0 else 0.0
        walkers.speed[i] = size * local_speed[i]
        widest = max(widest, radius[i])
        if active[i]:
            fastest = max(fastest, velocity[i, 0] ** 2 + velocity[i, 1] ** 2)
    return widest, np.sqrt(fastest)


@inner_kernel
def _find_reach(slot_start: int, slot_stop: int, fastest: float, batch: Batch, params: Headway) -> float:
    """Write the gap [m] up to which others matter to everyone, who may be seen further; returns the largest.

    Beyond it nobody slows anyone down, and nobody comes near enough in the time that is foreseen.
    """
    walkers, velocity, own_time_gap = batch.workspace.walkers, batch.state.velocity, batch.bodies.time_gap
    farthest = 0.0
    for i in range(index(slot_start), index(slot_stop)):
        time_gap = own_time_gap[i] if own_time_gap[i] == own_time_gap[i] else params.time_gap
        closing = np.sqrt(velocity[i, 0] ** 2 + velocity[i, 1] ** 2) + fastest
        foreseen = params.anticipation * closing
        needed = params.standing + (time_gap + params.anticipation) * walkers.speed[i]
        reach = max(needed, FARTHEST * params.length + foreseen) + _MARGIN
        walkers.reach[i] = min(reach, params.sight)
        farthest = max(farthest, walkers.reach[i])
    return farthest
