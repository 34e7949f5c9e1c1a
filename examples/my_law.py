"""A contact law of your own in one file: copy it, and change what stands under "the law".

    P_c = h max(0, -k D_c - c w_c)     if D_c < 0, along the normal          a spring and a dashpot
    u+  = u + (h f + B^T P) / m,       q+ = q + h u+

Try it:  crowd-env run room-v0 --scheme examples/my_law.py:MyLaw    or in Python    CrowdEnv(physics=MyLaw())
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.bounds import hold_to_speed, stay_within_bounds
from crowd_env.physics.driving_force import Influences, regular_forces
from crowd_env.physics.exits import leave
from crowd_env.physics.scheme import ContactScheme, SchemeInfo
from crowd_env.physics.steering import steer
from crowd_env.physics.step import begin_call, contact_range, detect, record_contacts, tick
from crowd_env.physics.workspace import Batch

INFO = SchemeInfo(
    name="my-law",
    title="soft discs: spring and dashpot",
    reference="Cundall, Strack 1979",
    order=1,
    conserves_energy_at_contact=False,
    overlap="some centimeters, the softness of the spring",
    stable_step="2 / sqrt(2 k / m_min)",
    uses=("desired_velocity", "force", "previous_position"),  # arrays that it needs, see physics/workspace.py
)


class Params(NamedTuple):
    """The parameters as kernels read them."""

    stiffness: float  # N/m
    damping: float  # N s/m


@dataclass(frozen=True)
class MyLaw(ContactScheme):
    """Soft discs whose contacts lose energy; parameters in SI units."""

    stiffness: float = 1.2e5
    damping: float = 500.0

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO

    def stable_dt(self, bodies: Bodies) -> float:
        """Return the largest stable step [s]."""
        return float(min(2.0 / np.sqrt(2.0 * self.stiffness / bodies.mass.min()), super().stable_dt(bodies)))

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return an overlap [m] that an impact at twice the desired speed does not exceed."""
        return float(2.0 * bodies.desired_speed.max() * np.sqrt(bodies.mass.max() / self.stiffness))

    @property
    def kernel(self) -> Callable[..., None]:
        """The loop below."""
        return _advance_range

    def parameters(self) -> tuple[Any, ...]:
        """Return what the loop takes last."""
        return (Params(self.stiffness, self.damping),)


# ------------------------------------------------------------------------------------------------------------- the law


@inner_kernel
def _push(e: int, batch: Batch, dt: float, params: Params) -> None:
    """Write the impulses of all contacts [N s], then add them to the velocities: the order of contacts plays no part."""
    contacts, velocity, mass = batch.history.contacts, batch.state.velocity, batch.bodies.mass
    contact_i, contact_j, gap, normal, impulse = contacts.i, contacts.j, contacts.gap, contacts.normal, contacts.impulse
    start, stop = contact_range(e, batch)
    for c in range(start, stop):
        i, j, nx, ny = contact_i[c], contact_j[c], normal[c, 0], normal[c, 1]
        speed = nx * velocity[i, 0] + ny * velocity[i, 1]  # of separation; the normal points from j to i
        if j >= 0:  # else a wall, which rests
            speed -= nx * velocity[j, 0] + ny * velocity[j, 1]
        impulse[c, 0] = dt * max(0.0, -params.stiffness * gap[c] - params.damping * speed)
        impulse[c, 1] = 0.0  # tangential
    for c in range(start, stop):
        i, j = contact_i[c], contact_j[c]
        for k in range(2):
            velocity[i, k] += impulse[c, 0] * normal[c, k] / mass[i]
            if j >= 0:
                velocity[j, k] -= impulse[c, 0] * normal[c, k] / mass[j]


# ---------------------------------------------------------------------------------- the rest of a step: keep it as it is


@inner_kernel
def _accelerate(e: int, rank_stop: int, batch: Batch, dt: float) -> None:
    """Add all forces but contact to the velocities."""
    inside, velocity, force, mass = batch.workspace.inside, batch.state.velocity, batch.history.force, batch.bodies.mass
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        for k in range(2):
            velocity[i, k] += dt * force[i, k] / mass[i]


@inner_kernel
def _move(e: int, rank_stop: int, batch: Batch, dt: float, limit: float) -> float:
    """Move everyone, no faster than ``limit`` [m/s]; returns the longest path [m]."""
    inside, previous = batch.workspace.inside, batch.workspace.previous_position
    position, velocity = batch.state.position, batch.state.velocity
    longest = dt * hold_to_speed(e, rank_stop, batch, velocity, limit)
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        for k in range(2):
            previous[i, k] = position[i, k]
            position[i, k] += dt * velocity[i, k]
    return float(longest)


@kernel
def _advance_range(
    batch: Batch, dt: float, n_substeps: int, env_first: int, env_stop: int, acting: Influences, params: Params
) -> None:
    """Advance the environments ``env_first:env_stop`` to step ``n_substeps`` of this call, one after the other."""
    for e in range(env_first, env_stop):
        rank_start = batch.bodies.env_start[e]
        rank_stop, limit, smallest = begin_call(e, batch, acting)
        while batch.workspace.substep[e] < n_substeps and rank_stop > rank_start:
            # Contacts: all pairs with a gap below 0, and neighbors as far as the social force reaches.
            if not detect(e, batch, 0.0, acting.reach):
                break  # the list is too short: Python makes it longer and calls again
            # Where everyone wants to go, and all forces but contact.
            steer(e, rank_stop, batch, dt, acting)
            regular_forces(e, rank_stop, batch, dt, acting)
            # The law: impulses and velocities, then the sums that rewards and reports read.
            _push(e, batch, dt, params)
            deepest = record_contacts(e, batch)
            # Motion, within the bounds of every scheme.
            _accelerate(e, rank_stop, batch, dt)
            longest = _move(e, rank_stop, batch, dt, limit)
            if not stay_within_bounds(e, rank_stop, batch, deepest, smallest, longest):
                break
            # Exits and clock.
            rank_stop = leave(e, rank_stop, batch, dt)
            tick(e, batch, dt)
