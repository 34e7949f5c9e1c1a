"""The contact problem of NSM1 and NSM2, and two ways to solve it to a true residual.

Both schemes ask for impulses P and velocities v = v_start + M^-1 B^T P such that every contact meets its own law, with
w = B v + bias the speed at which it separates ((B v)_c = n_c . (v_i - v_j), a_c = 1/m_i + 1/m_j its diagonal):

    unilateral          0 <= P orthogonal to w >= 0                                  NSM1, with bias D / h
    with dissipation    P = -K_N (w- + w) / 2 + mu,  0 <= mu orthogonal to w >= 0    NSM2, if it approached; else as above
    tangential          P_T = -K_T (w_T- + w_T) / 2                                  NSM2, if it approached

Projected Gauss-Seidel sets one contact right after the other: quick for few.  Accelerated projected gradient (Nesterov, with
gradient restart, on the dual scaled by a_c) moves all at once: its iterations hardly grow with the crowd.  A step that changes
little is no proof of a small error, so both stop on the violation of the laws themselves, in m/s, all at the same velocities:
max_c a_c |P_c - law_c(v)|, which for a unilateral contact is |min(a_c P_c, w_c)|.
"""

from typing import Literal, NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.physics.contacts import Contacts
from crowd_env.state import Bools, Floats

AUTO, GAUSS_SEIDEL, ACCELERATED = 0, 1, 2
SolverName = Literal["auto", "gauss-seidel", "accelerated"]
SOLVERS: dict[str, int] = {"auto": AUTO, "gauss-seidel": GAUSS_SEIDEL, "accelerated": ACCELERATED}
# From this many contacts on "auto" takes the accelerated gradient.  Measured in NSM1 jams: equal at 190 contacts, 1.5 to 2
# times faster at 600, 2 to 3 times at 2300.
_MANY = 150
# Largest eigenvalue of the scaled dual matrix: 3 in a frozen jam; too small a guess is noticed and mended.
_FIRST_LIPSCHITZ = 3.0
_LOOK_EVERY = 5  # iterations between two looks at the residual


class Problem(NamedTuple):
    """What the solvers read of every contact, and their scratch memory."""

    bias: Floats  # (M,)   m/s  added to the normal speed: D / h or 0
    w_minus: Floats  # (M, 2) m/s  normal and tangential speed before the step
    mobility: Floats  # (M,)   1/kg a_c
    approaching: Bools  # (M,)    whether the contact dissipates
    last: Floats  # (M, 2) N s  previous iterate
    look: Floats  # (M, 2) N s  extrapolated iterate
    v_start: Floats  # (P, 2) m/s
    v_last: Floats  # (P, 2) m/s
    v_look: Floats  # (P, 2) m/s


class ContactLaw(NamedTuple):
    """The parameters as kernels read them."""

    k_normal: float  # kg
    k_tangent: float  # kg
    tolerance: float  # m/s
    max_iterations: int
    solver: int  # AUTO, GAUSS_SEIDEL or ACCELERATED
    warm: bool  # try the impulses of the last step as a start


def allocate_problem(people: int, entries: int) -> Problem:
    """Return a problem with room for ``entries`` contacts."""
    return Problem(
        bias=np.zeros(entries),
        w_minus=np.zeros((entries, 2)),
        mobility=np.zeros(entries),
        approaching=np.zeros(entries, dtype=np.bool_),
        last=np.zeros((entries, 2)),
        look=np.zeros((entries, 2)),
        v_start=np.zeros((people, 2)),
        v_last=np.zeros((people, 2)),
        v_look=np.zeros((people, 2)),
    )


@kernel
def pose_no_overlap(begin: int, end: int, contacts: Contacts, mass: Floats, problem: Problem, dt: float) -> None:
    """NSM1: D + h w >= 0 for the contacts ``begin:end`` (Pécol et al. 2011, eq 6)."""
    for c in range(begin, end):
        problem.mobility[c] = _mobility(contacts, c, mass)
        problem.bias[c] = contacts.gap[c] / dt
        problem.approaching[c] = False
        contacts.impulse[c, 1] = 0.0


