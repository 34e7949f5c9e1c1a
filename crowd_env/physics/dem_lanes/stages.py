"""What a step of the soft scheme does besides pushing and walking: people in and out of the lanes, the list, the exits."""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.physics.dem_lanes.contact import COUNT, DEEPEST, FASTEST, OUTSIDE, STRAYS, SUM
from crowd_env.physics.dem_lanes.lanes import park, show_positions
from crowd_env.physics.dem_lanes.partition import SLABS, first_entry, slab_start
from crowd_env.physics.exits import leave_lanes_anywhere, leave_lanes_by_list, take_out_of_lanes
from crowd_env.physics.neighbors.update import OK, TOO_FAST
from crowd_env.physics.steering import reset_routes
from crowd_env.physics.step import list_active
from crowd_env.physics.workspace import Batch
from crowd_env.state import Bools, Floats


@inner_kernel
def begin_call(e: int, slabs: int, batch: Batch, regions: bool | None) -> None:
    """Copy everyone into the lanes; whether the list still holds is to be seen."""
    bodies, state, driving = batch.bodies, batch.state, batch.control.driving
    mass, relaxation_time, response_time = bodies.mass, bodies.relaxation_time, bodies.response_time
    position, velocity, active, external = state.position, state.velocity, state.active, batch.control.external_force
    push, crush, lanes, near, cut = (
        batch.results.impulse,
        batch.results.impulse_magnitude,
        batch.workspace.lanes,
        batch.workspace.neighbors,
        batch.workspace.cut,
    )
    x, y, vx, vy, gx, gy = lanes.x, lanes.y, lanes.vx, lanes.vy, lanes.gx, lanes.gy
    fx, fy, squeeze, per_mass, per_tau = lanes.fx, lanes.fy, lanes.squeeze, lanes.per_mass, lanes.per_tau
    push_x, push_y, crushed = lanes.push_x, lanes.push_y, lanes.crush
    pressed, latest, radius, smallest = False, 0.0, bodies.radius, np.inf
    for i in range(index(bodies.env_start[e]), index(bodies.env_start[e + 1])):
        fx[i] = fy[i] = squeeze[i] = 0.0
        push_x[i], push_y[i], crushed[i] = push[i, 0], push[i, 1], crush[i]
        latest = max(latest, response_time[i])
        if active[i]:
            x[i], y[i] = position[i, 0], position[i, 1]
            vx[i], vy[i] = velocity[i, 0], velocity[i, 1]
            gx[i], gy[i] = external[i, 0], external[i, 1]
            pressed |= external[i, 0] != 0.0 or external[i, 1] != 0.0
            per_mass[i] = 1.0 / mass[i]
            smallest = min(smallest, radius[i])
            per_tau[i] = 1.0 / relaxation_time[i] if driving else 0.0
        else:
            park(i, lanes, near.origin_x, near.origin_y)
    cut.pressed[e], cut.last_response[e], cut.smallest[e], cut.stray[e] = pressed, latest, smallest, True
    batch.workspace.status[e] = OK
    muster_slabs(e, slabs, batch)
    reset_routes(e, batch, regions)


@inner_kernel
def muster_slabs(e: int, slabs: int, batch: Batch) -> None:
    """List who is inside, and who of them belongs to which slab."""
    cut, inside = batch.workspace.cut, batch.workspace.inside
    begin, end, last = batch.bodies.env_start[e], batch.bodies.env_start[e + 1], list_active(e, batch)
    cut.inside[e] = last - begin
    for s in range(slabs):
        cut.inside_start[SLABS * e + s] = first_entry(slab_start(s, slabs, begin, end), begin, last, inside)
        cut.inside_stop[SLABS * e + s] = first_entry(slab_start(s + 1, slabs, begin, end), begin, last, inside)


@inner_kernel
def aim(first: int, last: int, e: int, batch: Batch) -> None:
    """Write the desired velocity of the places ``first:last`` of `Workspace.inside`; see `crowd_env.physics.driving_force`."""
    time, inside, response_time = batch.state.time[e], batch.workspace.inside, batch.bodies.response_time
    command, relative, way, pace = (
        batch.control.command,
        batch.control.relative,
        batch.history.direction,
        batch.history.local_speed,
    )
    wish_x, wish_y = batch.workspace.lanes.wish_x, batch.workspace.lanes.wish_y
    for place in range(index(first), index(last)):
        i = inside[place]
        speed = pace[i] if time >= response_time[i] else 0.0
        cx, cy = command[i, 0], command[i, 1]
        if relative[i]:
            ex, ey = way[i, 0], way[i, 1]
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        wish_x[i], wish_y[i] = speed * cx, speed * cy


@inner_kernel
def leave_lanes(begin: int, end: int, batch: Batch) -> None:
    """Copy the people ``begin:end`` back, and the impulses that they have got in this call."""
    lanes, active, push, crush = (
        batch.workspace.lanes,
        batch.state.active,
        batch.results.impulse,
        batch.results.impulse_magnitude,
    )
    show_positions(begin, end, active, lanes.x, lanes.y, batch.state.position)
    show_positions(begin, end, active, lanes.vx, lanes.vy, batch.state.velocity)
    push_x, push_y, crushed = lanes.push_x, lanes.push_y, lanes.crush
    for i in range(index(begin), index(end)):
        push[i, 0], push[i, 1], crush[i] = push_x[i], push_y[i], crushed[i]


