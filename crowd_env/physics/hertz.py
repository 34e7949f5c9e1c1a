"""Hertz: discs with a Hertzian contact, dry friction with memory, and rotation, after Lin, Ma, Lo (eqs 1-11).

With overlap d, R = r_i r_j / (r_i + r_j), m = m_i m_j / (m_i + m_j), alpha = sqrt(d R); at a wall R = r_i and m = m_i:
    F_n = alpha (k_n d + m gamma_n v_n)                                   v_n: closing speed             (eq 3)
    F_t = -alpha (k_t s + m gamma_t v_t),  |F_t| <= mu |F_n|               v_t: slip of the surfaces      (eq 4)
    ds/dt = v_t while the contact lasts; while it slides, s gives exactly the limit
    I dw/dt = -r sum F_t,   I = m r^2 / 2                                                                 (eqs 5, 6)
    k_n = 2 E / (3 (1 - sigma^2)),   k_t = 2 E / ((1 + sigma) (2 - sigma))
Formulas and parameters are as in granular flow codes, which settles an open point of the paper: gamma is a rate per length.
In two dimensions s is one number, in the frame that turns with the contact; `Contacts.history` keeps it.

Bodies may have an outline of several discs (`crowd_env.core.behaviors.outline`): then r is the radius of the disc that touches,
and normal forces turn a body too.  The paper has discs.

Velocity Verlet (eqs 9-11): half a kick, drift, forces at the new positions with the HALF-step velocity, half a kick.  The
forces of the last step are kept for the first half kick of the next.  The drive alone uses the velocity after the second half
kick (trapezoidal rule).  With the velocity of the half step it would act as if tau were shorter by dt / 2, and the scheme would
be of first order.

The paper steps by 0.001 s.  A contact of two people lasts 40 to 70 ms.  Exit times, clogging, impulses and overlaps at 0.005 s
agree with 0.001 s (docs/physics.md).  So environments take 0.005 s, or half the stable step of the most extreme people of their
scenario where many push.

alpha = sqrt(delta R) is the contact radius of two spheres, which the paper assumes; the force of discs in the plane would be
nearly proportional to their overlap.  docs/physics.md, "Materials of people", compares its moduli and damping with others.

The open question of WALLS decides whether the crowd blocks: with the friction of people (the literal reading) it freezes above
1 m/s already.  The default wall, mu = 0.1 and a social force of 300 N, is FITTED to the paper's Figure 7.
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from crowd_env.core.arrays.state import Bodies
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, Range
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.bounds import hold_fastest, stay_within_bounds
from crowd_env.physics.driving_force import Influences, drive_after_kick, regular_forces
from crowd_env.physics.exits import leave
from crowd_env.physics.outlines.contacts import detect_discs
from crowd_env.physics.outlines.turning import add_turning_torques, begin_to_face, lever
from crowd_env.physics.scheme import DECISION_DT, ContactScheme, SchemeInfo
from crowd_env.physics.social_force import SocialForce
from crowd_env.physics.steering import steer
from crowd_env.physics.step import begin_call, contact_range, detect, record_impulses, record_overlaps, tick
from crowd_env.physics.workspace import Batch

DampingUnit = Literal["rate per length", "rate", "critical"]

INFO = SchemeInfo(
    name="hertz",
    title="Hertz contact, friction with memory, rotation, social force; walls fitted",
    reference="Lin, Ma, Lo: Discrete element crowd model for pedestrian evacuation through an exit, eqs 1-11",
    order=2,
    conserves_energy_at_contact=False,
    overlap="(5 m v^2 / (4 k_n sqrt R))^(2/5), 3 cm for two who run into each other at 1 m/s each, and the push of the crowd",
    stable_step="2 / omega, omega^2 = 1.5 k_n alpha / m_e at the overlap bound, and 2 tau_min; environments take at most "
    "half of it, and at most 0.005 s, since contacts last 0.04 s or more",
    uses=("desired_velocity", "force", "previous_position", "torque"),
    default_dt=5e-3,
    contacts_at="end",
)

# The paper as printed: walls rub like people do and have no social force.
_TITLE = "Hertz contact, friction with memory, rotation, social force; as printed"
LITERAL = replace(INFO, name="hertz-literal", title=_TITLE)

# The stage of an environment, in `History.phase`.  The forces at the end of a step serve the start of the next: KNOWN between
# two steps.  A step that has moved people, and then lacks memory for the contacts at the new positions, is DRIFTED, and
# continues from there with more memory.
_UNKNOWN, _KNOWN, _DRIFTED = 0, 1, 2

_DISSIPATES = NOT_NEGATIVE.because("a contact dissipates (eqs 3, 4)")
_FITTED = SocialForce(wall_strength=300.0)  # eq 2 with Table 1; the walls' share is ours


class HertzParams(NamedTuple):
    """Parameters of the contact for kernels."""

    normal_stiffness: float  # Pa
    tangential_stiffness: float  # Pa
    normal_damping: float
    tangential_damping: float
    damping_unit: int  # row of DampingUnit
    friction: float
    wall_friction: float
    rotation: bool


@dataclass(frozen=True)
class Hertz(ContactScheme):
    """Discs with Hertzian contacts, friction and spin.

    The defaults are the preset "calibrated": Table 1 of the paper, with two fitted wall parameters.  `Hertz.literal` is the
    text as printed.

    Parameters
    ----------
    youngs_modulus, poisson_ratio : Pa and 1, Table 1.
    normal_damping, tangential_damping : gamma, 0.8 in Table 1, without a unit; as "rate per length" two hundredths of a
        percent of the critical damping at 1 cm, so that people bounce.
    damping_unit : reading of gamma: "rate per length" [1/(m s)] as in eqs 3 and 4; "rate" [1/s], without alpha; "critical",
        the share of the critical damping of the contact at its present overlap.
    friction : Coulomb coefficient of people on people.
    wall_friction : Coulomb coefficient of people on walls; 0.1 is fitted, 0.5 literal.
    rotation : False switches eqs 5 and 6 off: bodies do not turn.
    social : eq 2; its ``wall_strength`` of 300 N is fitted, 0 literal.  None = no social force; see `ContactScheme`.
    """

    youngs_modulus: float = 5e6
    poisson_ratio: float = 0.25
    normal_damping: float = 0.8
    tangential_damping: float = 0.8
    damping_unit: DampingUnit = "rate per length"
    friction: float = 0.5
    wall_friction: float = 0.1
    rotation: bool = True
    _: KW_ONLY
    social: SocialForce | None = _FITTED

    ALLOWED = {
        "youngs_modulus": POSITIVE.because("k_n = 2 E / (3 (1 - sigma^2)) has to push"),
        "poisson_ratio": Range(-1.0, 0.5, above=True),
        **dict.fromkeys(("normal_damping", "tangential_damping", "friction", "wall_friction"), _DISSIPATES),
    }

    @staticmethod
    def literal() -> "Hertz":
        """Return the paper's text as printed: walls rub like people do and have no social force."""
        return Hertz(wall_friction=0.5, social=SocialForce())

    @property
    def info(self) -> SchemeInfo:
        """Facts about the scheme."""
        walls_are_people = self.wall_friction == self.friction and getattr(self.social, "wall_strength", 0.0) == 0.0
        return LITERAL if walls_are_people else INFO

    @property
    def turns_bodies(self) -> bool:
        """Whether contacts turn bodies: not without ``rotation``."""
        return self.rotation

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
        return float(min(2.0 / omega, super().stable_dt(bodies)))

    def default_dt(self, bodies: Bodies, within: float = DECISION_DT, outline: Outline | None = None) -> float:
        """Return 0.005 s or half the stable step, whichever is shorter, rounded down to a part of ``within``."""
        limit = min(self.info.default_dt, 0.5 * self.stable_dt(bodies)) * (
            1.0 if outline is None else outline.step_share
        )
        return float(within / np.ceil(within / limit - 1e-9))

    def overlap_bound(self, bodies: Bodies, dt: float) -> float:
        """Return the overlap of a head-on impact plus that under the push of the largest crowd leaning on one contact.

        The social force, which repels, is left out.  The impact is at 1 m/s each, or at the desired speeds if higher.
        """
        speed = 2.0 * max(float(bodies.desired_speed.max()), 1.0)
        stiffness = self.normal_stiffness * np.sqrt(0.5 * bodies.radius.min())
        impact = (1.25 * 0.5 * bodies.mass.max() * speed**2 / stiffness) ** 0.4
        drive = bodies.mass * bodies.desired_speed / bodies.relaxation_time
        lean = (np.add.reduceat(drive, bodies.env_start[:-1]).max() / stiffness) ** (2.0 / 3.0)
        return float(impact + lean)

    @property
    def kernel(self) -> Callable[..., None]:
        """The compiled loop."""
        return _advance_range

    def parameters(self) -> tuple[Any, ...]:
        """Return stiffness, damping and friction."""
        values = {name: getattr(self, name) for name in HertzParams._fields}
        return (HertzParams(**values | {"damping_unit": get_args(DampingUnit).index(self.damping_unit)}),)