@kernel
def pose_percussions(
    begin: int, end: int, contacts: Contacts, mass: Floats, problem: Problem, before: Floats, dissipative: bool
) -> None:
    """NSM2: a contact dissipates if it approached at t(n), velocities ``before`` (eqs 8-10 with the approach gate).

    ``dissipative`` lets a contact that was separating be closed only down to w+ = -w-, where it does no work.
    """
    for c in range(begin, end):
        problem.mobility[c] = _mobility(contacts, c, mass)
        problem.w_minus[c, 0], problem.w_minus[c, 1] = _relative(contacts, c, before)
        problem.approaching[c] = problem.w_minus[c, 0] < 0.0
        problem.bias[c] = max(problem.w_minus[c, 0], 0.0) if dissipative else 0.0


@kernel
def solve(
    begin: int,
    end: int,
    first: int,
    last: int,
    contacts: Contacts,
    mass: Floats,
    v: Floats,
    problem: Problem,
    law: ContactLaw,
) -> tuple[int, float]:
    """Solve the contacts ``begin:end`` of the people ``first:last``.

    ``v`` holds the velocities without contact and becomes the solution; `Contacts.impulse` holds the impulses of the last step
    and becomes P.  Returns the number of iterations and the residual in m/s.
    """
    for i in range(first, last):
        problem.v_start[i, 0], problem.v_start[i, 1] = v[i, 0], v[i, 1]
    residual = _begin(begin, end, first, last, contacts, mass, v, problem, law)
    if residual <= law.tolerance:
        return 0, residual
    if law.solver == GAUSS_SEIDEL or (law.solver == AUTO and end - begin < _MANY):
        return _gauss_seidel(begin, end, contacts, mass, v, problem, law)
    return _accelerated(begin, end, first, last, contacts, mass, v, problem, law)


@kernel
def _begin(
    begin: int,
    end: int,
    first: int,
    last: int,
    contacts: Contacts,
    mass: Floats,
    v: Floats,
    problem: Problem,
    law: ContactLaw,
) -> float:
    """Start from the impulses of the last step or from zero, whichever violates the laws less; return its residual."""
    warm = np.inf
    if law.warm:
        _velocities(begin, end, first, last, contacts, mass, problem.v_start, contacts.impulse, v)
        warm = _residual(begin, end, contacts, v, problem, law)
        if warm <= law.tolerance:
            return warm
    for c in range(begin, end):
        for k in range(2):
            problem.last[c, k] = contacts.impulse[c, k]
            contacts.impulse[c, k] = 0.0
    cold = _residual(begin, end, contacts, problem.v_start, problem, law)
    if cold < warm:
        for i in range(first, last):
            v[i, 0], v[i, 1] = problem.v_start[i, 0], problem.v_start[i, 1]
        return cold
    for c in range(begin, end):
        for k in range(2):
            contacts.impulse[c, k] = problem.last[c, k]
    return warm


@kernel
def _gauss_seidel(
    begin: int, end: int, contacts: Contacts, mass: Floats, v: Floats, problem: Problem, law: ContactLaw
) -> tuple[int, float]:
    sweeps, residual = 0, np.inf
    while residual > law.tolerance and sweeps < law.max_iterations:
        moved = 0.0
        for c in range(begin, end):
            normal, tangent = _law(contacts, c, v, problem, law)
            dn, dt = normal - contacts.impulse[c, 0], tangent - contacts.impulse[c, 1]
            if dn != 0.0 or dt != 0.0:
                contacts.impulse[c, 0], contacts.impulse[c, 1] = normal, tangent
                _apply(contacts, c, mass, v, dn, dt)
                moved = max(moved, problem.mobility[c] * max(abs(dn), abs(dt)))
        sweeps += 1
        if moved <= law.tolerance or sweeps == law.max_iterations:
            residual = _residual(begin, end, contacts, v, problem, law)
    return sweeps, residual


