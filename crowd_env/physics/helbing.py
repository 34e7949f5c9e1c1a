"""Helbing: soft discs that rub, and keep apart by a social force, after Helbing, Farkas, Vicsek 2000.

With overlap d = max(0, -D), unit normal n from j to i and unit tangent t = n turned left:
    f_ij = [A exp(-D / B) + k d] n + kappa d ((u_j - u_i) . t) t            walls the same, at rest
    m_i du_i/dt = m_i (v_d e_d - u_i) / tau + sum_j f_ij + sum_walls f_iW
The term with A is `SocialForce`, without anisotropy.  Pécol et al. 2011 call this model the adapted DEM.

A step of h is symplectic Euler, but for the friction.  That is stiff: 10 cm of overlap stop a slip within 2 ms.  So it is taken
at the end of the step, for all contacts together (backward Euler): u* are the velocities after all other forces, and
    u(n+1) = u* + M^-1 B^T P,   P_c = -h kappa d_c (B u(n+1))_c                  B takes velocities to slips
Then friction never adds energy, for any h.  One damped sweep over the contacts in place of the solution lets a jam creep: at
5 m/s the room of `crowd_env.reproduce.helbing2000` was empty after 139 s with h = 5 ms and 187 s with 0.5 ms.  Solved, it is
empty after 193 s and 196 s.
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.bounds import hold_to_speed, stay_within_bounds
from crowd_env.physics.constraints import assemble_friction
from crowd_env.physics.dem import DEM
from crowd_env.physics.driving_force import Influences, regular_forces
from crowd_env.physics.exits import leave
from crowd_env.physics.scheme import IterativeScheme, SchemeInfo
from crowd_env.physics.social_force import SocialForce
from crowd_env.physics.solvers import Stopping, solve
from crowd_env.physics.steering import steer
from crowd_env.physics.step import (
    begin_call,
    contact_range,
    detect,
    extent_of,
    record_impulses,
    record_overlaps,
    record_solver,
    tick,
)
from crowd_env.physics.workspace import Batch

INFO = SchemeInfo(
    name="helbing",
    title="soft discs: linear spring, sliding friction, social force of people and walls",
    reference="Helbing, Farkas, Vicsek, Nature 407 (2000) 487",
    order=1,
    conserves_energy_at_contact=False,
    overlap="v / omega and the push of the crowd over k, some centimeters at k = 1.2e5 N/m: the softness of the body",
    stable_step="2 / sqrt(2 (k + A / B) / m_min), of two bodies of the smallest mass that just touch, and 2 tau_min",
    uses=("desired_velocity", "force", "previous_position", "constraints"),
    default_dt=5e-3,
)

# A and B of people and walls, the same all around.
_SOCIAL = replace(SocialForce.helbing(behind=1.0), wall_strength=2000.0)


@dataclass(frozen=True)
class Helbing(IterativeScheme):
    """Soft discs with sliding friction.

    Parameters
    ----------
    stiffness : N/m, ``k``.
    friction : kg/(m s), ``kappa``; 0 = frictionless.
    social : ``A`` = 2000 N and ``B`` = 0.08 m, of people and walls; see `ContactScheme`.
    tolerance, relative_tolerance, max_iterations : of the friction, see `IterativeScheme`.
    """

    stiffness: float = 1.2e5
    friction: float = 2.4e5
    _: KW_ONLY
    social: SocialForce | None = _SOCIAL
    relative_tolerance: float | None = 1e-3  # without it, friction that changes no speed by ``tolerance`` is left out

    ALLOWED = {
        **IterativeScheme.ALLOWED,
        "stiffness": POSITIVE.because("the contact force k d has to push"),
        "friction": NOT_NEGATIVE.because("a contact dissipates"),
    }

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO

    def stable_dt(self, bodies: Bodies) -> float:
        """Return 2 / omega of the stiffest pair that just touches, or 2 tau of the quickest drive; friction has no bound."""
        stiffness = self.stiffness
        if self.social is not None:
            stiffness += self.social.strength / self.social.length
        contact = 2.0 / np.sqrt(2.0 * stiffness / bodies.mass.min())
        return float(min(contact, super().stable_dt(bodies)))

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return that of `DEM`, which neither rubs nor repels before contact."""
        return DEM(self.stiffness).overlap_bound(bodies, dt)

    @property
    def kernel(self) -> Callable[..., None]:
        """The compiled loop."""
        return _advance_range

    def parameters(self) -> tuple[Any, ...]:
        """Return stiffness, friction and the stopping rule of the solver."""
        return self.stiffness, self.friction, self.stopping()


# ------------------------------------------------------------------------------------------------------------- the law


