"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

import numpy as np

from crowd_env._jit import kernel
from crowd_env.geometry import Boundary
from crowd_env.guidance import apply_rules, notice_regions
from crowd_env.navigation import FieldArrays, direction_at, quick_direction
from crowd_env.physics.neighbors import NeighbourList
from crowd_env.physics.social import SocialLaw, add_social_forces
from crowd_env.physics.world import Control, Memory, World
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

# The way out is looked up anew after so long: at every step of 0.01 s, at every tenth of 0.001 s.  It costs as much as two
# contacts, and nobody gets 2 cm further in between.
_LOOK_EVERY = 0.01  # s


@kernel
def desired_velocities(
    e: int, world: World, bodies: Bodies, state: CrowdState, control: Control, memory: Memory, dt: float
) -> None:
    """Write the desired velocity [m/s] of everyone in environment ``e`` into ``Memory.desired`` (P, 2).

    A command is a multiple of the desired speed, which is one's own but for what a region says.  A relative one turns with
    the direction of the route one follows, looked up anew every 0.01 s: command (1, 0) is the rule "walk the way out".
    """
    if memory.way_age[e] > _LOOK_EVERY - 0.5 * dt:
        g = world.geometry_of_env[e]
        guidance, now = world.guidance, state.time[e]
        notice_regions(e, g, guidance.region, bodies, state, memory.here, memory.pace)
        apply_rules(
            e,
            g,
            now,
            world.field,
            guidance,
            bodies,
            state,
            memory.here,
            memory.followed,
            memory.rule_on,
            memory.rule_since,
        )
        # Who may be told to follow the way within the next 0.01 s needs it too.
        everyone = dt < _LOOK_EVERY
        look_for_the_way(
            e,
            world.field,
            world.boundary,
            guidance.field_of_route,
            bodies,
            state,
            control.relative,
            everyone,
            memory.followed,
            memory.way,
        )
        memory.way_age[e] = 0.0
    memory.way_age[e] += dt
    command, relative, way, pace, desired = control.command, control.relative, memory.way, memory.pace, memory.desired
    time = state.time[e]
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not state.active[i]:
            continue
        speed = pace[i] if time >= bodies.response_time[i] else 0.0
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = way[i, 0], way[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        desired[i, 0], desired[i, 1] = speed * cx, speed * cy


@kernel
def look_for_the_way(
    e: int,
    field: FieldArrays,
    boundary: Boundary,
    field_of_route: Ints,
    bodies: Bodies,
    state: CrowdState,
    relative: Bools,
    everyone: bool,
    followed: Ints,
    way: Floats,
) -> None:
    """Write the direction (P, 2) of the followed route of those whose command is relative to it, or of everyone."""
    cell, direction, exit_line = field.cell, field.direction, boundary.exit
    f, rows, cols, start, margin, left, bottom, spacing = -1, 0, 0, 0, np.nan, 0.0, 0.0, 1.0
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not (state.active[i] and (relative[i] or everyone)):
            continue
        mine = field_of_route[e, followed[i]]
        if mine != f:
            f = mine
            rows, cols, margin = field.shape[f, 0], field.shape[f, 1], field.margin[f]
            start, left, bottom, spacing = field.node_start[f], field.origin[f, 0], field.origin[f, 1], field.spacing[f]
        x, y, radius = state.position[i, 0], state.position[i, 1], bodies.radius[i]
        plain, ex, ey = False, 0.0, 0.0
        if cols > 0:
            plain, ex, ey = quick_direction(
                cell, direction, exit_line, start, rows, cols, left, bottom, spacing, margin, x, y, radius
            )
        if not plain:
            ex, ey = direction_at(field, boundary, f, x, y, radius)
        way[i, 0], way[i, 1] = ex, ey


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
    active, velocity, external = state.active, state.velocity, control.external_force
    mass, relaxation_time, driving = bodies.mass, bodies.relaxation_time, control.driving
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not active[i]:
            continue
        force[i, 0], force[i, 1] = external[i, 0], external[i, 1]
        if driving:
            rate = mass[i] / relaxation_time[i]
            force[i, 0] += rate * (desired[i, 0] - velocity[i, 0])
            force[i, 1] += rate * (desired[i, 1] - velocity[i, 1])
    if social.cutoff > 0.0:
        add_social_forces(e, g, boundary, bodies, state, near, desired, heading, force, social)
