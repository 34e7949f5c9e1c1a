"""DEM: the soft contact of Cundall and Helbing, as Pécol et al. 2011 write it (eqs 3-5).

    g_ij = -k min(0, D_ij) e_ji            a linear spring that pushes only while the discs overlap
    u(n+1) = u(n) + h M^-1 (f + g),  q(n+1) = q(n) + h u(n+1)      symplectic Euler

Equation 5 is printed with the unit vector from i to j and would attract; the sign here pushes the two apart.
With omega = sqrt(k / m_e), 1/m_e = 1/m_i + 1/m_j, a contact lasts pi / omega and the deepest overlap is v / omega.
"""

from dataclasses import dataclass

import numpy as np

from crowd_env._kernels.jit import inner_kernel, kernel
from crowd_env._kernels.struct_ref import StructRef
from crowd_env.checks import POSITIVE, check_fields
from crowd_env.physics.bounds import MARGIN, hold_lanes_at_walls, speed_limit
from crowd_env.physics.contacts import find_contacts
from crowd_env.physics.dem_lanes.contact import (
    CARRIED,
    COUNT,
    FASTEST,
    FURTHEST,
    OUTSIDE,
    STRAYS,
    push_off_walls,
    push_people,
    receive,
)
from crowd_env.physics.dem_lanes.lanes import (
    accelerate,
    accelerate_freely,
    book,
    count_strays,
    greatest_speed,
    move,
    show_positions,
)
from crowd_env.physics.dem_lanes.partition import SLABS, slab_start, slabs_of, wait_for_all
from crowd_env.physics.dem_lanes.stages import (
    aim,
    begin_call,
    copy_forces,
    finish,
    follow_list,
    leave_lanes,
    press,
    write_impulses,
)
from crowd_env.physics.driving_force import influences
from crowd_env.physics.neighbors.update import OK, update_neighbors
from crowd_env.physics.scheme import ContactScheme, SchemeInfo
from crowd_env.physics.social_force import SocialParams, add_social_forces
from crowd_env.physics.steering import LOOK_EVERY, choose_turn, follow_rules, update_steering
from crowd_env.physics.step import tick
from crowd_env.physics.workspace import Batch
from crowd_env.state import Bodies

INFO = SchemeInfo(
    name="dem",
    title="soft discs: linear spring, symplectic Euler",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 3-5; stiffness of Helbing, Farkas, Vicsek 2000",
    order=1,
    conserves_energy_at_contact=True,
    overlap="v / omega, some centimeters at k = 1.2e5 N/m; it is the softness, not an error of the time step",
    stable_step="2 / sqrt(2 k / m_min), from h omega < 2 for two bodies of the smallest mass, and 2 tau_min",
    uses=("lanes",),
)


# What a step has to do about where people want to go: nothing, turn commands anew, or look up the way first.
_NOTHING, _AIM, _LOOK = 0, 1, 2


@dataclass(frozen=True)
class DEM(ContactScheme):
    """Soft discs.

    Parameters
    ----------
    stiffness : N/m, constant ``k`` of eq 5; 1.2e5 after Helbing et al. 2000.
    social : see `ContactScheme`.
    """

    stiffness: float = 1.2e5

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields("dem", self, stiffness=POSITIVE.because("the contact force k |D| (eq 5) has to push"))

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

    def slabs(self, people: int, driving: bool) -> int:
        """Return into how many slabs a crowd of so many is cut; the social force is not shared out."""
        return 1 if self.social is not None and driving else int(slabs_of(people))

    def advance(
        self, batch: StructRef, dt: float, n_substeps: int, first: int, stop: int, thread: int = 0, threads: int = 1
    ) -> None:
        """Advance the environments ``first:stop`` in place."""
        acting = influences(self.social, batch)
        _advance_range(batch, dt, n_substeps, first, stop, self.stiffness, *acting, thread, threads)


