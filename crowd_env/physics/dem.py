"""DEM: the soft contact of Cundall and Helbing, in the form of Pécol et al. 2011 (eqs 3-5).

    g_ij = -k min(0, D_ij) e_ji            a linear spring that pushes only while the discs overlap
    u(n+1) = u(n) + h M^-1 (f + g),  q(n+1) = q(n) + h u(n+1)      symplectic Euler

Equation 5 as printed, with the unit vector from i to j, would attract; the sign here repels.
With omega = sqrt(k / m_e), 1/m_e = 1/m_i + 1/m_j, a contact lasts pi / omega and the deepest overlap is v / omega.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.checks import POSITIVE
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.dem_lanes.barrier import wait_for_all
from crowd_env.physics.dem_lanes.buffers import interleave
from crowd_env.physics.dem_lanes.gather import gather_crowd, scatter_slab
from crowd_env.physics.dem_lanes.partition import (
    CARRIED,
    DEEPEST,
    LAST_REACHED,
    OUTSIDE,
    OVERLAP,
    OVERLAPS,
    SLABS,
    count_slabs,
)
from crowd_env.physics.dem_lanes.stages import (
    DECIDE,
    detect,
    leave,
    merge_slabs,
    move_slab,
    plan_steering,
    regular_forces,
)
from crowd_env.physics.driving_force import Influences
from crowd_env.physics.narrow_phase import find_contacts, gap_to_feature
from crowd_env.physics.neighbors.update import list_slabs
from crowd_env.physics.scheme import ContactScheme, SchemeInfo
from crowd_env.physics.step import contact_range, tick
from crowd_env.physics.walking.decide import decide_share
from crowd_env.physics.workspace import Batch

INFO = SchemeInfo(
    name="dem",
    title="soft discs: linear spring, symplectic Euler",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 3-5; stiffness of Helbing, Farkas, Vicsek 2000",
    order=1,
    conserves_energy_at_contact=True,
    overlap="v / omega, some centimeters at k = 1.2e5 N/m; it is the softness, not an error of the time step",
    stable_step="2 / sqrt(2 k / m_min), from h omega < 2 for two bodies of the smallest mass, and 2 tau_min",
    uses=("soa",),
)


@dataclass(frozen=True)
class DEM(ContactScheme):
    """Soft discs.

    Parameters
    ----------
    stiffness : N/m, constant ``k`` of eq 5; 1.2e5 after Helbing et al. 2000.
    social : see `ContactScheme`.
    """

    stiffness: float = 1.2e5

    ALLOWED = {"stiffness": POSITIVE.because("the contact force k |D| (eq 5) has to push")}
    shares_crowds = True  # the slabs of a large crowd

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO

    def stable_dt(self, bodies: Bodies) -> float:
        """Return 2 / omega of the stiffest pair (h omega < 2 for a binary contact), or 2 tau of the quickest drive."""
        contact = 2.0 / np.sqrt(2.0 * self.stiffness / bodies.mass.min())
        return float(min(contact, super().stable_dt(bodies)))

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return head-on closing speed / omega plus the static push of the largest crowd leaning on one contact."""
        fastest = bodies.desired_speed.max()
        impact = 2.0 * fastest * np.sqrt(bodies.mass.max() / self.stiffness)
        drive = bodies.mass * bodies.desired_speed / bodies.relaxation_time
        lean = np.add.reduceat(drive, bodies.env_start[:-1]).max() / self.stiffness
        return float(impact + lean)

    def slabs(self, people: int, reach: float) -> int:
        """Return the number of slabs of a crowd of ``people``; 1 with forces at a distance, which are not shared out."""
        return int(count_slabs(people)) if reach == 0.0 else 1

    @property
    def kernel(self) -> Callable[..., None]:
        """The compiled loop."""
        return _advance_range

    def parameters(self) -> tuple[Any, ...]:
        """Return the stiffness."""
        return (self.stiffness,)


# ------------------------------------------------------------------------------------------------------------- the law


@inner_kernel
def _spring_force(stiffness: float, gap: float) -> float:
    """Return the force [N] that pushes two overlapping surfaces apart: -k D (eq 5), for a gap D < 0."""
    return -stiffness * gap


