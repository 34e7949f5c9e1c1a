"""The stages of a `dem` step besides its law: lists, regular forces, motion and bounds, exits."""

import numpy as np

from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.surface import has_sheets
from crowd_env.physics.bounds import MARGIN, limited, slide, speed_limit, stop_at_walls
from crowd_env.physics.dem_lanes.buffers import (
    FAR_AWAY,
    SoABuffers,
    add_impulse,
    count_too_far,
    integrate_free,
    integrate_position,
    integrate_velocity,
    interleave,
    limit_speed,
    move_out,
)
from crowd_env.physics.dem_lanes.gather import cut_neighbor_list, list_present_by_slab
from crowd_env.physics.dem_lanes.partition import DEEPEST, FASTEST, OUTSIDE, OVERLAP, OVERLAPS, SLABS, TOO_FAR
from crowd_env.physics.driving_force import Influences, add_forces_at_distance, desired_velocity
from crowd_env.physics.exits import change_sheet, end_of_apron, mark_crossing
from crowd_env.physics.neighbors.update import OK, TOO_FAST, update_neighbors
from crowd_env.physics.steering import begin_look_up, follow_rules, is_decision_due, is_look_up_due, update_steering
from crowd_env.physics.walking.around import look_around
from crowd_env.physics.workspace import Batch

# Task of a step for desired velocities: keep them, compute them from the directions, look up the directions first, or let
# people decide how to walk (after their look-up).
KEEP, COMPUTE, LOOK_UP, DECIDE = 0, 1, 2, 3


# ------------------------------------------------------------------------------------------------------------- contacts


@inner_kernel
def detect(e: int, slabs: int, team: int, batch: Batch, n_substeps: int, cutoff: float) -> bool:
    """Bring the neighbor list of environment ``e`` up to date; returns whether there is a step to do.

    There is none after the last one of the call, in an empty place, or (with the reason in `status`) if the list does not fit.
    """
    work, state, present = batch.workspace, batch.state, batch.state.present
    if work.status[e] != OK or work.substep[e] >= n_substeps or work.partition.people_inside[e] == 0:
        return False
    soa, begin, end = work.soa, batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    if work.partition.list_is_stale[e]:
        interleave(begin, end, present, soa.x, soa.y, state.position)
        interleave(begin, end, present, soa.vx, soa.vy, state.velocity)
        work.status[e] = update_neighbors(e, batch, cutoff, team)
        if work.status[e] != OK:
            return False
        cut_neighbor_list(e, slabs, batch)
    return True


# ------------------------------------------------------------------------------------------------------- regular forces


@inner_kernel
def plan_steering(e: int, batch: Batch, dt: float, acting: Influences) -> None:
    """Choose the task of this step for desired velocities, and apply control rules when directions are due."""
    partition = batch.workspace.partition
    partition.steering[e] = COMPUTE if batch.state.time[e] <= partition.desired_until[e] else KEEP
    if acting.balance is not None or acting.desire is not None:
        partition.steering[e] = COMPUTE
    _plan_look_up(e, batch, dt, acting.regions, acting.walking)


@inner_kernel
def _plan_look_up(e: int, batch: Batch, dt: float, regions: bool | None, walking: bool | None) -> None:
    partition, state = batch.workspace.partition, batch.state
    if is_look_up_due(e, batch, dt):
        partition.turn[e] = begin_look_up(e, batch, regions)
        partition.steering[e] = LOOK_UP
        if regions is not None:
            begin, end = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
            interleave(begin, end, state.present, batch.workspace.soa.x, batch.workspace.soa.y, state.position)
            follow_rules(e, batch)
    if walking is not None and is_decision_due(e, batch, dt):
        _prepare_decision(e, batch, dt)
        partition.steering[e] = DECIDE


@inner_kernel
def _prepare_decision(e: int, batch: Batch, dt: float) -> None:
    """Look up the directions of all people if they are due, and run `look_around`."""
    partition, soa, state = batch.workspace.partition, batch.workspace.soa, batch.state
    begin, end = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    interleave(begin, end, state.present, soa.x, soa.y, state.position)
    interleave(begin, end, state.present, soa.vx, soa.vy, state.velocity)
    if partition.steering[e] == LOOK_UP:
        update_steering(e, begin, begin + partition.people_inside[e], batch, dt, partition.turn[e])
    look_around(e, batch, batch.behaviors.manner)


@inner_kernel
def regular_forces(e: int, row: int, batch: Batch, dt: float, acting: Influences) -> None:
    """Bring the desired velocities of one slab up to date, and the sum of external forces and forces at a distance.

    The driving force needs no array: `integrate_velocity` forms it from the desired velocity.
    """
    state, soa, partition = batch.state, batch.workspace.soa, batch.workspace.partition
    begin, end = partition.slot_start[row], partition.slot_stop[row]
    rank_start, rank_stop, inside = partition.rank_start[row], partition.rank_stop[row], batch.workspace.inside
    if partition.steering[e] > KEEP:
        if partition.steering[e] == LOOK_UP:
            interleave(begin, end, state.present, soa.x, soa.y, state.position)
            update_steering(e, rank_start, rank_stop, batch, dt, partition.turn[e])
        if acting.balance is not None or acting.desire is not None:
            interleave(begin, end, state.present, soa.x, soa.y, state.position)
            interleave(begin, end, state.present, soa.vx, soa.vy, state.velocity)
        time, desired_vx, desired_vy = state.time[e], soa.desired_vx, soa.desired_vy
        for rank in range(index(rank_start), index(rank_stop)):
            i = inside[rank]
            desired_vx[i], desired_vy[i] = desired_velocity(i, time, batch, acting)
    if acting.reach > 0.0:
        _add_forces_at_distance(e, row, batch, dt, acting)


