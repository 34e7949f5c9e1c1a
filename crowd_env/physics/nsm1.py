"""NSM1: no overlap, by projection of a trial velocity (Maury and Venel), in the form of Pécol et al. 2011 (eqs 6, 7).

    u(n+1) = argmin 1/2 |v - V_trial|_M^2   subject to   D_c(q(n)) + h n_c . (v_i - v_j) >= 0 for every contact c
    q(n+1) = q(n) + h u(n+1)

The trial velocity is either V_trial = u(n) + (h/m) f (inertial: grains, and section 3 of the paper) or V_trial = v_d e_d
(spontaneous: Venel's crowd, without inertia).  Only the second gives the paper's flow of Table 5.  The law is perfectly
inelastic.  The linearised gap bounds the true one from below, so all overlap comes from the solver: h * tolerance.
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Literal

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.bounds import hold_to_speed, stay_within_bounds
from crowd_env.physics.constraints import assemble_no_overlap, restore_impulses, set_impulses, stash_impulses
from crowd_env.physics.driving_force import Influences, regular_forces
from crowd_env.physics.exits import leave
from crowd_env.physics.narrow_phase import gap_to_feature
from crowd_env.physics.scheme import IterativeScheme, SchemeInfo
from crowd_env.physics.solvers import Stopping, closing_speed, solve
from crowd_env.physics.steering import steer
from crowd_env.physics.step import begin_call, detect, extent_of, find_neighbors, record_contacts, record_solver, tick
from crowd_env.physics.workspace import Batch

INFO = SchemeInfo(
    name="nsm1",
    title="no overlap: projection of the desired (spontaneous) velocity",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 6-7; Maury 2006; Venel 2008",
    order=1,
    conserves_energy_at_contact=False,
    overlap="solver tolerance times time step, 0.1 mm with the defaults; it does not accumulate",
    stable_step="2 tau_min with inertia, from the explicit driving force; none without",
    uses=("constraints", "desired_velocity", "force", "previous_position", "trial_velocity"),
    impulses_are_forces=False,  # without inertia they only keep bodies apart: no body would feel them as a push
)

_TITLE = "no overlap: projection of the inertial velocity"
INERTIAL = replace(INFO, name="nsm1-inertial", title=_TITLE, impulses_are_forces=True)

LOOSE = replace(
    INFO,
    name="nsm1-loose",
    title="little overlap: projection of the desired (spontaneous) velocity, stopped early",
    overlap="solver tolerance times time step, 1.6 mm; in jams of 5000 people 0.5 mm (p99), 28 mm at most, at 12.5 m/s",
)

# Margin for contacts over the need of the trial speeds: a wider one costs less than solving a step twice.
_HEADROOM = 1.25


@dataclass(frozen=True)
class NSM1(IterativeScheme):
    """Discs that never overlap.

    Parameters
    ----------
    trial : "spontaneous" (Venel: the desired velocity itself) or "inertial" (velocity, driving and external force).
    tolerance, relative_tolerance, max_iterations, social : see `IterativeScheme` and `ContactScheme`.
    """

    trial: Literal["spontaneous", "inertial"] = "spontaneous"
    _: KW_ONLY
    tolerance: float = 1e-2

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO if self.trial == "spontaneous" else INERTIAL

    def stable_dt(self, bodies: Bodies) -> float:
        """Return 2 tau_min for the explicit driving force of the inertial form; the spontaneous one is always stable."""
        return np.inf if self.trial == "spontaneous" else super().stable_dt(bodies)

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return 2 h tolerance: h times the residual, twice for safety against rounding."""
        return 2.0 * dt * self.tolerance

    @property
    def drives(self) -> bool:
        """Only the inertial form has a driving force."""
        return self.trial == "inertial"

    def check(self, driving: bool) -> None:
        """Refuse passive grains without inertia."""
        if not driving and self.trial == "spontaneous":
            raise ValueError("nsm1: passive grains have no spontaneous velocity; use NSM1(trial='inertial')")

    @property
    def kernel(self) -> Callable[..., None]:
        """The compiled loop."""
        return _advance_range

    def parameters(self) -> tuple[Any, ...]:
        """Return whether the trial velocity is the spontaneous one, and when the solver stops."""
        return self.trial == "spontaneous", self.stopping()


@dataclass(frozen=True)
class NSM1Loose(NSM1):
    """`NSM1` with a solver that stops early: a third of the time, overlaps of a millimeter; parameters as there."""

    _: KW_ONLY
    tolerance: float = 0.16

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return LOOSE if self.trial == "spontaneous" else super().info


@inner_kernel
def _propose(e: int, rank_stop: int, batch: Batch, dt: float, spontaneous: bool) -> None:
    """Write V_trial = u + h f / m into `Workspace.trial_velocity`.

    A spontaneous velocity is the result of the forces for h = tau: without other forces, the desired velocity itself.  An
    external or social force shifts it by tau f / m, where the drive balances it.
    """
    inside, velocity, mass = batch.workspace.inside, batch.state.velocity, batch.bodies.mass
    relaxation_time, force, trial = batch.bodies.relaxation_time, batch.history.force, batch.workspace.trial_velocity
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        ahead = relaxation_time[i] if spontaneous else dt
        for k in range(2):
            trial[i, k] = velocity[i, k] + ahead * force[i, k] / mass[i]


