"""Contacts as rows of constraints: two bodies, a direction and a law each.

The schemes seek impulses P and velocities v = v_start + M^-1 B^T P such that every contact meets its law, with
w = B v + bias the speed at which it separates ((B v)_c = n_c . (v_i - v_j), a_c = 1/m_i + 1/m_j its diagonal):

    unilateral          0 <= P orthogonal to w >= 0                                  NSM1, with bias D / h
    with dissipation    P = -K_N (w- + w) / 2 + mu,  0 <= mu orthogonal to w >= 0    NSM2, if it approached; else as above
    tangential          P_T = -K_T (w_T- + w_T) / 2                                  NSM2, if it approached
    viscous             P_T = -h kappa d w_T                                         Helbing, backward Euler

A row holds two bodies, a direction and the law of its reaction r = a P [m/s] while all other reactions are fixed.  A wall is a
body that no reaction moves.  Rows of NSM1 are sorted by color: no two of a color share a body (but walls), so the processor
need not finish one row before the next.  In the order of the contacts a sweep was measured to take 1.5 times as long.
"""

from typing import Annotated, NamedTuple

from crowd_env.core.arrays.state import Floats, Indices
from crowd_env.core.kernels.jit import inner_kernel
from crowd_env.physics.contacts import Contacts

_FEW = 32  # contacts; this many are in flight together in any order, so sorting costs more than it saves
_COLORS = 12  # 7 or 8 are used in a jam; a contact without a free color shares the last


class Extent(NamedTuple):
    """Ranges of an environment in the arrays of a batch: its people and its contacts; its rows begin at its first contact."""

    e: int
    slot_start: int
    slot_stop: int
    contact_start: int
    contact_stop: int


class Constraints(NamedTuple):
    """The rows of all environments, in the order of solution, and their velocities.

    Environment e has the rows from its first contact on, and the bodies ``env_start[e] + e`` to ``env_start[e + 1] + e``, of
    which the last is the wall.
    """

    # The two bodies, counted within the environment; the wall is the last.
    pair: Annotated[Indices, "M 2", "constraints"]
    source: Annotated[Indices, "M", "constraints"]  # contact of the row, counted from the first of its environment
    # Direction from the second to the first (2); m/s bias, or w- of a soft row; share of i.
    coefficients: Annotated[Floats, "M 4", "constraints"]
    compliance: Annotated[Floats, "M", "constraints"]  # 0 hard, > 0 with dissipation, < 0 tangential
    reaction: Annotated[Floats, "M 2", "constraints"]  # m/s  r = a P of this sweep and of the last
    velocity: Annotated[Floats, "B 2", "constraints"]  # m/s
    previous_velocity: Annotated[Floats, "B 2", "constraints"]  # m/s  of the sweep before
    colors: Annotated[Indices, "B 2", "constraints"]  # colors taken by each body (bits); where each color starts


@inner_kernel
def assemble_no_overlap(
    extent: Extent, contacts: Contacts, mass: Floats, v: Floats, constraints: Constraints, dt: float, warm: bool
) -> int:
    """NSM1: D + h w >= 0 for the contacts of an environment (Pécol et al. 2011, eq 6).

    ``v`` (P, 2) m/s are the velocities without contact; ``warm`` starts from the impulses that the contacts hold.
    Returns the size of the active set: the rows that are likely to push, which come first.
    """
    active_rows = _sort_by_color(extent, contacts, v, constraints, dt)
    source, coefficients, reaction = constraints.source, constraints.coefficients, constraints.reaction
    gap, impulse, contact_start = contacts.gap, contacts.impulse, extent.contact_start
    for t in range(contact_start, extent.contact_stop):
        c = contact_start + source[t]
        a = _assemble_row(t, c, extent, contacts, mass, constraints)
        coefficients[t, 2] = gap[c] / dt
        reaction[t, 0] = a * impulse[c, 0] if warm else 0.0
        reaction[t, 1] = 0.0
    return active_rows


class Percussion(NamedTuple):
    """Parameters of the contact of NSM2 for kernels."""

    k_normal: float  # kg
    k_tangent: float  # kg
    dissipative: bool  # a contact that was separating may close down to w+ = -w-, where it does no work


