"""NSM2: percussions from a pseudopotential of dissipation (Frémond), as Pécol et al. 2011 write it (eqs 8-10).

    M (u(n+1) - u(n)) = p_ext + B^T P,   p_ext = h f(t(n))
    P_c = -lambda_c K_N (w- + w+) / 2 + mu_c,    0 <= mu_c orthogonal to w+ >= 0      as printed
                                                 0 <= mu_c orthogonal to w+ + max(w-, 0) >= 0     our default: dissipative
    q(n+1) = q(n) + h (u(n) + u(n+1)) / 2

A contact is a pair with D(q(n)) <= 0; lambda_c = 1 only if it approaches at t(n) (w- < 0): without this gate contacts stick,
against Fig 2c.  Binary restitution e = max(0, (K_N - 2 m_e) / (K_N + 2 m_e)), so K_N -> infinity is elastic and K_N = 2 m_e
exactly inelastic; tangentially u_T+ = u_T- (2 m_e - K_T) / (2 m_e + K_T).  The law acts on velocities alone: an overlap of the
order of h times the closing speed remains, and is the scheme's, not the solver's.
"""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel, kernel
from crowd_env._kernels.struct_ref import StructRef
from crowd_env.checks import POSITIVE, SHARE, Range, check_fields, require_not_negative, require_positive
from crowd_env.physics.bounds import hold_to_speed, least_radius, speed_limit, stay_within_bounds
from crowd_env.physics.constraints import give_impulses, pose_no_overlap, pose_percussions
from crowd_env.physics.driving_force import influences, regular_forces, reset_routes
from crowd_env.physics.exits import leave
from crowd_env.physics.neighbors.update import FULL
from crowd_env.physics.scheme import SchemeInfo
from crowd_env.physics.social_force import SocialForce, SocialLaw
from crowd_env.physics.solvers import SolverName, Stopping, solve
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
    name="nsm2",
    title="percussions: pseudopotential of dissipation, dissipative reaction",
    reference="Pécol, Dal Pont, Erlicher, Argoul 2011, eqs 8-10; Frémond 1995, 2007",
    order=1,
    conserves_energy_at_contact=True,
    overlap="time step times closing speed, up to about 40 mm at 0.01 s in a room of 20; it shrinks with the time step",
    stable_step="2 tau_min, from the explicit driving force",
    uses=("problem", "desired_velocity", "force", "previous_position", "previous_velocity"),
)

PRINTED = replace(
    INFO,
    name="nsm2-printed",
    title="percussions, reaction as printed: makes energy where many touch at once",
    conserves_energy_at_contact=True,
)

# A contact has D <= 0; the narrow phase keeps what lies strictly below its margin.
_TOUCHING = 1e-12  # m


class Options(NamedTuple):
    """The parameters as kernels read them."""

    k_normal: float  # kg
    k_tangent: float  # kg
    dissipative: bool