@inner_kernel
def _is_missed(e: int, batch: Batch, margin: float, dt: float) -> bool:
    """Whether a pair, or a body and a wall, overlaps after this step after a gap of ``margin`` or more before it."""
    near, boundary, g = batch.workspace.neighbors, batch.world.boundary, batch.world.geometry_of_env[e]
    owner, partner, contact_distance = near.owner, near.partner, near.contact_distance
    present, x, v, radius = (
        batch.state.present,
        batch.state.position,
        batch.workspace.trial_velocity,
        batch.bodies.radius,
    )
    missed = 0
    for entry in range(index(near.entry_start[e]), index(near.pair_end[e])):
        i, j = owner[entry], partner[entry]
        dx, dy, touching = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], contact_distance[entry]
        ahead_x, ahead_y = dx + dt * (v[i, 0] - v[j, 0]), dy + dt * (v[i, 1] - v[j, 1])
        was_apart = dx * dx + dy * dy >= (touching + margin) * (touching + margin)
        overlaps = ahead_x * ahead_x + ahead_y * ahead_y < touching * touching
        missed += was_apart & overlaps & present[i] & present[j]
    for entry in range(index(near.pair_end[e]), index(near.wall_end[e])):
        i, k = owner[entry], np.int64(partner[entry])
        gap, _, _ = gap_to_feature(x[i, 0], x[i, 1], radius[i], boundary, g, k)
        after, _, _ = gap_to_feature(x[i, 0] + dt * v[i, 0], x[i, 1] + dt * v[i, 1], radius[i], boundary, g, k)
        missed += (gap >= margin) & (after < 0.0) & present[i]
    return missed > 0


@inner_kernel
def _project(
    e: int, rank_stop: int, batch: Batch, dt: float, spontaneous: bool, stopping: Stopping, reach: float
) -> bool:
    """Project the trial velocities in place (eq 6); False if the contacts could not be found.

    Contacts are gathered up to the gap that two people could close at their trial velocities.  The projection can make a few
    people faster than that.  Then all pairs are tested once more.  If an unlisted pair would overlap, the gap is widened and
    the step is solved again from a warm start, so no contact is ever missed.
    """
    mass, inside, v = batch.bodies.mass, batch.workspace.inside, batch.workspace.trial_velocity
    rank_start = batch.bodies.env_start[e]
    contacts, constraints = batch.history.contacts, batch.workspace.constraints
    sweeps, margin, listed, solved = 0, -1.0, reach, -np.inf
    while True:
        _propose(e, rank_stop, batch, dt, spontaneous)
        if margin < 0.0:
            margin = _HEADROOM * dt * closing_speed(rank_start, rank_stop, inside, v) + 1e-3
            # Fast people stay fast: a list up to their reach need not be built twice a step.
            before = closing_speed(rank_start, rank_stop, inside, batch.state.velocity)
            listed = max(reach, _HEADROOM * dt * before + 1e-3)
        if not detect(e, batch, margin, listed):
            return False
        extent = extent_of(e, batch)
        rows = extent.contact_stop - extent.contact_start
        restore_impulses(extent, solved, contacts, constraints)
        active_rows = assemble_no_overlap(extent, contacts, mass, v, constraints, dt, True)
        iterations, residual, converged = solve(extent, rows, active_rows, mass, v, constraints, None, stopping)
        sweeps += iterations
        needed = dt * closing_speed(rank_start, rank_stop, inside, v)
        set_impulses(extent, rows, contacts, mass, constraints)
        if needed > margin and not find_neighbors(e, batch, max(needed, reach)):
            return False
        if not (needed > margin and _is_missed(e, batch, margin, dt)):
            record_solver(e, batch, sweeps, residual, converged)
            return True
        stash_impulses(extent, contacts, constraints)
        solved, margin = margin, 1.2 * needed


@inner_kernel
def _move(e: int, rank_stop: int, batch: Batch, dt: float, limit: float) -> float:
    """Move all people, at ``limit`` [m/s] at most; returns the longest path [m]."""
    inside, after = batch.workspace.inside, batch.workspace.trial_velocity
    previous = batch.workspace.previous_position
    position, velocity = batch.state.position, batch.state.velocity
    longest = dt * hold_to_speed(e, rank_stop, batch, after, limit)
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        for k in range(2):
            previous[i, k] = position[i, k]
            velocity[i, k] = after[i, k]
            position[i, k] += dt * after[i, k]
    return longest


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    env_first: int,
    env_stop: int,
    acting: Influences,
    spontaneous: bool,
    stopping: Stopping,
) -> None:
    """Advance the environments ``env_first:env_stop`` to step ``n_substeps`` of this call, one after the other.

    A step that lacks memory is repeated as a whole: it reads nothing that it has written.
    """
    for e in range(env_first, env_stop):
        rank_start = batch.bodies.env_start[e]
        rank_stop, limit, smallest = begin_call(e, batch, acting)
        while batch.workspace.substep[e] < n_substeps and rank_stop > rank_start:
            # Pairs within reach of forces at a distance; without these, the search for contacts builds the list.
            if acting.reach > 0.0 and not find_neighbors(e, batch, acting.reach):
                break
            # Desired velocities, and all forces but contact.
            steer(e, rank_stop, batch, dt, acting)
            regular_forces(e, rank_stop, batch, dt, acting)
            # Trial velocities and their projection onto velocities without overlap (eqs 6, 7).
            if not _project(e, rank_stop, batch, dt, spontaneous, stopping, acting.reach):
                break
            # Impulses and overlaps into the sums, and for the solver of the next step.
            deepest = record_contacts(e, batch)
            # Positions.
            longest = _move(e, rank_stop, batch, dt, limit)
            # Bounds.
            if not stay_within_bounds(e, rank_stop, batch, deepest, smallest, longest):
                break
            # Exits and clock.
            rank_stop = leave(e, rank_stop, batch, dt)
            tick(e, batch, dt)
