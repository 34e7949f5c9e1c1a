"""The preparation of a decision: ways, ranges within which others matter, and people in cells."""

import numpy as np

from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.driving_force import asked_of, has_set_out
from crowd_env.physics.neighbors.lists import sort_into_cells
from crowd_env.physics.walking.pulls import pull_aside, walk_at_full_speed
from crowd_env.physics.workspace import Batch

CELLS = 2  # no relevant pedestrian is more cells away; smaller cells fit the range of sight better
FARTHEST = 8.0  # of the length D: a larger foreseen gap causes no side step
_MARGIN = 1e-6  # m    for rounding


@inner_kernel
def look_around(e: int, batch: Batch, params: Headway) -> None:
    """Find all ways, and sort people into cells: no relevant pedestrian is more than `CELLS` cells away."""
    slot_start, slot_stop = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    present, position, radius = batch.state.present, batch.state.position, batch.bodies.radius
    velocity, gives_way, active = batch.state.velocity, batch.control.gives_way, batch.state.active
    near, walkers = batch.workspace.neighbors, batch.workspace.walkers
    widest, fastest = _find_ways(e, slot_start, slot_stop, batch)
    if batch.acts.pulls:
        pull_aside(e, batch)
        if not batch.acts.manner:
            walk_at_full_speed(e, batch)
            return
    size = (2.0 * widest + _find_reach(slot_start, slot_stop, fastest, batch, params)) / CELLS
    head, columns, rows = sort_into_cells(e, slot_start, slot_stop, present, position, near, size)
    walkers.columns[e], walkers.rows[e] = columns, rows
    slot, record, way_x, way_y = walkers.slot, walkers.record, walkers.way_x, walkers.way_y
    for n in range(index(slot_start), index(slot_start) + index(near.cell_start[head + columns * rows])):
        j = index(near.cell_item[n])
        slot[n] = j
        record[n, 0], record[n, 1], record[n, 2] = position[j, 0], position[j, 1], radius[j]
        record[n, 3], record[n, 4], record[n, 5], record[n, 6] = velocity[j, 0], velocity[j, 1], way_x[j], way_y[j]
        record[n, 7] = 1.0 if gives_way[j] or not active[j] else 0.0


@inner_kernel
def _find_ways(e: int, slot_start: int, slot_stop: int, batch: Batch) -> tuple[float, float]:
    """Write unit vectors along all ways, and desired speeds; returns the largest radius [m] and speed [m/s]."""
    walkers, local_speed, radius = batch.workspace.walkers, batch.history.local_speed, batch.bodies.radius
    time, velocity = batch.state.time[e], batch.state.velocity
    present, widest, fastest = batch.state.present, 0.0, 0.0
    for i in range(index(slot_start), index(slot_stop)):
        cx, cy = asked_of(i, batch)
        size = np.sqrt(cx * cx + cy * cy)
        if not has_set_out(i, time, batch):
            size = 0.0  # not on the way yet, and waiting for no other
        walkers.way_x[i] = cx / size if size > 0.0 else 0.0
        walkers.way_y[i] = cy / size if size > 0.0 else 0.0
        walkers.speed[i] = size * local_speed[i]
        widest = max(widest, radius[i])
        if present[i]:
            fastest = max(fastest, velocity[i, 0] ** 2 + velocity[i, 1] ** 2)
    return widest, np.sqrt(fastest)


@inner_kernel
def _find_reach(slot_start: int, slot_stop: int, fastest: float, batch: Batch, params: Headway) -> float:
    """Write for each pedestrian the gap [m] up to which others matter, at most the range of sight; returns the largest.

    Beyond it no pedestrian slows the other down, or comes near enough in the foreseen time.
    """
    walkers, velocity, farthest = batch.workspace.walkers, batch.state.velocity, 0.0
    for i in range(index(slot_start), index(slot_stop)):
        closing = np.sqrt(velocity[i, 0] ** 2 + velocity[i, 1] ** 2) + fastest
        foreseen = params.anticipation * closing
        needed = params.standing + (time_gap_of(i, batch, params) + params.anticipation) * walkers.speed[i]
        reach = max(needed, FARTHEST * params.length + foreseen) + _MARGIN
        walkers.reach[i] = min(reach, params.sight)
        farthest = max(farthest, walkers.reach[i])
    return farthest


@inner_kernel
def time_gap_of(i: int, batch: Batch, params: Headway) -> float:
    """Return the time gap [s] of pedestrian ``i``: its own, or that of the manner."""
    own = batch.bodies.time_gap[i]
    return own if own == own else params.time_gap