@inner_kernel
def _kick(
    e: int,
    rank_stop: int,
    batch: Batch,
    half: float,
    limit: float,
    drives: bool,
    acting: Influences,
) -> float:
    """Half a kick (eqs 9, 11), limited to ``limit`` [m/s]; returns the largest speed [m/s].

    The second half kick of a step ``drives``: it evaluates the drive at the velocity after it.
    """
    inside, velocity, spin, mass = batch.workspace.inside, batch.state.velocity, batch.state.spin, batch.bodies.mass
    inertia, force, torque = batch.bodies.inertia, batch.history.force, batch.history.torque
    fastest = 0.0
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        if drives:
            drive_after_kick(i, batch, half, acting)
        rate = half / mass[i]
        velocity[i, 0] += rate * force[i, 0]
        velocity[i, 1] += rate * force[i, 1]
        if torque[i] != 0.0:  # few are in contact, and a division is slow
            spin[i] += half * torque[i] / inertia[i]
        fastest = max(fastest, velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
    return hold_fastest(e, rank_stop, batch, velocity, limit, fastest)


@inner_kernel
def _drift(e: int, rank_stop: int, batch: Batch, dt: float) -> None:
    """Move and turn (eq 10)."""
    state, inside, previous = batch.state, batch.workspace.inside, batch.workspace.previous_position
    position, velocity, angle, spin = state.position, state.velocity, state.angle, state.spin
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        previous[i, 0], previous[i, 1] = position[i, 0], position[i, 1]
        position[i, 0] += dt * velocity[i, 0]
        position[i, 1] += dt * velocity[i, 1]
        angle[i] += dt * spin[i]


@inner_kernel
def _clear_torques(e: int, batch: Batch) -> None:
    """Set all torques of environment ``e`` to zero."""
    torque = batch.history.torque
    for i in range(index(batch.bodies.env_start[e]), index(batch.bodies.env_start[e + 1])):
        torque[i] = 0.0


@inner_kernel
def _add_contact_forces(
    e: int, batch: Batch, dt: float, elapsed: float, params: HertzParams, outline: bool | None
) -> None:
    """Add the forces and torques of all contacts (eqs 3, 4, 6); ``elapsed`` is the time over which the springs stretch.

    With the normal from j to i and the tangent t = normal turned left, the contact point of i moves with v_i - w_i r_i t and
    that of j with v_j + w_j r_j t; a tangential force F_t t on i turns both in the same sense, by -r F_t.

    With an ``outline`` r is the radius of the disc that touches.  Its center lies (a, b) from the center of the body along
    normal and tangent.  So the lever arm of the tangential force is r - a for i and r + a for j, of the normal force b.
    """
    contacts, radius, masses = batch.history.contacts, batch.bodies.radius, batch.bodies.mass
    contact_i, contact_j, gap, normal = contacts.i, contacts.j, contacts.gap, contacts.normal
    history, impulse = contacts.history, contacts.impulse
    velocity, spin, force, torque = batch.state.velocity, batch.state.spin, batch.history.force, batch.history.torque
    kn, kt, turning = params.normal_stiffness, params.tangential_stiffness, params.rotation
    contact_start, contact_stop = contact_range(e, batch)
    for c in range(contact_start, contact_stop):
        i, j, overlap = contact_i[c], contact_j[c], -gap[c]
        nx, ny = normal[c, 0], normal[c, 1]
        reduced, mass, friction = radius[i], masses[i], params.wall_friction
        arm, side, other_arm, other_side = radius[i], 0.0, 0.0, 0.0
        if outline is not None:
            reduced, ahead, side = lever(batch, i, contacts.disc_i[c], nx, ny)
            arm = reduced - ahead
        ux, uy, turn = velocity[i, 0], velocity[i, 1], arm * spin[i]
        if j >= 0:
            other, heft = radius[j], masses[j]
            other_arm = other
            if outline is not None:
                other, ahead, other_side = lever(batch, j, contacts.disc_j[c], nx, ny)
                other_arm = other + ahead
            reduced, mass, friction = reduced * other / (reduced + other), mass * heft / (mass + heft), params.friction
            ux, uy, turn = ux - velocity[j, 0], uy - velocity[j, 1], turn + other_arm * spin[j]
        closing, slip = -(ux * nx + uy * ny), uy * nx - ux * ny - turn
        if outline is not None:
            closing += side * spin[i]
            if j >= 0:
                closing -= other_side * spin[j]
        alpha = np.sqrt(overlap * reduced)
        cn, ct = mass * params.normal_damping, mass * params.tangential_damping  # N s/m, per alpha
        if params.damping_unit == 1:
            cn, ct = cn / alpha, ct / alpha
        elif params.damping_unit == 2:
            cn = 2.0 * params.normal_damping * np.sqrt(1.5 * kn * mass / alpha)
            ct = 2.0 * params.tangential_damping * np.sqrt(kt * mass / alpha)
        fn = kn * overlap + cn * closing
        stretch = history[c, 0] + slip * elapsed
        ft = -(kt * stretch + ct * slip)
        most = friction * abs(fn)
        if abs(ft) > most:  # it slides: the spring keeps the length that gives the limit
            ft = most if ft > 0.0 else -most
            stretch = -(ft + ct * slip) / kt
        history[c, 0] = stretch
        fn *= alpha
        ft *= alpha
        impulse[c, 0], impulse[c, 1] = fn * dt, ft * dt
        fx, fy = fn * nx - ft * ny, fn * ny + ft * nx
        force[i, 0] += fx
        force[i, 1] += fy
        if turning:
            torque[i] -= arm * ft
            if outline is not None:
                torque[i] -= side * fn
        if j >= 0:
            force[j, 0] -= fx
            force[j, 1] -= fy
            if turning:
                torque[j] -= other_arm * ft
                if outline is not None:
                    torque[j] += other_side * fn


@inner_kernel
def _find_forces(
    e: int,
    rank_stop: int,
    batch: Batch,
    dt: float,
    elapsed: float,
    acting: Influences,
    params: HertzParams,
    outline: bool | None,
) -> None:
    """Write all forces and torques at the present positions (eqs 1-6)."""
    steer(e, rank_stop, batch, dt, acting)
    regular_forces(e, rank_stop, batch, dt, acting)
    _clear_torques(e, batch)
    _add_contact_forces(e, batch, dt, elapsed, params, outline)
    if outline is not None:
        add_turning_torques(e, rank_stop, batch, 0.5 * elapsed)


@inner_kernel
def _detect(e: int, rank_stop: int, batch: Batch, cutoff: float, outline: bool | None) -> bool:
    """Update neighbors and contacts, of discs if bodies have an ``outline``; False if they do not fit."""
    if outline is not None:
        return detect_discs(e, rank_stop, batch, cutoff)
    return detect(e, batch, 0.0, cutoff)


@inner_kernel
def _first_forces(
    e: int, rank_stop: int, batch: Batch, dt: float, acting: Influences, params: HertzParams, outline: bool | None
) -> bool:
    """Find the forces before the first step, with unstretched springs; False if the contacts do not fit."""
    if outline is not None and not begin_to_face(e, rank_stop, batch, dt, acting):
        return False
    if not _detect(e, rank_stop, batch, acting.reach, outline):
        return False
    _find_forces(e, rank_stop, batch, dt, 0.0, acting, params, outline)
    batch.history.direction_age[e] += dt  # counts as a step, so it does not delay the next look-up
    batch.history.decision_age[e] += dt
    batch.history.phase[e] = _KNOWN
    return True


@kernel
def _advance_range(
    batch: Batch, dt: float, n_substeps: int, env_first: int, env_stop: int, acting: Influences, params: HertzParams
) -> None:
    """Advance the environments ``env_first:env_stop`` to step ``n_substeps`` of this call, one after the other."""
    phase, substep = batch.history.phase, batch.workspace.substep
    for e in range(env_first, env_stop):
        rank_start = batch.bodies.env_start[e]
        rank_stop, limit, smallest = begin_call(e, batch, acting)
        deepest = np.inf  # contact with a wall [m] at the start of the step, not known before the first of a call
        is_first = phase[e] == _UNKNOWN and substep[e] < n_substeps and rank_stop > rank_start
        if is_first and not _first_forces(e, rank_stop, batch, dt, acting, params, acting.outline):
            continue
        while substep[e] < n_substeps and rank_stop > rank_start:
            if phase[e] == _KNOWN:
                # Half a kick with the forces of the last step, and the drift (eqs 9, 10).
                record_impulses(e, batch, 0.5)
                longest = dt * _kick(e, rank_stop, batch, 0.5 * dt, limit, False, acting)
                _drift(e, rank_stop, batch, dt)
                # Bounds.
                if not stay_within_bounds(e, rank_stop, batch, deepest, smallest, longest):
                    break
                # Exits.
                rank_stop = leave(e, rank_stop, batch, dt)
                phase[e] = _DRIFTED
            # Contacts at the new positions.
            if not _detect(e, rank_stop, batch, acting.reach, acting.outline):
                break
            # Forces there, with the velocity of the half step (eqs 1-6).
            _find_forces(e, rank_stop, batch, dt, dt, acting, params, acting.outline)
            # Half of the impulses and the overlaps into the sums.
            record_impulses(e, batch, 0.5)
            deepest = record_overlaps(e, batch)
            if (
                acting.outline is not None
            ):  # the overlaps of outer discs do not bound the distance of a center from a wall
                deepest = np.inf
            # The other half of the kick (eq 11), and the clock.
            _kick(e, rank_stop, batch, 0.5 * dt, limit, batch.control.driving, acting)
            tick(e, batch, dt)
            phase[e] = _KNOWN
