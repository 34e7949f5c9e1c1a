"""Stages that every scheme shares: contacts at the start of a step, sums after the impulses, the clock at the end."""

import numpy as np

from crowd_env.core.arrays.state import Bools
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.bounds import least_radius, speed_limit
from crowd_env.physics.constraints import Extent
from crowd_env.physics.driving_force import Influences
from crowd_env.physics.narrow_phase import find_contacts
from crowd_env.physics.neighbors.update import OK, update_neighbors
from crowd_env.physics.steering import reset_routes
from crowd_env.physics.workspace import Batch


@inner_kernel
def list_present(e: int, batch: Batch) -> int:
    """List the slots of environment ``e`` with a body in `Workspace.inside`; returns one past the last rank.

    A body is that of a pedestrian inside, or on an apron: callers write into ``active`` alone.

    On average half of the slots of a room are empty, in no order: a loop over all of them that tests each loses more time by
    mispredicted branches than by its work.
    """
    slot_start, slot_stop = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    active, present, exit_time = batch.state.active, batch.state.present, batch.state.exit_time
    inside, rank = batch.workspace.inside, index(slot_start)
    for i in range(index(slot_start), index(slot_stop)):
        present[i] = active[i] | (present[i] & (exit_time[i] == exit_time[i]))
        inside[rank] = i
        rank += index(present[i])
    return int(np.int64(rank))  # int alone would keep it unsigned


@inner_kernel
def begin_call(e: int, batch: Batch, acting: Influences) -> tuple[int, float, float]:
    """List the bodies of environment ``e`` and update routes, at the start of a call.

    Returns one past the last rank, the speed limit [m/s] and the least radius [m].
    """
    rank_stop = list_present(e, batch)
    reset_routes(e, batch, acting.regions)
    return rank_stop, speed_limit(batch), least_radius(e, rank_stop, batch)


@inner_kernel
def find_neighbors(e: int, batch: Batch, cutoff: float) -> bool:
    """Update the neighbor list for gaps below ``cutoff``; False (with the reason in `status`) on failure."""
    batch.workspace.status[e] = update_neighbors(e, batch, cutoff, 1)
    return batch.workspace.status[e] == OK


@inner_kernel
def detect(e: int, batch: Batch, margin: float, cutoff: float) -> bool:
    """Update neighbors and contacts of environment ``e``; False (with the reason in `status`) on failure.

    Contacts have a gap below ``margin``; the neighbor list also holds every pair with a gap below ``cutoff``.
    """
    if not find_neighbors(e, batch, max(margin, cutoff)):
        return False
    find_contacts(e, batch, margin)
    return True


@inner_kernel
def contact_range(e: int, batch: Batch) -> tuple[int, int]:
    """Return the first contact of environment ``e`` and one past its last."""
    contact_start = batch.workspace.neighbors.entry_start[e]
    return contact_start, contact_start + batch.history.contacts.number[e]


@inner_kernel
def extent_of(e: int, batch: Batch) -> Extent:
    """Return the ranges of the people and the contacts of environment ``e``."""
    contact_start, contact_stop = contact_range(e, batch)
    return Extent(e, batch.bodies.env_start[e], batch.bodies.env_start[e + 1], contact_start, contact_stop)


@inner_kernel
def record_impulses(e: int, batch: Batch, share: float) -> None:
    """Add a share of the contact impulses of environment ``e`` to the impulses on bodies in this call."""
    contacts, received, magnitudes = batch.history.contacts, batch.results.impulse, batch.results.impulse_magnitude
    of_walls = batch.results.wall_impulse
    ci, cj, direction, impulse = contacts.i, contacts.j, contacts.normal, contacts.impulse
    contact_start, contact_stop = contact_range(e, batch)
    for c in range(contact_start, contact_stop):
        i, j = ci[c], cj[c]
        nx, ny = direction[c, 0], direction[c, 1]
        normal, tangent = share * impulse[c, 0], share * impulse[c, 1]
        px, py = normal * nx - tangent * ny, normal * ny + tangent * nx
        magnitude = np.sqrt(px * px + py * py)
        received[i, 0] += px
        received[i, 1] += py
        magnitudes[i] += magnitude
        if j >= 0:
            received[j, 0] -= px
            received[j, 1] -= py
            magnitudes[j] += magnitude
        else:
            of_walls[i, 0] += px
            of_walls[i, 1] += py


@inner_kernel
def record_overlaps(e: int, batch: Batch) -> float:
    """Add the overlaps of the contacts of environment ``e`` to the sums; returns the deepest with a wall [m]."""
    gap, j, sums = batch.history.contacts.gap, batch.history.contacts.j, batch.results.diagnostics
    contact_start, contact_stop = contact_range(e, batch)
    deepest, outside, total, count = sums.max_overlap[e], 0.0, 0.0, 0
    for c in range(contact_start, contact_stop):
        overlap = -gap[c]
        if overlap > 0.0:
            deepest = max(deepest, overlap)
            total += overlap
            count += 1
            if j[c] < 0:
                outside = max(outside, overlap)
    sums.max_overlap[e], sums.max_outside[e] = deepest, max(outside, sums.max_outside[e])
    sums.overlap_sum[e] += total
    sums.overlap_count[e] += count
    return outside


@inner_kernel
def record_contacts(e: int, batch: Batch, rattles: bool = False) -> float:
    """Add impulses and overlaps to the sums, and keep the impulses as warm start of the next step.

    Elastic contacts at rest rattle with a period of two steps: where a law ``rattles`` so, the warm start is from the step
    before.

    Returns the deepest overlap of a contact of environment ``e`` with a wall [m].
    """
    record_impulses(e, batch, 1.0)
    impulse, history = batch.history.contacts.impulse, batch.history.contacts.history
    contact_start, contact_stop = contact_range(e, batch)
    for c in range(contact_start, contact_stop):
        history[c, 0], history[c, 1] = history[c, 1] if rattles else impulse[c, 0], impulse[c, 0]
    return record_overlaps(e, batch)


@inner_kernel
def record_solver(e: int, batch: Batch, sweeps: int, residual: float, converged: bool) -> None:
    """Add one solve to the sums."""
    sums = batch.results.diagnostics
    sums.iterations[e] += sweeps
    sums.residual[e] = max(sums.residual[e], residual)
    sums.unconverged[e] += not converged and residual > 0.0  # nan: the next search for contacts reports it


@inner_kernel
def tick(e: int, batch: Batch, dt: float) -> None:
    """Advance the clock of environment ``e`` by one step."""
    batch.state.time[e] += dt
    batch.history.direction_age[e] += dt
    batch.history.decision_age[e] += dt
    batch.workspace.substep[e] += 1


@kernel
def pass_time(batch: Batch, dt: float, until: int, first: int, stop: int, waiting: Bools) -> None:
    """Let the clock of empty environments ``first:stop`` go on to step ``until`` of the call, where people are ``waiting``.

    Step by step, so that the time is the same to the bit however a call is cut.
    """
    for e in range(first, stop):
        while waiting[e] and batch.workspace.substep[e] < until:
            tick(e, batch, dt)
