"""NSM2: percussions from a pseudopotential of dissipation (Frémond), in the form of Pécol et al. 2011 (eqs 8-10).

    M (u(n+1) - u(n)) = p_ext + B^T P,   p_ext = h f(t(n))
    P_c = -lambda_c K_N (w- + w+) / 2 + mu_c,    0 <= mu_c orthogonal to w+ >= 0      as printed
                                                 0 <= mu_c orthogonal to w+ + max(w-, 0) >= 0     our default: dissipative
    q(n+1) = q(n) + h (u(n) + u(n+1)) / 2

A contact is a pair with D(q(n)) <= 0; lambda_c = 1 only if it approaches at t(n) (w- < 0): without this gate contacts stick,
against Fig 2c.  Binary restitution e = max(0, (K_N - 2 m_e) / (K_N + 2 m_e)), so K_N -> infinity is elastic and K_N = 2 m_e
exactly inelastic; tangentially u_T+ = u_T- (2 m_e - K_T) / (2 m_e + K_T).  The law acts on velocities alone: an overlap of the
order of h times the closing speed remains, as an error of the scheme, not of the solver.
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Literal

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.checks import SHARE, Range
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.bounds import hold_to_speed, stay_within_bounds
from crowd_env.physics.constraints import Percussion, assemble_no_overlap, assemble_percussions, set_impulses
from crowd_env.physics.driving_force import Influences, regular_forces
from crowd_env.physics.exits import leave
from crowd_env.physics.neighbors.update import FULL
from crowd_env.physics.scheme import IterativeScheme, SchemeInfo
from crowd_env.physics.solvers import Stopping, solve
from crowd_env.physics.steering import steer
from crowd_env.physics.step import begin_call, contact_range, detect, extent_of, record_contacts, record_solver, tick
from crowd_env.physics.workspace import Batch

INFO = SchemeInfo(
    name="nsm2",
    title="percussions: pseudopotential of dissipation, dissipative reaction",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 8-10; Frémond 1995, 2007",
    order=1,
    conserves_energy_at_contact=True,
    overlap="time step times closing speed, up to about 40 mm at 0.01 s in a room of 20; it shrinks with the time step",
    stable_step="2 tau_min, from the explicit driving force",
    uses=("constraints", "desired_velocity", "force", "previous_position", "previous_velocity", "correction_velocity"),
)

_TITLE = "percussions, reaction as printed: makes energy where many touch at once"
PRINTED = replace(INFO, name="nsm2-printed", title=_TITLE)

_DISSIPATES = Range(0.0, infinite=True).because("a contact dissipates, restitution (K_N - 2 m_e) / (K_N + 2 m_e)")

# A contact has D <= 0; the narrow phase keeps what lies strictly below its margin.
_TOUCHING = 1e-12  # m


@dataclass(frozen=True)
class NSM2(IterativeScheme):
    """Discs that collide by percussions.

    Parameters
    ----------
    normal_dissipation : kg, ``K_N`` of eq 9; 1e5 (nearly elastic) as in Table 4, infinite for exactly elastic.
    tangential_dissipation : kg, ``K_T`` of eq 9; 0 = frictionless as in Table 4.
    reaction : which reaction forbids approach after the step.  "dissipative" is an EXTENSION: w+ >= -max(w-, 0), i.e. the mean
        speed of the step must not approach; then contacts never make energy.  "printed" (eq 10): w+ >= 0 for every overlapping
        contact; this does work on one that was separating already, and many bodies in contact gain energy: a crowd of 2000
        explodes.  The two agree where only two bodies touch.
    position_correction : share of every overlap that each step takes back, 0 to 1.  An EXTENSION, since the law of the paper
        acts on velocities alone: people are moved apart by the least displacement (mass-weighted), without any velocity.
    tolerance, relative_tolerance, max_iterations, social : see `IterativeScheme` and `ContactScheme`.
    """

    normal_dissipation: float = 1e5
    tangential_dissipation: float = 0.0
    _: KW_ONLY
    reaction: Literal["dissipative", "printed"] = "dissipative"
    position_correction: float = 0.0

    ALLOWED = {
        **IterativeScheme.ALLOWED,
        **dict.fromkeys(("normal_dissipation", "tangential_dissipation"), _DISSIPATES),
        "position_correction": SHARE,
    }

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO if self.reaction == "dissipative" else PRINTED

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return one step of head-on closing at twice the desired speed, since elastic contacts can double it."""
        return 4.0 * dt * float(bodies.desired_speed.max())

    @property
    def kernel(self) -> Callable[..., None]:
        """The compiled loop."""
        return _advance_range

    def parameters(self) -> tuple[Any, ...]:
        """Return the dissipation, the stopping rule of the solver, and the share of an overlap that a step takes back."""
        params = Percussion(self.normal_dissipation, self.tangential_dissipation, self.reaction == "dissipative")
        return params, self.stopping(), self.position_correction or None


