"""Exits: a pedestrian is out from the moment when the center crosses an exit line outwards.

Behind the line lies its apron (`crowd_env.geometry.aprons`).  A pedestrian that is out walks straight on there, a body in the
way of the next, and is gone at its end.  Where the apron has no depth, as in the papers, the pedestrian vanishes at the line.
"""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.surface import has_sheets, sheet_beyond
from crowd_env.physics.step import list_present
from crowd_env.physics.workspace import Batch

_ACROSS = 0.7  # cosine between outward normals: people do not meet behind exits that lead more alike


@inner_kernel
def leave(e: int, rank_stop: int, batch: Batch, dt: float) -> int:
    """Mark all people with a center that crossed an exit line outwards during this step; take out people beyond an apron.

    `Workspace.inside` lists the bodies up to ``rank_stop``; returns the new end of the list.
    """
    boundary, g, gone = batch.world.boundary, batch.world.geometry_of_env[e], False
    inside, previous, position = batch.workspace.inside, batch.workspace.previous_position, batch.state.position
    exit_line, first, stop = boundary.exit, boundary.exit_start[g], boundary.exit_start[g + 1]
    rank_start, active = batch.bodies.env_start[e], batch.state.active
    for rank in range(index(rank_start), index(rank_stop)):
        i = inside[rank]
        if not active[i]:
            gone |= end_of_apron(e, i, batch, position[i, 0], position[i, 1])
    for k in range(first, stop):
        for rank in range(index(rank_start), index(rank_stop)):
            i = inside[rank]
            x0, y0, x1, y1 = previous[i, 0], previous[i, 1], position[i, 0], position[i, 1]
            if _crossing(exit_line, k, x0, y0, x1, y1) <= 1.0:  # rare: the other arrays are read only then
                gone |= mark_crossing(e, i, k - first, batch, dt, x0, y0, x1, y1)
    if has_sheets(batch.world.surface, g):
        for rank in range(index(rank_start), index(rank_stop)):
            change_sheet(e, inside[rank], batch, position[inside[rank], 0], position[inside[rank], 1])
    return list_present(e, batch) if gone else rank_stop


@inner_kernel
def change_sheet(e: int, i: int, batch: Batch, x: float, y: float) -> None:
    """Put pedestrian ``i`` at (x, y) on the sheet behind the seam that it has passed, and behind another one next to it."""
    g, sheet, surface = batch.world.geometry_of_env[e], batch.state.sheet, batch.world.surface
    if batch.state.active[i]:
        before = sheet[i]
        sheet[i] = sheet_beyond(surface, g, before, x, y)
        if sheet[i] != before:
            sheet[i] = sheet_beyond(surface, g, sheet[i], x, y)


@inner_kernel
def mark_crossing(
    e: int, i: int, exit_number: int, batch: Batch, dt: float, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Mark pedestrian ``i`` as out if the path from 0 to 1 of this step crosses an exit outwards.

    Of several exits crossed in one step the first counts.  Returns whether the body was there until now and is gone.
    """
    state, boundary, time = batch.state, batch.world.boundary, batch.state.time[e]
    k = boundary.exit_start[batch.world.geometry_of_env[e]] + exit_number
    part = _crossing(boundary.exit, k, x0, y0, x1, y1)
    if not part <= 1.0 or batch.world.surface.exit_sheet[k] != state.sheet[i]:
        return False
    moment, was_present = time + part * dt, state.present[i]
    if not (state.active[i] or (state.exit_time[i] > moment and state.exit_time[i] > time)):
        return False
    state.active[i] = False
    state.exit_time[i] = moment
    state.exit_index[i] = exit_number
    state.present[i] = boundary.apron[k] > 0.0
    direction = batch.history.direction
    direction[i, 0], direction[i, 1] = _outwards(boundary.exit, k)
    return was_present and not state.present[i]


@inner_kernel
def end_of_apron(e: int, i: int, batch: Batch, x: float, y: float) -> bool:
    """Take out the body of ``i``, which is out, at the end of its apron; returns whether it is gone.

    That is the depth of the apron, or where it would meet people out of another exit, towards it or across: nobody
    gives way there.
    """
    boundary, g = batch.world.boundary, batch.world.geometry_of_env[e]
    first, stop, line = boundary.exit_start[g], boundary.exit_start[g + 1], boundary.exit
    own = first + batch.state.exit_index[i]
    nx, ny = _outwards(line, own)
    beyond = (x - line[own, 0, 0]) * nx + (y - line[own, 0, 1]) * ny
    gone, reach = beyond >= boundary.apron[own], beyond + 2.0 * batch.bodies.radius[i]
    for k in range(first, stop):
        if boundary.apron[k] > 0.0 and k != own:
            mx, my = _outwards(line, k)
            dx, dy = x - line[k, 0, 0], y - line[k, 0, 1]
            length = np.hypot(line[k, 1, 0] - line[k, 0, 0], line[k, 1, 1] - line[k, 0, 1])
            aside = dx * -my + dy * mx  # along the line
            aside = max(max(-aside, aside - length), 0.0)
            out = dx * mx + dy * my
            meets = out * out + aside * aside < reach * reach
            gone |= (beyond > 0.0) & (out > 0.0) & meets & (nx * mx + ny * my < _ACROSS)
    batch.state.present[i] = not gone
    return gone


@inner_kernel
def _outwards(exit_line: Floats, k: int) -> tuple[float, float]:
    """Return the outward normal of exit ``k``."""
    tx, ty = exit_line[k, 1, 0] - exit_line[k, 0, 0], exit_line[k, 1, 1] - exit_line[k, 0, 1]
    length = np.sqrt(tx * tx + ty * ty)
    return ty / length, -tx / length


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
