"""One decision of everyone in an environment: how fast to walk, and where to."""

import numpy as np

from crowd_env.core.arrays.headway import Headway
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.wall_grid import free_path, is_hidden, walls_near
from crowd_env.physics.neighbors.lists import first_cell
from crowd_env.physics.walking.around import FARTHEST, look_around
from crowd_env.physics.workspace import Batch

_STILL = 0.02  # of the desired speed, along the way: slower counts as standing ...
_WALKING = 0.25  # ... and faster as walking: who creeps in a jam neither gains patience nor loses it
_MOST_IMPATIENT = (
    0.2  # push of those who have stood for long: still aside for others, so that streams that cross do not lock
)
_SIDES = np.array([-0.13, 0.13, -0.27, 0.27, -0.58, 0.58])  # tangents of 7, 15 and 30 degrees to either side
_MOST_ASIDE = 2.0  # people never turn further from their way than atan 2 = 63 degrees


@inner_kernel
def decide(e: int, batch: Batch, params: Headway) -> None:
    """Write the velocity that everyone in environment ``e`` wants to walk at into `History.walking_velocity`.

    It depends on positions, velocities and ways at this moment alone, so on no order of people.
    """
    look_around(e, batch, params)
    decide_share(e, 0, 1, batch, params)


@inner_kernel
def decide_share(e: int, share: int, shares: int, batch: Batch, params: Headway) -> None:
    """Let the people in one of so many parts of the cells decide; any thread may do so, after `look_around`."""
    walkers, slot_start = batch.workspace.walkers, batch.bodies.env_start[e]
    cell_start = batch.workspace.neighbors.cell_start
    cells, head = walkers.columns[e] * walkers.rows[e], first_cell(e, slot_start)
    # Where the list of those seen is: each share has room for all people.
    seen_start = slot_start * (len(walkers.seen) // len(walkers.x)) + share * cell_start[head + cells]
    for cell in range(cells * share // shares, cells * (share + 1) // shares):
        n_start, n_stop = slot_start + cell_start[head + cell], slot_start + cell_start[head + cell + 1]
        for n in range(index(n_start), index(n_stop)):
            _decide_one(e, walkers.slot[n], cell, seen_start, batch, params)


@inner_kernel
def _decide_one(e: int, i: int, cell: int, seen_start: int, batch: Batch, params: Headway) -> None:
    """Write what person ``i`` wants, who stands in ``cell``; those seen are listed from ``seen_start`` on."""
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
    waited = max(history.waited[i] - params.patience, 0.0)
    push = max(min(push + params.impatience * waited, _MOST_IMPATIENT), push)
    count, aside = _look(e, i, cell, seen_start, batch, params)
    seen = (seen_start, seen_start + count)
    aside += _overtake(e, i, seen, time_gap, speed, batch, params)
    if params.off_walls > 0.0:
        aside += _off_walls(e, i, batch, params)
    aside = min(max((1.0 - push) * aside, -_MOST_ASIDE), _MOST_ASIDE)
    per_size = 1.0 / np.sqrt(1.0 + aside * aside)
    ex, ey = per_size * (way_x - aside * way_y), per_size * (way_y + aside * way_x)
    behind, leader = _speed_behind(i, seen, ex, ey, time_gap, batch, params, params.width)
    size = min(max(behind, push * speed), speed)
    walking[i, 0], walking[i, 1] = size * ex, size * ey
    _wait(i, u * way_x + v * way_y, speed, leader if behind < speed else i, batch, params)


@inner_kernel
def _wait(i: int, pace: float, speed: float, leader: int, batch: Batch, params: Headway) -> None:
    """Count the time [s] on or back that ``i`` has stood, who gets on at ``pace`` [m/s] and whom ``leader`` slows most."""
    waited, walkers = batch.history.waited, batch.workspace.walkers
    if pace < _STILL * speed:
        against = -(walkers.way_x[i] * walkers.way_x[leader] + walkers.way_y[i] * walkers.way_y[leader])
        waited[i] += params.interval * (1.0 + params.oncoming * max(against, 0.0))
    elif pace > _WALKING * speed:
        most = params.patience + _MOST_IMPATIENT / max(params.impatience, 1e-9)
        waited[i] = max(min(waited[i], most) - params.interval, 0.0)


@inner_kernel
def _look(e: int, i: int, cell: int, seen_start: int, batch: Batch, params: Headway) -> tuple[int, float]:
    """Write those whom ``i`` sees in front; returns how many they are, and how far to step aside (left > 0), of the way."""
    walkers, radius = batch.workspace.walkers, batch.bodies.radius
    position, velocity = batch.state.position, batch.state.velocity
    world, g, door_open = batch.world, batch.world.geometry_of_env[e], batch.history.door_open[e]
    x, y, r, u, v = position[i, 0], position[i, 1], radius[i], velocity[i, 0], velocity[i, 1]
    way_x, way_y = walkers.way_x[i], walkers.way_y[i]
    near = walls_near(world.wall_grid, g, x, y)
    seen, aside = walkers.seen, 0.0
    xs, ys, radii, cell_start = walkers.x, walkers.y, walkers.radius, batch.workspace.neighbors.cell_start
    slot_start, columns, rows = batch.bodies.env_start[e], walkers.columns[e], walkers.rows[e]
    head, row, column, limit = first_cell(e, slot_start), cell // columns, cell % columns, walkers.reach[i] + r
    count = index(seen_start)
    for above in range(max(row - 1, 0), min(row + 2, rows)):
        left, right = head + above * columns + max(column - 1, 0), head + above * columns + min(column + 2, columns)
        for n in range(index(slot_start + cell_start[left]), index(slot_start + cell_start[right])):
            dx, dy, reach = xs[n] - x, ys[n] - y, limit + radii[n]
            seen[count] = n  # without a branch: most are too far, or behind
            count += index((dx * dx + dy * dy < reach * reach) & (dx * way_x + dy * way_y > 0.0))
    kept = index(seen_start)
    for m in range(index(seen_start), count):
        n = seen[m]
        dx, dy = walkers.x[n] - x, walkers.y[n] - y
        if is_hidden(world.wall_grid, near, world.boundary, door_open, x, y, dx, dy):
            continue
        seen[kept] = n
        kept += index(1)
        j = walkers.slot[n]
        distance = np.sqrt(dx * dx + dy * dy)
        closing = ((u - velocity[j, 0]) * dx + (v - velocity[j, 1]) * dy) / distance
        foreseen = max(distance - r - radii[n] - params.anticipation * closing, 0.0)
        if foreseen > FARTHEST * params.length:
            continue
        same = way_x * walkers.way_x[j] + way_y * walkers.way_y[j]
        size = params.strength * (1.0 + params.oncoming * max(-same, 0.0)) * np.exp(-foreseen / params.length)
        sideways = way_x * (dy + params.anticipation * velocity[j, 1]) - way_y * (
            dx + params.anticipation * velocity[j, 0]
        )
        # Away from there; to the right if it is straight ahead, and of those who come towards one also a little beyond.
        aside += size if sideways < -params.keep_right * max(-same, 0.0) else -size
    return int(np.int64(kept - index(seen_start))), aside


@inner_kernel
def _overtake(
    e: int, i: int, seen: tuple[int, int], time_gap: float, speed: float, batch: Batch, params: Headway
) -> float:
    """Return how far to step aside, of the way, to get past someone slower; 0 if that gains too little, or in a queue."""
    walkers, world, velocity = batch.workspace.walkers, batch.world, batch.state.velocity
    x, y, r = batch.state.position[i, 0], batch.state.position[i, 1], batch.bodies.radius[i]
    way_x, way_y = walkers.way_x[i], walkers.way_y[i]
    behind, leader = _speed_behind(i, seen, way_x, way_y, time_gap, batch, params, params.width)
    if behind >= speed:
        return 0.0
    if velocity[leader, 0] * way_x + velocity[leader, 1] * way_y < params.overtaking:
        return 0.0
    near = walls_near(world.wall_grid, world.geometry_of_env[e], x, y)
    best, chosen = behind + params.gain * speed, 0.0
    for k in range(len(_SIDES)):
        aside = _SIDES[k]
        per_size = 1.0 / np.sqrt(1.0 + aside * aside)
        ex, ey = per_size * (way_x - aside * way_y), per_size * (way_y + aside * way_x)
        behind, _ = _speed_behind(i, seen, ex, ey, time_gap, batch, params, params.berth)
        pace = per_size * min(behind, speed)
        if pace > best:
            free = free_path(world.wall_grid, near, world.boundary.wall, x, y, ex, ey, time_gap * speed + r) - r
            pace = min(pace, per_size * free / time_gap)
            if pace > best:
                best, chosen = pace, aside
    return chosen


@inner_kernel
def _off_walls(e: int, i: int, batch: Batch, params: Headway) -> float:
    """Return how far to bend the way off walls at either hand, of the way (left > 0)."""
    walkers, world, r = batch.workspace.walkers, batch.world, batch.bodies.radius[i]
    x, y = batch.state.position[i, 0], batch.state.position[i, 1]
    way_x, way_y = walkers.way_x[i], walkers.way_y[i]
    near, wall, reach = (
        walls_near(world.wall_grid, world.geometry_of_env[e], x, y),
        world.boundary.wall,
        r + params.off_walls,
    )
    left = free_path(world.wall_grid, near, wall, x, y, -way_y, way_x, reach)
    right = free_path(world.wall_grid, near, wall, x, y, way_y, -way_x, reach)
    return params.shyness * (min(left - r, params.off_walls) - min(right - r, params.off_walls)) / params.off_walls


@inner_kernel
def _speed_behind(
    i: int,
    seen: tuple[int, int],
    ex: float,
    ey: float,
    time_gap: float,
    batch: Batch,
    params: Headway,
    width: float,
) -> tuple[float, int]:
    """Return how fast [m/s] those seen in the strip along (ex, ey), and beside it, let ``i`` walk, and who slows most."""
    walkers, radius = batch.workspace.walkers, batch.bodies.radius
    position, velocity = batch.state.position, batch.state.velocity
    x, y, r, slowest, leader = position[i, 0], position[i, 1], radius[i], np.inf, i
    way_x, way_y, gives_way = walkers.way_x[i], walkers.way_y[i], batch.control.gives_way
    for m in range(index(seen[0]), index(seen[1])):
        n = walkers.seen[m]
        dx, dy, reach = walkers.x[n] - x, walkers.y[n] - y, r + walkers.radius[n]
        along, across = dx * ex + dy * ey, dy * ex - dx * ey
        beyond = abs(across) - width * reach  # of the strip
        if along > 0.0 and (beyond < 0.0 or beyond < params.beside * min(slowest, walkers.speed[i])):
            j = walkers.slot[n]
            ux, uy = walkers.way_x[j], walkers.way_y[j]
            same = max(way_x * ux + way_y * uy, 0.0)
            is_ahead = same > 0.0 and -(dx * ux + dy * uy) > dx * way_x + dy * way_y
            if is_ahead and (beyond >= 0.0 or abs(dy * ux - dx * uy) < width * reach) and gives_way[j]:
                continue  # the other has this one further in front, and gives way
            foreseen = same * params.anticipation
            onward = max(velocity[j, 0] * ex + velocity[j, 1] * ey, 0.0)
            room = np.sqrt(dx * dx + dy * dy) - reach - same * params.standing + foreseen * onward
            if beyond >= 0.0:
                pace = max(
                    room / (time_gap + foreseen), beyond / max(same * params.beside, 1e-9), params.keep_up * onward
                )
                if pace < slowest:
                    slowest, leader = pace, j
            elif room < slowest * (time_gap + foreseen):
                slowest, leader = room / (time_gap + foreseen), j
    return max(slowest, 0.0), leader
