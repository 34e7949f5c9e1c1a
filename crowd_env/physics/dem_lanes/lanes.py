"""The crowd as the soft scheme steps it: one array a quantity, so that eight people fit into one instruction.

Positions and velocities are copied here at the start of a call and back at its end; in between only these move.  Whoever is
out is parked far away with nothing to drive him: no loop has to ask who is inside.
"""

from typing import NamedTuple

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
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
def accelerate(
    begin: int,
    end: int,
    dt: float,
    force: Floats,
    regular: Floats,
    per_mass: Floats,
    wish: Floats,
    per_tau: Floats,
    v: Floats,
) -> None:
    """First half of symplectic Euler, of one coordinate:  v += h (f / m + (v_d - v) / tau).

    Short loops: each vectorises, a long one with all these arrays does not.
    """
    for i in range(index(begin), index(end)):
        v[i] += dt * ((force[i] + regular[i]) * per_mass[i] + (wish[i] - v[i]) * per_tau[i])


@inner_kernel
def accelerate_freely(begin: int, end: int, dt: float, wish: Floats, per_tau: Floats, v: Floats) -> None:
    """The same for people on whom no force acts, to the bit: a third less to fetch from memory, which is what it costs."""
    for i in range(index(begin), index(end)):
        v[i] += dt * (0.0 + (wish[i] - v[i]) * per_tau[i])


@inner_kernel
def move(begin: int, end: int, dt: float, v: Floats, x: Floats) -> None:
    """Second half:  x += h v."""
    for i in range(index(begin), index(end)):
        x[i] += dt * v[i]


@inner_kernel
def greatest_speed(begin: int, end: int, vx: Floats, vy: Floats, limit: float) -> float:
    """Return the greatest speed [m/s], after those above ``limit`` have been held to it.

    Four by four: each comparison has to wait for the one before, but not for its three neighbors.
    """
    one, four = index(1), index(4)
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for i in range(index(begin), index(begin + (end - begin) // 4 * 4), four):
        j, k, m = i + one, i + one + one, i + one + one + one
        p, q = vx[i] * vx[i] + vy[i] * vy[i], vx[j] * vx[j] + vy[j] * vy[j]
        r, s = vx[k] * vx[k] + vy[k] * vy[k], vx[m] * vx[m] + vy[m] * vy[m]
        a, b, c, d = p if p > a else a, q if q > b else b, r if r > c else c, s if s > d else d
    for i in range(index(begin + (end - begin) // 4 * 4), index(end)):
        p = vx[i] * vx[i] + vy[i] * vy[i]
        a = p if p > a else a
    fastest = max(max(a, b), max(c, d))
    if fastest > limit * limit:
        for i in range(index(begin), index(end)):
            square = vx[i] * vx[i] + vy[i] * vy[i]
            if square > limit * limit:
                share = limit / np.sqrt(square)
                vx[i] *= share
                vy[i] *= share
        return limit
    return float(np.sqrt(fastest))


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
