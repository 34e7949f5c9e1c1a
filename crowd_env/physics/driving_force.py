"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env._kernels.struct_ref import StructRef
from crowd_env.physics.social_force import SocialForce, SocialParams, add_social_forces
from crowd_env.physics.workspace import Batch


def influences(social: SocialForce | None, batch: StructRef) -> tuple[SocialParams | None, float, bool | None]:
    """Return what acts besides contact and drive, as kernels take it: None is not even compiled.

    The social force (passive grains feel none), how far it reaches [m], and whether there are regions, and so perhaps rules.
    """
    params = social.params() if social is not None and batch.fields.control.driving else None
    regions = bool(batch.fields.world.guidance.region.shape.any())
    return params, 0.0 if params is None else params.cutoff, regions or None


@inner_kernel
def regular_forces(e: int, rank_stop: int, batch: Batch, social: SocialParams | None) -> None:
    """Write the sum of all forces but contact [N] into ``History.force`` (P, 2): external, driving and social.

    It is written for the people whom ``Workspace.inside`` lists up to ``rank_stop``; with it the desired velocity [m/s], into
    ``Workspace.desired_velocity`` (P, 2).  A command is a multiple of the desired speed, the own one unless a region says
    otherwise.  A relative command turns with the direction of the followed route (`steering.steer`): command (1, 0) is the
    rule "walk the way out".  With a social force the neighbor list must be complete up to its cut-off.
    """
    _drive(e, rank_stop, batch)
    if social is not None:
        add_social_forces(e, rank_stop, batch, social)


@inner_kernel
def _drive(e: int, rank_stop: int, batch: Batch) -> None:
    """Write desired velocities, and external and driving forces (eq 11)."""
    control, bodies, history, driving = batch.control, batch.bodies, batch.history, batch.control.driving
    command, relative, external = control.command, control.relative, control.external_force
    mass, relaxation_time, response_time = bodies.mass, bodies.relaxation_time, bodies.response_time
    direction, local_speed, velocity, time = (
        history.direction,
        history.local_speed,
        batch.state.velocity,
        batch.state.time[e],
    )
    inside, desired, force = batch.workspace.inside, batch.workspace.desired_velocity, history.force
    for rank in range(index(bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        speed = local_speed[i] if time >= response_time[i] else 0.0
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = direction[i, 0], direction[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        vx, vy = speed * cx, speed * cy
        fx, fy = external[i, 0], external[i, 1]
        if driving:
            rate = mass[i] / relaxation_time[i]
            fx += rate * (vx - velocity[i, 0])
            fy += rate * (vy - velocity[i, 1])
        desired[i, 0], desired[i, 1] = vx, vy
        force[i, 0], force[i, 1] = fx, fy
