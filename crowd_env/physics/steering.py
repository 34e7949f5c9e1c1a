"""Steering: the route that each pedestrian follows, the direction along it, and the local desired speed."""

from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.kernels.fetch import fetch
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.surface import ground_of, speed_at
from crowd_env.physics.driving_force import Influences, asked_of
from crowd_env.physics.walking.decide import decide
from crowd_env.physics.workspace import LOOKUP_PERIOD, Batch
from crowd_env.routing.fields.lookup import BLEND, blended_direction, exit_frame, quick_cell, through_exit, way_at
from crowd_env.routing.rules import apply_rules, notice_regions

# Directions are looked up again after this time: at every step of 0.01 s, at every tenth of 0.001 s.  A look-up costs as much
# as two contacts, and no pedestrian moves 2 cm in between.
LOOK_EVERY = 0.01  # s
# The table of directions of a crowd of this size does not fit into the caches, and the look-up is most of a step.  Where all
# directions of a cell agree to 1/20 (3 degrees) a pedestrian takes every fourth look-up only: in 0.04 s no pedestrian gets
# further beyond the cell than its width.
_MANY = 1000
_UNIFORM = 0.05
_AT_SPOT = 0.1  # m, from the spot at which a pedestrian waits
_SLOW_DOWN = 0.5  # s, the way to the spot at the speed that is allowed there
_AHEAD = 8  # people: the table entry of the one this many ranks ahead, most likely in the same field, is prefetched


@inner_kernel
def reset_routes(e: int, batch: Batch, regions: bool | None) -> None:
    """Without regions, give all people their own desired speed and route for the whole call."""
    if regions is not None and has_regions(e, batch):
        return
    desired_speed, route = batch.bodies.desired_speed, batch.state.route
    speed, followed = batch.history.local_speed, batch.history.followed
    changed = False
    for i in range(index(batch.bodies.env_start[e]), index(batch.bodies.env_start[e + 1])):
        speed[i] = desired_speed[i]
        changed |= followed[i] != route[i]
        followed[i] = route[i]
    if changed:
        batch.history.directions_known[e] = False


@inner_kernel
def steer(e: int, rank_stop: int, batch: Batch, dt: float, acting: Influences) -> None:
    """Bring rules, routes, directions and walking velocities of environment ``e`` up to date if they are due."""
    _steer(e, rank_stop, batch, dt, acting.regions, acting.walking)


@inner_kernel
def _steer(e: int, rank_stop: int, batch: Batch, dt: float, regions: bool | None, walking: bool | None) -> None:
    if is_look_up_due(e, batch, dt):
        if regions is not None:
            follow_rules(e, batch)
        update_steering(e, batch.bodies.env_start[e], rank_stop, batch, dt, begin_look_up(e, batch, regions))
    if walking is not None and is_decision_due(e, batch, dt):
        decide(e, batch, batch.behaviors.manner)


@inner_kernel
def is_look_up_due(e: int, batch: Batch, dt: float) -> bool:
    """Whether this step of environment ``e`` looks up directions; a repeated step does not look again."""
    return not batch.history.directions_known[e] or batch.history.direction_age[e] > max(LOOK_EVERY - 0.5 * dt, 0.0)


@inner_kernel
def is_decision_due(e: int, batch: Batch, dt: float) -> bool:
    """Whether people decide in this step how to walk; a decision is recorded, so a repeated step makes no other."""
    history, interval = batch.history, batch.behaviors.manner.interval
    if history.have_decided[e] and history.decision_age[e] <= max(interval - 0.5 * dt, 0.0):
        return False
    history.have_decided[e], history.decision_age[e] = True, 0.0
    return True


@inner_kernel
def has_regions(e: int, batch: Batch) -> bool:
    """Whether desired speeds change from place to place: there are regions, and so perhaps rules, or slopes."""
    g, surface = batch.world.geometry_of_env[e], batch.world.surface
    slopes = surface.slope_start[surface.sheet_start[g + 1]] > surface.slope_start[surface.sheet_start[g]]
    return slopes or batch.world.guidance.region.shape[g, 1] > 0