@dataclass(frozen=True)
class NSM2:
    """Discs that collide by percussions.

    Parameters
    ----------
    normal_dissipation : kg, ``K_N`` of eq 9; 1e5 (nearly elastic) as in Table 4, infinite for exactly elastic.
    tangential_dissipation : kg, ``K_T`` of eq 9; 0 = frictionless as in Table 4.
    tolerance : m/s, residual at which the solver stops.
    relative_tolerance : if given, the residual (its 2-norm over the contacts) must also be below this share of what it would be
        without any impulse.
    max_iterations : after so many a step is given up and counted in ``Diagnostics.unconverged``.
    reaction : which reaction forbids approach after the step.  "dissipative" is an EXTENSION: w+ >= -max(w-, 0), i.e. the mean
        speed of the step must not approach; then contacts never make energy.  "printed" (eq 10): w+ >= 0 for every overlapping
        contact; on one that was separating already it does work, and many bodies in contact gain energy: a crowd of 2000
        explodes.  The two agree where only two bodies touch.
    position_correction : share of every overlap that is taken back in each step, 0 to 1.  An EXTENSION, not in the paper, whose
        law acts on velocities alone: people are moved apart by the least displacement (mass-weighted), without any velocity.
    solver : "gauss-seidel", "accelerated" (with momentum), or "auto": the faster one, here the second.
    social : social force; None = people do not mind until they touch.
    """

    normal_dissipation: float = 1e5
    tangential_dissipation: float = 0.0
    tolerance: float = 1e-4
    relative_tolerance: float | None = None
    max_iterations: int = 20_000
    solver: SolverName = "auto"
    reaction: Literal["dissipative", "printed"] = "dissipative"
    position_correction: float = 0.0
    social: SocialForce | None = None

    def __post_init__(self) -> None:
        require_not_negative(
            "nsm2",
            "a contact dissipates, restitution (K_N - 2 m_e) / (K_N + 2 m_e)",
            normal_dissipation=self.normal_dissipation,
            tangential_dissipation=self.tangential_dissipation,
        )
        require_positive("nsm2", "the solver stops on it", tolerance=self.tolerance, max_iterations=self.max_iterations)
        at_least_0 = Range(0.0, infinite=True)
        check_fields(
            "nsm2",
            self,
            normal_dissipation=at_least_0,
            tangential_dissipation=at_least_0,
            relative_tolerance=POSITIVE,
            position_correction=SHARE,
        )

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        return INFO if self.reaction == "dissipative" else PRINTED

    def stable_dt(self, bodies: Bodies) -> float:
        """Unconditional for the contact; the explicit driving force needs h < 2 tau."""
        return 2.0 * float(bodies.relaxation_time.min())

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return one step of head-on closing at twice the desired speed: elastic contacts can double it."""
        return 4.0 * dt * float(bodies.desired_speed.max())

    def check(self, driving: bool) -> None:
        """Accept both uses."""

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
        dissipation = (self.normal_dissipation, self.tangential_dissipation)
        options = Options(*dissipation, self.reaction == "dissipative")
        correction = self.position_correction or None
        _advance_range(batch, dt, n_substeps, first, stop, law, options, correction, *influences(self.social, batch))


@inner_kernel
def _accelerate(first: int, last: int, batch: Batch, dt: float) -> None:
    """Keep u(n) and add the regular forces: u(n) + M^-1 p_ext."""
    inside, force, before, velocity = (
        batch.workspace.inside,
        batch.history.force,
        batch.workspace.previous_velocity,
        batch.state.velocity,
    )
    mass = batch.bodies.mass
    for place in range(index(first), index(last)):
        i = inside[place]
        for k in range(2):
            before[i, k] = velocity[i, k]
            velocity[i, k] += dt * force[i, k] / mass[i]


@inner_kernel
def _move(e: int, last: int, batch: Batch, dt: float, limit: float) -> float:
    """Move everyone, no faster than ``limit`` [m/s]; returns the longest path [m]."""
    inside, before, previous = (
        batch.workspace.inside,
        batch.workspace.previous_velocity,
        batch.workspace.previous_position,
    )
    position, velocity = batch.state.position, batch.state.velocity
    hold_to_speed(e, last, batch, velocity, limit)
    furthest = 0.0
    for place in range(index(batch.bodies.env_start[e]), index(last)):
        i = inside[place]
        dx, dy = 0.5 * dt * (before[i, 0] + velocity[i, 0]), 0.5 * dt * (before[i, 1] + velocity[i, 1])
        previous[i, 0], previous[i, 1] = position[i, 0], position[i, 1]
        position[i, 0] += dx
        position[i, 1] += dy
        furthest = max(furthest, dx * dx + dy * dy)
    return float(np.sqrt(furthest))


@inner_kernel
def _collide(e: int, batch: Batch, law: Stopping, options: Options) -> float:
    """Give everyone the velocity after the percussions of this step; returns the deepest overlap with a wall [m]."""
    bodies = batch.bodies
    near, contacts, problem = batch.workspace.neighbors, batch.history.contacts, batch.workspace.problem
    begin, end = bodies.env_start[e], bodies.env_start[e + 1]
    first, number = near.entry_start[e], contacts.number[e]
    last = first + number
    rows = pose_percussions(
        first,
        last,
        begin,
        end,
        contacts,
        bodies.mass,
        batch.workspace.previous_velocity,
        problem,
        options.k_normal,
        options.k_tangent,
        options.dissipative,
    )
    iterations, residual, converged = solve(
        first, rows, rows, begin, end, e, bodies.mass, batch.state.velocity, problem, problem.soft, law
    )
    give_impulses(first, rows, number, contacts, bodies.mass, problem)
    record_solver(e, batch.results.diagnostics, iterations, residual, residual if converged else 0.0)
    record_impulses(first, last, batch, 1.0)
    store_warm_start(first, last, batch)
    return float(record_overlaps(e, first, last, batch))


@inner_kernel
def _part(e: int, batch: Batch, dt: float, law: Stopping, correction: float) -> float:
    """Move overlapping people apart by the least mass-weighted displacement that takes back a share of every overlap.

    It is the problem of NSM1 for a velocity that is used once and forgotten.  Returns the longest way [m].
    """
    bodies = batch.bodies
    contacts, problem, position = batch.history.contacts, batch.workspace.problem, batch.state.position
    begin, end, first = bodies.env_start[e], bodies.env_start[e + 1], batch.workspace.neighbors.entry_start[e]
    last = first + contacts.number[e]
    shift = batch.workspace.desired_velocity  # no longer needed in this step
    for i in range(index(begin), index(end)):
        shift[i, 0], shift[i, 1] = 0.0, 0.0
    busy = pose_no_overlap(first, last, begin, end, e, contacts, bodies.mass, shift, problem, dt / correction, False)
    solve(first, last - first, busy, begin, end, e, bodies.mass, shift, problem, None, law)
    furthest = 0.0
    for i in range(index(begin), index(end)):
        dx, dy = dt * shift[i, 0], dt * shift[i, 1]
        position[i, 0] += dx
        position[i, 1] += dy
        furthest = max(furthest, dx * dx + dy * dy)
    return float(np.sqrt(furthest))


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    first: int,
    stop: int,
    law: Stopping,
    options: Options,
    correction: float | None,
    social: SocialLaw | None,
    reach: float,
    regions: bool | None,
) -> None:
    env_start, progress = batch.bodies.env_start, batch.workspace.substep
    for e in range(first, stop):
        begin, last = env_start[e], list_active(e, batch)
        reset_routes(e, batch, regions)
        limit, smallest = speed_limit(batch), least_radius(e, last, batch)
        while progress[e] < n_substeps and last > begin:
            if not detect(e, batch, _TOUCHING, reach):
                break
            number = batch.history.contacts.number[e]
            if (
                options.k_tangent > 0.0
                and batch.workspace.neighbors.entry_start[e] + 2 * number > batch.workspace.neighbors.entry_start[e + 1]
            ):
                batch.workspace.status[e] = FULL  # a rough contact takes two rows: come back with more room
                break
            regular_forces(e, last, batch, dt, social, regions)
            _accelerate(begin, last, batch, dt)
            deepest = _collide(e, batch, law, options) if number > 0 else 0.0
            furthest = _move(e, last, batch, dt, limit)
            if correction is not None:
                furthest += _part(e, batch, dt, law, correction)
            if not stay_within_bounds(e, last, batch, deepest, smallest, furthest):
                break
            last = leave(e, last, batch, dt)
            tick(e, batch, dt)