@inner_kernel
def _detect(e: int, batch: Batch, rough: bool, reach: float) -> bool:
    """Find the touching contacts of environment ``e``; False (with the reason in `status`) if they or their rows do not fit."""
    if not detect(e, batch, _TOUCHING, reach):
        return False
    contact_start, contact_stop = contact_range(e, batch)
    most_rows = (2 if rough else 1) * (contact_stop - contact_start)  # a rough contact takes two
    if contact_start + most_rows > batch.workspace.neighbors.entry_start[e + 1]:
        batch.workspace.status[e] = FULL
        return False
    return True


@inner_kernel
def _accelerate(e: int, rank_stop: int, batch: Batch, dt: float) -> None:
    """Keep u(n) and add the regular forces: u(n) + M^-1 p_ext."""
    inside, previous = batch.workspace.inside, batch.workspace.previous_velocity
    force, velocity, mass = batch.history.force, batch.state.velocity, batch.bodies.mass
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        for k in range(2):
            previous[i, k] = velocity[i, k]
            velocity[i, k] += dt * force[i, k] / mass[i]


@inner_kernel
def _collide(e: int, batch: Batch, params: Percussion, stopping: Stopping) -> float:
    """Write the velocities after the percussions of this step; returns the deepest overlap with a wall [m]."""
    extent = extent_of(e, batch)
    if extent.contact_stop == extent.contact_start:
        return 0.0
    contacts, constraints, mass = batch.history.contacts, batch.workspace.constraints, batch.bodies.mass
    rows = assemble_percussions(extent, contacts, mass, batch.workspace.previous_velocity, constraints, params)
    v, compliance = batch.state.velocity, constraints.compliance
    sweeps, residual, converged = solve(extent, rows, rows, mass, v, constraints, compliance, stopping)
    set_impulses(extent, rows, contacts, mass, constraints)
    record_solver(e, batch, sweeps, residual, converged)
    return record_contacts(e, batch, True)


@inner_kernel
def _move(e: int, rank_stop: int, batch: Batch, dt: float, limit: float) -> float:
    """Move all people, at ``limit`` [m/s] at most; returns the longest path [m]."""
    inside, before = batch.workspace.inside, batch.workspace.previous_velocity
    previous = batch.workspace.previous_position
    position, velocity = batch.state.position, batch.state.velocity
    hold_to_speed(e, rank_stop, batch, velocity, limit)
    longest = 0.0
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        dx, dy = 0.5 * dt * (before[i, 0] + velocity[i, 0]), 0.5 * dt * (before[i, 1] + velocity[i, 1])
        previous[i, 0], previous[i, 1] = position[i, 0], position[i, 1]
        position[i, 0] += dx
        position[i, 1] += dy
        longest = max(longest, dx * dx + dy * dy)
    return np.sqrt(longest)


@inner_kernel
def _separate(e: int, batch: Batch, dt: float, stopping: Stopping, correction: float) -> float:
    """Move overlapping people apart by the least mass-weighted displacement that takes back a share of every overlap.

    This is the projection of NSM1 for a velocity that is not kept.  Returns the longest displacement [m].
    """
    contacts, constraints, mass = batch.history.contacts, batch.workspace.constraints, batch.bodies.mass
    position, v = batch.state.position, batch.workspace.correction_velocity
    extent = extent_of(e, batch)
    slot_start, slot_stop = extent.slot_start, extent.slot_stop
    for i in range(index(slot_start), index(slot_stop)):
        v[i, 0], v[i, 1] = 0.0, 0.0
    active_rows = assemble_no_overlap(extent, contacts, mass, v, constraints, dt / correction, False)
    rows = extent.contact_stop - extent.contact_start
    solve(extent, rows, active_rows, mass, v, constraints, None, stopping)
    longest = 0.0
    for i in range(index(slot_start), index(slot_stop)):
        dx, dy = dt * v[i, 0], dt * v[i, 1]
        position[i, 0] += dx
        position[i, 1] += dy
        longest = max(longest, dx * dx + dy * dy)
    return np.sqrt(longest)


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    env_first: int,
    env_stop: int,
    acting: Influences,
    params: Percussion,
    stopping: Stopping,
    correction: float | None,
) -> None:
    """Advance the environments ``env_first:env_stop`` to step ``n_substeps`` of this call, one after the other."""
    for e in range(env_first, env_stop):
        rank_start = batch.bodies.env_start[e]
        rank_stop, limit, smallest = begin_call(e, batch, acting)
        while batch.workspace.substep[e] < n_substeps and rank_stop > rank_start:
            # Contacts at q(n).
            if not _detect(e, batch, params.k_tangent > 0.0, acting.reach):
                break
            # Desired velocities, and all forces but contact.
            steer(e, rank_stop, batch, dt, acting)
            regular_forces(e, rank_stop, batch, dt, acting)
            # Velocities u(n+1): regular forces, then percussions (eqs 8-10).
            _accelerate(e, rank_stop, batch, dt)
            deepest = _collide(e, batch, params, stopping)
            # Positions, by the mean velocity of the step.
            longest = _move(e, rank_stop, batch, dt, limit)
            # Position correction, if chosen.
            if correction is not None:
                longest += _separate(e, batch, dt, stopping, correction)
            # Bounds.
            if not stay_within_bounds(e, rank_stop, batch, deepest, smallest, longest):
                break
            # Exits and clock.
            rank_stop = leave(e, rank_stop, batch, dt)
            tick(e, batch, dt)
