"""What pedestrians perceive, compiled: the laws behind the terms of an observation.

The laws write their columns of the rows (P, D) float32 of those who are ``seen``, clipped to [-1, 1]; `feel` comes first and
writes zeros everywhere else.  Each runs over the people of many rooms and takes the few arrays it reads: handing over whole
NamedTuples of arrays, person by person, costs more than the law itself.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import inner_kernel, kernel
from crowd_env.physics.neighbor_list import NeighbourList, sort_into_cells
from crowd_env.state import Bools, Floats, Ints

Rows = NDArray[np.float32]

SIGHT = 3.0  # m     how far neighbours and walls are seen
SPEED_SCALE = 2.0  # m/s
TIME_SCALE = 5.0  # s     a travel time of 5 s is observed as 1/2
DENSITY_RADIUS = 1.0  # m
DENSITY_SCALE = 8.0  # 1/m2
KICK_SCALE = 1.0  # m/s   an impulse that changes the own speed by this much is observed as 1

# Numbers of the compiled terms, rows of `Plan.column`.
VELOCITY, DESIRED_SPEED, DIRECTION, TRAVEL_TIME, PUSH, CRUSH, DENSITY, WALLS, NEIGHBOURS = range(9)

# The nearest are found by one whole number, gap before slot: gaps that differ by less than 0.2 nm count as equal.
_GAP_STEPS = 4294967296.0  # 1/m
_SLOTS = 16777216
_NOBODY = 9223372036854775807


class Plan(NamedTuple):
    """Where the compiled terms of a layout go, and scratch for one thread."""

    column: Ints  # (9,)    first column of each term; -1 = not wanted
    turn: Floats  # (R, 2)  cosine and sine of the angle of each ray to the axis
    beam: Floats  # (3, R)  scratch: direction of each ray of one person, and how far it is free
    nearest: Ints  # (K,)    scratch: the nearest of one person
    around: Floats  # (3, N)  scratch: place and radius of those who are inside one room, if at most N are
    slot: Ints  # (N,)    scratch: who they are
    key: Ints  # (N,)    scratch: how near they are to one person


@inner_kernel
def clipped(value: float) -> float:
    """Return the value moved into [-1, 1]; nan stays."""
    if value < -1.0:
        return -1.0
    if value > 1.0:
        return 1.0
    return value


@kernel
def feel(
    rooms: Ints,
    env_start: Ints,
    column: Ints,
    seen: Bools,
    axis: Floats,
    velocity: Floats,
    desired_speed: Floats,
    direction: Floats,
    travel_time: Floats,
    push: Floats,
    crush: Floats,
    mass: Floats,
    out: Rows,
) -> None:
    """Write what everyone has of himself: velocity, desired speed, the way out, and what presses on him."""
    for e in rooms:
        for i in range(env_start[e], env_start[e + 1]):
            for k in range(out.shape[1]):
                out[i, k] = 0.0
    at_velocity, at_speed, at_direction = column[VELOCITY], column[DESIRED_SPEED], column[DIRECTION]
    at_time, at_push, at_crush = column[TRAVEL_TIME], column[PUSH], column[CRUSH]
    for e in rooms:
        for i in range(env_start[e], env_start[e + 1]):
            if not seen[i]:
                continue
            ax, ay = axis[i, 0], axis[i, 1]
            if at_velocity >= 0:
                x, y = velocity[i, 0], velocity[i, 1]
                out[i, at_velocity] = clipped((x * ax + y * ay) / SPEED_SCALE)
                out[i, at_velocity + 1] = clipped((y * ax - x * ay) / SPEED_SCALE)
            if at_speed >= 0:
                out[i, at_speed] = clipped(desired_speed[i] / SPEED_SCALE)
            if at_direction >= 0:
                out[i, at_direction] = clipped(direction[i, 0])
                out[i, at_direction + 1] = clipped(direction[i, 1])
            if at_time >= 0:
                out[i, at_time] = clipped(travel_time[i] / (travel_time[i] + TIME_SCALE))
            if crush[i] > 0.0:
                kick = mass[i] * KICK_SCALE
                if at_push >= 0:
                    x, y = push[i, 0], push[i, 1]
                    out[i, at_push] = clipped((x * ax + y * ay) / kick)
                    out[i, at_push + 1] = clipped((y * ax - x * ay) / kick)
                if at_crush >= 0:
                    out[i, at_crush] = clipped(crush[i] / kick)


@kernel
def cast_rays(
    rooms: Ints,
    env_start: Ints,
    column: Ints,
    geometry_of_env: Ints,
    wall_start: Ints,
    wall: Floats,
    wall_door: Ints,
    door_open: Bools,
    seen: Bools,
    axis: Floats,
    position: Floats,
    radius: Floats,
    turn: Floats,
    beam: Floats,
    out: Rows,
) -> None:
    """Write the free distance from everyone's surface to the nearest wall along rays / 3 m."""
    rays, first = len(turn), column[WALLS]
    for e in rooms:
        g = geometry_of_env[e]
        w0, w1 = wall_start[g], wall_start[g + 1]
        for i in range(env_start[e], env_start[e + 1]):
            if not seen[i]:
                continue
            x, y, reach = position[i, 0], position[i, 1], SIGHT + radius[i]
            for k in range(rays):
                c, s = turn[k, 0], turn[k, 1]
                beam[0, k] = c * axis[i, 0] - s * axis[i, 1]
                beam[1, k] = s * axis[i, 0] + c * axis[i, 1]
                beam[2, k] = reach
            limit = reach * reach * (1.0 + 1e-9)
            for w in range(w0, w1):
                if wall_door[w] >= 0 and door_open[e, wall_door[w]]:
                    continue
                ax, ay = wall[w, 0, 0] - x, wall[w, 0, 1] - y
                tx, ty = wall[w, 1, 0] - x - ax, wall[w, 1, 1] - y - ay
                across = ax * ty - ay * tx  # the distance of its line times its length
                if across * across > limit * (tx * tx + ty * ty):
                    continue
                for k in range(rays):
                    dx, dy = beam[0, k], beam[1, k]
                    cross, along = dx * ty - dy * tx, ax * dy - ay * dx
                    # Where ray and line meet, along / cross is the place between the ends; only a hit is worth a division.
                    if cross > 0.0:
                        hit = across >= 0.0 and 0.0 <= along <= cross
                    else:
                        hit = cross < 0.0 and across <= 0.0 and cross <= along <= 0.0
                    if hit:
                        beam[2, k] = min(beam[2, k], across / cross)
            for k in range(rays):
                out[i, first + k] = clipped(max(beam[2, k] - radius[i], 0.0) / SIGHT)


