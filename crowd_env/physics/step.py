"""What every scheme does before and after its own law: contacts at the start of a step, exits and sums at its end.

Kernels take the arrays they use, not the whole batch: numba spends about 10 ms of compiling on every array of every argument.
"""

import numpy as np

from crowd_env._jit import inlined_kernel
from crowd_env.geometry import Boundary
from crowd_env.physics.contacts import Contacts, find_contacts
from crowd_env.physics.neighbor_list import NeighbourList
from crowd_env.physics.neighbors import OK, update_neighbours
from crowd_env.physics.world import Diagnostics
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints


@inlined_kernel
def unfinished(e: int, env_start: Ints, active: Bools, progress: Ints, n_substeps: int) -> bool:
    """Whether environment ``e`` has steps of this call left and someone still inside."""
    if progress[e] >= n_substeps:
        return False
    for i in range(env_start[e], env_start[e + 1]):
        if active[i]:
            return True
    return False


@inlined_kernel
def detect(
    e: int,
    g: int,
    boundary: Boundary,
    door_open: Bools,
    bodies: Bodies,
    state: CrowdState,
    near: NeighbourList,
    contacts: Contacts,
    status: Ints,
    margin: float,
    cutoff: float,
) -> bool:
    """Bring neighbours and contacts of environment ``e`` up to date; False (with the reason in `status`) if it cannot.

    Contacts have a gap below ``margin``; the neighbour list also holds whoever is nearer than ``cutoff``.
    """
    status[e] = update_neighbours(e, g, boundary, door_open, bodies, state, near, max(margin, cutoff))
    if status[e] != OK:
        return False
    find_contacts(e, g, boundary, bodies, state, near, contacts, margin)
    return True


@inlined_kernel
def remember_impulses(first: int, last: int, impulse: Floats, memory: Floats) -> None:
    """Leave the impulses of the contacts ``first:last`` where the next step starts from them."""
    for c in range(first, last):
        memory[c, 0], memory[c, 1] = impulse[c, 0], impulse[c, 1]


@inlined_kernel
def record_pushes(first: int, last: int, contacts: Contacts, push: Floats, crush: Floats, share: float) -> None:
    """Add a share of the impulses of the contacts ``first:last`` to what people have got in this call."""
    for c in range(first, last):
        i, j = contacts.i[c], contacts.j[c]
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        normal, tangent = share * contacts.impulse[c, 0], share * contacts.impulse[c, 1]
        px, py = normal * nx - tangent * ny, normal * ny + tangent * nx
        size = np.sqrt(px * px + py * py)
        push[i, 0] += px
        push[i, 1] += py
        crush[i] += size
        if j >= 0:
            push[j, 0] -= px
            push[j, 1] -= py
            crush[j] += size


@inlined_kernel
def record_overlaps(e: int, first: int, last: int, contacts: Contacts, sums: Diagnostics) -> None:
    """Add the overlaps of the contacts ``first:last`` to the sums."""
    for c in range(first, last):
        overlap = -contacts.gap[c]
        if overlap > 0.0:
            sums.max_overlap[e] = max(sums.max_overlap[e], overlap)
            sums.overlap_sum[e] += overlap
            sums.overlap_count[e] += 1
            if contacts.j[c] < 0:
                sums.max_outside[e] = max(sums.max_outside[e], overlap)


@inlined_kernel
def record_solver(e: int, sums: Diagnostics, sweeps: int, residual: float, tolerance: float) -> None:
    """Add one solve to the sums."""
    sums.iterations[e] += sweeps
    sums.residual[e] = max(sums.residual[e], residual)
    sums.unconverged[e] += residual > tolerance


@inlined_kernel
def tick(e: int, time: Floats, progress: Ints, dt: float) -> None:
    """Advance the clock of environment ``e`` by the step that is done."""
    time[e] += dt
    progress[e] += 1