@inner_kernel
def assemble_percussions(
    extent: Extent, contacts: Contacts, mass: Floats, before: Floats, constraints: Constraints, params: Percussion
) -> int:
    """NSM2: a contact dissipates if it approached at t(n), with velocities ``before`` (eqs 8-10 with the approach gate).

    Returns the number of rows: with tangential dissipation up to twice the number of contacts.
    """
    k_normal, k_tangent, dissipative = params
    contact_start, contact_stop = extent.contact_start, extent.contact_stop
    tangents = contact_stop
    source, pair, coefficients = constraints.source, constraints.pair, constraints.coefficients
    compliance, reaction = constraints.compliance, constraints.reaction
    contact_i, contact_j, normal, impulse = contacts.i, contacts.j, contacts.normal, contacts.impulse
    for t in range(contact_start, contact_stop):
        source[t] = t - contact_start
        a = _assemble_row(t, t, extent, contacts, mass, constraints)
        i, j = contact_i[t], contact_j[t]
        vx, vy = before[i, 0], before[i, 1]
        if j >= 0:
            vx -= before[j, 0]
            vy -= before[j, 1]
        nx, ny = normal[t, 0], normal[t, 1]
        w = vx * nx + vy * ny
        reaction[t, 0], reaction[t, 1] = a * impulse[t, 0] if dissipative else 0.0, 0.0
        if w < 0.0:
            coefficients[t, 2] = w if k_normal > 0.0 else 0.0
            compliance[t] = a / (2.0 / k_normal + a)
            if k_tangent > 0.0:
                k = tangents
                tangents += 1
                source[k] = t - contact_start
                pair[k, 0], pair[k, 1] = pair[t, 0], pair[t, 1]
                coefficients[k, 0], coefficients[k, 1] = -ny, nx
                coefficients[k, 2] = vy * nx - vx * ny
                coefficients[k, 3] = coefficients[t, 3]
                compliance[k] = -a / (2.0 / k_tangent + a)
                reaction[k, 0], reaction[k, 1] = 0.0, 0.0
        else:
            coefficients[t, 2] = w if dissipative else 0.0
            compliance[t] = 0.0
    return tangents - contact_start


@inner_kernel
def assemble_friction(
    extent: Extent, contacts: Contacts, mass: Floats, constraints: Constraints, friction: float
) -> None:
    """Helbing: tangential rows alone, a contact each; ``friction`` [kg/m] is that of the law times the step.

    They start from the tangential impulses that the contacts hold.
    """
    coefficients, compliance, reaction = constraints.coefficients, constraints.compliance, constraints.reaction
    gap, impulse, source, contact_start = contacts.gap, contacts.impulse, constraints.source, extent.contact_start
    for t in range(contact_start, extent.contact_stop):
        source[t] = t - contact_start
        a = _assemble_row(t, t, extent, contacts, mass, constraints)
        coefficients[t, 0], coefficients[t, 1] = -coefficients[t, 1], coefficients[t, 0]
        coefficients[t, 2] = 0.0
        resistance = -a * friction * gap[t]
        compliance[t] = -resistance / (1.0 + resistance)
        reaction[t, 0], reaction[t, 1] = a * impulse[t, 1], 0.0


@inner_kernel
def _assemble_row(t: int, c: int, extent: Extent, contacts: Contacts, mass: Floats, constraints: Constraints) -> float:
    """Give row ``t`` the bodies and the direction of contact ``c``; returns its inverse effective mass a_c [1/kg]."""
    pair, coefficients, normal = constraints.pair, constraints.coefficients, contacts.normal
    i, j, slot_start = contacts.i[c], contacts.j[c], extent.slot_start
    a = 1.0 / mass[i]
    pair[t, 0] = i - slot_start
    coefficients[t, 0], coefficients[t, 1] = normal[c, 0], normal[c, 1]
    if j >= 0:
        pair[t, 1] = j - slot_start
        coefficients[t, 3] = mass[j] / (mass[i] + mass[j])
        a += 1.0 / mass[j]
    else:
        pair[t, 1] = extent.slot_stop - slot_start
        coefficients[t, 3] = 1.0  # exactly: the wall gets 1 - 1 = 0
    return a


