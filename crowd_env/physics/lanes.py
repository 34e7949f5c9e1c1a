"""The crowd as the soft scheme steps it: one array a quantity, so that eight people fit into one instruction.

Positions and velocities are copied here at the start of a call and back at its end; in between only these move.  Whoever is
out is parked far away with nothing to drive him: no loop has to ask who is inside.
"""

from typing import NamedTuple

import numpy as np

from crowd_env._jit import index, inner_kernel, kernel
from crowd_env.state import Bools, Floats

PARKED = 1e9  # m   beyond any crowd: nobody touches anyone there, and to add zero changes nothing


class Lanes(NamedTuple):
    """Working copy of everyone, (P,) each."""

    x: Floats  # m
    y: Floats
    vx: Floats  # m/s
    vy: Floats
    wish_x: Floats  # m/s  desired velocity
    wish_y: Floats
    per_tau: Floats  # 1/s  0 for passive grains
    per_mass: Floats  # 1/kg
    fx: Floats  # N    contact force; 0 between steps
    fy: Floats
    squeeze: Floats  # N    sum of its magnitudes
    gx: Floats  # N    external and social force
    gy: Floats
    push_x: Floats  # N s  contact impulse since the start of the call
    push_y: Floats
    crush: Floats


def allocate_lanes(people: int) -> Lanes:
    """Return lanes for so many people."""
    return Lanes._make(np.zeros(people) for _ in Lanes._fields)


@inner_kernel
def enter_lanes(
    begin: int,
    end: int,
    position: Floats,
    velocity: Floats,
    active: Bools,
    mass: Floats,
    relaxation_time: Floats,
    external: Floats,
    driving: bool,
    push: Floats,
    crush: Floats,
    lanes: Lanes,
    origin_x: Floats,
    origin_y: Floats,
) -> tuple[int, bool]:
    """Copy the people ``begin:end`` into their lanes; returns how many are inside, and whether an external force acts."""
    inside, pressed = 0, False
    for i in range(index(begin), index(end)):
        lanes.fx[i] = lanes.fy[i] = lanes.squeeze[i] = 0.0
        lanes.push_x[i], lanes.push_y[i], lanes.crush[i] = push[i, 0], push[i, 1], crush[i]
        if active[i]:
            inside += 1
            lanes.x[i], lanes.y[i] = position[i, 0], position[i, 1]
            lanes.vx[i], lanes.vy[i] = velocity[i, 0], velocity[i, 1]
            lanes.gx[i], lanes.gy[i] = external[i, 0], external[i, 1]
            pressed |= external[i, 0] != 0.0 or external[i, 1] != 0.0
            lanes.per_mass[i] = 1.0 / mass[i]
            lanes.per_tau[i] = 1.0 / relaxation_time[i] if driving else 0.0
        else:
            park(i, lanes, origin_x, origin_y)
    return inside, pressed


@inner_kernel
def park(i: int, lanes: Lanes, origin_x: Floats, origin_y: Floats) -> None:
    """Take person ``i`` out of the way, and let the list think that he has always been there."""
    lanes.x[i], lanes.y[i] = PARKED + 100.0 * i, PARKED  # apart from each other
    origin_x[i], origin_y[i] = lanes.x[i], lanes.y[i]
    lanes.vx[i] = lanes.vy[i] = lanes.gx[i] = lanes.gy[i] = 0.0
    lanes.per_tau[i] = lanes.per_mass[i] = lanes.wish_x[i] = lanes.wish_y[i] = 0.0


@inner_kernel
def show_positions(begin: int, end: int, active: Bools, x: Floats, y: Floats, position: Floats) -> None:
    """Copy the positions of those inside back to where all others look for them."""
    for i in range(index(begin), index(end)):
        if active[i]:
            position[i, 0], position[i, 1] = x[i], y[i]


@inner_kernel
def leave_lanes(
    begin: int, end: int, active: Bools, lanes: Lanes, position: Floats, velocity: Floats, push: Floats, crush: Floats
) -> None:
    """Copy the people ``begin:end`` back, and the impulses that they have got in this call."""
    show_positions(begin, end, active, lanes.x, lanes.y, position)
    show_positions(begin, end, active, lanes.vx, lanes.vy, velocity)
    for i in range(index(begin), index(end)):
        push[i, 0], push[i, 1], crush[i] = lanes.push_x[i], lanes.push_y[i], lanes.crush[i]


@inner_kernel
def walk(
    begin: int,
    end: int,
    dt: float,
    force: Floats,
    regular: Floats,
    per_mass: Floats,
    wish: Floats,
    per_tau: Floats,
    v: Floats,
    x: Floats,
) -> None:
    """Symplectic Euler of one coordinate:  v += h (f / m + (v_d - v) / tau),  x += h v.

    Short loops: each vectorises, a long one with all these arrays does not.
    """
    for i in range(index(begin), index(end)):
        v[i] += dt * ((force[i] + regular[i]) * per_mass[i] + (wish[i] - v[i]) * per_tau[i])
    for i in range(index(begin), index(end)):
        x[i] += dt * v[i]


@inner_kernel
def walk_freely(begin: int, end: int, dt: float, wish: Floats, per_tau: Floats, v: Floats, x: Floats) -> None:
    """The same for people on whom no force acts, to the bit: a third less to fetch from memory, which is what it costs."""
    for i in range(index(begin), index(end)):
        v[i] += dt * (0.0 + (wish[i] - v[i]) * per_tau[i])
    for i in range(index(begin), index(end)):
        x[i] += dt * v[i]


@inner_kernel
def book(begin: int, end: int, dt: float, force: Floats, push: Floats) -> None:
    """Add the impulse of a force to what is booked, and clear it."""
    for i in range(index(begin), index(end)):
        push[i] += dt * force[i]
    for i in range(index(begin), index(end)):
        force[i] = 0.0


@inner_kernel
def count_strays(
    begin: int, end: int, x: Floats, y: Floats, origin_x: Floats, origin_y: Floats, allowed: Floats
) -> int:
    """How many have gone further than allowed from where the list was built; nan counts."""
    gone = 0
    for i in range(index(begin), index(end)):
        dx, dy = x[i] - origin_x[i], y[i] - origin_y[i]
        gone += not dx * dx + dy * dy <= allowed[i] * allowed[i]
    return gone


@kernel
def aim(
    begin: int,
    end: int,
    time: float,
    command: Floats,
    relative: Bools,
    way: Floats,
    pace: Floats,
    response_time: Floats,
    active: Bools,
    wish_x: Floats,
    wish_y: Floats,
) -> None:
    """Write the desired velocity of those inside; see `crowd_env.physics.forces.desired_velocities`."""
    for i in range(index(begin), index(end)):
        if not active[i]:
            continue
        speed = pace[i] if time >= response_time[i] else 0.0
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = way[i, 0], way[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        wish_x[i], wish_y[i] = speed * cx, speed * cy
