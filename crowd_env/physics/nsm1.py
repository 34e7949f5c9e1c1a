"""NSM1: no overlap, by projection of a trial velocity (Maury and Venel), as Pécol et al. 2011 write it (eqs 6, 7).

    u(n+1) = argmin 1/2 |v - V_trial|_M^2   subject to   D_c(q(n)) + h n_c . (v_i - v_j) >= 0 for every contact c
    q(n+1) = q(n) + h u(n+1)

The trial velocity is either V_trial = u(n) + (h/m) f (inertial: grains, and section 3 of the paper) or V_trial = v_d e_d
(spontaneous: Venel's crowd, without inertia).  Only the second gives the paper's flow of Table 5.  The law is perfectly
inelastic.  The linearised gap bounds the true one from below, so what overlap there is comes from the solver: h * tolerance.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel, kernel
from crowd_env._kernels.struct_ref import StructRef
from crowd_env.checks import POSITIVE, check_fields, require_positive
from crowd_env.physics.bounds import hold_to_speed, least_radius, speed_limit, stay_within_bounds
from crowd_env.physics.constraints import give_impulses, keep_impulses, pose_no_overlap, take_impulses
from crowd_env.physics.driving_force import influences, regular_forces, reset_routes
from crowd_env.physics.exits import leave
from crowd_env.physics.neighbors.update import FULL, OK, update_neighbors
from crowd_env.physics.scheme import SchemeInfo
from crowd_env.physics.social_force import SocialForce, SocialLaw
from crowd_env.physics.solvers import SolverName, Stopping, closing_speed, solve
from crowd_env.physics.step import (
    detect,
    list_active,
    record_impulses,
    record_overlaps,
    record_solver,
    store_warm_start,
    tick,
)
from crowd_env.physics.workspace import Batch
from crowd_env.state import Bodies

INFO = SchemeInfo(
    name="nsm1",
    title="no overlap: projection of the desired (spontaneous) velocity",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 6-7; Maury 2006; Venel 2008",
    order=1,
    conserves_energy_at_contact=False,
    overlap="solver tolerance times time step, 0.1 mm with the defaults; it does not accumulate",
    stable_step="2 tau_min with inertia, from the explicit driving force; none without",
    uses=("problem", "desired_velocity", "force", "previous_position", "previous_velocity"),
)


# In History.phase: whether the forces of the present step have been found before it ran out of room.
_UNKNOWN, _KNOWN = 0, 1

# Margin for contacts over what the speeds before and of the trial ask for: wider costs less than to solve a step twice.
_HEADROOM = 1.25


@dataclass(frozen=True)
class NSM1:
    """Discs that never overlap.

    Parameters
    ----------
    trial : "spontaneous" (Venel: the desired velocity itself) or "inertial" (velocity, driving and external force).
    tolerance : m/s, complementarity residual at which the solver stops.
    relative_tolerance : if given, the residual (its 2-norm over the contacts) must also be below this share of what it would be
        without any impulse.
    max_iterations : after so many a step is given up and counted in ``Diagnostics.unconverged``.
    solver : "gauss-seidel", "accelerated" (with momentum), or "auto": the faster one, here the second.
    social : social force; None = people do not mind until they touch.
    """

    trial: Literal["spontaneous", "inertial"] = "spontaneous"
    tolerance: float = 1e-2
    relative_tolerance: float | None = None
    max_iterations: int = 20_000
    solver: SolverName = "auto"
    social: SocialForce | None = None

    def __post_init__(self) -> None:
        require_positive("nsm1", "the solver stops on it", tolerance=self.tolerance, max_iterations=self.max_iterations)
        check_fields("nsm1", self, relative_tolerance=POSITIVE)

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        if self.trial == "spontaneous":
            return INFO
        return replace(INFO, name="nsm1-inertial", title="no overlap: projection of the inertial velocity")

    def stable_dt(self, bodies: Bodies) -> float:
        """Unconditional for the contact; the explicit driving force of the inertial form needs h < 2 tau."""
        return np.inf if self.trial == "spontaneous" else 2.0 * float(bodies.relaxation_time.min())

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return 2 h tolerance: h times the residual, twice for safety against rounding."""
        return 2.0 * dt * self.tolerance

    def check(self, driving: bool) -> None:
        """Refuse passive grains without inertia."""
        if not driving and self.trial == "spontaneous":
            raise ValueError("nsm1: passive grains have no spontaneous velocity; use NSM1(trial='inertial')")

    def slabs(self, people: int, driving: bool) -> int:
        """One: a crowd is stepped by one thread."""
        return 1

    def advance(
        self, batch: StructRef, dt: float, n_substeps: int, first: int, stop: int, thread: int = 0, threads: int = 1
    ) -> None:
        """Advance the environments ``first:stop`` in place."""
        accelerated = self.solver != "gauss-seidel"
        relative = np.inf if self.relative_tolerance is None else self.relative_tolerance
        law = Stopping(self.tolerance, relative, self.max_iterations, accelerated)
        _advance_range(
            batch, dt, n_substeps, first, stop, self.trial == "spontaneous", law, *influences(self.social, batch)
        )


