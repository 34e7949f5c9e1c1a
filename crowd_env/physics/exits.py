"""Exits: a pedestrian is out from the moment when the center crosses an exit line outwards."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.step import list_active
from crowd_env.physics.workspace import Batch


@inner_kernel
def leave(e: int, rank_stop: int, batch: Batch, dt: float) -> int:
    """Take out all people with a center that crossed an exit line outwards during this step.

    `Workspace.inside` lists the active people up to ``rank_stop``; returns the new end of the list.
    """
    boundary, g, left = batch.world.boundary, batch.world.geometry_of_env[e], False
    inside, previous, position = batch.workspace.inside, batch.workspace.previous_position, batch.state.position
    exit_line, first, stop = boundary.exit, boundary.exit_start[g], boundary.exit_start[g + 1]
    for k in range(first, stop):
        for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
            i = inside[rank]
            x0, y0, x1, y1 = previous[i, 0], previous[i, 1], position[i, 0], position[i, 1]
            if _crossing(exit_line, k, x0, y0, x1, y1) <= 1.0:  # rare: the other arrays are read only then
                left |= mark_crossing(e, i, k - first, batch, dt, x0, y0, x1, y1)
    return list_active(e, batch) if left else rank_stop


@inner_kernel
def mark_crossing(
    e: int, i: int, exit_number: int, batch: Batch, dt: float, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Mark pedestrian ``i`` as out if the path from 0 to 1 of this step crosses an exit outwards.

    Of several exits crossed in one step the first counts.  Returns whether the pedestrian was inside until now.
    """
    state, boundary, time = batch.state, batch.world.boundary, batch.state.time[e]
    k = boundary.exit_start[batch.world.geometry_of_env[e]] + exit_number
    part = _crossing(boundary.exit, k, x0, y0, x1, y1)
    if not part <= 1.0:
        return False
    moment, was_inside = time + part * dt, state.active[i]
    if not (was_inside or (state.exit_time[i] > moment and state.exit_time[i] > time)):
        return False
    state.active[i] = False
    state.exit_time[i] = moment
    state.exit_index[i] = exit_number
    return was_inside


@inner_kernel
def _crossing(exit_line: Floats, k: int, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return the part of the path from 0 to 1 before exit ``k``; infinite if it is not crossed outwards."""
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