@inner_kernel
def _add_forces_at_distance(e: int, row: int, batch: Batch, dt: float, acting: Influences) -> None:
    soa, partition, present = batch.workspace.soa, batch.workspace.partition, batch.state.present
    begin, end, rank_stop = partition.slot_start[row], partition.slot_stop[row], partition.rank_stop[row]
    force, external = batch.history.force, batch.control.external_force
    regular_fx, regular_fy = soa.regular_fx, soa.regular_fy
    interleave(begin, end, present, soa.x, soa.y, batch.state.position)
    interleave(begin, end, present, soa.desired_vx, soa.desired_vy, batch.workspace.desired_velocity)
    for i in range(index(begin), index(end)):
        force[i, 0], force[i, 1] = external[i, 0], external[i, 1]
    add_forces_at_distance(e, rank_stop, batch, dt, acting)
    for i in range(index(begin), index(end)):
        if present[i]:
            regular_fx[i], regular_fy[i] = force[i, 0], force[i, 1]


# ----------------------------------------------------------------------------------------------------- motion and bounds


@inner_kernel
def move_slab(e: int, row: int, batch: Batch, dt: float, is_touched: bool, max_drive: float | None) -> None:
    """Advance velocities, then positions, of one slab by symplectic Euler (eq 3), within the bounds of speed and of walls."""
    soa, partition, near = batch.workspace.soa, batch.workspace.partition, batch.workspace.neighbors
    begin, end, found = partition.slot_start[row], partition.slot_stop[row], partition.found
    vx, vy, inv_mass, inv_tau = soa.vx, soa.vy, soa.inv_mass, soa.inv_tau
    if max_drive is not None:
        _integrate_limited(begin, end, dt, soa, max_drive)
    elif is_touched or partition.has_regular_force[e]:
        integrate_velocity(begin, end, dt, soa.fx, soa.regular_fx, inv_mass, soa.desired_vx, inv_tau, vx)
        integrate_velocity(begin, end, dt, soa.fy, soa.regular_fy, inv_mass, soa.desired_vy, inv_tau, vy)
    else:
        integrate_free(begin, end, dt, soa.desired_vx, inv_tau, vx)
        integrate_free(begin, end, dt, soa.desired_vy, inv_tau, vy)
    fastest = limit_speed(begin, end, vx, vy, speed_limit(batch))
    integrate_position(begin, end, dt, vx, soa.x)
    integrate_position(begin, end, dt, vy, soa.y)
    found[row, FASTEST] = fastest
    if batch.control.bounded and found[row, OUTSIDE] + dt * fastest > partition.smallest_radius[e] - 2.0 * MARGIN:
        _hold_at_walls(e, row, batch, dt)
    if is_touched:
        add_impulse(begin, end, dt, soa.fx, soa.impulse_x)
        add_impulse(begin, end, dt, soa.fy, soa.impulse_y)
        add_impulse(begin, end, dt, soa.force_magnitude, soa.impulse_magnitude)
    found[row, TOO_FAR] = count_too_far(begin, end, soa, near)


@inner_kernel
def _integrate_limited(slot_begin: int, slot_end: int, dt: float, soa: SoABuffers, max_drive: float) -> None:
    """Advance the velocity by  v += h ((g + f) / m + a),  a = (v_d - v) / tau cut to the length ``max_drive`` / m."""
    vx, vy, fx, fy, regular_fx, regular_fy = soa.vx, soa.vy, soa.fx, soa.fy, soa.regular_fx, soa.regular_fy
    desired_vx, desired_vy, inv_tau, inv_mass = soa.desired_vx, soa.desired_vy, soa.inv_tau, soa.inv_mass
    for i in range(index(slot_begin), index(slot_end)):
        ax, ay = (desired_vx[i] - vx[i]) * inv_tau[i], (desired_vy[i] - vy[i]) * inv_tau[i]
        ax, ay = limited(ax, ay, max_drive * inv_mass[i])
        vx[i] += dt * ((fx[i] + regular_fx[i]) * inv_mass[i] + ax)
        vy[i] += dt * ((fy[i] + regular_fy[i]) * inv_mass[i] + ay)


