"""What a pedestrian wants: the desired velocity, the driving force that seeks it, and to keep a distance.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env._kernels.struct_ref import StructRef
from crowd_env.navigation.lookup import BLEND, blended_direction, exit_frame, quick_cell, through_exit, way_at
from crowd_env.physics.social_force import SocialForce, SocialLaw, add_social_forces
from crowd_env.physics.workspace import LOOKUP_PERIOD, Batch
from crowd_env.routing.rules import apply_rules, notice_regions
from crowd_env.state import Floats

# The way out is looked up anew after so long: at every step of 0.01 s, at every tenth of 0.001 s.  It costs as much as two
# contacts, and nobody gets 2 cm further in between.
LOOK_EVERY = 0.01  # s
# In a crowd of so many the table of ways does not fit into the caches, and to look is most of a step.  Where all ways of a cell
# agree to 1/20 (3 degrees) everybody looks only every fourth time: in 0.04 s nobody leaves his cell by more than its width.
_MANY = 1000
_STEADY = 0.05


def influences(social: SocialForce | None, batch: StructRef) -> tuple[SocialLaw | None, float, bool | None]:
    """Return what there is besides contact and drive, as kernels take it: None is not even compiled.

    The social force (passive grains feel none), how far it reaches [m], and whether there are regions, and so perhaps rules.
    """
    law = social.law() if social is not None and batch.fields.control.driving else None
    regions = bool(batch.fields.world.guidance.region.shape.any())
    return law, 0.0 if law is None else law.cutoff, regions or None


@inner_kernel
def regular_forces(e: int, last: int, batch: Batch, dt: float, social: SocialLaw | None, regions: bool | None) -> None:
    """Write the sum of all forces but contact [N] into ``History.force`` (P, 2): external, driving and social.

    It is written for those inside, whom ``Workspace.inside`` lists up to place ``last``; with it the desired velocity [m/s],
    into ``Workspace.desired_velocity`` (P, 2).  A command is a multiple of the desired speed, which is one's own but for what
    a region says.  A relative one turns with the direction of the route one follows, looked up anew every 0.01 s: command
    (1, 0) is the rule "walk the way out".  With a social force the neighbor list must be complete up to its cut-off.
    """
    begin, direction_age = batch.bodies.env_start[e], batch.history.direction_age
    if direction_age[e] > LOOK_EVERY - 0.5 * dt:
        if regions is not None:
            follow_rules(e, batch)
        update_steering(e, begin, last, batch, dt, choose_turn(e, batch, regions))
        direction_age[e] = 0.0
    direction_age[e] += dt
    _drive(begin, last, batch.state.time[e], batch)
    if social is not None:
        add_social_forces(e, last, batch, social)


@inner_kernel
def has_regions(e: int, batch: Batch) -> bool:
    """Whether there are regions, and so perhaps rules, in environment ``e``."""
    return bool(batch.world.guidance.region.shape[batch.world.geometry_of_env[e], 1] > 0)


@inner_kernel
def follow_rules(e: int, batch: Batch) -> None:
    """Bring pace and followed route up to date where there are regions."""
    if not has_regions(e, batch):
        return
    world, g = batch.world, batch.world.geometry_of_env[e]
    notice_regions(
        e, g, world.guidance.region, batch.bodies, batch.state, batch.history.region_bits, batch.history.local_speed
    )
    apply_rules(
        e,
        g,
        world.field,
        world.guidance,
        batch.bodies,
        batch.state,
        batch.history.region_bits,
        batch.history.followed,
        batch.history.rule_on,
        batch.history.rule_since,
    )


@inner_kernel
def reset_routes(e: int, batch: Batch, regions: bool | None) -> None:
    """Where there are no regions everyone walks at the own speed on the own route: for the whole of a call."""
    if regions is not None and has_regions(e, batch):
        return
    desired_speed, route = batch.bodies.desired_speed, batch.state.route
    pace, followed, direction_age = batch.history.local_speed, batch.history.followed, batch.history.direction_age
    changed = False
    for i in range(index(batch.bodies.env_start[e]), index(batch.bodies.env_start[e + 1])):
        pace[i] = desired_speed[i]
        changed |= followed[i] != route[i]
        followed[i] = route[i]
    if changed:
        direction_age[e] = np.inf


@inner_kernel
def choose_turn(e: int, batch: Batch, regions: bool | None) -> int:
    """Return whose turn it is to look, of those who need not look every time; -1 = everyone's."""
    turn, many = batch.history.turn, batch.bodies.env_start[e + 1] - batch.bodies.env_start[e] >= _MANY
    turn[e] = (turn[e] + 1) % LOOKUP_PERIOD
    if regions is not None and has_regions(e, batch):
        many = False  # rules send people elsewhere at any time
    return turn[e] if many and batch.history.direction_age[e] < np.inf else -1


