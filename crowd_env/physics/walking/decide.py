"""One decision of everyone in an environment: how fast to walk, and where to."""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.geometry.wall_grid import free_path, is_hidden, walls_near
from crowd_env.headway import HeadwayParams
from crowd_env.physics.neighbors.lists import sort_into_cells
from crowd_env.physics.workspace import Batch

_STILL = 0.02  # of the desired speed: slower counts as standing
_SIDES = np.array([-0.13, 0.13, -0.27, 0.27, -0.58, 0.58])  # tangents of 7, 15 and 30 degrees to either side
_MOST_ASIDE = 2.0  # people never turn further from their way than atan 2 = 63 degrees


@inner_kernel
def decide(e: int, batch: Batch, params: HeadwayParams) -> None:
    """Write the velocity that everyone in environment ``e`` wants to walk at into `History.walking_velocity`.

    It depends on positions, velocities and ways at this moment alone, so on no order of people.
    """
    slot_start, slot_stop = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    active, position, near = batch.state.active, batch.state.position, batch.workspace.neighbors
    widest = _find_ways(slot_start, slot_stop, batch)
    size = params.sight + 2.0 * widest
    head, columns, rows = sort_into_cells(e, slot_start, slot_stop, active, position, near, size)
    for cell in range(columns * rows):
        item_start, item_stop = slot_start + near.cell_start[head + cell], slot_start + near.cell_start[head + cell + 1]
        if item_start < item_stop:
            seen = _gather_around(head, cell, columns, rows, slot_start, batch)
            for item in range(index(item_start), index(item_stop)):
                _decide_one(e, near.cell_item[item], slot_start, seen, batch, params)


