"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau, as printed however
large.  With a limit F it keeps its direction and is no larger than F: f_a min(1, F / |f_a|).
"""

from typing import NamedTuple

import numpy as np

from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.core.kernels.struct_ref import StructRef
from crowd_env.physics.balance import stand
from crowd_env.physics.bounds import limited
from crowd_env.physics.social_force import SocialForce, SocialParams, add_social_forces
from crowd_env.physics.workspace import Batch


class Influences(NamedTuple):
    """What acts besides contact and drive, as kernels take it: None is not even compiled."""

    social: SocialParams | None  # passive grains feel none
    reach: float  # m    of the social force; 0 without one
    regions: bool | None  # there are regions, and so perhaps rules
    walking: bool | None  # people keep a headway, or are pulled off their way
    max_drive: float | None  # N    largest driving force of a person
    balance: bool | None  # those who stand lean over their feet
    outline: bool | None  # bodies are of several discs


def influences(social: SocialForce | None, batch: StructRef) -> Influences:
    """Return what acts on a batch besides contact and drive."""
    params = social.params() if social is not None and batch.fields.control.driving else None
    regions = bool(batch.fields.world.guidance.region.shape.any())
    control = batch.fields.control
    walking = bool((control.keeps_headway or control.pulled) and control.driving)
    limit = batch.fields.control.max_drive
    max_drive = limit if limit < np.inf and batch.fields.control.driving else None
    balance = bool(batch.fields.control.keeps_balance and batch.fields.control.driving)
    outline = bool(len(batch.fields.world.outline.radius))
    reach = 0.0 if params is None else params.cutoff
    return Influences(params, reach, regions or None, walking or None, max_drive, balance or None, outline or None)


@inner_kernel
def regular_forces(
    e: int,
    rank_stop: int,
    batch: Batch,
    social: SocialParams | None,
    walking: bool | None,
    max_drive: float | None,
    balance: bool | None = None,
) -> None:
    """Write the sum of all forces but contact [N] into ``History.force`` (P, 2): external, driving and social.

    It is written for the people whom ``Workspace.inside`` lists up to ``rank_stop``; with it the desired velocity [m/s], into
    ``Workspace.desired_velocity`` (P, 2).  A command is a multiple of the desired speed, the own one unless a region says
    otherwise.  A relative command turns with the direction of the followed route (`steering.steer`): command (1, 0) is the
    rule "walk the way out".  With a social force the neighbor list must be complete up to its cut-off.
    """
    _drive(e, rank_stop, batch, walking, max_drive, balance)
    if social is not None:
        add_social_forces(e, rank_stop, batch, social)


@inner_kernel
def asked_of(i: int, batch: Batch) -> tuple[float, float]:
    """Return the command, turned with the direction if it is relative: along the way that a person wants to take."""
    command, direction = batch.control.command, batch.history.direction
    cx, cy = command[i, 0], command[i, 1]
    if batch.control.relative[i]:
        ex, ey = direction[i, 0], direction[i, 1]
        cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
    return cx, cy


@inner_kernel
def desired_velocity(
    i: int, time: float, batch: Batch, walking: bool | None, balance: bool | None
) -> tuple[float, float]:
    """Return the desired velocity [m/s]: the command, turned with the direction if it is relative, times the desired speed.

    Where people keep a headway (``walking``), what they have last decided of that.  Where they keep their ``balance``, for
    those who want to stand, the one whose drive is the force of the ground (`crowd_env.physics.balance`).
    """
    vx, vy = _wanted_velocity(i, time, batch, walking)
    if balance is not None:
        if vx * vx + vy * vy <= batch.control.balance.walks_from**2:
            return stand(i, time, batch, batch.control.balance)
        batch.history.stands[i] = False
    return vx, vy


@inner_kernel
def _wanted_velocity(i: int, time: float, batch: Batch, walking: bool | None) -> tuple[float, float]:
    if walking is not None:
        if time >= batch.bodies.response_time[i]:
            return batch.history.walking_velocity[i, 0], batch.history.walking_velocity[i, 1]
        return 0.0, 0.0
    speed = batch.history.local_speed[i] if time >= batch.bodies.response_time[i] else 0.0
    cx, cy = asked_of(i, batch)
    return speed * cx, speed * cy


@inner_kernel
def _drive(
    e: int, rank_stop: int, batch: Batch, walking: bool | None, max_drive: float | None, balance: bool | None
) -> None:
    """Write desired velocities, and external and driving forces (eq 11)."""
    bodies, driving, external = batch.bodies, batch.control.driving, batch.control.external_force
    mass, relaxation_time = bodies.mass, bodies.relaxation_time
    velocity, time = batch.state.velocity, batch.state.time[e]
    inside, desired, force = batch.workspace.inside, batch.workspace.desired_velocity, batch.history.force
    for rank in range(index(bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        vx, vy = desired_velocity(i, time, batch, walking, balance)
        fx, fy = external[i, 0], external[i, 1]
        if driving:
            rate = mass[i] / relaxation_time[i]
            if max_drive is not None:
                gx, gy = limited(rate * (vx - velocity[i, 0]), rate * (vy - velocity[i, 1]), max_drive)
                fx += gx
                fy += gy
            else:
                fx += rate * (vx - velocity[i, 0])
                fy += rate * (vy - velocity[i, 1])
        desired[i, 0], desired[i, 1] = vx, vy
        force[i, 0], force[i, 1] = fx, fy