@kernel
def look_around(
    rooms: Ints,
    env_start: Ints,
    column: Ints,
    axis: Floats,
    seen: Bools,
    active: Bools,
    position: Floats,
    velocity: Floats,
    radius: Floats,
    near: NeighbourList,
    nearest: Ints,
    around: Floats,
    slot: Ints,
    key: Ints,
    out: Rows,
) -> None:
    """Write the density and the nearest neighbours of everyone who is still inside."""
    at_density, at_neighbours = column[DENSITY], column[NEIGHBOURS]
    wanted = len(nearest) if at_neighbours >= 0 else 0
    sight = SIGHT if wanted else DENSITY_RADIUS
    sight2, close2 = sight * sight, DENSITY_RADIUS * DENSITY_RADIUS
    scale = 1.0 / (np.pi * DENSITY_RADIUS**2 * DENSITY_SCALE)
    for e in rooms:
        begin, end = env_start[e], env_start[e + 1]
        inside = 0
        for i in range(begin, end):
            if active[i]:
                if inside < len(slot):
                    around[0, inside], around[1, inside], around[2, inside] = position[i, 0], position[i, 1], radius[i]
                    slot[inside] = i
                inside += 1
        all_pairs = inside <= len(slot)
        columns, rows, head = 1, 1, 0
        if not all_pairs:
            head, columns, rows = sort_into_cells(e, begin, end, active, position, near, sight)
        for i in range(begin, end):
            if not (active[i] and seen[i]):
                continue
            x, y, r = position[i, 0], position[i, 1], radius[i]
            for k in range(wanted):
                nearest[k] = _NOBODY
            close = 0
            if all_pairs:
                for n in range(inside):
                    dx, dy = x - around[0, n], y - around[1, n]
                    close += dx * dx + dy * dy < close2
                if wanted:
                    for n in range(inside):
                        dx, dy = x - around[0, n], y - around[1, n]
                        square = dx * dx + dy * dy
                        known = key_of(np.sqrt(square) - r - around[2, n], slot[n] - begin)
                        key[n] = known if square < sight2 and slot[n] != i else _NOBODY
                    if wanted <= 6:
                        least_six(key, inside, nearest)
                    else:
                        for n in range(inside):
                            enter(nearest, key[n])
            else:
                cell_row, cell_column = near.cell_of[i] // columns, near.cell_of[i] % columns
                for row in range(max(cell_row - 1, 0), min(cell_row + 2, rows)):
                    first = head + row * columns + max(cell_column - 1, 0)
                    last = head + row * columns + min(cell_column + 1, columns - 1)
                    for item in range(begin + near.cell_start[first], begin + near.cell_start[last + 1]):
                        j = near.cell_item[item]
                        dx, dy = x - position[j, 0], y - position[j, 1]
                        square = dx * dx + dy * dy
                        close += square < close2
                        if wanted and square < sight2 and j != i:
                            enter(nearest, key_of(np.sqrt(square) - r - radius[j], j - begin))
            if at_density >= 0:
                out[i, at_density] = clipped(close * scale)
            ax, ay, u, v = axis[i, 0], axis[i, 1], velocity[i, 0], velocity[i, 1]
            for k in range(wanted):
                if nearest[k] == _NOBODY:
                    break
                j = begin + nearest[k] % _SLOTS
                dx, dy = position[j, 0] - x, position[j, 1] - y
                du, dv = velocity[j, 0] - u, velocity[j, 1] - v
                gap = max(nearest[k] // _SLOTS, 0) / _GAP_STEPS
                c = at_neighbours + 5 * k
                out[i, c], out[i, c + 1] = (dx * ax + dy * ay) * (1.0 / SIGHT), (dy * ax - dx * ay) * (1.0 / SIGHT)
                out[i, c + 2] = clipped((du * ax + dv * ay) / (2 * SPEED_SCALE))
                out[i, c + 3] = clipped((dv * ax - du * ay) / (2 * SPEED_SCALE))
                out[i, c + 4] = 1.0 - gap * (1.0 / SIGHT)


@inner_kernel
def key_of(gap: float, slot: int) -> int:
    """Return the whole number that neighbours are ordered by: gap before slot."""
    return int(np.floor(gap * _GAP_STEPS)) * _SLOTS + slot


@inner_kernel
def enter(nearest: Ints, key: int) -> None:
    """Put someone into the ascending list of the nearest, unless those who are listed are all nearer."""
    if key < nearest[len(nearest) - 1]:
        for k in range(len(nearest)):
            other = nearest[k]
            nearest[k] = min(other, key)
            key = max(other, key)


@inner_kernel
def least_six(key: Ints, count: int, nearest: Ints) -> None:
    """Write the least of ``count`` keys, up to six, in ascending order.

    Six numbers stay in registers, and their smaller and larger take no decision that a processor could guess wrong.
    """
    a, b, c, d, e, f = _NOBODY, _NOBODY, _NOBODY, _NOBODY, _NOBODY, _NOBODY
    for n in range(count):
        new = key[n]
        a, new = min(a, new), max(a, new)
        b, new = min(b, new), max(b, new)
        c, new = min(c, new), max(c, new)
        d, new = min(d, new), max(d, new)
        e, new = min(e, new), max(e, new)
        f = min(f, new)
    for k in range(len(nearest)):
        nearest[k] = a
        a, b, c, d, e = b, c, d, e, f
