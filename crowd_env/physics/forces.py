"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

from crowd_env._jit import kernel
from crowd_env.geometry import Boundary
from crowd_env.navigation import direction_at, quick_direction
from crowd_env.physics.neighbors import NeighbourList
from crowd_env.physics.social import SocialLaw, add_social_forces
from crowd_env.physics.world import Control, World
from crowd_env.state import Bodies, CrowdState, Floats


@kernel
def desired_velocities(
    e: int, world: World, bodies: Bodies, state: CrowdState, control: Control, desired: Floats
) -> None:
    """Write the desired velocity [m/s] of everyone in environment ``e`` into ``desired`` (P, 2).

    A command is a multiple of the own desired speed.  A relative one turns with the direction of the shortest path, which
    is looked up anew at every physics step: command (1, 0) is the rule "walk the shortest path".
    """
    g = world.geometry_of_env[e]
    field, boundary = world.field, world.boundary
    cell, direction, exit_line = field.cell, field.direction, boundary.exit
    rows, cols, margin = field.shape[g, 0], field.shape[g, 1], field.margin[g]
    start, left, bottom, spacing = field.node_start[g], field.origin[g, 0], field.origin[g, 1], field.spacing[g]
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not state.active[i]:
            continue
        speed = bodies.desired_speed[i]
        if state.time[e] < bodies.response_time[i]:
            speed = 0.0
        cx, cy = control.command[i, 0], control.command[i, 1]
        if control.relative[i]:
            x, y, radius = state.position[i, 0], state.position[i, 1], bodies.radius[i]
            plain, ex, ey = False, 0.0, 0.0
            if cols > 0:
                plain, ex, ey = quick_direction(
                    cell, direction, exit_line, start, rows, cols, left, bottom, spacing, margin, x, y, radius
                )
            if not plain:
                ex, ey = direction_at(field, boundary, g, x, y, radius)
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        desired[i, 0], desired[i, 1] = speed * cx, speed * cy


@kernel
def regular_forces(
    e: int,
    g: int,
    boundary: Boundary,
    bodies: Bodies,
    state: CrowdState,
    near: NeighbourList,
    control: Control,
    desired: Floats,
    heading: Floats,
    force: Floats,
    social: SocialLaw,
) -> None:
    """Write the sum of all forces but contact [N] into ``force`` (P, 2): external, driving and social.

    With a social force the neighbour list must be complete up to its cut-off.
    """
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not state.active[i]:
            continue
        force[i, 0], force[i, 1] = control.external_force[i, 0], control.external_force[i, 1]
        if control.driving:
            rate = bodies.mass[i] / bodies.relaxation_time[i]
            force[i, 0] += rate * (desired[i, 0] - state.velocity[i, 0])
            force[i, 1] += rate * (desired[i, 1] - state.velocity[i, 1])
    if social.cutoff > 0.0:
        add_social_forces(e, g, boundary, bodies, state, near, desired, heading, force, social)
