"""The contact problem of NSM1 and NSM2 as rows: who, in which direction, under which law.

Both schemes ask for impulses P and velocities v = v_start + M^-1 B^T P such that every contact meets its own law, with
w = B v + bias the speed at which it separates ((B v)_c = n_c . (v_i - v_j), a_c = 1/m_i + 1/m_j its diagonal):

    unilateral          0 <= P orthogonal to w >= 0                                  NSM1, with bias D / h
    with dissipation    P = -K_N (w- + w) / 2 + mu,  0 <= mu orthogonal to w >= 0    NSM2, if it approached; else as above
    tangential          P_T = -K_T (w_T- + w_T) / 2                                  NSM2, if it approached

Each law is a row that knows two bodies, a direction and what its reaction r = a P [m/s] should be, all else being as it is; a
wall is a body that no reaction moves.  Rows of NSM1 are sorted by color: no two of a color share a body (but walls), so that
the processor need not wait for one row to start the next; a sweep was measured to take 1.5 times as long in the order of the
contacts.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env._kernels.jit import inner_kernel
from crowd_env.physics.contacts import Contacts
from crowd_env.state import Floats

_FEW = 32  # contacts; so many are in flight together in any order, to sort them costs more than it saves
_COLOURS = 12  # 7 or 8 are used in a jam; whoever finds none free shares the last

Indices = NDArray[np.uint32]


class Problem(NamedTuple):
    """The rows of all environments, in the order of solution, and the velocities that they work on.

    Environment e has the rows from its first contact on, and the bodies ``env_start[e] + e`` to
    ``env_start[e + 1] + e``, of which the last is the wall.
    """

    pair: Indices  # (M, 2)        the two bodies, counted within the environment; the wall is the last
    source: Indices  # (M,)          contact of the row, counted from the first of its environment
    row: Floats  # (M, 4)        direction from the second to the first (2); m/s bias, or if it is soft w-; share of the first
    soft: Floats  # (M,)          compliance of the law: 0 hard, > 0 with dissipation, < 0 tangential
    reaction: Floats  # (M, 2)   m/s  r = a P of this sweep and of the one before
    velocity: Floats  # (P+E, 2) m/s
    v_last: Floats  # (P+E, 2) m/s  of the sweep before
    colors: Indices  # (P+E, 2)      colors taken by each body (bits); where each color starts


def allocate_problem(people: int, entries: int, environments: int) -> Problem:
    """Return a problem with room for ``entries`` contacts."""
    bodies = people + environments
    return Problem(
        pair=np.zeros((entries, 2), dtype=np.uint32),
        source=np.zeros(entries, dtype=np.uint32),
        row=np.zeros((entries, 4)),
        soft=np.zeros(entries),
        reaction=np.zeros((entries, 2)),
        velocity=np.zeros((bodies, 2)),
        v_last=np.zeros((bodies, 2)),
        colors=np.zeros((bodies, 2), dtype=np.uint32),
    )


@inner_kernel
def pose_no_overlap(
    begin: int,
    end: int,
    first: int,
    last: int,
    e: int,
    contacts: Contacts,
    mass: Floats,
    v: Floats,
    problem: Problem,
    dt: float,
    warm: bool,
) -> int:
    """NSM1: D + h w >= 0 for the contacts ``begin:end`` of the people ``first:last`` (Pécol et al. 2011, eq 6).

    ``v`` (P, 2) m/s are the velocities without contact; ``warm`` starts from the impulses that the contacts hold.
    Returns the number of rows that are likely to push: they come first.
    """
    busy = _sort(begin, end, first, last, e, contacts, v, problem, dt)
    source, row, reaction = problem.source, problem.row, problem.reaction
    gap, impulse = contacts.gap, contacts.impulse
    for t in range(begin, end):
        c = begin + source[t]
        a = _place(t, c, first, last, contacts, mass, problem)
        row[t, 2] = gap[c] / dt
        reaction[t, 0] = a * impulse[c, 0] if warm else 0.0
        reaction[t, 1] = 0.0
    return busy


@inner_kernel
def pose_percussions(
    begin: int,
    end: int,
    first: int,
    last: int,
    contacts: Contacts,
    mass: Floats,
    before: Floats,
    problem: Problem,
    k_normal: float,
    k_tangent: float,
    dissipative: bool,
) -> int:
    """NSM2: a contact dissipates if it approached at t(n), velocities ``before`` (eqs 8-10 with the approach gate).

    ``dissipative`` lets a contact that was separating be closed only down to w+ = -w-, where it does no work.  Returns the
    number of rows: with tangential dissipation up to twice the number of contacts.
    """
    tangents = end
    source, pair, row, soft, reaction = problem.source, problem.pair, problem.row, problem.soft, problem.reaction
    contact_i, contact_j, normal = contacts.i, contacts.j, contacts.normal
    for t in range(begin, end):
        source[t] = t - begin
        a = _place(t, t, first, last, contacts, mass, problem)
        i, j = contact_i[t], contact_j[t]
        vx, vy = before[i, 0], before[i, 1]
        if j >= 0:
            vx -= before[j, 0]
            vy -= before[j, 1]
        nx, ny = normal[t, 0], normal[t, 1]
        w = vx * nx + vy * ny
        reaction[t, 0], reaction[t, 1] = 0.0, 0.0
        if w < 0.0:
            row[t, 2] = w if k_normal > 0.0 else 0.0
            soft[t] = a / (2.0 / k_normal + a)
            if k_tangent > 0.0:
                k = tangents
                tangents += 1
                source[k] = t - begin
                pair[k, 0], pair[k, 1] = pair[t, 0], pair[t, 1]
                row[k, 0], row[k, 1] = -ny, nx
                row[k, 2] = vy * nx - vx * ny
                row[k, 3] = row[t, 3]
                soft[k] = -a / (2.0 / k_tangent + a)
                reaction[k, 0], reaction[k, 1] = 0.0, 0.0
        else:
            row[t, 2] = w if dissipative else 0.0
            soft[t] = 0.0
    return tangents - begin


@inner_kernel
def _place(t: int, c: int, first: int, last: int, contacts: Contacts, mass: Floats, problem: Problem) -> float:
    """Give row ``t`` the bodies and the direction of contact ``c``; returns its inverse effective mass a_c [1/kg]."""
    pair, row, normal = problem.pair, problem.row, contacts.normal
    i, j = contacts.i[c], contacts.j[c]
    a = 1.0 / mass[i]
    pair[t, 0] = i - first
    row[t, 0], row[t, 1] = normal[c, 0], normal[c, 1]
    if j >= 0:
        pair[t, 1] = j - first
        row[t, 3] = mass[j] / (mass[i] + mass[j])
        a += 1.0 / mass[j]
    else:
        pair[t, 1] = last - first
        row[t, 3] = 1.0  # exactly: the wall gets 1 - 1 = 0
    return a


@inner_kernel
def _sort(
    begin: int, end: int, first: int, last: int, e: int, contacts: Contacts, v: Floats, problem: Problem, dt: float
) -> int:
    """Sort the contacts by color; returns how many come before those that neither pushed nor would close without pushes."""
    source, pair, bodies = problem.source, problem.pair, problem.colors
    contact_i, contact_j, normal, impulse, gap = contacts.i, contacts.j, contacts.normal, contacts.impulse, contacts.gap
    if end - begin <= _FEW:
        for c in range(begin, end):
            source[c] = c - begin
        return end - begin
    base = first + e
    idle = min(_COLOURS, last - first)  # the color of those
    for i in range(base, last + e + 1):
        bodies[i, 0] = 0
        bodies[i, 1] = 0
    for c in range(begin, end):
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
    busy = bodies[base + idle, 1]
    for c in range(begin, end):
        place = base + pair[c, 0]
        source[begin + bodies[place, 1]] = c - begin
        bodies[place, 1] += 1
    return busy


@inner_kernel
def give_impulses(begin: int, rows: int, number: int, contacts: Contacts, mass: Floats, problem: Problem) -> None:
    """Leave the impulses [N s] of the solution with the ``number`` contacts: rows beyond are tangential."""
    source, row, reaction = problem.source, problem.row, problem.reaction
    impulse, contact_i = contacts.impulse, contacts.i
    for c in range(begin, begin + number):
        impulse[c, 1] = 0.0
    for t in range(begin, begin + rows):
        c = begin + source[t]
        gained = reaction[t, 0] * row[t, 3] * mass[contact_i[c]]  # share of i = 1 / (a m_i)
        impulse[c, 0 if t < begin + number else 1] = gained


@inner_kernel
def keep_impulses(begin: int, end: int, contacts: Contacts, problem: Problem) -> None:
    """Keep the impulses of the contacts ``begin:end`` while they are found once more, up to a wider gap."""
    reaction, impulse = problem.reaction, contacts.impulse
    for c in range(begin, end):
        reaction[c, 1] = impulse[c, 0]


@inner_kernel
def take_impulses(begin: int, end: int, margin: float, contacts: Contacts, problem: Problem) -> None:
    """Give the kept impulses to the same contacts: those with a gap below the former ``margin``, in the same order."""
    gap, impulse, reaction, kept = contacts.gap, contacts.impulse, problem.reaction, begin
    for c in range(begin, end):
        if gap[c] < margin:
            impulse[c, 0] = reaction[kept, 1]
            kept += 1
