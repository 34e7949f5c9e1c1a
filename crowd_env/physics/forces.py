"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import index, inner_kernel
from crowd_env.guidance import apply_rules, notice_regions
from crowd_env.navigation_lookup import (
    BLEND,
    blended_direction,
    direction_at,
    exit_frame,
    quick_cell,
    through_exit,
)
from crowd_env.physics.social import SocialLaw, add_social_forces
from crowd_env.physics.world import Batch
from crowd_env.state import Bools, Floats, Ints

# The way out is looked up anew after so long: at every step of 0.01 s, at every tenth of 0.001 s.  It costs as much as two
# contacts, and nobody gets 2 cm further in between.
LOOK_EVERY = 0.01  # s


@inner_kernel
def desired_velocities(e: int, batch: Batch, dt: float) -> None:
    """Write the desired velocity [m/s] of everyone in environment ``e`` into ``Memory.desired`` (P, 2).

    A command is a multiple of the desired speed, which is one's own but for what a region says.  A relative one turns with
    the direction of the route one follows, looked up anew every 0.01 s: command (1, 0) is the rule "walk the way out".
    """
    bodies, control, memory = batch.bodies, batch.control, batch.memory
    begin, end = bodies.env_start[e], bodies.env_start[e + 1]
    if memory.way_age[e] > LOOK_EVERY - 0.5 * dt:
        follow_rules(e, batch)
        look_around(e, begin, end, batch, dt)
        memory.way_age[e] = 0.0
    memory.way_age[e] += dt
    _want(
        begin,
        end,
        batch.state.time[e],
        control.command,
        control.relative,
        memory.way,
        memory.pace,
        bodies.response_time,
        memory.desired,
    )


@inner_kernel
def has_regions(e: int, batch: Batch) -> bool:
    """Whether there are regions, and so perhaps rules, in environment ``e``."""
    return bool(batch.world.guidance.region.shape[batch.world.geometry_of_env[e], 1] > 0)


@inner_kernel
def follow_rules(e: int, batch: Batch) -> None:
    """Bring pace and followed route up to date where there are regions."""
    world, memory = batch.world, batch.memory
    if not has_regions(e, batch):
        return
    g = world.geometry_of_env[e]
    notice_regions(e, g, world.guidance.region, batch.bodies, batch.state, memory.here, memory.pace)
    apply_rules(
        e,
        g,
        world.field,
        world.guidance,
        batch.bodies,
        batch.state,
        memory.here,
        memory.followed,
        memory.rule_on,
        memory.rule_since,
    )


@inner_kernel
def look_around(e: int, begin: int, end: int, batch: Batch, dt: float) -> None:
    """Bring the way of the people ``begin:end`` up to date."""
    field, guidance, boundary = batch.world.field, batch.world.guidance, batch.world.boundary
    bodies, state, memory = batch.bodies, batch.state, batch.memory
    if not has_regions(e, batch):
        _walk_freely(begin, end, bodies.desired_speed, state.route, memory.pace, memory.followed)
    everyone = dt < LOOK_EVERY  # who may be told to follow the way before it is looked up again needs it too
    hard = look_for_the_way(
        e,
        begin,
        end,
        field.cell,
        field.direction,
        boundary.exit,
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
        batch.control.relative,
        everyone,
        memory.way,
    )
    if hard > 0:
        _look_harder(e, begin, end, batch)


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
def _look_harder(e: int, begin: int, end: int, batch: Batch) -> None:
    """Find the way of those for whom it is not plain: in cells that a wall runs through."""
    field, boundary, field_of_route = batch.world.field, batch.world.boundary, batch.world.guidance.field_of_route
    position, radius, active = batch.state.position, batch.bodies.radius, batch.state.active
    followed, way = batch.memory.followed, batch.memory.way
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


@inner_kernel
def regular_forces(e: int, batch: Batch, social: SocialLaw) -> None:
    """Write the sum of all forces but contact [N] into ``Memory.force`` (P, 2): external, driving and social.

    With a social force the neighbour list must be complete up to its cut-off.
    """
    world, bodies, state, memory = batch.world, batch.bodies, batch.state, batch.memory
    _drive(
        bodies.env_start[e],
        bodies.env_start[e + 1],
        state.active,
        state.velocity,
        batch.control.external_force,
        bodies.mass,
        bodies.relaxation_time,
        memory.desired,
        batch.control.driving,
        memory.force,
    )
    if social.cutoff > 0.0:
        g, desired = world.geometry_of_env[e], memory.desired
        add_social_forces(
            e, g, world.boundary, bodies, state, memory.near, desired, memory.heading, memory.force, social
        )


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