@inner_kernel
def _push_people(row: int, batch: Batch, stiffness: float) -> None:
    """Add the spring forces (eqs 4, 5) between the people of one slab, and record number and depth of their overlaps.

    The first loop writes every pair of the neighbor list and keeps its place only if the pair overlaps: a branch would be
    mispredicted every third time.  The second loop does the root and the division for overlapping pairs alone.  A force on a
    body of a later slab is carried: that slab adds it in `_receive_forces`.
    """
    near, soa, partition = batch.workspace.neighbors, batch.workspace.soa, batch.workspace.partition
    owner, partner, contact_distance = near.owner, near.partner, near.contact_distance
    candidates = batch.workspace.narrow_phase.candidates
    x, y, fx, fy, magnitude = soa.x, soa.y, soa.fx, soa.fy, soa.force_magnitude
    carried_to, carried_force, found = partition.carried_to, partition.carried_force, partition.found
    slab_end, first, hits = partition.slot_stop[row], partition.pair_start[row], index(partition.pair_start[row])
    for entry in range(index(first), index(partition.pair_stop[row])):
        i, j = owner[entry], partner[entry]
        dx, dy = x[i] - x[j], y[i] - y[j]
        candidates[hits] = entry
        hits += index(dx * dx + dy * dy < contact_distance[entry] * contact_distance[entry])
    deepest, total, carried, last_reached = 0.0, 0.0, index(first), -1.0
    for h in range(index(first), hits):
        entry = candidates[h]
        i, j = owner[entry], partner[entry]
        dx, dy = x[i] - x[j], y[i] - y[j]
        distance = np.sqrt(dx * dx + dy * dy)
        gap = distance - contact_distance[entry]
        size = _spring_force(stiffness, gap)
        deepest, total = max(deepest, -gap), total - gap
        px, py = size, 0.0  # coincident centers: as `find_contacts` has it
        if distance > 0.0:
            per_distance = size / distance
            px, py = per_distance * dx, per_distance * dy
        fx[i] += px
        fy[i] += py
        magnitude[i] += size
        if j < slab_end:
            fx[j] -= px
            fy[j] -= py
            magnitude[j] += size
        else:
            carried_to[carried] = j
            carried_force[carried, 0], carried_force[carried, 1] = px, py
            carried += index(1)
            last_reached = max(last_reached, float(j))
    found[row, DEEPEST], found[row, OVERLAP], found[row, OVERLAPS] = deepest, total, np.int64(hits) - first
    found[row, LAST_REACHED], found[row, CARRIED] = last_reached, np.int64(carried) - first


@inner_kernel
def _push_off_walls(e: int, row: int, batch: Batch, dt: float, stiffness: float) -> None:
    """Add the spring forces of walls on the people of one slab, and record number and depth of these overlaps."""
    near, soa, partition = batch.workspace.neighbors, batch.workspace.soa, batch.workspace.partition
    boundary, radius, g = batch.world.boundary, batch.bodies.radius, batch.world.geometry_of_env[e]
    owner, partner, found = near.owner, near.partner, partition.found
    x, y, fx, fy, magnitude = soa.x, soa.y, soa.fx, soa.fy, soa.force_magnitude
    of_walls = batch.results.wall_impulse
    found[row, OUTSIDE] = 0.0
    for entry in range(index(partition.wall_start[row]), index(partition.wall_stop[row])):
        i = owner[entry]
        gap, nx, ny = gap_to_feature(x[i], y[i], radius[i], boundary, g, np.int64(partner[entry]), 0.0)
        if gap < 0.0:
            size = _spring_force(stiffness, gap)
            fx[i] += size * nx
            fy[i] += size * ny
            magnitude[i] += size
            of_walls[i, 0] += dt * size * nx
            of_walls[i, 1] += dt * size * ny
            found[row, OUTSIDE] = max(found[row, OUTSIDE], -gap)
            found[row, OVERLAP] -= gap
            found[row, OVERLAPS] += 1


@inner_kernel
def _receive_forces(e: int, row: int, batch: Batch) -> bool:
    """Add the forces that earlier slabs carry for the people of this slab, in order; returns whether any contact touches it."""
    soa, partition = batch.workspace.soa, batch.workspace.partition
    found, begin, end = partition.found, partition.slot_start[row], partition.slot_stop[row]
    is_touched = found[row, OVERLAPS] > 0.0
    for other in range(SLABS * e, row):
        if found[other, LAST_REACHED] >= begin:
            is_touched = True
            for k in range(partition.pair_start[other], partition.pair_start[other] + int(found[other, CARRIED])):
                j = partition.carried_to[k]
                if begin <= j < end:
                    px, py = partition.carried_force[k, 0], partition.carried_force[k, 1]
                    soa.fx[j] -= px
                    soa.fy[j] -= py
                    soa.force_magnitude[j] += np.sqrt(px * px + py * py)
    return is_touched


