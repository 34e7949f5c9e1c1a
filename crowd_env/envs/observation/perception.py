"""Perception of pedestrians, compiled: the functions behind the terms of ``TERMS``.

They write their columns of the rows (P, D) float32 of ``seen`` pedestrians, clipped to [-1, 1].  All terms of one environment
are written before the next one begins: the data of twenty pedestrians stay in the nearest cache of the processor.
"""

import numpy as np

from crowd_env.core.arrays.state import Bools, Ints
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.envs.observation.neighbors import clipped, neighbor_features
from crowd_env.envs.observation.view import (
    GAIN,
    LOSS,
    SIGHT,
    SLOWEST,
    SPEED_SCALE,
    TIME_SCALE,
    Cells,
    Columns,
    Plan,
    Rows,
    View,
)
from crowd_env.envs.observation.ways import way_features
from crowd_env.geometry.surface import ground_of, rise_at, sheet_beyond, speed_at
from crowd_env.routing.fields.bottlenecks import bottleneck_at
from crowd_env.routing.fields.lookup import travel_time_at, way_at

GROUP_SCALE = 3.0  # people   this number of other members is observed as 1/2
KICK_SCALE = 1.0  # m/s   an impulse that changes the pedestrian's speed by this much is observed as 1


@kernel
def perceive(environments: Ints, view: View, plan: Plan, out: Rows) -> None:
    """Write the rows of ``out`` (P, D) of some environments, all but the terms that are not compiled."""
    column, listed = plan.column, view.listed
    for e in environments:
        begin = view.bodies.env_start[e]
        end = list_seen(begin, view.bodies.env_start[e + 1], view.seen, listed, out)
        update_route_ahead(e, begin, end, view)
        write_own_features(e, begin, end, view, column, out)
        if column.group >= 0:
            write_group(e, begin, end, view, column.group, out)
        if column.walls >= 0:
            cast_rays(e, begin, end, view, plan, out)
        if max(column.routes, column.queues_seen, column.queues_shown) >= 0:
            way_features(e, begin, end, view, plan, out)
        if max(column.density, column.neighbors, column.lead, column.ahead, column.queues_seen) >= 0:
            neighbor_features(e, begin, end, view, plan, out)


@inner_kernel
def list_seen(begin: int, end: int, seen: Bools, listed: Cells, out: Rows) -> int:
    """Empty the rows of one environment, and list the seen pedestrians of ``begin:end``; return the end of the list."""
    last = begin
    for i in range(index(begin), index(end)):
        for k in range(out.shape[1]):
            out[i, k] = 0.0
        listed[index(last)] = i  # no branch: the processor cannot predict which slots are empty
        last += seen[i]
    return last


@inner_kernel
def update_route_ahead(e: int, begin: int, end: int, view: View) -> None:
    """Write the rest of the route of each pedestrian in ``listed[begin:end]``, by the route that it follows.

    The potential is a travel time too, by a field that depends on route and doors alone: most often it is the same one.
    """
    position, active = view.state.position, view.state.active
    radius, desired_speed = view.bodies.radius, view.bodies.desired_speed
    travel_time, potential, walls, g = view.travel_time, view.potential, view.boundary, view.geometry_of_env[e]
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        route, x, y, r = view.followed[i], position[i, 0], position[i, 1], radius[i]
        f, p = view.field_of_route[e, route], view.potential_of_route[e, route]
        sheet = view.state.sheet[i]
        ground = ground_of(view.surface, g, sheet)
        ex, ey, length = way_at(view.field, walls, f + sheet, x, y, r, ground)
        view.direction[i, 0], view.direction[i, 1] = ex, ey
        left = length if p == f else travel_time_at(view.field, walls, p + sheet, x, y, r, ground)
        speed = max(desired_speed[i], SLOWEST)
        view.distance_to_go[i] = length
        travel_time[i] = length / speed if active[i] else 0.0
        potential[i] = left / speed if active[i] else 0.0


