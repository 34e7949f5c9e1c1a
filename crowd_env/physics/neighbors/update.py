"""Pairs that can touch soon: cell list -> Verlet half list with a skin, and the wall features near each body.

The list of an environment holds every pair i < j and every (person, wall feature) closer than ``reach`` (gap), each sorted, so
the order of every later sum depends neither on the cells nor on when the list was built.  It is flat, pairs first: a loop over
it has no inner loop with an end to mispredict.
"""

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.surface import has_sheets
from crowd_env.physics.dem_lanes.barrier import wait_for_all
from crowd_env.physics.dem_lanes.partition import SLABS
from crowd_env.physics.neighbors.lists import (
    NeighborList,
    drop_other_levels,
    find_distances,
    list_exits,
    list_pairs,
    list_walls,
    pairs_by_cell,
    sort_for_pairs,
)
from crowd_env.physics.workspace import Batch

# `Workspace.status`; anything but OK returns to Python.
OK, FULL, DIVERGED, TOO_FAST = 0, 1, 2, 3

# Map coordinates are allowed; beyond this a run has diverged, and the number of cells would overflow.
_FARTHEST = 1e8  # m

# The allowed path before a new list: a body's speed times the horizon, so that a few people shot out of a door do not force a
# new list on the whole crowd.  The horizon of an environment follows from the life of its last list and its number of spare
# pairs: a new list costs as much as some forty tests of a pair.  The contacts found do not depend on these numbers.
_LEAST_PATH, _MOST_PATH = 0.02, 0.2  # m
_LONGEST_HORIZON = 1.0  # s
_TESTS = 40.0


