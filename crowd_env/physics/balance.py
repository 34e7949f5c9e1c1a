"""Balance in every scheme: the ground force on standing pedestrians, as a desired velocity of their drive; and their arms.

A drive m (v_d - v) / tau is the force m a of the pendulum (`crowd_env.core.behaviors.balance`) if v_d = v + tau a.  So every
scheme with a drive has it through the desired velocity, and needs no other code for it.  Arms are a force at a distance.
"""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.balance import GRAVITY, Balance
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.bounds import limited
from crowd_env.physics.workspace import Batch


@inner_kernel
def stand(i: int, time: float, batch: Batch, params: Balance) -> tuple[float, float]:
    """Move the feet of standing pedestrian ``i`` if due; returns the velocity [m/s] that makes the drive the ground force.

    The result depends on the present state alone, so a repeated step of the physics gives the same.
    """
    position, velocity, memory = batch.state.position, batch.state.velocity, batch.history.memory.balance
    feet, lands_at = memory.feet, memory.lands_at
    x, y, u, v = position[i, 0], position[i, 1], velocity[i, 0], velocity[i, 1]
    lag = np.sqrt(params.height / GRAVITY)
    cx, cy = x + lag * u, y + lag * v
    if not memory.stands[i]:
        memory.stands[i], lands_at[i] = True, np.inf
        dx, dy = limited(cx - x, cy - y, params.step)  # the last step of a pedestrian that walked, or fell
        feet[i, 0], feet[i, 1], feet[i, 2], feet[i, 3] = x, y, x + dx, y + dy
    if lands_at[i] <= time:
        dx, dy = limited(cx - feet[i, 0], cy - feet[i, 1], params.step)
        feet[i, 2], feet[i, 3], lands_at[i] = feet[i, 0] + dx, feet[i, 1] + dy, np.inf
    if time < lands_at[i] - params.swing:  # both feet are on the ground
        ox, oy = _beyond(cx, cy, i, 2, feet)
        if ox * ox + oy * oy <= params.base * params.base:
            lands_at[i] = np.inf
        elif lands_at[i] == np.inf:
            lands_at[i] = time + params.reaction + params.swing
            _carry_on_nearer(cx, cy, i, feet)
    in_air = time >= lands_at[i] - params.swing
    other = 0 if in_air else 2  # the foot up to which the support reaches, from the first
    qx, qy = 0.5 * (feet[i, 0] + feet[i, other]), 0.5 * (feet[i, 1] + feet[i, other + 1])
    px, py = qx + (1.0 + params.gain) * (cx - qx), qy + (1.0 + params.gain) * (cy - qy)
    ox, oy = _beyond(px, py, i, other, feet)
    sx, sy = limited(ox, oy, params.base)
    ax, ay = limited(x - (px - ox + sx), y - (py - oy + sy), params.grip * params.height)
    rate = batch.bodies.relaxation_time[i] / (lag * lag)
    return u + rate * ax, v + rate * ay


@inner_kernel
def add_forces_of_arms(e: int, batch: Batch, dt: float, params: Balance) -> None:
    """Add the forces [N] of the arms between standing people of environment ``e`` to `History.force`.

    The neighbor list must be complete up to ``params.arms``.  A step brings the closing speed w of a pair alone exactly to
    w / (1 + w dt / l), so it never turns it around.  In the densest packing all pairs together do not while w dt < 2 l.
    """
    near, force, stands = batch.workspace.neighbors, batch.history.force, batch.history.memory.balance.stands
    owner, partner, contact_distance, mass = near.owner, near.partner, near.contact_distance, batch.bodies.mass
    position, velocity, present = batch.state.position, batch.state.velocity, batch.state.present
    for entry in range(index(near.entry_start[e]), index(near.pair_end[e])):
        i, j = owner[entry], partner[entry]
        dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
        square, reach = dx * dx + dy * dy, contact_distance[entry] + params.arms
        if square < reach * reach and present[i] and present[j] and stands[i] and stands[j]:
            approach = dx * (velocity[j, 0] - velocity[i, 0]) + dy * (velocity[j, 1] - velocity[i, 1])
            if approach > 0.0:
                distance = np.sqrt(square)
                speed = approach / distance
                reduced = mass[i] * mass[j] / (mass[i] + mass[j])
                size = reduced * speed * speed / ((params.give + speed * dt) * distance)
                force[i, 0] += size * dx
                force[i, 1] += size * dy
                force[j, 0] -= size * dx
                force[j, 1] -= size * dy


@inner_kernel
def _beyond(x: float, y: float, i: int, other: int, feet: Floats) -> tuple[float, float]:
    """Return the vector [m] to a point from the nearest one on the line from the first foot to the ``other``."""
    dx, dy = x - feet[i, 0], y - feet[i, 1]
    lx, ly = feet[i, other] - feet[i, 0], feet[i, other + 1] - feet[i, 1]
    square = lx * lx + ly * ly
    part = min(max((dx * lx + dy * ly) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return dx - part * lx, dy - part * ly


@inner_kernel
def _carry_on_nearer(x: float, y: float, i: int, feet: Floats) -> None:
    """Make the foot nearer to a point the first, which carries while the second is in the air."""
    ax, ay, bx, by = feet[i, 0], feet[i, 1], feet[i, 2], feet[i, 3]
    if (x - bx) ** 2 + (y - by) ** 2 < (x - ax) ** 2 + (y - ay) ** 2:
        feet[i, 0], feet[i, 1], feet[i, 2], feet[i, 3] = bx, by, ax, ay
