"""Copies of people into and out of the buffers, and the slabs of the lists of people and neighbors."""

import numpy as np

from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.dem_lanes.buffers import interleave, move_out
from crowd_env.physics.dem_lanes.partition import SLABS, first_entry
from crowd_env.physics.neighbors.update import OK
from crowd_env.physics.steering import reset_routes
from crowd_env.physics.step import list_present
from crowd_env.physics.workspace import Batch


@inner_kernel
def gather_crowd(e: int, slabs: int, batch: Batch, dt: float, cutoff: float, regions: bool | None) -> None:
    """Cut the crowd of environment ``e`` into slabs and copy it into the buffers; the neighbor list counts as stale."""
    bodies, state, driving, external = batch.bodies, batch.state, batch.control.driving, batch.control.external_force
    mass, radius = bodies.mass, bodies.radius
    relaxation_time, response_time = bodies.relaxation_time, bodies.response_time
    position, velocity, present = state.position, state.velocity, state.present
    impulse, magnitude = batch.results.impulse, batch.results.impulse_magnitude
    soa, near = batch.workspace.soa, batch.workspace.neighbors
    x, y, vx, vy, regular_fx, regular_fy = soa.x, soa.y, soa.vx, soa.vy, soa.regular_fx, soa.regular_fy
    fx, fy, force_magnitude, inv_mass, inv_tau = soa.fx, soa.fy, soa.force_magnitude, soa.inv_mass, soa.inv_tau
    impulse_x, impulse_y, impulse_magnitude = soa.impulse_x, soa.impulse_y, soa.impulse_magnitude
    begin, end, partition = bodies.env_start[e], bodies.env_start[e + 1], batch.workspace.partition
    is_pushed, latest, smallest = cutoff > 0.0, 0.0, np.inf
    for s in range(slabs):
        partition.slot_start[SLABS * e + s] = begin + s * (end - begin) // slabs
        partition.slot_stop[SLABS * e + s] = begin + (s + 1) * (end - begin) // slabs
    list_present_by_slab(e, slabs, batch)
    for i in range(index(begin), index(end)):
        fx[i] = fy[i] = force_magnitude[i] = 0.0
        impulse_x[i], impulse_y[i], impulse_magnitude[i] = impulse[i, 0], impulse[i, 1], magnitude[i]
        latest = max(latest, response_time[i])
        if present[i]:
            x[i], y[i] = position[i, 0], position[i, 1]
            vx[i], vy[i] = velocity[i, 0], velocity[i, 1]
            regular_fx[i], regular_fy[i] = external[i, 0], external[i, 1]
            is_pushed |= external[i, 0] != 0.0 or external[i, 1] != 0.0
            inv_mass[i] = 1.0 / mass[i]
            smallest = min(smallest, radius[i])
            inv_tau[i] = 1.0 / relaxation_time[i] if driving else 0.0
        else:
            move_out(i, soa, near)
    partition.has_regular_force[e], partition.smallest_radius[e] = is_pushed, smallest
    # The command of a call is new in its first step; after that people begin to walk until the last one has responded.
    partition.desired_until[e] = max(latest + dt, state.time[e])
    partition.list_is_stale[e], partition.is_listing[e] = True, False
    batch.workspace.status[e] = OK
    reset_routes(e, batch, regions)


@inner_kernel
def scatter_slab(row: int, batch: Batch) -> None:
    """Copy the people of one slab back, and their contact impulses of this call."""
    soa, present, partition = batch.workspace.soa, batch.state.present, batch.workspace.partition
    impulse, magnitude = batch.results.impulse, batch.results.impulse_magnitude
    begin, end = partition.slot_start[row], partition.slot_stop[row]
    interleave(begin, end, present, soa.x, soa.y, batch.state.position)
    interleave(begin, end, present, soa.vx, soa.vy, batch.state.velocity)
    impulse_x, impulse_y, impulse_magnitude = soa.impulse_x, soa.impulse_y, soa.impulse_magnitude
    for i in range(index(begin), index(end)):
        impulse[i, 0], impulse[i, 1], magnitude[i] = impulse_x[i], impulse_y[i], impulse_magnitude[i]


@inner_kernel
def list_present_by_slab(e: int, slabs: int, batch: Batch) -> None:
    """List the bodies, and write the range of that list for each slab."""
    partition, inside = batch.workspace.partition, batch.workspace.inside
    begin, rank_end = batch.bodies.env_start[e], list_present(e, batch)
    partition.people_inside[e] = rank_end - begin
    for row in range(SLABS * e, SLABS * e + slabs):
        partition.rank_start[row] = first_entry(partition.slot_start[row], begin, rank_end, inside)
        partition.rank_stop[row] = first_entry(partition.slot_stop[row], begin, rank_end, inside)


@inner_kernel
def cut_neighbor_list(e: int, slabs: int, batch: Batch) -> None:
    """Write the entries of a new neighbor list for each slab."""
    near, soa, partition = batch.workspace.neighbors, batch.workspace.soa, batch.workspace.partition
    present = batch.state.present
    origin_x, origin_y, x, y = near.origin_x, near.origin_y, soa.x, soa.y
    for i in range(index(batch.bodies.env_start[e]), index(batch.bodies.env_start[e + 1])):
        if not present[i]:
            origin_x[i], origin_y[i] = x[i], y[i]  # people that have left never make the list stale
    partition.list_is_stale[e] = False
    first, pair_end, wall_end = near.entry_start[e], near.pair_end[e], near.wall_end[e]
    for row in range(SLABS * e, SLABS * e + slabs):
        begin, end = partition.slot_start[row], partition.slot_stop[row]
        partition.pair_start[row] = first_entry(begin, first, pair_end, near.owner)
        partition.pair_stop[row] = first_entry(end, first, pair_end, near.owner)
        partition.wall_start[row] = first_entry(begin, pair_end, wall_end, near.owner)
        partition.wall_stop[row] = first_entry(end, pair_end, wall_end, near.owner)