@inner_kernel
def _sort_by_color(extent: Extent, contacts: Contacts, v: Floats, constraints: Constraints, dt: float) -> int:
    """Sort the contacts by color; last come idle ones, which neither pushed nor would close without impulses.

    Returns the number of contacts before the idle ones.
    """
    e, slot_start, slot_stop, contact_start, contact_stop = extent
    source, pair, bodies = constraints.source, constraints.pair, constraints.colors
    contact_i, contact_j, normal, impulse, gap = contacts.i, contacts.j, contacts.normal, contacts.impulse, contacts.gap
    if contact_stop - contact_start <= _FEW:
        for c in range(contact_start, contact_stop):
            source[c] = c - contact_start
        return contact_stop - contact_start
    base = slot_start + e
    idle = min(_COLORS, slot_stop - slot_start)  # color of idle contacts
    for i in range(base, slot_stop + e + 1):
        bodies[i, 0] = 0
        bodies[i, 1] = 0
    for c in range(contact_start, contact_stop):
        i, j = contact_i[c], contact_j[c]
        color = idle
        nx, ny = normal[c, 0], normal[c, 1]
        w = v[i, 0] * nx + v[i, 1] * ny
        if j >= 0:
            w -= v[j, 0] * nx + v[j, 1] * ny
        if impulse[c, 0] != 0.0 or dt * w + gap[c] < 0.0:
            taken = bodies[i + e, 0] | bodies[j + e, 0] if j >= 0 else bodies[i + e, 0]
            color = 0
            while color < idle - 1 and (taken >> color) & 1:
                color += 1
            bodies[i + e, 0] |= 1 << color
            if j >= 0:
                bodies[j + e, 0] |= 1 << color
        pair[c, 0] = color
        bodies[base + color, 1] += 1
    total = 0
    for color in range(idle + 1):
        count = bodies[base + color, 1]
        bodies[base + color, 1] = total
        total += count
    active_rows = bodies[base + idle, 1]
    for c in range(contact_start, contact_stop):
        head = base + pair[c, 0]
        source[contact_start + bodies[head, 1]] = c - contact_start
        bodies[head, 1] += 1
    return active_rows


@inner_kernel
def set_impulses(extent: Extent, rows: int, contacts: Contacts, mass: Floats, constraints: Constraints) -> None:
    """Write the impulses [N s] of ``rows`` solved rows to the contacts: rows beyond the number of contacts are tangential."""
    contact_start, contact_stop = extent.contact_start, extent.contact_stop
    source, coefficients, reaction = constraints.source, constraints.coefficients, constraints.reaction
    impulse, contact_i = contacts.impulse, contacts.i
    for c in range(contact_start, contact_stop):
        impulse[c, 1] = 0.0
    for t in range(contact_start, contact_start + rows):
        c = contact_start + source[t]
        gained = reaction[t, 0] * coefficients[t, 3] * mass[contact_i[c]]  # share of i = 1 / (a m_i)
        impulse[c, 0 if t < contact_stop else 1] = gained


@inner_kernel
def stash_impulses(extent: Extent, contacts: Contacts, constraints: Constraints) -> None:
    """Save the impulses of the contacts while contacts are found once more, up to a wider gap."""
    reaction, impulse = constraints.reaction, contacts.impulse
    for c in range(extent.contact_start, extent.contact_stop):
        reaction[c, 1] = impulse[c, 0]


@inner_kernel
def restore_impulses(extent: Extent, margin: float, contacts: Contacts, constraints: Constraints) -> None:
    """Give the saved impulses to the same contacts: all with a gap below the former ``margin``, in the same order."""
    gap, impulse, reaction, stashed = contacts.gap, contacts.impulse, constraints.reaction, extent.contact_start
    for c in range(extent.contact_start, extent.contact_stop):
        if gap[c] < margin:
            impulse[c, 0] = reaction[stashed, 1]
            stashed += 1