@inner_kernel
def _try_velocities(first: int, last: int, batch: Batch, dt: float, spontaneous: bool) -> None:
    """Write V_trial = u + h f / m into `Workspace.previous_velocity`.

    A spontaneous velocity is what the forces would lead to if h were tau: without others, the desired velocity itself; an
    external or social force shifts it by tau f / m, where the drive balances it.
    """
    inside, velocity, mass = batch.workspace.inside, batch.state.velocity, batch.bodies.mass
    relaxation_time, force, trial = batch.bodies.relaxation_time, batch.history.force, batch.workspace.previous_velocity
    for place in range(index(first), index(last)):
        i = inside[place]
        ahead = relaxation_time[i] if spontaneous else dt
        for k in range(2):
            trial[i, k] = velocity[i, k] + ahead * force[i, k] / mass[i]


@inner_kernel
def _project(e: int, last: int, batch: Batch, dt: float, spontaneous: bool, law: Stopping, cutoff: float) -> bool:
    """Leave the projection of the trial velocity in `Workspace.previous_velocity`; False if the contacts could not be found.

    Contacts are gathered up to the gap that two people could close in this step.  The projection can make someone faster
    than anyone was in the trial and in the step before; then the gap is widened and the step solved anew,
    from where it stood, so no contact is ever missed.
    """
    mass, inside, v = batch.bodies.mass, batch.workspace.inside, batch.workspace.previous_velocity
    begin, end = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    contacts, problem, first = batch.history.contacts, batch.workspace.problem, batch.workspace.neighbors.entry_start[e]
    sweeps, margin, solved = 0, -1.0, -np.inf
    while True:
        _try_velocities(begin, last, batch, dt, spontaneous)
        if margin < 0.0:
            before = closing_speed(begin, last, inside, batch.state.velocity)
            margin = _HEADROOM * dt * max(closing_speed(begin, last, inside, v), before) + 1e-3
        if not detect(e, batch, margin, cutoff):
            return False
        number = contacts.number[e]
        stop = first + number
        take_impulses(first, stop, solved, contacts, problem)
        busy = pose_no_overlap(first, stop, begin, end, e, contacts, mass, v, problem, dt, True)
        iterations, residual, converged = solve(first, number, busy, begin, end, e, mass, v, problem, None, law)
        sweeps += iterations
        needed = dt * closing_speed(begin, last, inside, v)
        give_impulses(first, number, number, contacts, mass, problem)
        if not needed > margin:
            record_solver(e, batch.results.diagnostics, sweeps, residual, residual if converged else 0.0)
            return True
        keep_impulses(first, stop, contacts, problem)
        solved, margin = margin, 1.2 * needed


@inner_kernel
def _move(e: int, last: int, batch: Batch, dt: float, limit: float) -> float:
    """Move everyone, no faster than ``limit`` [m/s]; returns the longest path [m]."""
    inside, after, previous = (
        batch.workspace.inside,
        batch.workspace.previous_velocity,
        batch.workspace.previous_position,
    )
    position, velocity = batch.state.position, batch.state.velocity
    furthest = dt * hold_to_speed(e, last, batch, after, limit)
    for place in range(index(batch.bodies.env_start[e]), index(last)):
        i = inside[place]
        for k in range(2):
            previous[i, k] = position[i, k]
            velocity[i, k] = after[i, k]
            position[i, k] += dt * after[i, k]
    return float(furthest)


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    first: int,
    stop: int,
    spontaneous: bool,
    law: Stopping,
    social: SocialLaw | None,
    reach: float,
    regions: bool | None,
) -> None:
    env_start, progress, phase = batch.bodies.env_start, batch.workspace.substep, batch.history.phase
    for e in range(first, stop):
        begin, last = env_start[e], list_active(e, batch)
        reset_routes(e, batch, regions)
        limit, smallest = speed_limit(batch), least_radius(e, last, batch)
        while progress[e] < n_substeps and last > begin:
            if social is not None:
                batch.workspace.status[e] = update_neighbors(e, batch, reach)
                if batch.workspace.status[e] != OK:
                    break
            if phase[e] == _UNKNOWN:  # or the way would be looked up twice in one step
                regular_forces(e, last, batch, dt, social, regions)
            if not _project(e, last, batch, dt, spontaneous, law, reach):
                # with more room it goes on from here
                phase[e] = _KNOWN if batch.workspace.status[e] == FULL else _UNKNOWN
                break
            phase[e] = _UNKNOWN
            contact = batch.workspace.neighbors.entry_start[e]
            behind = contact + batch.history.contacts.number[e]
            record_impulses(contact, behind, batch, 1.0)
            deepest = record_overlaps(e, contact, behind, batch)
            store_warm_start(contact, behind, batch)
            furthest = _move(e, last, batch, dt, limit)
            if not stay_within_bounds(e, last, batch, deepest, smallest, furthest):
                break
            last = leave(e, last, batch, dt)
            tick(e, batch, dt)