@inner_kernel
def update_steering(e: int, first: int, last: int, batch: Batch, dt: float, turn: int) -> None:
    """Bring the way of the people in the places ``first:last`` of `Workspace.inside` up to date.

    It is written for those whose command is relative to it, and for everyone if it will be good for more than one step; but
    for those who are steady and whose turn it is not.
    """
    field, boundary, field_of_route = batch.world.field, batch.world.boundary, batch.world.guidance.field_of_route
    cell, direction, exit_line, position = field.cell, field.direction, boundary.exit, batch.state.position
    radius, relative, inside, followed = (
        batch.bodies.radius,
        batch.control.relative,
        batch.workspace.inside,
        batch.history.followed,
    )
    way, steady, shift = batch.history.direction, batch.history.is_uniform, batch.history.lookup_turn
    everyone = dt < LOOK_EVERY  # who may be told to follow the way before it is looked up again needs it too
    f, rows, cols, start, keep, left, bottom, size = -1, 0, 0, 0, np.nan, 0.0, 0.0, 1.0
    aim, ax, ay, ux, uy, width, nx, ny = -1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    for place in range(index(first), index(last)):
        i = inside[place]
        if not (relative[i] or everyone):
            steady[i] = False
            continue
        if turn >= 0 and steady[i] and shift[i] != turn:
            continue
        mine = field_of_route[e, followed[i]]
        if mine != f:
            f = mine
            rows, cols, keep = field.shape[f, 0], field.shape[f, 1], field.margin[f]
            start, left, bottom, size = field.node_start[f], field.origin[f, 0], field.origin[f, 1], field.spacing[f]
        plain, ex, ey = False, np.nan, np.nan
        steady[i] = False
        if cols > 0:
            x, y, r = position[i, 0], position[i, 1], radius[i]
            node, u, v = quick_cell(start, rows, cols, left, bottom, size, x, y)
            k = cell[node]
            if k >= 0:
                if k != aim:  # most aim at the same exit as the one before
                    aim = k
                    ax, ay, ux, uy, width, nx, ny = exit_frame(exit_line, k)
                plain = True
                ex, ey = through_exit(ax, ay, ux, uy, width, nx, ny, x, y, r, keep if keep >= 0.0 else r)
            elif k == BLEND:
                plain, ex, ey = blended_direction(direction, node, cols, u, v)
                steady[i] = _is_steady(direction, node, cols)
        if not plain:  # in cells that a wall runs through
            ex, ey, _ = way_at(field, boundary, f, position[i, 0], position[i, 1], radius[i])
        way[i, 0], way[i, 1] = ex, ey


@inner_kernel
def _is_steady(direction: Floats, node: int, cols: int) -> bool:
    """Whether the ways at the corners of a cell hardly differ, along either diagonal."""
    above = node + cols
    ax, ay = direction[node, 0] - direction[above + 1, 0], direction[node, 1] - direction[above + 1, 1]
    bx, by = direction[node + 1, 0] - direction[above, 0], direction[node + 1, 1] - direction[above, 1]
    return max(ax * ax + ay * ay, bx * bx + by * by) < _STEADY * _STEADY


@inner_kernel
def _drive(first: int, last: int, time: float, batch: Batch) -> None:
    """Write desired velocities, and external and driving forces."""
    bodies, control, driving = batch.bodies, batch.control, batch.control.driving
    command, relative, external, velocity = (
        control.command,
        control.relative,
        control.external_force,
        batch.state.velocity,
    )
    mass, relaxation_time, response_time = bodies.mass, bodies.relaxation_time, bodies.response_time
    inside, way, pace, desired, force = (
        batch.workspace.inside,
        batch.history.direction,
        batch.history.local_speed,
        batch.workspace.desired_velocity,
        batch.history.force,
    )
    for place in range(index(first), index(last)):
        i = inside[place]
        speed = pace[i] if time >= response_time[i] else 0.0
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = way[i, 0], way[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        wish_x, wish_y = speed * cx, speed * cy
        fx, fy = external[i, 0], external[i, 1]
        if driving:
            rate = mass[i] / relaxation_time[i]
            fx += rate * (wish_x - velocity[i, 0])
            fy += rate * (wish_y - velocity[i, 1])
        desired[i, 0], desired[i, 1] = wish_x, wish_y
        force[i, 0], force[i, 1] = fx, fy
