"""The crowd in the soft scheme as a structure of arrays, so that one instruction moves eight people.

Positions and velocities are copied here at the start of a call and back at its end; in between only these copies move.  People
that have left are moved far away and get no forces, so no loop has to test whether a pedestrian is inside.
"""

from typing import Annotated, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.neighbors.lists import NeighborList

FAR_AWAY = 1e9  # m   beyond any crowd: there are no contacts, and adding zero changes nothing


class SoABuffers(NamedTuple):
    """Working copy of all people as a structure of arrays."""

    x: Annotated[Floats, "P", "soa"]  # m
    y: Annotated[Floats, "P", "soa"]
    vx: Annotated[Floats, "P", "soa"]  # m/s
    vy: Annotated[Floats, "P", "soa"]
    desired_vx: Annotated[Floats, "P", "soa"]  # m/s
    desired_vy: Annotated[Floats, "P", "soa"]
    inv_tau: Annotated[Floats, "P", "soa"]  # 1/s  of the relaxation time; 0 for passive grains
    inv_mass: Annotated[Floats, "P", "soa"]  # 1/kg  0 for people that have left
    fx: Annotated[Floats, "P", "soa"]  # N    contact force; 0 between steps
    fy: Annotated[Floats, "P", "soa"]
    force_magnitude: Annotated[Floats, "P", "soa"]  # N    sum of the magnitudes of the contact forces; 0 between steps
    regular_fx: Annotated[Floats, "P", "soa"]  # N    external and social force
    regular_fy: Annotated[Floats, "P", "soa"]
    impulse_x: Annotated[Floats, "P", "soa"]  # N s  contact impulse since the start of the call
    impulse_y: Annotated[Floats, "P", "soa"]
    impulse_magnitude: Annotated[Floats, "P", "soa"]  # N s


@inner_kernel
def move_out(i: int, soa: SoABuffers, near: NeighborList) -> None:
    """Move pedestrian ``i`` far away, with the position in the neighbor list, so that the list stays valid."""
    soa.x[i], soa.y[i] = FAR_AWAY + 100.0 * i, FAR_AWAY  # apart from each other
    near.origin_x[i], near.origin_y[i] = soa.x[i], soa.y[i]
    soa.vx[i] = soa.vy[i] = soa.regular_fx[i] = soa.regular_fy[i] = 0.0
    soa.inv_tau[i] = soa.inv_mass[i] = soa.desired_vx[i] = soa.desired_vy[i] = 0.0


@inner_kernel
def interleave(slot_begin: int, slot_end: int, present: Bools, x: Floats, y: Floats, target: Floats) -> None:
    """Copy two buffers of the bodies to an array (P, 2), for the code that all schemes share."""
    for i in range(index(slot_begin), index(slot_end)):
        if present[i]:
            target[i, 0], target[i, 1] = x[i], y[i]


# The loops below are short because a short loop becomes vector instructions; a long one with all these arrays does not.


@inner_kernel
def integrate_velocity(
    slot_begin: int,
    slot_end: int,
    dt: float,
    force: Floats,
    regular: Floats,
    inv_mass: Floats,
    desired: Floats,
    inv_tau: Floats,
    velocity: Floats,
) -> None:
    """Advance one coordinate of the velocity by  v += h ((g + f) / m + (v_d - v) / tau)."""
    for i in range(index(slot_begin), index(slot_end)):
        velocity[i] += dt * ((force[i] + regular[i]) * inv_mass[i] + (desired[i] - velocity[i]) * inv_tau[i])


@inner_kernel
def integrate_free(
    slot_begin: int, slot_end: int, dt: float, desired: Floats, inv_tau: Floats, velocity: Floats
) -> None:
    """Advance one coordinate of the velocity under the driving force alone.

    The result equals that of `integrate_velocity` with zero forces bit by bit.  The loop is bound by memory, and this one reads
    a third less.
    """
    for i in range(index(slot_begin), index(slot_end)):
        velocity[i] += dt * (0.0 + (desired[i] - velocity[i]) * inv_tau[i])


@inner_kernel
def integrate_position(slot_begin: int, slot_end: int, dt: float, velocity: Floats, position: Floats) -> None:
    """Advance one coordinate of the position by  q += h v."""
    for i in range(index(slot_begin), index(slot_end)):
        position[i] += dt * velocity[i]


@inner_kernel
def limit_speed(slot_begin: int, slot_end: int, vx: Floats, vy: Floats, limit: float) -> float:
    """Limit speeds to ``limit`` [m/s]; returns the largest resulting speed [m/s].

    Four people at a time: a comparison has to wait for the one before it, but not for its three neighbors.
    """
    one, four, whole = index(1), index(4), slot_begin + (slot_end - slot_begin) // 4 * 4
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for i in range(index(slot_begin), index(whole), four):
        j, k, m = i + one, i + one + one, i + one + one + one
        p, q = vx[i] * vx[i] + vy[i] * vy[i], vx[j] * vx[j] + vy[j] * vy[j]
        r, s = vx[k] * vx[k] + vy[k] * vy[k], vx[m] * vx[m] + vy[m] * vy[m]
        a, b, c, d = p if p > a else a, q if q > b else b, r if r > c else c, s if s > d else d
    for i in range(index(whole), index(slot_end)):
        p = vx[i] * vx[i] + vy[i] * vy[i]
        a = p if p > a else a
    fastest = max(max(a, b), max(c, d))
    if fastest > limit * limit:
        for i in range(index(slot_begin), index(slot_end)):
            square = vx[i] * vx[i] + vy[i] * vy[i]
            if square > limit * limit:
                share = limit / np.sqrt(square)
                vx[i] *= share
                vy[i] *= share
        return limit
    return np.sqrt(fastest)


@inner_kernel
def add_impulse(slot_begin: int, slot_end: int, dt: float, force: Floats, impulse: Floats) -> None:
    """Add the impulse of a force to the sum of the call, and clear the force."""
    for i in range(index(slot_begin), index(slot_end)):
        impulse[i] += dt * force[i]
    for i in range(index(slot_begin), index(slot_end)):
        force[i] = 0.0


@inner_kernel
def count_too_far(slot_begin: int, slot_end: int, soa: SoABuffers, near: NeighborList) -> int:
    """Return how many people have moved further than the neighbor list allows; nan counts."""
    x, y, origin_x, origin_y, allowed, count = soa.x, soa.y, near.origin_x, near.origin_y, near.allowed, 0
    for i in range(index(slot_begin), index(slot_end)):
        dx, dy = x[i] - origin_x[i], y[i] - origin_y[i]
        count += not dx * dx + dy * dy <= allowed[i] * allowed[i]
    return count
