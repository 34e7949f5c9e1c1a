"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import index, inlined_kernel, inner_kernel
from crowd_env.geometry import Boundary
from crowd_env.guidance import apply_rules, notice_regions
from crowd_env.navigation_lookup import (
    BLEND,
    FieldArrays,
    blended_direction,
    direction_at,
    exit_frame,
    quick_cell,
    through_exit,
)
from crowd_env.physics.neighbor_list import NeighbourList
from crowd_env.physics.social import SocialLaw, add_social_forces
from crowd_env.physics.world import Control, Memory, World
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

# The way out is looked up anew after so long: at every step of 0.01 s, at every tenth of 0.001 s.  It costs as much as two
# contacts, and nobody gets 2 cm further in between.
LOOK_EVERY = 0.01  # s


@inlined_kernel
def desired_velocities(
    e: int, world: World, bodies: Bodies, state: CrowdState, control: Control, memory: Memory, dt: float
) -> None:
    """Write the desired velocity [m/s] of everyone in environment ``e`` into ``Memory.desired`` (P, 2).

    A command is a multiple of the desired speed, which is one's own but for what a region says.  A relative one turns with
    the direction of the route one follows, looked up anew every 0.01 s: command (1, 0) is the rule "walk the way out".
    """
    begin, end, g = bodies.env_start[e], bodies.env_start[e + 1], world.geometry_of_env[e]
    if memory.way_age[e] > LOOK_EVERY - 0.5 * dt:
        if world.guidance.region.shape[g, 1] > 0:
            follow_rules(e, g, world, bodies, state, memory)
        look_around(e, g, begin, end, world, bodies, state, memory, control.relative, dt)
        memory.way_age[e] = 0.0
    memory.way_age[e] += dt
    _want(
        begin,
        end,
        state.time[e],
        control.command,
        control.relative,
        memory.way,
        memory.pace,
        bodies.response_time,
        memory.desired,
    )


@inlined_kernel
def follow_rules(e: int, g: int, world: World, bodies: Bodies, state: CrowdState, memory: Memory) -> None:
    """Bring pace and followed route up to date where there are regions."""
    notice_regions(e, g, world.guidance.region, bodies, state, memory.here, memory.pace)
    apply_rules(
        e,
        g,
        state.time[e],
        world.field,
        world.guidance,
        bodies,
        state,
        memory.here,
        memory.followed,
        memory.rule_on,
        memory.rule_since,
    )


@inlined_kernel
def look_around(
    e: int,
    g: int,
    begin: int,
    end: int,
    world: World,
    bodies: Bodies,
    state: CrowdState,
    memory: Memory,
    relative: Bools,
    dt: float,
) -> None:
    """Bring the way of the people ``begin:end`` up to date."""
    field, guidance = world.field, world.guidance
    if guidance.region.shape[g, 1] == 0:
        _walk_freely(begin, end, bodies.desired_speed, state.route, memory.pace, memory.followed)
    everyone = dt < LOOK_EVERY  # who may be told to follow the way before it is looked up again needs it too
    hard = look_for_the_way(
        e,
        begin,
        end,
        field.cell,
        field.direction,
        world.boundary.exit,
        field.shape,
        field.node_start,
        field.origin,
        field.spacing,
        field.margin,
        guidance.field_of_route,
        memory.followed,
        state.position,
        bodies.radius,
        state.active,
        relative,
        everyone,
        memory.way,
    )
    if hard > 0:
        _look_harder(
            begin,
            end,
            e,
            field,
            world.boundary,
            guidance.field_of_route,
            memory.followed,
            state.position,
            bodies.radius,
            state.active,
            memory.way,
        )


@inner_kernel
def _walk_freely(begin: int, end: int, desired_speed: Floats, route: Ints, pace: Floats, followed: Ints) -> None:
    """Where there are neither regions nor rules everyone walks at the own speed on the own route."""
    for i in range(index(begin), index(end)):
        pace[i] = desired_speed[i]
        followed[i] = route[i]