@inner_kernel
def _push(e: int, batch: Batch, dt: float, stiffness: float) -> None:
    """Write the normal impulses [N s] of all springs, and add them to the velocities."""
    contacts, velocity, mass = batch.history.contacts, batch.state.velocity, batch.bodies.mass
    contact_i, contact_j, gap, normal, impulse = contacts.i, contacts.j, contacts.gap, contacts.normal, contacts.impulse
    contact_start, contact_stop = contact_range(e, batch)
    for c in range(contact_start, contact_stop):
        i, j = contact_i[c], contact_j[c]
        size = -dt * stiffness * gap[c]
        impulse[c, 0] = size
        for k in range(2):
            velocity[i, k] += size * normal[c, k] / mass[i]
            if j >= 0:
                velocity[j, k] -= size * normal[c, k] / mass[j]


@inner_kernel
def _rub(e: int, batch: Batch, dt: float, friction: float, stopping: Stopping) -> None:
    """Write the tangential impulses [N s] of all contacts, from the velocities after all other forces, and add them.

    They are kept as start of the next step.
    """
    extent = extent_of(e, batch)
    rows = extent.contact_stop - extent.contact_start
    if rows == 0 or friction == 0.0:
        return
    contacts, constraints, mass = batch.history.contacts, batch.workspace.constraints, batch.bodies.mass
    assemble_friction(extent, contacts, mass, constraints, dt * friction)
    velocity, compliance = batch.state.velocity, constraints.compliance
    sweeps, residual, converged = solve(extent, rows, rows, mass, velocity, constraints, compliance, stopping)
    record_solver(e, batch, sweeps, residual, converged)
    reaction, coefficients, contact_i = constraints.reaction, constraints.coefficients, contacts.i
    for c in range(extent.contact_start, extent.contact_stop):
        contacts.impulse[c, 1] = reaction[c, 0] * coefficients[c, 3] * mass[contact_i[c]]  # share of i = 1 / (a m_i)
        contacts.history[c, 1] = contacts.impulse[c, 1]


# ---------------------------------------------------------------------------------------------------------------- steps


@inner_kernel
def _accelerate(e: int, rank_stop: int, batch: Batch, dt: float) -> None:
    """Add all forces but contact to the velocities."""
    inside, velocity, force, mass = batch.workspace.inside, batch.state.velocity, batch.history.force, batch.bodies.mass
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        rate = dt / mass[i]
        velocity[i, 0] += rate * force[i, 0]
        velocity[i, 1] += rate * force[i, 1]


@inner_kernel
def _move(e: int, rank_stop: int, batch: Batch, dt: float, limit: float) -> float:
    """Move all people, at ``limit`` [m/s] at most; returns the longest path [m]."""
    inside, previous = batch.workspace.inside, batch.workspace.previous_position
    position, velocity = batch.state.position, batch.state.velocity
    longest = dt * hold_to_speed(e, rank_stop, batch, velocity, limit)
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        previous[i, 0], previous[i, 1] = position[i, 0], position[i, 1]
        position[i, 0] += dt * velocity[i, 0]
        position[i, 1] += dt * velocity[i, 1]
    return float(longest)


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    env_first: int,
    env_stop: int,
    acting: Influences,
    stiffness: float,
    friction: float,
    stopping: Stopping,
) -> None:
    """Advance the environments ``env_first:env_stop`` to step ``n_substeps`` of this call, one after the other."""
    for e in range(env_first, env_stop):
        rank_start = batch.bodies.env_start[e]
        rank_stop, limit, smallest = begin_call(e, batch, acting)
        while batch.workspace.substep[e] < n_substeps and rank_stop > rank_start:
            # Contacts, and neighbors as far as the social force reaches.
            if not detect(e, batch, 0.0, acting.reach):
                break
            # Desired velocities, and all forces but contact: driving and social.
            steer(e, rank_stop, batch, dt, acting)
            regular_forces(e, rank_stop, batch, dt, acting)
            # Velocities: regular forces, springs, and friction last.
            _accelerate(e, rank_stop, batch, dt)
            _push(e, batch, dt, stiffness)
            _rub(e, batch, dt, friction, stopping)
            # Impulses and overlaps into the sums.
            record_impulses(e, batch, 1.0)
            deepest = record_overlaps(e, batch)
            # Positions and bounds.
            longest = _move(e, rank_stop, batch, dt, limit)
            if not stay_within_bounds(e, rank_stop, batch, deepest, smallest, longest):
                break
            # Exits and clock.
            rank_stop = leave(e, rank_stop, batch, dt)
            tick(e, batch, dt)