@kernel
def _accelerated(
    begin: int,
    end: int,
    first: int,
    last: int,
    contacts: Contacts,
    mass: Floats,
    v: Floats,
    problem: Problem,
    law: ContactLaw,
) -> tuple[int, float]:
    """Nesterov's gradient on the dual, restarted when it runs uphill (O'Donoghue and Candès 2015)."""
    impulse, before, look, v_last, v_look = contacts.impulse, problem.last, problem.look, problem.v_last, problem.v_look
    _copy(begin, end, impulse, look)
    _copy(first, last, v, v_look)
    lipschitz, theta = _FIRST_LIPSCHITZ, 1.0
    iterations, residual = 0, np.inf
    while iterations < law.max_iterations:
        _copy(begin, end, impulse, before)
        _copy(first, last, v, v_last)
        while True:
            _descend(begin, end, contacts, v_look, look, problem, law, lipschitz)
            _velocities(begin, end, first, last, contacts, mass, problem.v_start, impulse, v)
            curvature = _curvature(begin, end, first, last, impulse, look, problem.mobility, mass, v, v_look)
            if not curvature > lipschitz:  # nor if it is nan: the next search for contacts reports that
                break
            lipschitz = 1.05 * curvature  # the guess was too small for this step: take it again
        iterations += 1
        if _uphill(begin, end, impulse, before, look, problem.mobility):
            theta = 1.0
            _copy(begin, end, impulse, look)
            _copy(first, last, v, v_look)
        else:
            following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * theta * theta))
            beta = (theta - 1.0) / following
            theta = following
            _extrapolate(begin, end, impulse, before, beta, look)
            _extrapolate(first, last, v, v_last, beta, v_look)
        if iterations % _LOOK_EVERY == 0 or iterations == law.max_iterations:
            residual = _residual(begin, end, contacts, v, problem, law)
            if residual <= law.tolerance:
                break
    return iterations, residual


@kernel
def _descend(
    begin: int,
    end: int,
    contacts: Contacts,
    v_look: Floats,
    look: Floats,
    problem: Problem,
    law: ContactLaw,
    lipschitz: float,
) -> None:
    """One proximal step from ``look``: into `Contacts.impulse`."""
    for c in range(begin, end):
        stiff = lipschitz * problem.mobility[c]
        w, w_tangent = _relative(contacts, c, v_look)
        normal = look[c, 0] - (w + problem.bias[c]) / stiff
        tangent = 0.0
        if not problem.approaching[c]:
            normal = max(0.0, normal)
        else:
            # Below -K_N w- / 2 the contact separates, w = -w- - 2 P / K_N; above it the reaction holds it closed.
            if 2.0 * normal / law.k_normal < -problem.w_minus[c, 0]:
                normal = (stiff * normal - problem.w_minus[c, 0]) / (stiff + 2.0 / law.k_normal)
            if law.k_tangent > 0.0:
                tangent = look[c, 1] - w_tangent / stiff
                tangent = (stiff * tangent - problem.w_minus[c, 1]) / (stiff + 2.0 / law.k_tangent)
        contacts.impulse[c, 0], contacts.impulse[c, 1] = normal, tangent


@kernel
def _curvature(
    begin: int,
    end: int,
    first: int,
    last: int,
    impulse: Floats,
    look: Floats,
    mobility: Floats,
    mass: Floats,
    v: Floats,
    v_look: Floats,
) -> float:
    """Return (d . A d) / (d . diag(A) d) along the step d: A d is seen in the velocities, so it costs no product."""
    energy, scale = 0.0, 0.0
    for i in range(first, last):
        energy += mass[i] * ((v[i, 0] - v_look[i, 0]) ** 2 + (v[i, 1] - v_look[i, 1]) ** 2)
    for c in range(begin, end):
        scale += mobility[c] * ((impulse[c, 0] - look[c, 0]) ** 2 + (impulse[c, 1] - look[c, 1]) ** 2)
    return energy / scale if scale > 0.0 else 0.0


@kernel
def _uphill(begin: int, end: int, impulse: Floats, before: Floats, look: Floats, mobility: Floats) -> bool:
    slope = 0.0
    for c in range(begin, end):
        for k in range(2):
            slope += mobility[c] * (look[c, k] - impulse[c, k]) * (impulse[c, k] - before[c, k])
    return slope > 0.0


