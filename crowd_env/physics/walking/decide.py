"""One decision of all people in an environment: walking speed and direction."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.surface import are_level, has_sheets
from crowd_env.geometry.wall_grid import Near, free_paths, is_hidden, walls_near
from crowd_env.physics.neighbors.lists import first_cell
from crowd_env.physics.walking.ahead import compare, speed_behind
from crowd_env.physics.walking.around import CELLS, look_around, time_gap_of
from crowd_env.physics.workspace import BLOCK, Batch

_STILL = 0.02  # of the desired speed, along the way: slower counts as standing ...
_WALKING = 0.25  # ... and faster as walking: creeping in a jam leaves the standing time as it is
_MOST_IMPATIENT = 0.2  # largest push from standing: people still step aside, so that crossing streams do not lock
_SIDES = np.array([0.0, -0.13, 0.13, -0.27, 0.27, -0.58, 0.58])  # tangents of 0, 7, 15 and 30 degrees to either side
_MEETING = 0.5  # of its desired speed: above, a queue is overtaken where people come towards it
_ONCOMING = -0.5  # cosine of the angle between two ways: further apart than 120 degrees
_MOST_ASIDE = 2.0  # people never turn further from their way than atan 2 = 63 degrees


@inner_kernel
def decide(e: int, batch: Batch, params: Headway) -> None:
    """Write the walking velocities of environment ``e`` into `History.walking_velocity`.

    They depend on the present positions, velocities and ways alone, so on no order of people.
    """
    look_around(e, batch, params)
    decide_share(e, 0, 1, batch, params)


@inner_kernel
def decide_share(e: int, share: int, shares: int, batch: Batch, params: Headway) -> None:
    """Decide for the people in part ``share`` of ``shares`` of the cells; any thread may do so, after `look_around`."""
    if not batch.acts.manner:
        return  # `look_around` has written the velocities
    walkers, slot_start = batch.workspace.walkers, batch.bodies.env_start[e]
    cell_start = batch.workspace.neighbors.cell_start
    cells, head = walkers.columns[e] * walkers.rows[e], first_cell(e, slot_start)
    # Start of the list of people seen: each share has room for all.
    lists = len(walkers.seen) // len(walkers.slot)
    seen_start = slot_start * lists + share * cell_start[head + cells]
    for cell in range(cells * share // shares, cells * (share + 1) // shares):
        n_start, n_stop = slot_start + cell_start[head + cell], slot_start + cell_start[head + cell + 1]
        for n in range(index(n_start), index(n_stop)):
            _decide_one(e, walkers.slot[n], cell, seen_start, walkers.ahead[lists * e + share], batch, params)


@inner_kernel
def _decide_one(e: int, i: int, cell: int, seen_start: int, ahead: Floats, batch: Batch, params: Headway) -> None:
    """Write the walking velocity of pedestrian ``i`` in ``cell``; the people it sees are listed from ``seen_start`` on."""
    walkers, velocity, bodies, history = batch.workspace.walkers, batch.state.velocity, batch.bodies, batch.history
    walking = history.walking_velocity
    speed, way_x, way_y = walkers.speed[i], walkers.way_x[i], walkers.way_y[i]
    if speed == 0.0:
        walking[i, 0], walking[i, 1] = 0.0, 0.0
        return
    if not batch.control.gives_way[i] and batch.state.active[i]:
        walking[i, 0], walking[i, 1] = speed * way_x, speed * way_y
        return
    push = bodies.push[i] if bodies.push[i] == bodies.push[i] else params.push
    u, v = velocity[i, 0], velocity[i, 1]
    waited = max(history.memory.manner.waited[i] - params.patience, 0.0)
    push = max(min(push + params.impatience * waited, _MOST_IMPATIENT), push)
    x, y = batch.state.position[i, 0], batch.state.position[i, 1]
    sheet = batch.world.surface.sheet_start[batch.world.geometry_of_env[e]] + batch.state.sheet[i]
    near = walls_near(batch.world.wall_grid, sheet, x, y)
    seen, aside = (seen_start, _list_seen(e, i, cell, seen_start, near, batch)), 0.0
    for block in range(seen[0], seen[1], BLOCK):
        aside += compare(i, (block, min(block + BLOCK, seen[1])), ahead, batch, params)
    sidestep, passes = _overtake(i, seen, near, ahead, batch, params)
    aside += sidestep
    if params.off_walls > 0.0:
        aside += _off_walls(i, near, batch, params)
    aside = min(max((1.0 - push) * aside, -_MOST_ASIDE), _MOST_ASIDE)
    per_size = 1.0 / np.sqrt(1.0 + aside * aside)
    ex, ey = per_size * (way_x - aside * way_y), per_size * (way_y + aside * way_x)
    pace = u * way_x + v * way_y
    stands = pace < _STILL * speed
    behind, leader = speed_behind(i, seen, ex, ey, params.width, passes, stands, ahead, batch, params)
    size = max(behind, push * speed)
    walking[i, 0], walking[i, 1] = size * ex, size * ey
    _wait(i, pace, speed, leader, batch, params)


@inner_kernel
def _wait(i: int, pace: float, speed: float, leader: int, batch: Batch, params: Headway) -> None:
    """Update the standing time [s] of ``i`` with ``pace`` [m/s] along its way; ``leader`` slows it most."""
    waited, walkers = batch.history.memory.manner.waited, batch.workspace.walkers
    if pace < _STILL * speed:
        against = -(walkers.way_x[i] * walkers.way_x[leader] + walkers.way_y[i] * walkers.way_y[leader])
        waited[i] += params.interval * (1.0 + params.oncoming * max(against, 0.0))
    elif pace > _WALKING * speed:
        most = params.patience + _MOST_IMPATIENT / max(params.impatience, 1e-9)
        waited[i] = max(min(waited[i], most) - params.interval, 0.0)


@inner_kernel
def _list_seen(e: int, i: int, cell: int, seen_start: int, near: Near, batch: Batch) -> int:
    """List the people that ``i`` sees in front, from ``seen_start`` on; returns one past the last."""
    walkers, cell_start = batch.workspace.walkers, batch.workspace.neighbors.cell_start
    world, door_open = batch.world, batch.history.door_open[e]
    x, y, way_x, way_y = batch.state.position[i, 0], batch.state.position[i, 1], walkers.way_x[i], walkers.way_y[i]
    seen, record = walkers.seen, walkers.record
    slot_start, columns, rows = batch.bodies.env_start[e], walkers.columns[e], walkers.rows[e]
    head, row, column = first_cell(e, slot_start), cell // columns, cell % columns
    limit, count = walkers.reach[i] + batch.bodies.radius[i], index(seen_start)
    for above in range(max(row - CELLS, 0), min(row + CELLS + 1, rows)):
        left = head + above * columns + max(column - CELLS, 0)
        right = head + above * columns + min(column + CELLS + 1, columns)
        for n in range(index(slot_start + cell_start[left]), index(slot_start + cell_start[right])):
            dx, dy, reach = record[n, 0] - x, record[n, 1] - y, limit + record[n, 2]
            seen[count] = n  # without a branch: most are too far, or behind
            count += index((dx * dx + dy * dy < reach * reach) & (dx * way_x + dy * way_y > 0.0))
    if has_sheets(world.surface, world.geometry_of_env[e]):
        kept, height = index(seen_start), batch.history.height
        for m in range(index(seen_start), count):
            seen[kept] = seen[m]
            kept += index(are_level(height[i], height[walkers.slot[seen[m]]]))
        count = kept
    if near[0] < near[1]:
        kept = index(seen_start)
        for m in range(index(seen_start), count):
            n = seen[m]
            dx, dy = record[n, 0] - x, record[n, 1] - y
            if not is_hidden(world.wall_grid, near, world.boundary, door_open, x, y, dx, dy):
                seen[kept] = n
                kept += index(1)
        count = kept
    return int(np.int64(count))


@inner_kernel
def _overtake(
    i: int, seen: tuple[int, int], near: Near, ahead: Floats, batch: Batch, params: Headway
) -> tuple[float, bool]:
    """Return the tangent of the side step past a slower pedestrian, 0 straight past; and whether ``i`` passes one at all.

    It does not if that gains too little, or in a queue.  Where people come from the other side a queue that still walks is
    overtaken too: they hold it up, and waiting behind it would form no lane.  Past a slower one, two crowds lock in a corridor.
    """
    walkers, world, velocity = batch.workspace.walkers, batch.world, batch.state.velocity
    x, y, r = batch.state.position[i, 0], batch.state.position[i, 1], batch.bodies.radius[i]
    way_x, way_y, speed, time_gap = walkers.way_x[i], walkers.way_y[i], walkers.speed[i], time_gap_of(i, batch, params)
    behind, leader = speed_behind(i, seen, way_x, way_y, params.width, False, True, ahead, batch, params)
    if behind >= speed:
        return 0.0, False
    pace, wanted = velocity[leader, 0] * way_x + velocity[leader, 1] * way_y, walkers.speed[leader]
    if wanted > 0.0 and pace < params.overtaking * wanted and (pace < _MEETING * wanted or not _meets(i, seen, batch)):
        return 0.0, False
    best, chosen, passes = behind + params.gain * speed, 0.0, False
    for k in range(len(_SIDES)):
        aside = _SIDES[k] if params.keep_right >= 0.0 else -_SIDES[k]  # the first of equal ones
        per_size = 1.0 / np.sqrt(1.0 + aside * aside)
        if per_size * speed <= best:
            continue
        ex, ey = per_size * (way_x - aside * way_y), per_size * (way_y + aside * way_x)
        behind, _ = speed_behind(i, seen, ex, ey, params.berth, True, False, ahead, batch, params)
        pace = per_size * behind
        if pace > best:
            free, _ = free_paths(world.wall_grid, near, world.boundary.wall, x, y, ex, ey, time_gap * speed + r)
            pace = min(pace, per_size * (free - r) / time_gap)
            if pace > best:
                best, chosen, passes = pace, aside, True
    return chosen, passes


@inner_kernel
def _meets(i: int, seen: tuple[int, int], batch: Batch) -> bool:
    """Whether somebody that ``i`` sees comes from the other side."""
    walkers = batch.workspace.walkers
    for m in range(index(seen[0]), index(seen[1])):
        j = walkers.slot[walkers.seen[m]]
        if walkers.way_x[i] * walkers.way_x[j] + walkers.way_y[i] * walkers.way_y[j] < _ONCOMING:
            return True
    return False


@inner_kernel
def _off_walls(i: int, near: Near, batch: Batch, params: Headway) -> float:
    """Return the tangent by which walls on either side bend the way (left > 0)."""
    walkers, position, world, r = batch.workspace.walkers, batch.state.position, batch.world, batch.bodies.radius[i]
    x, y, way_x, way_y, reach = position[i, 0], position[i, 1], walkers.way_x[i], walkers.way_y[i], r + params.off_walls
    left, right = free_paths(world.wall_grid, near, world.boundary.wall, x, y, -way_y, way_x, reach)
    return params.shyness * (min(left - r, params.off_walls) - min(right - r, params.off_walls)) / params.off_walls
