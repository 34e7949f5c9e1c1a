"""What every scheme does before and after its own law: contacts at the start of a step, exits and sums at its end."""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.physics.contacts import find_contacts
from crowd_env.physics.neighbors.update import OK, update_neighbors
from crowd_env.physics.workspace import Batch, Diagnostics


@inner_kernel
def list_active(e: int, batch: Batch) -> int:
    """List who is inside environment ``e`` in `Workspace.inside`; returns one past the last place.

    Half of the slots of a room are empty on average, in no order: a loop over all of them that asks each is slowed down more
    by what the processor guesses wrong than by the work.
    """
    begin, end = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    active, inside, place = batch.state.active, batch.workspace.inside, index(begin)
    for i in range(index(begin), index(end)):
        inside[place] = i
        place += index(active[i])
    return int(np.int64(place))  # int alone would keep it unsigned


@inner_kernel
def detect(e: int, batch: Batch, margin: float, cutoff: float) -> bool:
    """Bring neighbors and contacts of environment ``e`` up to date; False (with the reason in `status`) if it cannot.

    Contacts have a gap below ``margin``; the neighbor list also holds whoever is nearer than ``cutoff``.
    """
    world = batch.world
    batch.workspace.status[e] = update_neighbors(e, batch, max(margin, cutoff))
    if batch.workspace.status[e] != OK:
        return False
    g = world.geometry_of_env[e]
    find_contacts(
        e, g, world.boundary, batch.bodies, batch.state, batch.workspace.neighbors, batch.history.contacts, margin
    )
    return True


@inner_kernel
def store_warm_start(first: int, last: int, batch: Batch) -> None:
    """Leave the impulses of the contacts ``first:last`` where the next step starts from them."""
    impulse, remembered = batch.history.contacts.impulse, batch.history.contacts.history
    for c in range(first, last):
        remembered[c, 0], remembered[c, 1] = impulse[c, 0], impulse[c, 1]


@inner_kernel
def record_impulses(first: int, last: int, batch: Batch, share: float) -> None:
    """Add a share of the impulses of the contacts ``first:last`` to what people have got in this call."""
    contacts, push, crush = batch.history.contacts, batch.results.impulse, batch.results.impulse_magnitude
    ci, cj, direction, impulse = contacts.i, contacts.j, contacts.normal, contacts.impulse
    for c in range(first, last):
        i, j = ci[c], cj[c]
        nx, ny = direction[c, 0], direction[c, 1]
        normal, tangent = share * impulse[c, 0], share * impulse[c, 1]
        px, py = normal * nx - tangent * ny, normal * ny + tangent * nx
        size = np.sqrt(px * px + py * py)
        push[i, 0] += px
        push[i, 1] += py
        crush[i] += size
        if j >= 0:
            push[j, 0] -= px
            push[j, 1] -= py
            crush[j] += size


@inner_kernel
def record_overlaps(e: int, first: int, last: int, batch: Batch) -> float:
    """Add the overlaps of the contacts ``first:last`` to the sums; returns the deepest with a wall [m]."""
    gap, j, sums = batch.history.contacts.gap, batch.history.contacts.j, batch.results.diagnostics
    deepest, outside, total, count = sums.max_overlap[e], 0.0, 0.0, 0
    for c in range(first, last):
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
    return float(outside)


@inner_kernel
def record_solver(e: int, sums: Diagnostics, sweeps: int, residual: float, tolerance: float) -> None:
    """Add one solve to the sums."""
    sums.iterations[e] += sweeps
    sums.residual[e] = max(sums.residual[e], residual)
    sums.unconverged[e] += residual > tolerance


@inner_kernel
def tick(e: int, batch: Batch, dt: float) -> None:
    """Advance the clock of environment ``e`` by the step that is done."""
    batch.state.time[e] += dt
    batch.workspace.substep[e] += 1