@inner_kernel
def _prepare(
    e: int,
    slabs: int,
    batch: Batch,
    dt: float,
    n_substeps: int,
    stiffness: float,
    reach: float,
    regions: bool | None,
    fresh: bool,
) -> None:
    """What one thread does before a step: the list, what is to be looked up, and the contacts of the last step of a call."""
    world, bodies, state = batch.world, batch.bodies, batch.state
    near, contacts, lanes, cut, g = (
        batch.workspace.neighbors,
        batch.history.contacts,
        batch.workspace.lanes,
        batch.workspace.cut,
        world.geometry_of_env[e],
    )
    begin, end = bodies.env_start[e], bodies.env_start[e + 1]
    cut.go[e] = batch.workspace.status[e] == OK and batch.workspace.substep[e] < n_substeps and cut.inside[e] > 0
    if cut.go[e] and cut.stray[e]:
        show_positions(begin, end, state.active, lanes.x, lanes.y, state.position)
        show_positions(begin, end, state.active, lanes.vx, lanes.vy, state.velocity)
        batch.workspace.status[e] = update_neighbors(e, batch, reach)
        cut.go[e] = batch.workspace.status[e] == OK
        follow_list(e, slabs, batch)
    if not cut.go[e]:
        return
    cut.look[e] = _AIM if fresh or state.time[e] <= cut.last_response[e] + dt else _NOTHING
    if batch.history.direction_age[e] > LOOK_EVERY - 0.5 * dt:
        cut.turn[e] = choose_turn(e, batch, regions)
        batch.history.direction_age[e] = 0.0
        cut.look[e] = _LOOK
        if regions is not None:
            show_positions(begin, end, state.active, lanes.x, lanes.y, state.position)
            follow_rules(e, batch)
    if batch.workspace.substep[e] == n_substeps - 1:
        show_positions(begin, end, state.active, lanes.x, lanes.y, state.position)
        find_contacts(e, g, world.boundary, bodies, state, near, contacts, 0.0)
        write_impulses(near.entry_start[e], contacts.number[e], contacts.gap, contacts.impulse, dt, stiffness)


@inner_kernel
def _push(
    e: int,
    low: int,
    high: int,
    row: int,
    batch: Batch,
    dt: float,
    stiffness: float,
    social: SocialParams | None,
) -> None:
    """Find the forces on and among the people ``low:high`` of one slab."""
    world, bodies, state = batch.world, batch.bodies, batch.state
    near, contacts, lanes, cut, g = (
        batch.workspace.neighbors,
        batch.history.contacts,
        batch.workspace.lanes,
        batch.workspace.cut,
        world.geometry_of_env[e],
    )
    first, last = cut.inside_start[row], cut.inside_stop[row]
    if cut.look[e] > _NOTHING:
        if cut.look[e] == _LOOK:
            show_positions(low, high, state.active, lanes.x, lanes.y, state.position)
            update_steering(e, first, last, batch, dt, cut.turn[e])
        aim(first, last, e, batch)
    if social is not None:
        show_positions(low, high, state.active, lanes.x, lanes.y, state.position)
        show_positions(low, high, state.active, lanes.wish_x, lanes.wish_y, batch.workspace.desired_velocity)
        copy_forces(low, high, batch.control.external_force, batch.history.force)
        add_social_forces(e, last, batch, social)
        press(low, high, state.active, batch.history.force, lanes.gx, lanes.gy)
    push_people(
        cut.pair_start[row],
        cut.pair_stop[row],
        high,
        near.owner,
        near.partner,
        near.contact_distance,
        lanes.x,
        lanes.y,
        stiffness,
        contacts.candidates,
        lanes.fx,
        lanes.fy,
        lanes.squeeze,
        contacts.old_key,
        contacts.old_history,
        cut.seen,
        row,
    )
    if cut.wall_start[row] < cut.wall_stop[row]:
        push_off_walls(
            g,
            cut.wall_start[row],
            cut.wall_stop[row],
            world.boundary,
            near.owner,
            near.partner,
            bodies.radius,
            lanes.x,
            lanes.y,
            stiffness,
            lanes.fx,
            lanes.fy,
            lanes.squeeze,
            cut.seen,
            row,
        )