@inner_kernel
def follow_list(e: int, slabs: int, batch: Batch) -> None:
    """Note which entries belong to which slab; whoever is parked stays so."""
    near, lanes, cut, active = batch.workspace.neighbors, batch.workspace.lanes, batch.workspace.cut, batch.state.active
    begin, end = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    origin_x, origin_y, x, y = near.origin_x, near.origin_y, lanes.x, lanes.y
    for i in range(index(begin), index(end)):
        if not active[i]:
            origin_x[i], origin_y[i] = x[i], y[i]
    cut.stray[e] = False
    first, pair_end, wall_end = near.entry_start[e], near.pair_end[e], near.wall_end[e]
    for s in range(slabs):
        row, low, high = SLABS * e + s, slab_start(s, slabs, begin, end), slab_start(s + 1, slabs, begin, end)
        cut.pair_start[row] = first_entry(low, first, pair_end, near.owner)
        cut.pair_stop[row] = first_entry(high, first, pair_end, near.owner)
        cut.wall_start[row] = first_entry(low, pair_end, wall_end, near.owner)
        cut.wall_stop[row] = first_entry(high, pair_end, wall_end, near.owner)


@inner_kernel
def finish(e: int, slabs: int, batch: Batch, dt: float) -> None:
    """Add up what the slabs have seen, and take out whoever crossed an exit."""
    boundary, state, g = batch.world.boundary, batch.state, batch.world.geometry_of_env[e]
    near, lanes, cut, sums = (
        batch.workspace.neighbors,
        batch.workspace.lanes,
        batch.workspace.cut,
        batch.results.diagnostics,
    )
    bodies, seen = batch.bodies, cut.seen
    begin, end = bodies.env_start[e], bodies.env_start[e + 1]
    strays, count, fastest = 0.0, 0.0, 0.0
    for row in range(SLABS * e, SLABS * e + slabs):
        sums.max_overlap[e] = max(sums.max_overlap[e], seen[row, DEEPEST], seen[row, OUTSIDE])
        sums.max_outside[e] = max(sums.max_outside[e], seen[row, OUTSIDE])
        sums.overlap_sum[e] += seen[row, SUM]
        count += seen[row, COUNT]
        strays += seen[row, STRAYS]
        fastest = max(fastest, seen[row, FASTEST])
    sums.overlap_count[e] += int(count)
    sums.max_speed[e] = max(sums.max_speed[e], fastest)
    bounded = batch.control.bounded
    if bounded and dt * fastest > cut.smallest[e] and _is_too_far(begin, end, dt, lanes.vx, lanes.vy, bodies.radius):
        batch.workspace.status[e] = TOO_FAST
    cut.stray[e] = strays > 0.0
    near.age[e] += 1
    exits, stop = boundary.exit_start[g], boundary.exit_start[g + 1]
    left = 0
    if strays > 0.0:
        left = leave_lanes_anywhere(
            begin,
            end,
            boundary.exit,
            exits,
            stop,
            lanes.x,
            lanes.y,
            lanes.vx,
            lanes.vy,
            state.time[e],
            dt,
            state.active,
            state.exit_time,
            state.exit_index,
        )
    elif near.wall_end[e] < near.exit_end[e]:
        left = leave_lanes_by_list(
            near.wall_end[e],
            near.exit_end[e],
            near.owner,
            near.partner,
            boundary.exit,
            exits,
            lanes.x,
            lanes.y,
            lanes.vx,
            lanes.vy,
            state.time[e],
            dt,
            state.active,
            state.exit_time,
            state.exit_index,
        )
    if left > 0:
        take_out_of_lanes(begin, end, state.active, lanes, near.origin_x, near.origin_y, state.position, state.velocity)
        muster_slabs(e, slabs, batch)


@inner_kernel
def _is_too_far(begin: int, end: int, dt: float, vx: Floats, vy: Floats, radius: Floats) -> bool:
    """Whether anyone has moved further than the own radius in this step."""
    for i in range(begin, end):
        if dt * dt * (vx[i] * vx[i] + vy[i] * vy[i]) > radius[i] * radius[i]:
            return True
    return False


@inner_kernel
def write_impulses(first: int, number: int, gap: Floats, impulse: Floats, dt: float, stiffness: float) -> None:
    """The contacts of the last step of a call are listed for those who ask; their forces are those that it pushed with."""
    for c in range(first, first + number):
        impulse[c, 0], impulse[c, 1] = -stiffness * gap[c] * dt, 0.0


@inner_kernel
def copy_forces(begin: int, end: int, source: Floats, target: Floats) -> None:
    """Begin the regular forces with the external ones."""
    for i in range(index(begin), index(end)):
        target[i, 0], target[i, 1] = source[i, 0], source[i, 1]


@inner_kernel
def press(begin: int, end: int, active: Bools, force: Floats, gx: Floats, gy: Floats) -> None:
    """Put the regular forces on those inside into their lanes."""
    for i in range(index(begin), index(end)):
        if active[i]:
            gx[i], gy[i] = force[i, 0], force[i, 1]
