"""Dual projected Gauss-Seidel for the contact problems of NSM1 and NSM2, with a stop on the true residual.

Both problems read: find impulses P and velocities v = v0 + M^-1 B^T P, with w = B v the separation speed of each contact
((B v)_c = n_c . (v_i - v_j), a_c = 1/m_i + 1/m_j its diagonal), such that every contact meets its own law.  A sweep sets each
contact right with all others frozen.  A sweep that changes little is no proof of a small error, so the stop is on the
violation of the laws themselves, all measured at the same velocities and in m/s.
"""

from typing import NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.physics.contacts import Contacts
from crowd_env.state import Bools, Floats


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
def solve_no_overlap(
    begin: int,
    end: int,
    contacts: Contacts,
    mass: Floats,
    v: Floats,
    dt: float,
    tolerance: float,
    max_sweeps: int,
) -> tuple[int, float]:
    """NSM1: 0 <= P orthogonal to D / h + w >= 0 for the contacts ``begin:end`` (Pécol et al. 2011, eqs 6, 7).

    ``v`` holds the trial velocity and becomes the solution; `Contacts.impulse` holds the first guess and becomes P.
    Returns the number of sweeps and the residual max_c |min(a_c P_c, D_c / h + w_c)| in m/s.
    """
    for c in range(begin, end):
        contacts.impulse[c, 1] = 0.0
        _apply(contacts, c, mass, v, contacts.impulse[c, 0], 0.0)
    residual = _overlap_residual(begin, end, contacts, mass, v, dt)
    sweeps = 0
    while residual > tolerance and sweeps < max_sweeps:
        moved = 0.0
        for c in range(begin, end):
            a = _mobility(contacts, c, mass)
            w, _ = _relative(contacts, c, v)
            old = contacts.impulse[c, 0]
            new = max(0.0, old - (contacts.gap[c] / dt + w) / a)
            if new != old:
                contacts.impulse[c, 0] = new
                _apply(contacts, c, mass, v, new - old, 0.0)
                moved = max(moved, a * abs(new - old))
        sweeps += 1
        if moved <= tolerance or sweeps == max_sweeps:
            residual = _overlap_residual(begin, end, contacts, mass, v, dt)
    return sweeps, residual


@kernel
def _overlap_residual(begin: int, end: int, contacts: Contacts, mass: Floats, v: Floats, dt: float) -> float:
    worst = 0.0
    for c in range(begin, end):
        w, _ = _relative(contacts, c, v)
        a = _mobility(contacts, c, mass)
        worst = max(worst, abs(min(a * contacts.impulse[c, 0], contacts.gap[c] / dt + w)))
    return worst


class PercussionLaw(NamedTuple):
    """The parameters of NSM2 as kernels read them."""

    k_normal: float
    k_tangent: float
    tolerance: float
    max_sweeps: int


@kernel
def _percussion(w_minus: float, w_free: float, a: float, approaching: bool, k_normal: float) -> float:
    """Normal percussion of one NSM2 contact with all others frozen (``w_free``: speed after the step without it)."""
    dissipative = -(w_minus + w_free) / (2.0 / k_normal + a) if approaching else 0.0
    reactive = -w_free / a
    return max(dissipative, reactive)


@kernel
def _tangential_percussion(w_minus: float, w_free: float, a: float, approaching: bool, k_tangent: float) -> float:
    """Tangential percussion of one NSM2 contact: -(K_T / 2) (w- + w+), nothing if K_T = 0."""
    if not approaching or k_tangent == 0.0:
        return 0.0
    return -(w_minus + w_free) / (2.0 / k_tangent + a)


@kernel
def solve_percussions(
    begin: int,
    end: int,
    contacts: Contacts,
    mass: Floats,
    before: Floats,
    v: Floats,
    law: PercussionLaw,
) -> tuple[int, float]:
    """NSM2: percussions of the overlapping contacts ``begin:end`` (Pécol et al. 2011, eqs 8-10).

    ``before`` is u(n), ``v`` holds u(n) + M^-1 p_ext and becomes u(n+1).  A contact dissipates only if it approached at t(n)
    (w- < 0); the reaction that forbids approach after the step acts on all of them.  Starts from zero: a warm start was
    measured to be useless here.  Returns the number of sweeps and the residual max_c a_c |P_c - law_c(v)| in m/s.
    """
    for c in range(begin, end):
        contacts.impulse[c, 0] = 0.0
        contacts.impulse[c, 1] = 0.0
    sweeps = 0
    residual = _percussion_residual(begin, end, contacts, mass, before, v, law)
    while residual > law.tolerance and sweeps < law.max_sweeps:
        moved = 0.0
        for c in range(begin, end):
            normal, tangent, a = _percussion_law(contacts, c, mass, before, v, law)
            dn, dt = normal - contacts.impulse[c, 0], tangent - contacts.impulse[c, 1]
            if dn != 0.0 or dt != 0.0:
                contacts.impulse[c, 0] = normal
                contacts.impulse[c, 1] = tangent
                _apply(contacts, c, mass, v, dn, dt)
                moved = max(moved, a * abs(dn), a * abs(dt))
        sweeps += 1
        if moved <= law.tolerance or sweeps == law.max_sweeps:
            residual = _percussion_residual(begin, end, contacts, mass, before, v, law)
    return sweeps, residual


@kernel
def _percussion_law(
    contacts: Contacts, c: int, mass: Floats, before: Floats, v: Floats, law: PercussionLaw
) -> tuple[float, float, float]:
    """What the percussion of contact ``c`` should be, given the velocities ``v``; and its a_c."""
    a = _mobility(contacts, c, mass)
    n_minus, t_minus = _relative(contacts, c, before)
    n_plus, t_plus = _relative(contacts, c, v)
    approaching = n_minus < 0.0
    normal = _percussion(n_minus, n_plus - a * contacts.impulse[c, 0], a, approaching, law.k_normal)
    tangent = _tangential_percussion(t_minus, t_plus - a * contacts.impulse[c, 1], a, approaching, law.k_tangent)
    return normal, tangent, a


@kernel
def _percussion_residual(
    begin: int,
    end: int,
    contacts: Contacts,
    mass: Floats,
    before: Floats,
    v: Floats,
    law: PercussionLaw,
) -> float:
    worst = 0.0
    for c in range(begin, end):
        normal, tangent, a = _percussion_law(contacts, c, mass, before, v, law)
        worst = max(worst, a * abs(normal - contacts.impulse[c, 0]), a * abs(tangent - contacts.impulse[c, 1]))
    return worst


@kernel
def fastest_speed(begin: int, end: int, active: Bools, v: Floats) -> float:
    """Largest speed [m/s] among the active people ``begin:end``."""
    square = 0.0
    for i in range(begin, end):
        if active[i]:
            square = max(square, v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1])
    return np.sqrt(square)
