"""DEM: the soft contact of Cundall and Helbing, as Pécol et al. 2011 write it (eqs 3-5).

    g_ij = -k min(0, D_ij) e_ji            a linear spring that pushes only while the discs overlap
    u(n+1) = u(n) + h M^-1 (f + g),  q(n+1) = q(n) + h u(n+1)      symplectic Euler

Equation 5 is printed with the unit vector from i to j and would attract; the sign here pushes the two apart.
With omega = sqrt(k / m_e), 1/m_e = 1/m_i + 1/m_j, a contact lasts pi / omega and the deepest overlap is v / omega.
"""

from dataclasses import dataclass

import numpy as np

from crowd_env._jit import kernel
from crowd_env.physics.contacts import Contacts
from crowd_env.physics.forces import desired_velocities, regular_forces
from crowd_env.physics.require import require_positive
from crowd_env.physics.scheme import SchemeInfo
from crowd_env.physics.social import SocialForce, SocialLaw, social_law
from crowd_env.physics.step import detect, leave, record_overlaps, record_pushes, tick, unfinished
from crowd_env.physics.world import Batch
from crowd_env.state import Bodies, CrowdState, Floats

INFO = SchemeInfo(
    name="dem",
    title="soft discs: linear spring, symplectic Euler",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 3-5; stiffness of Helbing, Farkas, Vicsek 2000",
    order=1,
    conserves_energy_at_contact=True,
    overlap="v / omega, some centimetres at k = 1.2e5 N/m; it is the softness, not an error of the time step",
    stable_step="2 / sqrt(2 k / m_min), from h omega < 2 for two bodies of the smallest mass, and 2 tau_min",
)


@dataclass(frozen=True)
class DEM:
    """Soft discs.

    Parameters
    ----------
    stiffness : N/m, constant ``k`` of eq 5; 1.2e5 after Helbing et al. 2000.
    social : social force; None = people do not mind until they touch.
    """

    stiffness: float = 1.2e5
    social: SocialForce | None = None

    def __post_init__(self) -> None:
        require_positive("dem", "the contact force k |D| (eq 5) has to push", stiffness=self.stiffness)

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO

    def stable_dt(self, bodies: Bodies) -> float:
        """Return 2 / omega of the stiffest pair (h omega < 2 for a binary contact), or 2 tau of the quickest drive."""
        contact = 2.0 / np.sqrt(2.0 * self.stiffness / bodies.mass.min())
        return float(min(contact, 2.0 * bodies.relaxation_time.min()))

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return head-on closing speed / omega plus the static push of the largest crowd leaning on one contact."""
        fastest = bodies.desired_speed.max()
        impact = 2.0 * fastest * np.sqrt(bodies.mass.max() / self.stiffness)
        drive = bodies.mass * bodies.desired_speed / bodies.relaxation_time
        lean = np.add.reduceat(drive, bodies.env_start[:-1]).max() / self.stiffness
        return float(impact + lean)

    def check(self, driving: bool) -> None:
        """Accept both uses."""

    def advance(self, batch: Batch, dt: float, n_substeps: int, first: int, stop: int) -> None:
        """Advance the environments ``first:stop`` in place."""
        social = social_law(self.social, batch.control.driving)
        _advance_range(batch, dt, n_substeps, first, stop, self.stiffness, social)


@kernel
def _springs(begin: int, end: int, contacts: Contacts, force: Floats, dt: float, stiffness: float) -> None:
    """Add the forces (eqs 4, 5) of the contacts ``begin:end`` to ``force``."""
    for c in range(begin, end):
        size = -stiffness * min(0.0, contacts.gap[c])
        contacts.impulse[c, 0] = size * dt
        contacts.impulse[c, 1] = 0.0
        i, j = contacts.i[c], contacts.j[c]
        force[i, 0] += size * contacts.normal[c, 0]
        force[i, 1] += size * contacts.normal[c, 1]
        if j >= 0:
            force[j, 0] -= size * contacts.normal[c, 0]
            force[j, 1] -= size * contacts.normal[c, 1]


@kernel
def _integrate(e: int, bodies: Bodies, state: CrowdState, force: Floats, previous: Floats, dt: float) -> None:
    """Symplectic Euler (eq 3)."""
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if state.active[i]:
            for k in range(2):
                previous[i, k] = state.position[i, k]
                state.velocity[i, k] += dt * force[i, k] / bodies.mass[i]
                state.position[i, k] += dt * state.velocity[i, k]


@kernel
def _advance_one(e: int, batch: Batch, dt: float, n_substeps: int, stiffness: float, social: SocialLaw) -> None:
    world, bodies, state, control, memory = batch
    near, contacts, g = memory.near, memory.contacts, world.geometry_of_env[e]
    while unfinished(e, bodies.env_start, state.active, memory.progress, n_substeps):
        if not detect(
            e, g, world.boundary, memory.door_open, bodies, state, near, contacts, memory.status, 0.0, social.cutoff
        ):
            return
        desired_velocities(e, world, bodies, state, control, memory, dt)
        regular_forces(
            e, g, world.boundary, bodies, state, near, control, memory.desired, memory.heading, memory.force, social
        )
        first = near.entry_start[e]
        last = first + contacts.number[e]
        _springs(first, last, contacts, memory.force, dt, stiffness)
        record_pushes(first, last, contacts, memory.push, memory.crush, 1.0)
        record_overlaps(e, first, last, contacts, memory.diagnostics)
        _integrate(e, bodies, state, memory.force, memory.previous, dt)
        leave(e, g, world.boundary, bodies, state, memory.previous, dt)
        tick(e, state.time, memory.progress, dt)


@kernel
def _advance_range(
    batch: Batch, dt: float, n_substeps: int, first: int, stop: int, stiffness: float, social: SocialLaw
) -> None:
    for e in range(first, stop):
        _advance_one(e, batch, dt, n_substeps, stiffness, social)