@inner_kernel
def _walk(e: int, low: int, high: int, row: int, batch: Batch, dt: float, reach: float) -> None:
    """Move the people ``low:high`` of one slab, and see who has gone far."""
    contacts, lanes, cut, near = (
        batch.history.contacts,
        batch.workspace.lanes,
        batch.workspace.cut,
        batch.workspace.neighbors,
    )
    touched = cut.seen[row, COUNT] > 0.0
    for other in range(SLABS * e, row):
        if cut.seen[other, FURTHEST] >= low:
            touched = True
            receive(
                cut.pair_start[other],
                int(cut.seen[other, CARRIED]),
                low,
                high,
                contacts.old_key,
                contacts.old_history,
                lanes.fx,
                lanes.fy,
                lanes.squeeze,
            )
    if touched or cut.pressed[e] or reach > 0.0:
        accelerate(low, high, dt, lanes.fx, lanes.gx, lanes.per_mass, lanes.wish_x, lanes.per_tau, lanes.vx)
        accelerate(low, high, dt, lanes.fy, lanes.gy, lanes.per_mass, lanes.wish_y, lanes.per_tau, lanes.vy)
    else:
        accelerate_freely(low, high, dt, lanes.wish_x, lanes.per_tau, lanes.vx)
        accelerate_freely(low, high, dt, lanes.wish_y, lanes.per_tau, lanes.vy)
    fastest = greatest_speed(low, high, lanes.vx, lanes.vy, speed_limit(batch))
    move(low, high, dt, lanes.vx, lanes.x)
    move(low, high, dt, lanes.vy, lanes.y)
    cut.seen[row, FASTEST] = fastest
    if batch.control.bounded and cut.seen[row, OUTSIDE] + dt * fastest > cut.smallest[e] - 2.0 * MARGIN:
        first, last, g = cut.wall_start[row], cut.wall_stop[row], batch.world.geometry_of_env[e]
        hold_lanes_at_walls(g, first, last, batch.world.boundary, near.owner, near.partner, lanes, dt)
    if touched:
        book(low, high, dt, lanes.fx, lanes.push_x)
        book(low, high, dt, lanes.fy, lanes.push_y)
        book(low, high, dt, lanes.squeeze, lanes.crush)
    cut.seen[row, STRAYS] = count_strays(low, high, lanes.x, lanes.y, near.origin_x, near.origin_y, near.allowed)


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    first: int,
    stop: int,
    stiffness: float,
    social: SocialParams | None,
    reach: float,
    regions: bool | None,
    thread: int,
    threads: int,
) -> None:
    """Advance the environments ``first:stop``; several threads may do so together, each with its share of the slabs.

    Between two gates nobody writes what another reads; what is not worth sharing is left to thread 0.
    """
    cut, env_start = batch.workspace.cut, batch.bodies.env_start
    for e in range(first, stop):
        begin, end = env_start[e], env_start[e + 1]
        slabs = slabs_of(end - begin) if reach == 0.0 else 1
        together = threads if slabs > 1 else 1
        if thread >= together or batch.workspace.substep[e] >= n_substeps:
            continue
        fresh = True
        while True:
            if thread == 0:
                if fresh:
                    begin_call(e, slabs, batch, regions)
                else:
                    finish(e, slabs, batch, dt)
                    tick(e, batch, dt)
                _prepare(e, slabs, batch, dt, n_substeps, stiffness, reach, regions, fresh)
            fresh = False
            wait_for_all(cut.gate, together)
            if not cut.go[e]:
                break
            for s in range(thread, slabs, together):
                low, high = slab_start(s, slabs, begin, end), slab_start(s + 1, slabs, begin, end)
                _push(e, low, high, SLABS * e + s, batch, dt, stiffness, social)
            wait_for_all(cut.gate, together)
            for s in range(thread, slabs, together):
                low, high = slab_start(s, slabs, begin, end), slab_start(s + 1, slabs, begin, end)
                _walk(e, low, high, SLABS * e + s, batch, dt, reach)
            wait_for_all(cut.gate, together)
        for s in range(thread, slabs, together):
            leave_lanes(slab_start(s, slabs, begin, end), slab_start(s + 1, slabs, begin, end), batch)