@inner_kernel
def _find_ways(slot_start: int, slot_stop: int, batch: Batch) -> float:
    """Write the unit vector along everyone's way, and the desired speed [m/s]; returns the largest radius [m]."""
    walkers, command, relative = batch.workspace.walkers, batch.control.command, batch.control.relative
    direction, local_speed, radius = batch.history.direction, batch.history.local_speed, batch.bodies.radius
    widest = 0.0
    for i in range(index(slot_start), index(slot_stop)):
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = direction[i, 0], direction[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        size = np.sqrt(cx * cx + cy * cy)
        walkers.way_x[i] = cx / size if size > 0.0 else 0.0
        walkers.way_y[i] = cy / size if size > 0.0 else 0.0
        walkers.speed[i] = size * local_speed[i]
        widest = max(widest, radius[i])
    return widest


@inner_kernel
def _gather_around(head: int, cell: int, columns: int, rows: int, slot_start: int, batch: Batch) -> int:
    """Write positions and radii of those in a cell and beside it one behind the other; returns how many they are."""
    near, walkers, position, radius = (
        batch.workspace.neighbors,
        batch.workspace.walkers,
        batch.state.position,
        batch.bodies.radius,
    )
    row, column, count = cell // columns, cell % columns, index(slot_start)
    for other in range(max(row - 1, 0), min(row + 2, rows)):
        left, right = head + other * columns + max(column - 1, 0), head + other * columns + min(column + 2, columns)
        for item in range(index(slot_start + near.cell_start[left]), index(slot_start + near.cell_start[right])):
            j = near.cell_item[item]
            walkers.slot[count] = j
            walkers.x[count], walkers.y[count], walkers.radius[count] = position[j, 0], position[j, 1], radius[j]
            count += index(1)
    return int(np.int64(count))


@inner_kernel
def _decide_one(e: int, i: int, slot_start: int, slot_stop: int, batch: Batch, params: HeadwayParams) -> None:
    """Write what person ``i`` wants, who sees at most the people gathered in ``slot_start:slot_stop``."""
    walkers, velocity, bodies, history = batch.workspace.walkers, batch.state.velocity, batch.bodies, batch.history
    walking = history.walking_velocity
    speed, way_x, way_y = walkers.speed[i], walkers.way_x[i], walkers.way_y[i]
    if speed == 0.0:
        walking[i, 0], walking[i, 1] = 0.0, 0.0
        return
    if not batch.control.gives_way[i]:
        walking[i, 0], walking[i, 1] = speed * way_x, speed * way_y
        return
    time_gap = bodies.time_gap[i] if bodies.time_gap[i] == bodies.time_gap[i] else params.time_gap
    push = bodies.push[i] if bodies.push[i] == bodies.push[i] else params.push
    u, v = velocity[i, 0], velocity[i, 1]
    push = _impatient(i, u, v, speed, push, batch, params)
    count, aside = _look(e, i, slot_start, slot_stop, batch, params)
    aside += _overtake(e, i, slot_start, slot_start + count, time_gap, speed, batch, params)
    aside = min(max((1.0 - push) * aside, -_MOST_ASIDE), _MOST_ASIDE)
    per_size = 1.0 / np.sqrt(1.0 + aside * aside)
    ex, ey = per_size * (way_x - aside * way_y), per_size * (way_y + aside * way_x)
    gap, _ = _gap_ahead(i, slot_start, slot_start + count, ex, ey, batch, params.width)
    size = min(max(gap / time_gap, push * speed), speed)
    walking[i, 0], walking[i, 1] = size * ex, size * ey


@inner_kernel
def _impatient(i: int, u: float, v: float, speed: float, push: float, batch: Batch, params: HeadwayParams) -> float:
    """Return the push of someone who may have stood still for long, and count the time [s] on or back."""
    waited = batch.history.waited
    if u * u + v * v < (_STILL * speed) ** 2:
        waited[i] += params.interval
    else:
        waited[i] = max(min(waited[i], params.patience + 1.0 / max(params.impatience, 1e-9)) - params.interval, 0.0)
    return min(push + params.impatience * max(waited[i] - params.patience, 0.0), 1.0)


@inner_kernel
def _look(e: int, i: int, slot_start: int, slot_stop: int, batch: Batch, params: HeadwayParams) -> tuple[int, float]:
    """Write those whom ``i`` sees in front; returns how many they are, and how far to step aside (left > 0), of the way."""
    walkers, position, velocity, radius = (
        batch.workspace.walkers,
        batch.state.position,
        batch.state.velocity,
        batch.bodies.radius,
    )
    world, g, door_open = batch.world, batch.world.geometry_of_env[e], batch.history.door_open[e]
    grid, wall, wall_door = world.wall_grid, world.boundary.wall, world.boundary.wall_door
    x, y, r, u, v = position[i, 0], position[i, 1], radius[i], velocity[i, 0], velocity[i, 1]
    way_x, way_y = walkers.way_x[i], walkers.way_y[i]
    wall_first, wall_stop = walls_near(grid, g, x, y)
    seen, aside = walkers.seen, 0.0
    count = index(slot_start)
    for n in range(index(slot_start), index(slot_stop)):  # without a branch: most are too far, or behind
        dx, dy, reach = walkers.x[n] - x, walkers.y[n] - y, params.sight + r + walkers.radius[n]
        seen[count] = n
        count += index((dx * dx + dy * dy < reach * reach) & (dx * way_x + dy * way_y > 0.0) & (walkers.slot[n] != i))
    kept = index(slot_start)
    for m in range(index(slot_start), count):
        n = seen[m]
        dx, dy = walkers.x[n] - x, walkers.y[n] - y
        if is_hidden(grid, wall_first, wall_stop, wall, wall_door, door_open, x, y, dx, dy):
            continue
        seen[kept] = n
        kept += index(1)
        j = walkers.slot[n]
        distance = np.sqrt(dx * dx + dy * dy)
        gap, nx, ny = distance - r - radius[j], dx / distance, dy / distance
        closing = (u - velocity[j, 0]) * nx + (v - velocity[j, 1]) * ny
        foreseen = max(gap - params.anticipation * closing, 0.0)
        if foreseen > 8.0 * params.length:
            continue
        same = way_x * walkers.way_x[j] + way_y * walkers.way_y[j]
        size = params.strength * (1.0 + params.oncoming * max(-same, 0.0)) * np.exp(-foreseen / params.length)
        sideways = way_x * (dy + params.anticipation * velocity[j, 1]) - way_y * (
            dx + params.anticipation * velocity[j, 0]
        )
        aside += size if sideways < 0.0 else -size  # away from there; to the right if it is straight ahead
    return int(np.int64(kept - index(slot_start))), aside


@inner_kernel
def _overtake(
    e: int, i: int, slot_start: int, slot_stop: int, time_gap: float, speed: float, batch: Batch, params: HeadwayParams
) -> float:
    """Return how far to step aside, of the way, to get past someone slower; 0 if that gains too little, or in a queue."""
    walkers, world, velocity = batch.workspace.walkers, batch.world, batch.state.velocity
    x, y, r = batch.state.position[i, 0], batch.state.position[i, 1], batch.bodies.radius[i]
    way_x, way_y = walkers.way_x[i], walkers.way_y[i]
    gap, leader = _gap_ahead(i, slot_start, slot_stop, way_x, way_y, batch, params.width)
    if gap >= time_gap * speed:
        return 0.0
    if velocity[leader, 0] * way_x + velocity[leader, 1] * way_y < params.overtaking:
        return 0.0
    first, stop = walls_near(world.wall_grid, world.geometry_of_env[e], x, y)
    best, chosen = gap / time_gap + params.gain * speed, 0.0
    for k in range(len(_SIDES)):
        aside = _SIDES[k]
        per_size = 1.0 / np.sqrt(1.0 + aside * aside)
        ex, ey = per_size * (way_x - aside * way_y), per_size * (way_y + aside * way_x)
        gap, _ = _gap_ahead(i, slot_start, slot_stop, ex, ey, batch, params.berth)
        if per_size * min(gap / time_gap, speed) > best:
            free = free_path(world.wall_grid, first, stop, world.boundary.wall, x, y, ex, ey, gap + r) - r
            pace = per_size * min(free / time_gap, speed)
            if pace > best:
                best, chosen = pace, aside
    return chosen


@inner_kernel
def _gap_ahead(
    i: int, slot_start: int, slot_stop: int, ex: float, ey: float, batch: Batch, width: float
) -> tuple[float, int]:
    """Return the gap [m] to the nearest of those seen whose body overlaps the strip along (ex, ey), and who it is."""
    walkers, position, radius = batch.workspace.walkers, batch.state.position, batch.bodies.radius
    x, y, r, nearest, leader = position[i, 0], position[i, 1], radius[i], np.inf, i
    way_x, way_y, gives_way = walkers.way_x[i], walkers.way_y[i], batch.control.gives_way
    for m in range(index(slot_start), index(slot_stop)):
        n = walkers.seen[m]
        dx, dy, reach = walkers.x[n] - x, walkers.y[n] - y, r + walkers.radius[n]
        along, across = dx * ex + dy * ey, dy * ex - dx * ey
        if along > 0.0 and abs(across) < width * reach:
            j = walkers.slot[n]
            ux, uy = walkers.way_x[j], walkers.way_y[j]
            is_ahead = way_x * ux + way_y * uy > 0.0 and -(dx * ux + dy * uy) > dx * way_x + dy * way_y
            if is_ahead and abs(dy * ux - dx * uy) < width * reach and gives_way[j]:
                continue  # the other has this one further in front, and gives way
            gap = np.sqrt(dx * dx + dy * dy) - reach
            if gap < nearest:
                nearest, leader = gap, j
    return max(nearest, 0.0), leader