@kernel
def _extrapolate(begin: int, end: int, now: Floats, before: Floats, beta: float, out: Floats) -> None:
    for c in range(begin, end):
        for k in range(2):
            out[c, k] = now[c, k] + beta * (now[c, k] - before[c, k])


@kernel
def _copy(begin: int, end: int, source: Floats, target: Floats) -> None:
    for c in range(begin, end):
        target[c, 0], target[c, 1] = source[c, 0], source[c, 1]


@kernel
def _velocities(
    begin: int,
    end: int,
    first: int,
    last: int,
    contacts: Contacts,
    mass: Floats,
    v_start: Floats,
    impulse: Floats,
    v: Floats,
) -> None:
    """Write v = v_start + M^-1 B^T P."""
    for i in range(first, last):
        v[i, 0], v[i, 1] = v_start[i, 0], v_start[i, 1]
    for c in range(begin, end):
        if impulse[c, 0] != 0.0 or impulse[c, 1] != 0.0:
            _apply(contacts, c, mass, v, impulse[c, 0], impulse[c, 1])


@kernel
def _residual(begin: int, end: int, contacts: Contacts, v: Floats, problem: Problem, law: ContactLaw) -> float:
    worst = 0.0
    for c in range(begin, end):
        normal, tangent = _law(contacts, c, v, problem, law)
        off = max(abs(normal - contacts.impulse[c, 0]), abs(tangent - contacts.impulse[c, 1]))
        worst = max(worst, problem.mobility[c] * off)
    return worst


@kernel
def _law(contacts: Contacts, c: int, v: Floats, problem: Problem, law: ContactLaw) -> tuple[float, float]:
    """What the impulse of contact ``c`` should be, given ``v`` and all other contacts as they are."""
    a = problem.mobility[c]
    w, w_tangent = _relative(contacts, c, v)
    free = w + problem.bias[c] - a * contacts.impulse[c, 0]
    reaction = -free / a
    if not problem.approaching[c]:
        return max(0.0, reaction), 0.0
    normal = max(reaction, -(problem.w_minus[c, 0] + free) / (2.0 / law.k_normal + a))
    if law.k_tangent == 0.0:
        return normal, 0.0
    free = w_tangent - a * contacts.impulse[c, 1]
    return normal, -(problem.w_minus[c, 1] + free) / (2.0 / law.k_tangent + a)


@kernel
def _relative(contacts: Contacts, c: int, v: Floats) -> tuple[float, float]:
    """Normal and tangential speed of i relative to j at contact ``c``."""
    i, j = contacts.i[c], contacts.j[c]
    vx, vy = v[i, 0], v[i, 1]
    if j >= 0:
        vx -= v[j, 0]
        vy -= v[j, 1]
    nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
    return vx * nx + vy * ny, vy * nx - vx * ny


@kernel
def _mobility(contacts: Contacts, c: int, mass: Floats) -> float:
    """Inverse effective mass a_c [1/kg]."""
    j = contacts.j[c]
    return 1.0 / mass[contacts.i[c]] + (1.0 / mass[j] if j >= 0 else 0.0)


@kernel
def _apply(contacts: Contacts, c: int, mass: Floats, v: Floats, normal: float, tangent: float) -> None:
    """Change the velocities by an impulse (normal, tangent) at contact ``c``."""
    i, j = contacts.i[c], contacts.j[c]
    nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
    px, py = normal * nx - tangent * ny, normal * ny + tangent * nx
    v[i, 0] += px / mass[i]
    v[i, 1] += py / mass[i]
    if j >= 0:
        v[j, 0] -= px / mass[j]
        v[j, 1] -= py / mass[j]


@kernel
def fastest_speed(begin: int, end: int, active: Bools, v: Floats) -> float:
    """Largest speed [m/s] among the active people ``begin:end``."""
    square = 0.0
    for i in range(begin, end):
        if active[i]:
            square = max(square, v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1])
    return np.sqrt(square)