@inner_kernel
def _list_contacts(e: int, batch: Batch, dt: float, stiffness: float) -> None:
    """Write the contacts of this step and their impulses into the contact list.

    This is a second narrow phase, in the last step of a call only: the first, in `_push_people`, keeps no normals.  The gaps
    and the forces are the same.
    """
    state, contacts, soa = batch.state, batch.history.contacts, batch.workspace.soa
    interleave(batch.bodies.env_start[e], batch.bodies.env_start[e + 1], state.present, soa.x, soa.y, state.position)
    find_contacts(e, batch, 0.0)
    gap, impulse = contacts.gap, contacts.impulse
    contact_start, contact_stop = contact_range(e, batch)
    for c in range(contact_start, contact_stop):
        impulse[c, 0], impulse[c, 1] = _spring_force(stiffness, gap[c]) * dt, 0.0


# ---------------------------------------------------------------------------------------------------------------- steps


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    env_first: int,
    env_stop: int,
    acting: Influences,
    stiffness: float,
    thread: int,
    threads: int,
) -> None:
    """Advance the environments ``env_first:env_stop``; several threads may do so together, each with its share of the slabs.

    A crowd lies in buffers during the call (`dem_lanes.buffers`), and a large one is cut into slabs, each a row of
    `dem_lanes.partition`.  Between two barriers no thread writes what another reads; thread 0 alone does small stages.
    """
    partition, env_start, substep = batch.workspace.partition, batch.bodies.env_start, batch.workspace.substep
    for e in range(env_first, env_stop):
        slabs = count_slabs(env_start[e + 1] - env_start[e]) if acting.reach == 0.0 else 1
        team = threads if slabs > 1 else 1
        if thread >= team or substep[e] >= n_substeps:
            continue
        row_start, row_stop = SLABS * e + thread, SLABS * e + slabs
        if thread == 0:
            # People inside: listed, cut into slabs and copied into the buffers.
            gather_crowd(e, slabs, batch, dt, acting.reach, acting.regions)
        while True:
            if thread == 0:
                # Neighbors: a new list if the old one is stale.  Contacts are listed in the last step of the call alone.
                partition.run[e] = detect(e, slabs, team, batch, n_substeps, acting.reach)
                if partition.run[e]:
                    plan_steering(e, batch, dt, acting)
                    if substep[e] == n_substeps - 1:
                        _list_contacts(e, batch, dt, stiffness)
            wait_for_all(partition.barrier, team)
            if partition.is_listing[e]:
                # Thread 0 asks for help with the list, and returns to this barrier when the list is complete.
                list_slabs(e, thread, team, batch)
                wait_for_all(partition.barrier, team)
                wait_for_all(partition.barrier, team)
            if not partition.run[e]:
                break
            if acting.walking is not None and partition.steering[e] == DECIDE:
                for row in range(row_start, row_stop, team):
                    # Decisions how to walk.
                    decide_share(e, row - SLABS * e, slabs, batch, batch.behaviors.manner)
                wait_for_all(partition.barrier, team)
            for row in range(row_start, row_stop, team):
                # Regular forces: directions and desired velocities where they are due, social force.
                regular_forces(e, row, batch, dt, acting)
                # The law: springs between people, and between people and walls.
                _push_people(row, batch, stiffness)
                _push_off_walls(e, row, batch, dt, stiffness)
            wait_for_all(partition.barrier, team)
            for row in range(row_start, row_stop, team):
                # Motion: the springs that reach from slab to slab, then velocities, positions, bounds and sums of impulses.
                is_touched = _receive_forces(e, row, batch)
                move_slab(e, row, batch, dt, is_touched, acting.max_drive)
            wait_for_all(partition.barrier, team)
            if thread == 0:
                # Diagnostics: the sums of all slabs; paths that are too long.
                merge_slabs(e, slabs, batch, dt)
                # Exits: a pedestrian is out when the center crosses one.
                leave(e, slabs, batch, dt)
                # Clock.
                tick(e, batch, dt)
        for row in range(row_start, row_stop, team):
            scatter_slab(row, batch)