@inner_kernel
def update_neighbors(e: int, batch: Batch, margin: float, team: int) -> int:
    """Rebuild the list of environment ``e`` if a gap below ``margin`` could be missing from it.

    The other threads of a ``team`` wait at the barrier, and help (`list_slabs`).
    Returns OK; FULL if the entries do not fit; or DIVERGED if a position is beyond `_FARTHEST` or nan.
    """
    near, radius, allowed = batch.workspace.neighbors, batch.bodies.radius, batch.workspace.neighbors.allowed
    present, position, velocity = batch.state.present, batch.state.position, batch.state.velocity
    slot_start, slot_stop = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    near.age[e] += 1
    if near.is_valid[e] and margin <= near.reach[e] and are_near(slot_start, slot_stop, present, position, near):
        return OK
    for i in range(slot_start, slot_stop):
        if present[i] and not (abs(position[i, 0]) < _FARTHEST and abs(position[i, 1]) < _FARTHEST):
            return DIVERGED  # nan too
    if near.is_valid[e] and near.reach[e] >= margin:
        near.horizon[e] = _better_horizon(e, slot_start, slot_stop, radius, near, batch.state.time[e] - near.built[e])
    near.age[e], near.built[e] = 0, batch.state.time[e]
    near.is_valid[e] = False
    widest, largest, horizon = 0.0, 0.0, near.horizon[e]
    for i in range(index(slot_start), index(slot_stop)):
        speed = np.sqrt(velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
        path = min(_LEAST_PATH + horizon * speed, _MOST_PATH)
        allowed[i] = path
        if present[i]:
            widest, largest = max(widest, path), max(largest, radius[i])
    near.reach[e] = reach = 1.1 * margin  # some schemes need a little more or less every step
    size = 2.0 * (largest + widest) + reach
    if not (_list_together(e, batch, size, team) if team > 1 else list_pairs(e, batch.bodies, batch.state, near, size)):
        return FULL
    g, boundary, surface = batch.world.geometry_of_env[e], batch.world.boundary, batch.world.surface
    if has_sheets(surface, g):
        drop_other_levels(e, batch.history.height, near)
    if not list_walls(e, g, boundary, surface, batch.history, batch.bodies, batch.state, near, reach):
        return FULL
    if not list_exits(e, g, boundary, batch.bodies, batch.state, near):
        return FULL
    origin_x, origin_y = near.origin_x, near.origin_y
    for i in range(slot_start, slot_stop):
        # A slot that is not listed is never near: making it active from outside forces a new list.
        origin_x[i] = position[i, 0] if present[i] else np.inf
        origin_y[i] = position[i, 1]
    near.is_valid[e] = True
    return OK


@inner_kernel
def _list_together(e: int, batch: Batch, size: float, team: int) -> bool:
    """List the pairs of a large crowd, each thread the pairs of its slabs; the list equals that of `list_pairs`."""
    near, partition = batch.workspace.neighbors, batch.workspace.partition
    sort_for_pairs(e, batch.bodies, batch.state, near, size)
    partition.is_listing[e] = True
    wait_for_all(partition.barrier, team)
    list_slabs(e, 0, team, batch)
    wait_for_all(partition.barrier, team)
    partition.is_listing[e] = False
    owner, partner, distance, entry = near.owner, near.partner, near.contact_distance, index(near.entry_start[e])
    for row in range(SLABS * e, SLABS * (e + 1)):
        if partition.pair_stop[row] < 0:
            return False
        for k in range(index(partition.pair_start[row]), index(partition.pair_stop[row])):
            owner[entry], partner[entry], distance[entry] = owner[k], partner[k], distance[k]
            entry += index(1)
    near.pair_end[e] = entry
    return True


@inner_kernel
def list_slabs(e: int, thread: int, team: int, batch: Batch) -> None:
    """List the pairs of the slabs of one thread, each slab in its own part of the array."""
    near, partition = batch.workspace.neighbors, batch.workspace.partition
    first, room = near.entry_start[e], near.entry_start[e + 1] - near.entry_start[e]
    for s in range(thread, SLABS, team):
        row, entries = SLABS * e + s, (first + s * room // SLABS, first + (s + 1) * room // SLABS)
        slots = partition.slot_start[row], partition.slot_stop[row]
        partition.pair_start[row] = entries[0]
        partition.pair_stop[row] = pairs_by_cell(e, slots, entries, batch.bodies, batch.state, near)
        find_distances(entries[0], partition.pair_stop[row], batch.bodies, near)


@inner_kernel
def are_near(slot_start: int, slot_stop: int, present: Bools, position: Floats, near: NeighborList) -> bool:
    """Whether all bodies are within the allowed path; nan is not.  The loop is free of branches."""
    origin_x, origin_y, allowed, gone = near.origin_x, near.origin_y, near.allowed, 0
    for i in range(index(slot_start), index(slot_stop)):
        dx, dy = position[i, 0] - origin_x[i], position[i, 1] - origin_y[i]
        gone += present[i] & (not dx * dx + dy * dy <= allowed[i] * allowed[i])
    return gone == 0


@inner_kernel
def _better_horizon(
    e: int, slot_start: int, slot_stop: int, radius: Floats, near: NeighborList, lasted: float
) -> float:
    """Return the horizon of the next list of environment ``e``: spare pairs should cost as much as the list itself.

    Where people are evenly spread, the share d^2 / (d + s)^2 of the pairs would be listed with no allowed path.  A list that
    ``lasted`` [s] much shorter than its horizon was ended by a few people that are too fast for any horizon.
    """
    horizon, allowed, diameter, skin = near.horizon[e], near.allowed, 0.0, 0.0
    for i in range(index(slot_start), index(slot_stop)):
        diameter += 2.0 * radius[i]
        skin += 2.0 * allowed[i]
    pairs = (near.pair_end[e] - near.entry_start[e]) / (slot_stop - slot_start)
    spare = pairs * (1.0 - (diameter / (diameter + skin)) ** 2)
    tests = spare * near.age[e]
    if horizon > 4.0 * lasted:
        return horizon / 1.25
    if tests < _TESTS / 1.5:
        return min(1.25 * horizon, _LONGEST_HORIZON)
    return horizon / 1.25 if tests > _TESTS * 1.5 else horizon