@inner_kernel
def follow_rules(e: int, batch: Batch) -> None:
    """Bring local speeds and followed routes up to date where there are regions."""
    if not has_regions(e, batch):
        return
    world, history, g = batch.world, batch.history, batch.world.geometry_of_env[e]
    notice_regions(e, g, world.guidance.region, world.surface, batch.bodies, batch.state, history)
    apply_rules(e, g, world.field, world.guidance, batch.bodies, batch.state, history)


@inner_kernel
def begin_look_up(e: int, batch: Batch, regions: bool | None) -> int:
    """Count a look-up; returns the turn of pedestrians in a uniform field, -1 = all look."""
    history, many = batch.history, batch.bodies.env_start[e + 1] - batch.bodies.env_start[e] >= _MANY
    if regions is not None and has_regions(e, batch):
        many = False  # rules send people elsewhere at any time
    everyone = not (many and history.directions_known[e])
    history.turn[e] = (history.turn[e] + 1) % LOOKUP_PERIOD
    history.directions_known[e], history.direction_age[e] = True, 0.0
    return -1 if everyone else history.turn[e]


@inner_kernel
def update_steering(e: int, rank_start: int, rank_stop: int, batch: Batch, dt: float, turn: int) -> None:
    """Look up the direction of the people with the ranks ``rank_start:rank_stop`` in `Workspace.inside`.

    It is written if the command is relative to it, and for all people if it is valid for more than one step.  A pedestrian in
    a uniform field is skipped except at its turn.
    """
    field, boundary, field_of_route = batch.world.field, batch.world.boundary, batch.world.guidance.field_of_route
    cell, table, exit_line, position = field.cell, field.direction, boundary.aim, batch.state.position
    radius, is_uniform, looking = batch.bodies.radius, batch.history.is_uniform, batch.workspace.looking
    followed, direction = batch.history.followed, batch.history.direction
    looking_stop = _list_looking(rank_start, rank_stop, batch, dt < LOOK_EVERY, turn)
    f, rows, cols, start, keep, left, bottom, size = -1, 0, 0, 0, np.nan, 0.0, 0.0, 1.0
    aim, frame = -1, (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    sheet, surface, g = batch.state.sheet, batch.world.surface, batch.world.geometry_of_env[e]
    ground = ground_of(surface, g, 0)
    for k in range(index(rank_start), looking_stop):
        i = looking[k]
        if turn >= 0 and cols > 0 and k + index(_AHEAD) < looking_stop:
            j = looking[k + index(_AHEAD)]
            node, _, _ = quick_cell(start, rows, cols, left, bottom, size, position[j, 0], position[j, 1])
            fetch(cell, node)
            fetch(table, 2 * node)
            fetch(table, 2 * (node + cols))
        mine = field_of_route[e, followed[i]] + sheet[i]
        if mine != f:
            f, ground = mine, ground_of(surface, g, sheet[i])
            rows, cols, keep = field.shape[f, 0], field.shape[f, 1], field.margin[f]
            start, left, bottom, size = field.node_start[f], field.origin[f, 0], field.origin[f, 1], field.spacing[f]
        plain, ex, ey = False, np.nan, np.nan
        is_uniform[i] = False
        if cols > 0:
            x, y, r = position[i, 0], position[i, 1], radius[i]
            node, u, v = quick_cell(start, rows, cols, left, bottom, size, x, y)
            kind = cell[node]
            if kind >= 0:
                if kind != aim:  # most aim at the same exit as the last pedestrian
                    aim = kind
                    frame = exit_frame(exit_line, kind)
                plain = True
                ex, ey = through_exit(frame, x, y, r, keep if keep >= 0.0 else r)
            elif kind == BLEND:
                plain, ex, ey = blended_direction(table, node, cols, u, v)
                is_uniform[i] = _agree(table, node, cols)
        if not plain:  # in cells that a wall runs through
            ex, ey, _ = way_at(field, boundary, f, position[i, 0], position[i, 1], radius[i], ground)
        direction[i, 0], direction[i, 1] = ex, ey
    if len(batch.history.stay) > 0:
        _hold_at_spots(rank_start, rank_stop, batch)
    if surface.slope_start[surface.sheet_start[g + 1]] > surface.slope_start[surface.sheet_start[g]]:
        _slow_on_slopes(e, rank_start, rank_stop, batch)


@inner_kernel
def _slow_on_slopes(e: int, rank_start: int, rank_stop: int, batch: Batch) -> None:
    """Change the desired speed of people on stairs and ramps, by the direction in which they mean to walk."""
    surface, inside, local_speed = batch.world.surface, batch.workspace.inside, batch.history.local_speed
    first, position = surface.sheet_start[batch.world.geometry_of_env[e]], batch.state.position
    for rank in range(index(rank_start), index(rank_stop)):
        i = inside[rank]
        s = first + batch.state.sheet[i]
        if surface.slope_start[s + 1] > surface.slope_start[s]:
            ex, ey = asked_of(i, batch)
            size = np.sqrt(ex * ex + ey * ey)
            if size > 0.0:
                up, down = batch.bodies.upstairs[i], batch.bodies.downstairs[i]
                share, belt = speed_at(surface, s, position[i, 0], position[i, 1], ex / size, ey / size, up, down)
                local_speed[i] = max(local_speed[i] * share + belt, 0.0)


@inner_kernel
def _hold_at_spots(rank_start: int, rank_stop: int, batch: Batch) -> None:
    """Let people that wait walk to their spot, and stand there."""
    history, inside, position = batch.history, batch.workspace.inside, batch.state.position
    for rank in range(index(rank_start), index(rank_stop)):
        i = inside[rank]
        if history.waits[i]:
            dx, dy = history.spot[i, 0] - position[i, 0], history.spot[i, 1] - position[i, 1]
            far = np.sqrt(dx * dx + dy * dy)
            if far > _AT_SPOT:
                history.direction[i, 0], history.direction[i, 1] = dx / far, dy / far
                history.local_speed[i] = min(history.local_speed[i], far / _SLOW_DOWN)
            else:
                history.local_speed[i] = 0.0


@inner_kernel
def _list_looking(rank_start: int, rank_stop: int, batch: Batch, everyone: bool, turn: int) -> Any:
    """List the slots that look up the direction in `Workspace.looking`, without a branch; returns one past the last.

    These are all slots if ``everyone``, since a command may become relative before the next look-up, else the slots with a
    relative command.  A pedestrian in a uniform field is listed at its ``turn`` only; one that is out looks no more.
    """
    inside, looking, relative = batch.workspace.inside, batch.workspace.looking, batch.control.relative
    active = batch.state.active
    is_uniform, lookup_turn, k = batch.history.is_uniform, batch.history.lookup_turn, index(rank_start)
    for rank in range(index(rank_start), index(rank_stop)):
        i = inside[rank]
        follows = (relative[i] | everyone) & active[i]
        is_uniform[i] &= follows
        looking[k] = i
        k += index(follows & ((turn < 0) | (lookup_turn[i] == turn) | (not is_uniform[i])))
    return k


@inner_kernel
def _agree(direction: Floats, node: int, cols: int) -> bool:
    """Whether the directions at the corners of a cell nearly agree, along either diagonal."""
    above = node + cols
    ax, ay = direction[node, 0] - direction[above + 1, 0], direction[node, 1] - direction[above + 1, 1]
    bx, by = direction[node + 1, 0] - direction[above, 0], direction[node + 1, 1] - direction[above, 1]
    return max(ax * ax + ay * ay, bx * bx + by * by) < _UNIFORM * _UNIFORM
