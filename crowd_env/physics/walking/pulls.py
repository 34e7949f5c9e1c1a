"""How groups and attractions pull people off their way, see `crowd_env.core.behaviors.pulls`.

A pedestrian of desired velocity w, relaxation time tau, pull f and head angle alpha walks at the velocity

    v = (w + tau f) / (1 + tau beta_1 alpha)

at which the drive, (w - v) / tau, and all forces balance.  The drive towards it, m (v - u) / tau, is the sum of drive and
forces, with v in place of the momentary velocity u in the gaze.  Without a drive (`nsm1`) the velocity is v at once.  So a
force acts alike in every scheme, and a headway is kept along the pulled way.
"""

import numpy as np

from crowd_env.core.behaviors.pulls import ALONE
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.surface import ground_of
from crowd_env.geometry.wall_grid import is_in_sight
from crowd_env.physics.driving_force import asked_of
from crowd_env.physics.workspace import Batch
from crowd_env.routing.fields.lookup import travel_time_at

HURRY = 1.3  # times the desired speed: the largest speed under pulls
_SLOW = 0.25  # of the desired speed, along the way: a lower mean over the recent past counts as held back
_RECENT = 2.0  # s, of that mean: the time in which a moment's weight falls to 1/e
_GAZE, _COHESION, _REPULSION, _SPACING, _APART, _PATIENCE = 0, 1, 2, 3, 4, 5  # columns of `PullArrays.groups`
_X, _Y, _STRENGTH, _REACH, _LIFETIME, _SINCE = 0, 1, 2, 3, 4, 5  # columns of `PullArrays.attraction`


@inner_kernel
def pull_aside(e: int, batch: Batch) -> None:
    """Change the desired ways and speeds of environment ``e`` in `Workspace.walkers` by the pulls."""
    walkers, bodies, time, seen_at = (
        batch.workspace.walkers,
        batch.bodies,
        batch.state.time[e],
        batch.history.memory.pulls.seen_at,
    )
    passed, seen_at[e] = 1.0 - np.exp(-(time - seen_at[e]) / _RECENT), time
    gaze = batch.behaviors.pulls.groups[batch.world.geometry_of_env[e], _GAZE]
    _list_members(e, batch)
    for i in range(index(bodies.env_start[e]), index(bodies.env_start[e + 1])):
        if not batch.state.active[i] or time < bodies.response_time[i]:
            continue
        fx, fy = _attract(e, i, time, batch)
        gx, gy, angle, waits = _keep_together(e, i, time, passed, fx, fy, batch)
        if waits:
            walkers.way_x[i], walkers.way_y[i], walkers.speed[i] = 0.0, 0.0, 0.0
        elif gx != 0.0 or gy != 0.0 or angle != 0.0:
            x, y = pulled(i, gx, gy, gaze * angle, batch)
            size = np.sqrt(x * x + y * y)
            walkers.way_x[i] = x / size if size > 0.0 else 0.0
            walkers.way_y[i] = y / size if size > 0.0 else 0.0
            walkers.speed[i] = min(size, HURRY * batch.history.local_speed[i])


@inner_kernel
def pulled(i: int, fx: float, fy: float, slowing: float, batch: Batch) -> tuple[float, float]:
    """Return the velocity [m/s] at which the drive of ``i`` and the forces balance; ``slowing`` is beta_1 alpha [1/s]."""
    walkers, tau = batch.workspace.walkers, batch.bodies.relaxation_time[i]
    per, speed = 1.0 / (1.0 + tau * slowing), walkers.speed[i]
    return per * (speed * walkers.way_x[i] + tau * fx), per * (speed * walkers.way_y[i] + tau * fy)


@inner_kernel
def walk_at_full_speed(e: int, batch: Batch) -> None:
    """Write the walking velocities without a headway, changed by the pulls, into `History.walking_velocity`.

    A pedestrian that nothing can pull walks bit by bit as without this file.
    """
    walkers, walking, speed = batch.workspace.walkers, batch.history.walking_velocity, batch.history.local_speed
    g = batch.world.geometry_of_env[e]
    attracts = batch.behaviors.pulls.start[g + 1] > batch.behaviors.pulls.start[g]
    for i in range(index(batch.bodies.env_start[e]), index(batch.bodies.env_start[e + 1])):
        if attracts or batch.bodies.group[i] != ALONE:
            walking[i, 0] = walkers.speed[i] * walkers.way_x[i]
            walking[i, 1] = walkers.speed[i] * walkers.way_y[i]
        else:
            cx, cy = asked_of(i, batch)
            walking[i, 0], walking[i, 1] = speed[i] * cx, speed[i] * cy


@inner_kernel
def _list_members(e: int, batch: Batch) -> None:
    """Chain the active members of each group, and add up their positions [m] and their number."""
    walkers, group, position = batch.workspace.walkers, batch.bodies.group, batch.state.position
    first, following, sums, active = walkers.first, walkers.following, walkers.sums, batch.state.active
    slot_start, slot_stop = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    for i in range(index(slot_start), index(slot_stop)):
        first[i], sums[i, 0], sums[i, 1], sums[i, 2] = -1, 0.0, 0.0, 0.0
    for i in range(index(slot_start), index(slot_stop)):
        if active[i] and group[i] != ALONE:
            c = slot_start + group[i]
            following[i], first[c] = first[c], i
            sums[c, 0] += position[i, 0]
            sums[c, 1] += position[i, 1]
            sums[c, 2] += 1.0