@inner_kernel
def write_own_features(e: int, begin: int, end: int, view: View, column: Columns, out: Rows) -> None:
    """Write the pedestrians' state: velocity, desired speed, the route ahead, and the contact impulses."""
    axis, velocity, impulse = view.axis, view.state.velocity, view.impulse
    at_velocity, at_speed, at_direction = column.velocity, column.desired_speed, column.direction
    at_time, at_push, at_crush = column.travel_time, column.push, column.crush
    at_opening, at_slope, at_stood = column.opening, column.slope, column.stood
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        ax, ay = axis[i, 0], axis[i, 1]
        if at_velocity >= 0:
            write_turned(out, i, at_velocity, velocity[i, 0], velocity[i, 1], ax, ay, SPEED_SCALE)
        if at_speed >= 0:
            out[i, at_speed] = clipped(view.bodies.desired_speed[i] / SPEED_SCALE)
        if at_direction >= 0:
            out[i, at_direction] = clipped(view.direction[i, 0])
            out[i, at_direction + 1] = clipped(view.direction[i, 1])
        if at_time >= 0:
            time = view.travel_time[i]
            out[i, at_time] = clipped(time / (time + TIME_SCALE))
        if at_opening >= 0:
            write_opening(e, i, at_opening, view, out)
        if at_slope >= 0:
            write_slope(e, i, at_slope, view, out)
        if at_stood >= 0:
            stood = time_stood(i, view.state.time[e], view)
            out[i, at_stood] = stood / (stood + TIME_SCALE)
        if view.impulse_magnitude[i] > 0.0:
            scale = view.bodies.mass[i] * KICK_SCALE
            if at_push >= 0:
                write_turned(out, i, at_push, impulse[i, 0], impulse[i, 1], ax, ay, scale)
            if at_crush >= 0:
                out[i, at_crush] = clipped(view.impulse_magnitude[i] / scale)


@inner_kernel
def write_opening(e: int, i: int, k: int, view: View, out: Rows) -> None:
    """Write the term `opening` of person ``i`` into two columns; 0 where no way is known."""
    p = view.potential_of_route[e, view.followed[i]] + view.state.sheet[i]
    width, rest = bottleneck_at(view.openings, p, view.state.position[i, 0], view.state.position[i, 1])
    if width > 0.0:
        speed = max(view.bodies.desired_speed[i], SLOWEST)
        time = max(view.potential[i] - rest / speed, 0.0)
        out[i, k] = max(1.0 - 2.0 * view.bodies.radius[i] / width, 0.0)
        out[i, k + 1] = clipped(time / (time + TIME_SCALE))


@inner_kernel
def write_slope(e: int, i: int, k: int, view: View, out: Rows) -> None:
    """Write the term `slope` of person ``i`` into four columns."""
    g, sheet = view.geometry_of_env[e], view.state.sheet[i]
    first, ex, ey = view.surface.sheet_start[g], view.direction[i, 0], view.direction[i, 1]
    for ahead in range(2):
        x, y = view.state.position[i, 0] + ahead * ex, view.state.position[i, 1] + ahead * ey
        if ahead:
            sheet = sheet_beyond(view.surface, g, sheet, x, y, 1.0)
        rise = rise_at(view.surface, first + sheet, x, y, ex, ey)
        out[i, k + 2 * ahead] = clipped(rise / np.sqrt(1.0 + rise * rise))
        up, down = view.bodies.upstairs[i], view.bodies.downstairs[i]
        share, belt = speed_at(view.surface, first + sheet, x, y, ex, ey, up, down)
        speed = share + belt / max(view.bodies.desired_speed[i], SLOWEST)
        out[i, k + 2 * ahead + 1] = clipped(speed * np.sqrt(1.0 + rise * rise) - 1.0)


@inner_kernel
def time_stood(i: int, now: float, view: View) -> float:
    """Return the time [s] since pedestrian ``i`` last got nearer to the end of the way, and store the least potential."""
    reached, potential = view.reached, view.potential[i]
    if not reached[i, 0] - GAIN < potential < reached[i, 0] + LOSS:
        reached[i, 0], reached[i, 1] = potential, now
    return now - reached[i, 1]


