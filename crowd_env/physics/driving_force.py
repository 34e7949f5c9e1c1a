"""Regular forces: the desired velocity, the driving force towards it, the social force and that of arms.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau, as printed without a
limit.  With a limit F it keeps its direction and is no larger than F: f_a min(1, F / |f_a|).
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.core.kernels.struct_ref import StructRef
from crowd_env.physics.balance import add_forces_of_arms, stand
from crowd_env.physics.bounds import limited
from crowd_env.physics.social_force import SocialForce, SocialParams, add_social_forces
from crowd_env.physics.workspace import Batch


class Influences(NamedTuple):
    """All influences besides contact, as kernels take them; the code of a None is not compiled."""

    social: SocialParams | None  # passive grains feel none
    reach: float  # m    of the social force and of arms; 0 without both
    regions: bool | None  # there are regions, and so perhaps rules
    walking: bool | None  # people decide how to walk: a headway or pulls act
    max_drive: float | None  # N    largest driving force of a pedestrian
    balance: bool | None  # standing pedestrians lean over their feet, and have arms
    outline: bool | None  # bodies are of several discs
    desire: Any  # kernel of behaviors that change the desired velocity; see `Behavior.desire`


def influences(social: SocialForce | None, batch: StructRef, desire: Any = None) -> Influences:
    """Return the influences on a batch; on passive grains the outline alone can act."""
    acts, driving = batch.fields.acts.fields, bool(batch.fields.control.driving)
    params = social.params() if social is not None and driving else None
    arms = batch.fields.behaviors.balance.arms if driving and acts.balance else 0.0
    return Influences(
        social=params,
        reach=arms if params is None else max(arms, params.cutoff),
        regions=bool(batch.fields.world.guidance.region.shape.any() or len(batch.fields.world.surface.plane)) or None,
        walking=(driving and (acts.manner or acts.pulls)) or None,
        max_drive=batch.fields.behaviors.max_drive if driving and acts.max_drive else None,
        balance=(driving and acts.balance) or None,
        outline=acts.outline or None,
        desire=desire if driving else None,
    )


def desire_of(others: Iterable[Behavior]) -> Any:
    """Return the kernel in which behaviors change the desired velocity one after the other; None if none does."""
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
def regular_forces(e: int, rank_stop: int, batch: Batch, dt: float, acting: Influences) -> None:
    """Write the sum of all forces but contact [N] into ``History.force`` (P, 2): external, driving and social.

    The desired velocity [m/s] goes into ``Workspace.desired_velocity`` (P, 2).  Both are written for the people in
    ``Workspace.inside`` up to ``rank_stop``.  A command is a multiple of the pedestrian's desired speed, or of that of a
    region.  A relative command turns with the direction of the followed route (`steering.steer`): command (1, 0) is the rule
    "walk the way out".  The neighbor list must be complete up to ``acting.reach``.
    """
    _drive(e, rank_stop, batch, acting, acting.max_drive)
    add_forces_at_distance(e, rank_stop, batch, dt, acting)


@inner_kernel
def add_forces_at_distance(e: int, rank_stop: int, batch: Batch, dt: float, acting: Influences) -> None:
    """Add the forces [N] between people that need not touch to `History.force`: social forces and forces of arms."""
    _repel(e, rank_stop, batch, acting.social)
    _brace(e, batch, dt, acting.balance)


@inner_kernel
def _repel(e: int, rank_stop: int, batch: Batch, social: SocialParams | None) -> None:
    if social is not None:
        add_social_forces(e, rank_stop, batch, social)


@inner_kernel
def _brace(e: int, batch: Batch, dt: float, balance: bool | None) -> None:
    if balance is not None:
        add_forces_of_arms(e, batch, dt, batch.behaviors.balance)


@inner_kernel
def asked_of(i: int, batch: Batch) -> tuple[float, float]:
    """Return the command of pedestrian ``i``, turned with the direction of the route if it is relative.

    One that is out walks straight on, whatever the command.
    """
    command, direction = batch.control.command, batch.history.direction
    if not batch.state.active[i]:
        return direction[i, 0], direction[i, 1]
    cx, cy = command[i, 0], command[i, 1]
    if batch.control.relative[i]:
        ex, ey = direction[i, 0], direction[i, 1]
        cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
    return cx, cy


@inner_kernel
def has_set_out(i: int, time: float, batch: Batch) -> bool:
    """Whether pedestrian ``i`` walks: it has responded, or was pushed out before."""
    return time >= batch.bodies.response_time[i] or not batch.state.active[i]


@inner_kernel
def desired_velocity(i: int, time: float, batch: Batch, acting: Influences) -> tuple[float, float]:
    """Return the desired velocity [m/s]: the command, turned with the direction if it is relative, times the desired speed.

    Where people decide how to walk, it is the velocity of the last decision; behaviors with a `Behavior.desire` change it.
    For standing pedestrians with balance it turns the drive into the ground force: see `crowd_env.physics.balance`.
    """
    vx, vy = _wanted_velocity(i, time, batch, acting.walking)
    vx, vy = _changed(i, time, vx, vy, batch, acting.desire)
    return _upright(i, time, vx, vy, batch, acting.balance)


@inner_kernel
def _wanted_velocity(i: int, time: float, batch: Batch, walking: bool | None) -> tuple[float, float]:
    if walking is not None:
        if has_set_out(i, time, batch):
            return batch.history.walking_velocity[i, 0], batch.history.walking_velocity[i, 1]
        return 0.0, 0.0
    speed = batch.history.local_speed[i] if has_set_out(i, time, batch) else 0.0
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
    """Evaluate the drive of pedestrian ``i`` at the velocity after a half kick by all forces, not before it.

    With v' = v + half (F + g) / m and g = m (v_d - v') / tau:  g = (m (v_d - v) - half F) / (tau + half), then limited.
    The force on a standing pedestrian with balance contains no drive and stays as it is.
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