@inner_kernel
def _attract(e: int, i: int, time: float, batch: Batch) -> tuple[float, float]:
    """Return the pull [m/s2] of the attractions that pedestrian ``i`` sees."""
    pulls, g, fx, fy = batch.behaviors.pulls, batch.world.geometry_of_env[e], 0.0, 0.0
    for k in range(index(pulls.start[g]), index(pulls.start[g + 1])):
        one = pulls.attraction[k]
        age = time - one[_SINCE]
        dx, dy = one[_X] - batch.state.position[i, 0], one[_Y] - batch.state.position[i, 1]
        if age >= 0.0 and _sees(e, i, dx, dy, batch):
            far = np.sqrt(dx * dx + dy * dy) / one[_REACH]
            size = one[_STRENGTH] * np.exp(0.5 * (1.0 - far * far) - age / one[_LIFETIME]) / one[_REACH]
            fx, fy = fx + size * dx, fy + size * dy
    return fx, fy


@inner_kernel
def _sees(e: int, i: int, dx: float, dy: float, batch: Batch) -> bool:
    """Whether no wall and no closed door stands between pedestrian ``i`` and a point (dx, dy) [m] from there."""
    g, x, y = batch.world.geometry_of_env[e], batch.state.position[i, 0], batch.state.position[i, 1]
    ground = ground_of(batch.world.surface, g, batch.state.sheet[i])
    return is_in_sight(batch.world.boundary, ground, batch.history.door_open[e], x, y, dx, dy)


@inner_kernel
def _keep_together(
    e: int, i: int, time: float, passed: float, fx: float, fy: float, batch: Batch
) -> tuple[float, float, float, bool]:
    """Add the forces of the group of pedestrian ``i`` to (fx, fy) [m/s2].

    ``passed`` is the weight of now in means over the recent past: the pull is a step, across which people shuffle, so
    one moment does not tell whether they are held back.

    Returns the sum, the angle of the head [rad], and whether ``i`` waits.
    """
    group, held_since, lost = (
        batch.bodies.group[i],
        batch.history.memory.pulls.held_since,
        batch.history.memory.pulls.lost,
    )
    walkers, position = batch.workspace.walkers, batch.state.position
    c = batch.bodies.env_start[e] + max(group, 0)
    members = walkers.sums[c, 2]
    if group == ALONE or members < 2.0:
        held_since[i], lost[i] = 0.0, 0.0
        return fx, fy, 0.0, False
    rule = batch.behaviors.pulls.groups[batch.world.geometry_of_env[e]]
    gx, gy = _repel(i, c, rule[_SPACING], rule[_REPULSION], batch)
    fx, fy, angle = fx + gx, fy + gy, 0.0
    dx, dy = walkers.sums[c, 0] / members - position[i, 0], walkers.sums[c, 1] / members - position[i, 1]
    distance = np.sqrt(dx * dx + dy * dy)
    way_x, way_y, speed = walkers.way_x[i], walkers.way_y[i], walkers.speed[i]
    ahead = -(dx * way_x + dy * way_y)  # m  of the center, and so of the center of the others
    if ahead > 0.0:
        angle = np.arcsin(min(ahead / distance, 1.0))
    cx, cy = 0.0, 0.0
    if distance > 0.5 * (members - 1.0) and rule[_COHESION] > 0.0 and _sees(e, i, dx, dy, batch):
        cx, cy = rule[_COHESION] * dx / distance, rule[_COHESION] * dy / distance
    waits = _is_ahead(e, i, c, rule[_APART], rule[_SPACING], batch)
    x, y = pulled(i, fx + cx, fy + cy, rule[_GAZE] * angle, batch)
    along = 1.0
    if waits:
        along = 0.0
    elif ahead > 0.0 and speed > 0.0:
        along = (x * way_x + y * way_y) / speed
    lost[i] += passed * (1.0 - along - lost[i])
    if not waits and lost[i] <= 1.0 - _SLOW:
        held_since[i] = 0.0
    elif held_since[i] == 0.0:
        held_since[i] = time
    if held_since[i] > 0.0 and time - held_since[i] >= rule[_PATIENCE]:
        return fx, fy, 0.0, False
    return fx + cx, fy + cy, angle, waits


@inner_kernel
def _repel(i: int, c: int, spacing: float, strength: float, batch: Batch) -> tuple[float, float]:
    """Return the repulsion [m/s2] by members too near to pedestrian ``i``."""
    position, walkers, fx, fy = batch.state.position, batch.workspace.walkers, 0.0, 0.0
    j = walkers.first[c]
    while j >= 0:
        dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        if 0.0 < distance < spacing:
            fx, fy = fx + strength * dx / distance, fy + strength * dy / distance
        j = walkers.following[j]
    return fx, fy


@inner_kernel
def _is_ahead(e: int, i: int, c: int, apart: float, spacing: float, batch: Batch) -> bool:
    """Whether a member on the same way is further back than pedestrian ``i``, and far away or out of sight."""
    position, walkers, followed = batch.state.position, batch.workspace.walkers, batch.history.followed
    x, y, radius, sheet = position[i, 0], position[i, 1], batch.bodies.radius[i], batch.state.sheet
    surface, g = batch.world.surface, batch.world.geometry_of_env[e]
    field, boundary, j, left = batch.world.field, batch.world.boundary, walkers.first[c], np.nan
    f = batch.world.guidance.field_of_route[e, followed[i]]
    while j >= 0:
        dx, dy = position[j, 0] - x, position[j, 1] - y
        if followed[j] == followed[i] and dx * dx + dy * dy > spacing * spacing:
            if left != left:
                left = travel_time_at(field, boundary, f + sheet[i], x, y, radius, ground_of(surface, g, sheet[i]))
            there, fj = ground_of(surface, g, sheet[j]), f + sheet[j]
            other = travel_time_at(field, boundary, fj, position[j, 0], position[j, 1], radius, there)
            if other > left + spacing and (dx * dx + dy * dy > apart * apart or not _sees(e, i, dx, dy, batch)):
                return True
        j = walkers.following[j]
    return False