@inner_kernel
def write_group(e: int, begin: int, end: int, view: View, first: int, out: Rows) -> None:
    """Write the term `group` of ``listed[begin:end]`` in environment ``e``."""
    sums, group, position, active = view.group_sums, view.bodies.group, view.state.position, view.state.active
    slot_start, slot_stop = view.bodies.env_start[e], view.bodies.env_start[e + 1]
    for i in range(index(slot_start), index(slot_stop)):
        sums[i, 0], sums[i, 1], sums[i, 2] = 0.0, 0.0, 0.0
    for i in range(index(slot_start), index(slot_stop)):
        if active[i] and group[i] >= 0:
            c = slot_start + group[i]
            sums[c, 0] += position[i, 0]
            sums[c, 1] += position[i, 1]
            sums[c, 2] += 1.0
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        c, own = slot_start + max(group[i], 0), 1.0 if active[i] else 0.0
        others = sums[c, 2] - own
        if group[i] >= 0 and others > 0.0:
            x, y = position[i, 0], position[i, 1]
            dx, dy = (sums[c, 0] - own * x) / others - x, (sums[c, 1] - own * y) / others - y
            scale = SIGHT + np.sqrt(dx * dx + dy * dy)
            write_turned(out, i, first, dx, dy, view.axis[i, 0], view.axis[i, 1], scale)
            out[i, first + 2] = others / (others + GROUP_SCALE)


@inner_kernel
def write_turned(out: Rows, i: int, k: int, x: float, y: float, ax: float, ay: float, scale: float) -> None:
    """Write (x, y) / ``scale`` into two columns, in the frame with the first axis (ax, ay)."""
    out[i, k] = clipped((x * ax + y * ay) / scale)
    out[i, k + 1] = clipped((y * ax - x * ay) / scale)


@inner_kernel
def cast_rays(e: int, begin: int, end: int, view: View, plan: Plan, out: Rows) -> None:
    """Write the free distance from each body's surface to the nearest wall along rays / 3 m."""
    g = view.geometry_of_env[e]
    wall, wall_door, axis, turn, beam = view.boundary.wall, view.boundary.wall_door, view.axis, plan.turn, plan.beam
    rays, first = len(turn), plan.column.walls
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        x, y, r = view.state.position[i, 0], view.state.position[i, 1], view.bodies.radius[i]
        reach = SIGHT + r
        _, _, w0, w1 = ground_of(view.surface, g, view.state.sheet[i])
        for k in range(rays):
            c, s = turn[k, 0], turn[k, 1]
            beam[0, k] = c * axis[i, 0] - s * axis[i, 1]
            beam[1, k] = s * axis[i, 0] + c * axis[i, 1]
            beam[2, k] = reach
        limit = reach * reach * (1.0 + 1e-9)
        for w in range(index(w0), index(w1)):
            if wall_door[w] >= 0 and view.door_open[e, wall_door[w]]:
                continue
            ax, ay = wall[w, 0, 0] - x, wall[w, 0, 1] - y
            tx, ty = wall[w, 1, 0] - x - ax, wall[w, 1, 1] - y - ay
            across = ax * ty - ay * tx  # the distance of its line times its length
            if across * across > limit * (tx * tx + ty * ty):
                continue
            for k in range(rays):
                dx, dy = beam[0, k], beam[1, k]
                cross, along = dx * ty - dy * tx, ax * dy - ay * dx
                # Ray and line meet at the share along / cross of the wall; only a hit is worth a division.
                if cross > 0.0:
                    hit = across >= 0.0 and 0.0 <= along <= cross
                else:
                    hit = cross < 0.0 and across <= 0.0 and cross <= along <= 0.0
                if hit:
                    beam[2, k] = min(beam[2, k], across / cross)
        for k in range(rays):
            out[i, first + k] = clipped(max(beam[2, k] - r, 0.0) / SIGHT)
