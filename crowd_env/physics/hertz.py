"""Hertz: discs with a Hertzian contact, dry friction with memory, and rotation, as Lin, Ma, Lo write it (eqs 1-11).

With overlap d, R = r_i r_j / (r_i + r_j), m = m_i m_j / (m_i + m_j), alpha = sqrt(d R); at a wall R = r_i and m = m_i:
    F_n = alpha (k_n d + m gamma_n v_n)                                   v_n: closing speed             (eq 3)
    F_t = -alpha (k_t s + m gamma_t v_t),  |F_t| <= mu |F_n|               v_t: slip of the surfaces      (eq 4)
    ds/dt = v_t while the contact lasts; while it slides, s is what gives exactly the limit
    I dw/dt = -r sum F_t,   I = m r^2 / 2                                                                 (eqs 5, 6)
    k_n = 2 E / (3 (1 - sigma^2)),   k_t = 2 E / ((1 + sigma) (2 - sigma))
The formulas and parameters are those of granular flow codes, which settles what the paper leaves open: gamma is a rate per
length.  In two dimensions s is one number, in the frame that turns with the contact; it lives with the pair in the list.

Velocity Verlet (eqs 9-11): half a kick, drift, forces at the new place with the HALF-step velocity, half a kick.  The forces of
the last step are kept for the first half kick of the next.

What the paper leaves open about WALLS decides whether the crowd blocks: with the friction of people (the literal reading) it
freezes above 1 m/s already.  The default wall, mu = 0.1 and a social force of 300 N, is FITTED to the paper's Figure 7.
"""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel, kernel
from crowd_env._kernels.struct_ref import StructRef
from crowd_env.checks import Range, check_fields, require_not_negative, require_positive
from crowd_env.physics.bounds import hold_to_speed, least_radius, speed_limit, stay_within_bounds
from crowd_env.physics.driving_force import influences, regular_forces, reset_routes
from crowd_env.physics.exits import leave
from crowd_env.physics.scheme import SchemeInfo
from crowd_env.physics.social_force import SocialForce, SocialLaw
from crowd_env.physics.step import detect, list_active, record_impulses, record_overlaps, tick
from crowd_env.physics.workspace import Batch
from crowd_env.state import Bodies

DampingUnit = Literal["rate per length", "rate", "critical"]

INFO = SchemeInfo(
    name="hertz",
    title="Hertz contact, friction with memory, rotation, social force; walls fitted",
    reference="Lin, Ma, Lo: Discrete element crowd model for pedestrian evacuation through an exit, eqs 1-11",
    order=1,
    conserves_energy_at_contact=False,
    overlap="(5 m v^2 / (4 k_n sqrt R))^(2/5), 3 cm for two who run into each other at 1 m/s each, and the push of the crowd",
    stable_step="2 / omega, omega^2 = 1.5 k_n alpha / m_e at the overlap bound, and 2 tau_min",
    uses=("desired_velocity", "force", "previous_position", "torque"),
    default_dt=1e-3,
    contacts_at="end",
)

# Phases of a step, in History.phase: the forces at the present place are not known; are known; the step has drifted.
_UNKNOWN, _KNOWN, _DRIFTED = 0, 1, 2

_FITTED = SocialForce(wall_strength=300.0)  # eq 2 with Table 1; the walls' share is ours


class HertzLaw(NamedTuple):
    """The contact as kernels read it."""

    normal_stiffness: float  # Pa
    tangential_stiffness: float  # Pa
    normal_damping: float
    tangential_damping: float
    damping_unit: int  # row of DampingUnit
    friction: float
    wall_friction: float
    rotation: bool


