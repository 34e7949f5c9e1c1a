"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau, as printed however
large.  With a limit F it keeps its direction and is no larger than F: f_a min(1, F / |f_a|).
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.core.kernels.struct_ref import StructRef
from crowd_env.physics.balance import stand
from crowd_env.physics.bounds import limited
from crowd_env.physics.social_force import SocialForce, SocialParams, add_social_forces
from crowd_env.physics.workspace import Batch


class Influences(NamedTuple):
    """What acts besides contact, as kernels take it, all at once: None is not even compiled."""

    social: SocialParams | None  # passive grains feel none
    reach: float  # m    of the social force; 0 without one
    regions: bool | None  # there are regions, and so perhaps rules
    walking: bool | None  # people decide how to walk: they keep a headway, or are pulled off their way
    max_drive: float | None  # N    largest driving force of a person
    balance: bool | None  # those who stand lean over their feet
    outline: bool | None  # bodies are of several discs
    desire: Any  # kernel of behaviors that change what people want; see `Behavior.desire`


def influences(social: SocialForce | None, batch: StructRef, desire: Any = None) -> Influences:
    """Return what acts on a batch; only bodies have a shape where nobody is driven."""
    acts, driving = batch.fields.acts.fields, bool(batch.fields.control.driving)
    params = social.params() if social is not None and driving else None
    return Influences(
        social=params,
        reach=0.0 if params is None else params.cutoff,
        regions=bool(batch.fields.world.guidance.region.shape.any()) or None,
        walking=(driving and (acts.manner or acts.pulls)) or None,
        max_drive=batch.fields.behaviors.max_drive if driving and acts.max_drive else None,
        balance=(driving and acts.balance) or None,
        outline=acts.outline or None,
        desire=desire if driving else None,
    )


def desire_of(others: Iterable[Behavior]) -> Any:
    """Return the kernel in which some behaviors change one after the other what people want; None if none does."""
    chained = None
    for one in others:
        kernel = type(one).desire  # of the class: a kernel that is read from an object is bound to it
        chained = kernel if chained is None or kernel is None else _then(chained, kernel)
    return chained


def _then(first: Any, second: Any) -> Any:
    @inner_kernel
    def both(i: int, time: float, vx: float, vy: float, batch: Batch) -> tuple[float, float]:
        vx, vy = first(i, time, vx, vy, batch)
        return second(i, time, vx, vy, batch)

    return both


@inner_kernel
def regular_forces(e: int, rank_stop: int, batch: Batch, acting: Influences) -> None:
    """Write the sum of all forces but contact [N] into ``History.force`` (P, 2): external, driving and social.

    It is written for the people whom ``Workspace.inside`` lists up to ``rank_stop``; with it the desired velocity [m/s], into
    ``Workspace.desired_velocity`` (P, 2).  A command is a multiple of the desired speed, the own one unless a region says
    otherwise.  A relative command turns with the direction of the followed route (`steering.steer`): command (1, 0) is the
    rule "walk the way out".  With a social force the neighbor list must be complete up to its cut-off.
    """
    _drive(e, rank_stop, batch, acting, acting.max_drive)
    _repel(e, rank_stop, batch, acting.social)


@inner_kernel
def _repel(e: int, rank_stop: int, batch: Batch, social: SocialParams | None) -> None:
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
def desired_velocity(i: int, time: float, batch: Batch, acting: Influences) -> tuple[float, float]:
    """Return the desired velocity [m/s]: the command, turned with the direction if it is relative, times the desired speed.

    Where people decide how to walk, it is what they have last decided of that; behaviors with a `Behavior.desire` change it.
    Of people who stand and keep their balance it is the one whose drive is the force of the ground: see
    `crowd_env.physics.balance`.
    """
    vx, vy = _wanted_velocity(i, time, batch, acting.walking)
    vx, vy = _changed(i, time, vx, vy, batch, acting.desire)
    return _upright(i, time, vx, vy, batch, acting.balance)


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
def _changed(i: int, time: float, vx: float, vy: float, batch: Batch, desire: Any) -> tuple[float, float]:
    if desire is not None:
        return desire(i, time, vx, vy, batch)
    return vx, vy


@inner_kernel
def _upright(i: int, time: float, vx: float, vy: float, batch: Batch, balance: bool | None) -> tuple[float, float]:
    if balance is not None:
        if vx * vx + vy * vy <= batch.behaviors.balance.walks_from**2:
            return stand(i, time, batch, batch.behaviors.balance)
        batch.history.memory.balance.stands[i] = False
    return vx, vy


@inner_kernel
def _drive(e: int, rank_stop: int, batch: Batch, acting: Influences, max_drive: float | None) -> None:
    """Write desired velocities, and external and driving forces (eq 11)."""
    bodies, driving, external = batch.bodies, batch.control.driving, batch.control.external_force
    mass, relaxation_time = bodies.mass, bodies.relaxation_time
    velocity, time = batch.state.velocity, batch.state.time[e]
    inside, desired, force = batch.workspace.inside, batch.workspace.desired_velocity, batch.history.force
    for rank in range(index(bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        vx, vy = desired_velocity(i, time, batch, acting)
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


@inner_kernel
def drive_after_kick(i: int, batch: Batch, half: float, acting: Influences) -> None:
    """Let the drive of person ``i`` be that of the velocity after a half kick by all forces, not before it.

    With v' = v + half (F + g) / m and g = m (v_d - v') / tau:  g = (m (v_d - v) - half F) / (tau + half), limited as it is.
    Of people who stand and keep their balance no part of the force is a drive.
    """
    _follow_kick(i, batch, half, acting.max_drive, acting.balance)


@inner_kernel
def _follow_kick(i: int, batch: Batch, half: float, max_drive: float | None, balance: bool | None) -> None:
    if balance is not None and batch.history.memory.balance.stands[i]:
        return
    desired, velocity, force = batch.workspace.desired_velocity, batch.state.velocity, batch.history.force
    mass, tau, fx, fy = batch.bodies.mass[i], batch.bodies.relaxation_time[i], force[i, 0], force[i, 1]
    if max_drive is None:  # the same for all forces together
        force[i, 0], force[i, 1] = fx * (tau / (tau + half)), fy * (tau / (tau + half))
    else:
        px, py = mass * (desired[i, 0] - velocity[i, 0]), mass * (desired[i, 1] - velocity[i, 1])
        gx, gy = limited(px / tau, py / tau, max_drive)
        fx, fy = fx - gx, fy - gy  # all but the drive
        gx, gy = limited((px - half * fx) / (tau + half), (py - half * fy) / (tau + half), max_drive)
        force[i, 0], force[i, 1] = fx + gx, fy + gy