@inner_kernel
def _hold_at_walls(e: int, row: int, batch: Batch, dt: float) -> None:
    """Stop the paths of one slab at walls; each began ``dt`` times the velocity before its end; see `bounds`."""
    near, soa, partition = batch.workspace.neighbors, batch.workspace.soa, batch.workspace.partition
    boundary, g = batch.world.boundary, batch.world.geometry_of_env[e]
    owner, partner, x, y, vx, vy, inv_mass = near.owner, near.partner, soa.x, soa.y, soa.vx, soa.vy, soa.inv_mass
    entry, entry_end = partition.wall_start[row], partition.wall_stop[row]
    while entry < entry_end:
        i, stop = owner[entry], entry + 1
        while stop < entry_end and owner[stop] == i:
            stop += 1
        if inv_mass[i] > 0.0:  # inside
            x0, y0 = x[i] - dt * vx[i], y[i] - dt * vy[i]
            x1, y1, nx, ny, mx, my = stop_at_walls(boundary, g, partner, entry, stop, x0, y0, x[i], y[i])
            if nx != 0.0 or ny != 0.0:
                x[i], y[i] = x1, y1
                ux, uy = slide(vx[i], vy[i], nx, ny, mx, my)
                px, py = (ux - vx[i]) / inv_mass[i], (uy - vy[i]) / inv_mass[i]
                soa.impulse_x[i] += px
                soa.impulse_y[i] += py
                batch.results.wall_impulse[i, 0] += px
                batch.results.wall_impulse[i, 1] += py
                soa.impulse_magnitude[i] += np.sqrt(px * px + py * py)
                vx[i], vy[i] = ux, uy
        entry = stop


@inner_kernel
def merge_slabs(e: int, slabs: int, batch: Batch, dt: float) -> None:
    """Add the results of the slabs to the sums of the call, and test for paths too long for a step, or for the list."""
    soa, partition, sums = batch.workspace.soa, batch.workspace.partition, batch.results.diagnostics
    found = partition.found
    too_far, count, fastest = 0.0, 0.0, 0.0
    for row in range(SLABS * e, SLABS * e + slabs):
        sums.max_overlap[e] = max(sums.max_overlap[e], found[row, DEEPEST], found[row, OUTSIDE])
        sums.max_outside[e] = max(sums.max_outside[e], found[row, OUTSIDE])
        sums.overlap_sum[e] += found[row, OVERLAP]
        count += found[row, OVERLAPS]
        too_far += found[row, TOO_FAR]
        fastest = max(fastest, found[row, FASTEST])
    sums.overlap_count[e] += count
    sums.max_speed[e] = max(sums.max_speed[e], fastest)
    if batch.control.bounded and dt * fastest > partition.smallest_radius[e]:
        radius, vx, vy = batch.bodies.radius, soa.vx, soa.vy
        for i in range(batch.bodies.env_start[e], batch.bodies.env_start[e + 1]):
            if dt * dt * (vx[i] * vx[i] + vy[i] * vy[i]) > radius[i] * radius[i]:
                batch.workspace.status[e] = TOO_FAST
    partition.list_is_stale[e] = too_far > 0.0
    batch.workspace.neighbors.age[e] += 1


# ---------------------------------------------------------------------------------------------------------------- exits


@inner_kernel
def leave(e: int, slabs: int, batch: Batch, dt: float) -> None:
    """Do as `exits.leave`: mark the people that crossed an exit line in this step, and take out people beyond an apron."""
    boundary, state, near, soa = batch.world.boundary, batch.state, batch.workspace.neighbors, batch.workspace.soa
    begin, end, g = batch.bodies.env_start[e], batch.bodies.env_start[e + 1], batch.world.geometry_of_env[e]
    left = 0
    if batch.workspace.partition.list_is_stale[e]:  # it may lack a pedestrian near an exit
        for exit_number in range(boundary.exit_start[g + 1] - boundary.exit_start[g]):
            for i in range(index(begin), index(end)):
                left += _crosses(e, i, exit_number, batch, dt)
    else:
        for entry in range(near.wall_end[e], near.exit_end[e]):
            left += _crosses(e, near.owner[entry], np.int64(near.partner[entry]), batch, dt)
    inside, active, sheets = batch.workspace.inside, state.active, has_sheets(batch.world.surface, g)
    for rank in range(index(begin), index(begin) + index(batch.workspace.partition.people_inside[e])):
        i = inside[rank]
        if sheets:
            change_sheet(e, i, batch, soa.x[i], soa.y[i])
        if state.present[i] and not active[i]:
            left += end_of_apron(e, i, batch, soa.x[i], soa.y[i])
    if left > 0:
        for i in range(index(begin), index(end)):
            if not state.present[i] and soa.x[i] < FAR_AWAY:  # gone in this step: keeps its place in the state
                state.position[i, 0], state.position[i, 1] = soa.x[i], soa.y[i]
                state.velocity[i, 0], state.velocity[i, 1] = soa.vx[i], soa.vy[i]
                move_out(i, soa, near)
        list_present_by_slab(e, slabs, batch)


@inner_kernel
def _crosses(e: int, i: int, exit_number: int, batch: Batch, dt: float) -> bool:
    """Mark pedestrian ``i`` as out if the last step led through an exit; returns whether its body is gone with it."""
    soa = batch.workspace.soa
    x, y = soa.x[i], soa.y[i]
    return mark_crossing(e, i, exit_number, batch, dt, x - dt * soa.vx[i], y - dt * soa.vy[i], x, y)