@dataclass(frozen=True)
class Hertz:
    """Discs with Hertzian contacts, friction and spin.

    The defaults are the preset "calibrated": Table 1 of the paper, with the two wall parameters fitted.  `Hertz.literal` is the
    text as printed.

    Parameters
    ----------
    youngs_modulus, poisson_ratio : Pa and 1, Table 1.
    normal_damping, tangential_damping : gamma, 0.8 in Table 1, without a unit.
    damping_unit : reading of gamma: "rate per length" [1/(m s)] as in eqs 3 and 4; "rate" [1/s], without alpha; "critical",
        the share of the critical damping of the contact at its present overlap.
    friction : Coulomb coefficient of people on people.
    wall_friction : Coulomb coefficient of people on walls; 0.1 is fitted, 0.5 literal.
    rotation : False switches eqs 5 and 6 off: nobody turns.
    social : eq 2; its ``wall_strength`` of 300 N is fitted, 0 literal.  None = no social force.
    """

    youngs_modulus: float = 5e6
    poisson_ratio: float = 0.25
    normal_damping: float = 0.8
    tangential_damping: float = 0.8
    damping_unit: DampingUnit = "rate per length"
    friction: float = 0.5
    wall_friction: float = 0.1
    rotation: bool = True
    social: SocialForce | None = _FITTED

    def __post_init__(self) -> None:
        require_positive("hertz", "k_n = 2 E / (3 (1 - sigma^2)) has to push", youngs_modulus=self.youngs_modulus)
        require_not_negative(
            "hertz",
            "a contact dissipates (eqs 3, 4)",
            normal_damping=self.normal_damping,
            tangential_damping=self.tangential_damping,
            friction=self.friction,
            wall_friction=self.wall_friction,
        )
        check_fields("hertz", self, poisson_ratio=Range(-1.0, 0.5, above=True))

    @staticmethod
    def literal() -> "Hertz":
        """Return the paper's text as printed: walls rub like people do and have no social force."""
        return Hertz(wall_friction=0.5, social=SocialForce())

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        if self != Hertz.literal():
            return INFO
        return replace(
            INFO, name="hertz-literal", title="Hertz contact, friction with memory, rotation, social force; as printed"
        )

    @property
    def normal_stiffness(self) -> float:
        """``k_n`` [Pa]."""
        return 2.0 * self.youngs_modulus / (3.0 * (1.0 + self.poisson_ratio) * (1.0 - self.poisson_ratio))

    @property
    def tangential_stiffness(self) -> float:
        """``k_t`` [Pa]."""
        return 2.0 * self.youngs_modulus / ((1.0 + self.poisson_ratio) * (2.0 - self.poisson_ratio))

    def stable_dt(self, bodies: Bodies) -> float:
        """Return 2 / omega at the overlap bound, or 2 tau of the quickest drive."""
        alpha = np.sqrt(self.overlap_bound(bodies, 0.0) * 0.5 * bodies.radius.max())
        omega = np.sqrt(1.5 * self.normal_stiffness * alpha / (0.5 * bodies.mass.min()))
        return float(min(2.0 / omega, 2.0 * bodies.relaxation_time.min()))

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return the overlap of a head-on impact plus that under the push of the largest crowd leaning on one contact.

        Raises nothing; the social force, which pushes apart, is left out.  An impact of people who stand still by themselves is
        taken at 1 m/s each.
        """
        speed = 2.0 * max(float(bodies.desired_speed.max()), 1.0)
        stiffness = self.normal_stiffness * np.sqrt(0.5 * bodies.radius.min())
        impact = (1.25 * 0.5 * bodies.mass.max() * speed**2 / stiffness) ** 0.4
        drive = bodies.mass * bodies.desired_speed / bodies.relaxation_time
        lean = (np.add.reduceat(drive, bodies.env_start[:-1]).max() / stiffness) ** (2.0 / 3.0)
        return float(impact + lean)

    def check(self, driving: bool) -> None:
        """Accept both uses."""

    def slabs(self, people: int, driving: bool) -> int:
        """One: a crowd is stepped by one thread."""
        return 1

    def advance(
        self, batch: StructRef, dt: float, n_substeps: int, first: int, stop: int, thread: int = 0, threads: int = 1
    ) -> None:
        """Advance the environments ``first:stop`` in place."""
        law = HertzLaw(
            self.normal_stiffness,
            self.tangential_stiffness,
            self.normal_damping,
            self.tangential_damping,
            get_args(DampingUnit).index(self.damping_unit),
            self.friction,
            self.wall_friction,
            self.rotation,
        )
        _advance_range(batch, dt, n_substeps, first, stop, law, *influences(self.social, batch))


@inner_kernel
def _touch(first: int, last: int, batch: Batch, dt: float, elapsed: float, law: HertzLaw) -> None:
    """Add the forces and torques of the contacts ``first:last`` (eqs 3, 4, 6); ``elapsed`` is what the springs stretch over.

    With the normal from j to i and the tangent t = normal turned left, the contact point of i moves with v_i - w_i r_i t and
    that of j with v_j + w_j r_j t; a tangential force F_t t on i turns both the same way, by -r F_t.
    """
    contacts, radius, masses = batch.history.contacts, batch.bodies.radius, batch.bodies.mass
    contact_i, contact_j, gap, normal = contacts.i, contacts.j, contacts.gap, contacts.normal
    remembered, impulse = contacts.history, contacts.impulse
    velocity, spin, force, torque = batch.state.velocity, batch.state.spin, batch.history.force, batch.history.torque
    kn, kt, turning = law.normal_stiffness, law.tangential_stiffness, law.rotation
    for c in range(first, last):
        i, j, overlap = contact_i[c], contact_j[c], -gap[c]
        nx, ny = normal[c, 0], normal[c, 1]
        reduced, mass, limit = radius[i], masses[i], law.wall_friction
        ux, uy, turn = velocity[i, 0], velocity[i, 1], radius[i] * spin[i]
        if j >= 0:
            other, heft = radius[j], masses[j]
            reduced, mass, limit = reduced * other / (reduced + other), mass * heft / (mass + heft), law.friction
            ux, uy, turn = ux - velocity[j, 0], uy - velocity[j, 1], turn + other * spin[j]
        closing, slip = -(ux * nx + uy * ny), uy * nx - ux * ny - turn
        alpha = np.sqrt(overlap * reduced)
        cn, ct = mass * law.normal_damping, mass * law.tangential_damping  # N s/m, per alpha
        if law.damping_unit == 1:
            cn, ct = cn / alpha, ct / alpha
        elif law.damping_unit == 2:
            cn = 2.0 * law.normal_damping * np.sqrt(1.5 * kn * mass / alpha)
            ct = 2.0 * law.tangential_damping * np.sqrt(kt * mass / alpha)
        push = kn * overlap + cn * closing
        stretch = remembered[c, 0] + slip * elapsed
        rub = -(kt * stretch + ct * slip)
        most = limit * abs(push)
        if abs(rub) > most:  # slides: the spring is let go to where it gives the limit
            rub = most if rub > 0.0 else -most
            stretch = -(rub + ct * slip) / kt
        remembered[c, 0] = stretch
        push *= alpha
        rub *= alpha
        impulse[c, 0], impulse[c, 1] = push * dt, rub * dt
        px, py = push * nx - rub * ny, push * ny + rub * nx
        force[i, 0] += px
        force[i, 1] += py
        if turning:
            torque[i] -= radius[i] * rub
        if j >= 0:
            force[j, 0] -= px
            force[j, 1] -= py
            if turning:
                torque[j] -= radius[j] * rub


@inner_kernel
def _kick(e: int, last: int, batch: Batch, half: float, limit: float) -> float:
    """Half a kick (eqs 9, 11), to no more than ``limit`` [m/s]; returns the largest speed [m/s]."""
    inside, velocity, spin, mass = batch.workspace.inside, batch.state.velocity, batch.state.spin, batch.bodies.mass
    inertia, force, torque = batch.bodies.inertia, batch.history.force, batch.history.torque
    for place in range(index(batch.bodies.env_start[e]), index(last)):
        i = inside[place]
        rate = half / mass[i]
        velocity[i, 0] += rate * force[i, 0]
        velocity[i, 1] += rate * force[i, 1]
        if torque[i] != 0.0:  # few touch, and a division is dear
            spin[i] += half * torque[i] / inertia[i]
    return float(hold_to_speed(e, last, batch, velocity, limit))


@inner_kernel
def _drift(first: int, last: int, batch: Batch, dt: float) -> None:
    """Move and turn (eq 10)."""
    state, inside, previous = batch.state, batch.workspace.inside, batch.workspace.previous_position
    position, velocity, angle, spin = state.position, state.velocity, state.angle, state.spin
    for place in range(index(first), index(last)):
        i = inside[place]
        previous[i, 0], previous[i, 1] = position[i, 0], position[i, 1]
        position[i, 0] += dt * velocity[i, 0]
        position[i, 1] += dt * velocity[i, 1]
        angle[i] += dt * spin[i]


@kernel
def _advance_range(
    batch: Batch,
    dt: float,
    n_substeps: int,
    first: int,
    stop: int,
    law: HertzLaw,
    social: SocialLaw | None,
    reach: float,
    regions: bool | None,
) -> None:
    env_start, progress, phase = batch.bodies.env_start, batch.workspace.substep, batch.history.phase
    near, contacts, torque = batch.workspace.neighbors, batch.history.contacts, batch.history.torque
    for e in range(first, stop):
        begin, last, contact = env_start[e], list_active(e, batch), near.entry_start[e]
        reset_routes(e, batch, regions)
        limit, smallest = speed_limit(batch), least_radius(e, last, batch)
        deepest = np.inf  # with a wall, at the start of the step; not known before the first
        while progress[e] < n_substeps and last > begin:
            if phase[e] == _KNOWN:
                record_impulses(contact, contact + contacts.number[e], batch, 0.5)  # those of the last step
                furthest = dt * _kick(e, last, batch, 0.5 * dt, limit)
                _drift(begin, last, batch, dt)
                if not stay_within_bounds(e, last, batch, deepest, smallest, furthest):
                    break
                last = leave(e, last, batch, dt)
                phase[e] = _DRIFTED
            if not detect(e, batch, 0.0, reach):
                break  # goes on from here, with more room
            regular_forces(e, last, batch, dt, social, regions)
            for i in range(index(begin), index(env_start[e + 1])):
                torque[i] = 0.0
            behind = contact + contacts.number[e]
            elapsed = (
                dt if phase[e] == _DRIFTED else 0.0
            )  # the first forces of all are those of springs not yet stretched
            _touch(contact, behind, batch, dt, elapsed, law)
            if phase[e] == _DRIFTED:
                record_impulses(contact, behind, batch, 0.5)
                deepest = record_overlaps(e, contact, behind, batch)
                _kick(e, last, batch, 0.5 * dt, limit)
                tick(e, batch, dt)
            phase[e] = _KNOWN
