"""Rotation of bodies of several discs: lever arms of contacts, and the torque that turns bodies into their way."""

import numpy as np

from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.driving_force import Influences, asked_of
from crowd_env.physics.steering import steer
from crowd_env.physics.step import find_neighbors
from crowd_env.physics.workspace import Batch


@inner_kernel
def lever(batch: Batch, i: int, disc: int, nx: float, ny: float) -> tuple[float, float, float]:
    """Return the radius of a disc of ``i``, and the offset of its center from the body's along (nx, ny) and left of it."""
    discs, k = batch.workspace.discs, index(i) * index(len(batch.behaviors.outline.radius)) + index(disc)
    x, y = discs.x[k], discs.y[k]
    return discs.radius[k], x * nx + y * ny, y * nx - x * ny


@inner_kernel
def begin_to_face(e: int, rank_stop: int, batch: Batch, dt: float, acting: Influences) -> bool:
    """Turn all pedestrians of environment ``e`` into their way, unless an angle has been set.

    False (with the reason in `status`) if the neighbor list does not fit, or positions have diverged.
    """
    if not find_neighbors(e, batch, acting.reach):
        return False
    steer(e, rank_stop, batch, dt, acting)
    if batch.control.driving:
        _face_ways(e, rank_stop, batch)
    return True


@inner_kernel
def _face_ways(e: int, rank_stop: int, batch: Batch) -> None:
    inside, angle = batch.workspace.inside, batch.state.angle
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        if angle[inside[rank]] != 0.0:
            return
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        wx, wy = asked_of(i, batch)
        if wx != 0.0 or wy != 0.0:
            angle[i] = np.arctan2(wy, wx)


@inner_kernel
def add_turning_torques(e: int, rank_stop: int, batch: Batch, half: float) -> None:
    """Add the torque [N m] that turns pedestrians into their way, critically damped; without a way it only damps.

    It damps the spin that all torques together leave after another ``half`` [s].
    """
    if not batch.control.driving:
        return
    inside, inertia, spin, torque = batch.workspace.inside, batch.bodies.inertia, batch.state.spin, batch.history.torque
    cosine, sine = batch.workspace.discs.cosine, batch.workspace.discs.sine
    rate, most = 1.0 / batch.behaviors.outline.turning_time, batch.behaviors.outline.max_torque
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        wx, wy = asked_of(i, batch)
        ahead, left = wx * cosine[i] + wy * sine[i], wy * cosine[i] - wx * sine[i]
        after = spin[i] + half * torque[i] / inertia[i]
        moment = inertia[i] * rate * (rate * np.arctan2(left, ahead) - 2.0 * after) / (1.0 + 2.0 * rate * half)
        torque[i] += min(max(moment, -most), most)