@inner_kernel
def look_for_the_way(
    e: int,
    begin: int,
    end: int,
    cell: NDArray[np.int16],
    direction: Floats,
    exit_line: Floats,
    shape: Ints,
    node_start: Ints,
    origin: Floats,
    spacing: Floats,
    margin: Floats,
    field_of_route: Ints,
    followed: Ints,
    position: Floats,
    radius: Floats,
    active: Bools,
    relative: Bools,
    everyone: bool,
    way: Floats,
) -> int:
    """Write the direction (P, 2) of the followed route of those whose command is relative to it, or of everyone.

    Returns for how many it is not plain; theirs is nan.
    """
    f, rows, cols, start, keep, left, bottom, size, hard = -1, 0, 0, 0, np.nan, 0.0, 0.0, 1.0, 0
    aim, ax, ay, ux, uy, width, nx, ny = -1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    for i in range(index(begin), index(end)):
        if not (active[i] and (relative[i] or everyone)):
            continue
        mine = field_of_route[e, followed[i]]
        if mine != f:
            f = mine
            rows, cols, keep = shape[f, 0], shape[f, 1], margin[f]
            start, left, bottom, size = node_start[f], origin[f, 0], origin[f, 1], spacing[f]
        plain, ex, ey = False, np.nan, np.nan
        if cols > 0:
            x, y, r = position[i, 0], position[i, 1], radius[i]
            first, u, v = quick_cell(start, rows, cols, left, bottom, size, x, y)
            k = cell[first]
            if k >= 0:
                if k != aim:  # most aim at the same exit as the one before
                    aim = k
                    ax, ay, ux, uy, width, nx, ny = exit_frame(exit_line, k)
                plain = True
                ex, ey = through_exit(ax, ay, ux, uy, width, nx, ny, x, y, r, keep if keep >= 0.0 else r)
            elif k == BLEND:
                plain, ex, ey = blended_direction(direction, first, cols, u, v)
        if plain:
            way[i, 0], way[i, 1] = ex, ey
        else:
            way[i, 0] = np.nan
            hard += 1
    return hard


@inner_kernel
def _look_harder(
    begin: int,
    end: int,
    e: int,
    field: FieldArrays,
    boundary: Boundary,
    field_of_route: Ints,
    followed: Ints,
    position: Floats,
    radius: Floats,
    active: Bools,
    way: Floats,
) -> None:
    """Find the way of those for whom it is not plain: in cells that a wall runs through."""
    for i in range(index(begin), index(end)):
        if active[i] and np.isnan(way[i, 0]):
            f = field_of_route[e, followed[i]]
            way[i, 0], way[i, 1] = direction_at(field, boundary, f, position[i, 0], position[i, 1], radius[i])


@inner_kernel
def _want(
    begin: int,
    end: int,
    time: float,
    command: Floats,
    relative: Bools,
    way: Floats,
    pace: Floats,
    response_time: Floats,
    desired: Floats,
) -> None:
    for i in range(index(begin), index(end)):
        speed = pace[i] if time >= response_time[i] else 0.0
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = way[i, 0], way[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        desired[i, 0], desired[i, 1] = speed * cx, speed * cy


@inlined_kernel
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
    _drive(
        bodies.env_start[e],
        bodies.env_start[e + 1],
        state.active,
        state.velocity,
        control.external_force,
        bodies.mass,
        bodies.relaxation_time,
        desired,
        control.driving,
        force,
    )
    if social.cutoff > 0.0:
        add_social_forces(e, g, boundary, bodies, state, near, desired, heading, force, social)


@inner_kernel
def _drive(
    begin: int,
    end: int,
    active: Bools,
    velocity: Floats,
    external: Floats,
    mass: Floats,
    relaxation_time: Floats,
    desired: Floats,
    driving: bool,
    force: Floats,
) -> None:
    """Write external and driving force."""
    for i in range(index(begin), index(end)):
        if not active[i]:
            continue
        force[i, 0], force[i, 1] = external[i, 0], external[i, 1]
        if driving:
            rate = mass[i] / relaxation_time[i]
            force[i, 0] += rate * (desired[i, 0] - velocity[i, 0])
            force[i, 1] += rate * (desired[i, 1] - velocity[i, 1])
