"""The contact problem of NSM1 and NSM2, and its solution to a true residual.

Both schemes ask for impulses P and velocities v = v_start + M^-1 B^T P such that every contact meets its own law, with
w = B v + bias the speed at which it separates ((B v)_c = n_c . (v_i - v_j), a_c = 1/m_i + 1/m_j its diagonal):

    unilateral          0 <= P orthogonal to w >= 0                                  NSM1, with bias D / h
    with dissipation    P = -K_N (w- + w) / 2 + mu,  0 <= mu orthogonal to w >= 0    NSM2, if it approached; else as above
    tangential          P_T = -K_T (w_T- + w_T) / 2                                  NSM2, if it approached

Each law is a row that knows two bodies, a direction and what its reaction r = a P [m/s] should be, all else being as it is; a
wall is a body that no reaction moves.  Projected Gauss-Seidel sets one row right after the other.  "accelerated" starts every
sweep from an extrapolation of the last two (Nesterov's momentum, dropped whenever it runs uphill; O'Donoghue and Candès 2015):
in jams a third of the sweeps of the accelerated projected gradient, each at its price, and a tenth of those without momentum.

Rows are sorted by colour: no two of a colour share a body (but walls), so that the processor need not wait for one row to
start the next; measured to be 1.5 times as fast as in the order of the contacts.

A step that changes little is no proof of a small error, so the solvers stop on the violation of the laws themselves, in m/s, all
at the same velocities: max_c |r_c - law_c(v)|, which for a unilateral contact is |min(a_c P_c, w_c)|.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import kernel
from crowd_env.physics.contacts import Contacts
from crowd_env.state import Bools, Floats

AUTO, GAUSS_SEIDEL, ACCELERATED = 0, 1, 2
SolverName = Literal["auto", "gauss-seidel", "accelerated"]
SOLVERS: dict[str, int] = {"auto": AUTO, "gauss-seidel": GAUSS_SEIDEL, "accelerated": ACCELERATED}
_FEW = 32  # contacts; so many are in flight together in any order, to sort them costs more than it saves
_COLOURS = 12  # 7 or 8 are used in a jam; whoever finds none free shares the last
# Momentum may not grow beyond 1 - this / sqrt(rows): the slowest motions of a jam are as wide as the jam.  Measured from 300 to 5000
# people: without the limit, up to 20 % more sweeps to 1e-3 of the first residual.
_RESISTANCE = 1.5
_ROUNDING = 1e-12  # m/s, no relative residual below it is asked for

Indices = NDArray[np.uint32]


class Problem(NamedTuple):
    """The rows of all environments, in the order of solution, and the velocities that they work on.

    Environment e has the rows from its first contact on, and the bodies ``env_start[e] + e`` to ``env_start[e + 1] + e``, of which
    the last is the wall.
    """

    pair: Indices  # (M, 2)        the two bodies, counted within the environment; the wall is the last
    source: Indices  # (M,)          contact of the row, counted from the first of its environment
    row: Floats  # (M, 4)        direction from the second to the first (2); m/s bias, or if it is soft w-; share of the first
    soft: Floats  # (M,)          compliance of the law: 0 hard, > 0 with dissipation, < 0 tangential
    reaction: Floats  # (M, 2)   m/s  r = a P of this sweep and of the one before
    velocity: Floats  # (P+E, 2) m/s
    v_last: Floats  # (P+E, 2) m/s  of the sweep before
    colours: Indices  # (P+E, 2)      colours taken by each body (bits); where each colour starts


class ContactLaw(NamedTuple):
    """The parameters as kernels read them."""

    k_normal: float  # kg
    k_tangent: float  # kg
    tolerance: float  # m/s
    relative: float  # of the residual without any impulse, in the 2-norm; infinite = not asked for
    max_iterations: int
    accelerated: bool  # with momentum


def allocate_problem(people: int, entries: int, environments: int | None = None) -> Problem:
    """Return a problem with room for ``entries`` contacts; there are at most as many environments as people."""
    bodies = people + (people if environments is None else environments)
    return Problem(
        pair=np.zeros((entries, 2), dtype=np.uint32),
        source=np.zeros(entries, dtype=np.uint32),
        row=np.zeros((entries, 4)),
        soft=np.zeros(entries),
        reaction=np.zeros((entries, 2)),
        velocity=np.zeros((bodies, 2)),
        v_last=np.zeros((bodies, 2)),
        colours=np.zeros((bodies, 2), dtype=np.uint32),
    )


# ----------------------------------------------------------------------------------------------------- posing the problem


@kernel
def pose_no_overlap(
    begin: int, end: int, first: int, last: int, e: int, contacts: Contacts, mass: Floats, v: Floats, problem: Problem, dt: float, warm: bool
) -> int:
    """NSM1: D + h w >= 0 for the contacts ``begin:end`` of the people ``first:last`` (Pécol et al. 2011, eq 6).

    Returns the number of rows that are likely to push: they come first.
    """
    busy = _sort(begin, end, first, last, e, contacts, v, problem, dt)
    for t in range(begin, end):
        c = begin + problem.source[t]
        a = _place(t, c, first, last, contacts, mass, problem)
        problem.row[t, 2] = contacts.gap[c] / dt
        problem.soft[t] = 0.0
        problem.reaction[t, 0] = a * contacts.impulse[c, 0] if warm else 0.0
        problem.reaction[t, 1] = 0.0
    return busy


@kernel
def pose_percussions(
    begin: int,
    end: int,
    first: int,
    last: int,
    contacts: Contacts,
    mass: Floats,
    before: Floats,
    problem: Problem,
    law: ContactLaw,
    dissipative: bool,
) -> int:
    """NSM2: a contact dissipates if it approached at t(n), velocities ``before`` (eqs 8-10 with the approach gate).

    ``dissipative`` lets a contact that was separating be closed only down to w+ = -w-, where it does no work.  Returns the number
    of rows; with tangential dissipation that is up to twice the number of contacts.
    """
    tangents = end
    for t in range(begin, end):
        problem.source[t] = t - begin
        a = _place(t, t, first, last, contacts, mass, problem)
        i, j = contacts.i[t], contacts.j[t]
        vx, vy = before[i, 0], before[i, 1]
        if j >= 0:
            vx -= before[j, 0]
            vy -= before[j, 1]
        nx, ny = contacts.normal[t, 0], contacts.normal[t, 1]
        w = vx * nx + vy * ny
        problem.reaction[t, 0], problem.reaction[t, 1] = 0.0, 0.0
        if w < 0.0:
            problem.row[t, 2] = w if law.k_normal > 0.0 else 0.0
            problem.soft[t] = a / (2.0 / law.k_normal + a)
            if law.k_tangent > 0.0:
                k = tangents
                tangents += 1
                problem.source[k] = t - begin
                problem.pair[k, 0], problem.pair[k, 1] = problem.pair[t, 0], problem.pair[t, 1]
                problem.row[k, 0], problem.row[k, 1] = -ny, nx
                problem.row[k, 2] = vy * nx - vx * ny
                problem.row[k, 3] = problem.row[t, 3]
                problem.soft[k] = -a / (2.0 / law.k_tangent + a)
                problem.reaction[k, 0], problem.reaction[k, 1] = 0.0, 0.0
        else:
            problem.row[t, 2] = w if dissipative else 0.0
            problem.soft[t] = 0.0
    return tangents - begin


@kernel
def _place(t: int, c: int, first: int, last: int, contacts: Contacts, mass: Floats, problem: Problem) -> float:
    """Give row ``t`` the bodies and the direction of contact ``c``; returns its inverse effective mass a_c [1/kg]."""
    i, j = contacts.i[c], contacts.j[c]
    a = 1.0 / mass[i]
    problem.pair[t, 0] = i - first
    problem.row[t, 0], problem.row[t, 1] = contacts.normal[c, 0], contacts.normal[c, 1]
    if j >= 0:
        problem.pair[t, 1] = j - first
        problem.row[t, 3] = mass[j] / (mass[i] + mass[j])
        a += 1.0 / mass[j]
    else:
        problem.pair[t, 1] = last - first
        problem.row[t, 3] = 1.0  # exactly: the wall gets 1 - 1 = 0
    return a


@kernel
def _sort(
    begin: int, end: int, first: int, last: int, e: int, contacts: Contacts, v: Floats, problem: Problem, dt: float
) -> int:
    """Sort the contacts by colour; those that neither pushed nor would close without pushes come last.  Returns how many are not."""
    source, pair, bodies = problem.source, problem.pair, problem.colours
    if end - begin <= _FEW:
        for c in range(begin, end):
            source[c] = c - begin
        return end - begin
    base = first + e
    idle = min(_COLOURS, last - first)  # the colour of those
    for i in range(base, last + e + 1):
        bodies[i, 0] = 0
        bodies[i, 1] = 0
    for c in range(begin, end):
        i, j = contacts.i[c], contacts.j[c]
        colour = idle
        nx, ny = contacts.normal[c, 0], contacts.normal[c, 1]
        w = v[i, 0] * nx + v[i, 1] * ny
        if j >= 0:
            w -= v[j, 0] * nx + v[j, 1] * ny
        if contacts.impulse[c, 0] != 0.0 or dt * w + contacts.gap[c] < 0.0:
            taken = bodies[i + e, 0] | bodies[j + e, 0] if j >= 0 else bodies[i + e, 0]
            colour = 0
            while colour < idle - 1 and (taken >> colour) & 1:
                colour += 1
            bodies[i + e, 0] |= 1 << colour
            if j >= 0:
                bodies[j + e, 0] |= 1 << colour
        pair[c, 0] = colour
        bodies[base + colour, 1] += 1
    total = 0
    for colour in range(idle + 1):
        count = bodies[base + colour, 1]
        bodies[base + colour, 1] = total
        total += count
    busy = bodies[base + idle, 1]
    for c in range(begin, end):
        place = base + pair[c, 0]
        source[begin + bodies[place, 1]] = c - begin
        bodies[place, 1] += 1
    return busy


# ------------------------------------------------------------------------------------------------------------ solving it


@kernel
def solve(
    begin: int,
    rows: int,
    busy: int,
    first: int,
    last: int,
    e: int,
    mass: Floats,
    v: Floats,
    problem: Problem,
    law: ContactLaw,
) -> tuple[int, float, bool]:
    """Solve ``rows`` rows from ``begin`` on, of the people ``first:last``; the first ``busy`` of them are taken up at once.

    ``v`` holds the velocities without contact and becomes the solution; `Problem.reaction` holds a start and becomes the
    reactions.  Returns the number of sweeps, the residual in m/s, and whether it is small enough.
    """
    if rows == 0:
        return 0, 0.0, True
    pair, source = problem.pair[begin : begin + rows], problem.source[begin : begin + rows]
    row, soft = problem.row[begin : begin + rows], problem.soft[begin : begin + rows]
    reaction, start = problem.reaction[begin : begin + rows], v[first:last]
    u, u_last = problem.velocity[first + e : last + e + 1], problem.v_last[first + e : last + e + 1]
    for i in range(last - first):
        u[i, 0], u[i, 1] = start[i, 0], start[i, 1]
    u[last - first, 0], u[last - first, 1] = 0.0, 0.0
    limit = np.inf
    if law.relative < np.inf:
        for t in range(rows):
            reaction[t, 1] = reaction[t, 0]
            reaction[t, 0] = 0.0
        _, size, busy = _look(busy, pair, source, row, soft, reaction, u)
        limit = law.relative * size + _ROUNDING
        for t in range(rows):
            reaction[t, 0] = reaction[t, 1]
    _begin(pair, row, reaction, mass[first:last], start, u)
    residual, size, busy = _look(busy, pair, source, row, soft, reaction, u)
    sweeps, since, beta, least, look_at = 0, 0, 0.0, residual, 1
    most = max(0.5, 1.0 - _RESISTANCE / np.sqrt(busy + 1.0))
    while sweeps < law.max_iterations and not (residual <= law.tolerance and size <= limit):
        if law.accelerated:
            _extrapolate(beta, u, u_last)
        uphill = _sweep(busy, pair, row, soft, reaction, u, beta)
        sweeps += 1
        if law.accelerated:
            since = 0 if uphill else since + 1
            beta = min(most, since / (since + 2.0))
        if sweeps >= look_at or sweeps == law.max_iterations:
            residual, size, busy = _look(busy, pair, source, row, soft, reaction, u)
            if np.isnan(residual):  # the next search for contacts reports that
                break
            look_at = sweeps + 1 + sweeps // 12
            least = min(least, residual)
            if residual > 100.0 * least:  # not seen yet; without momentum the sweeps are sure to converge
                since, beta, most, least = 0, 0.0, 0.5 * most, residual
    for i in range(last - first):
        start[i, 0], start[i, 1] = u[i, 0], u[i, 1]
    return sweeps, residual, residual <= law.tolerance and size <= limit


@kernel
def _begin(pair: Indices, row: Floats, reaction: Floats, mass: Floats, start: Floats, u: Floats) -> None:
    """Start from the best multiple of the given reactions: the one of least energy, so never worse than from none.

    The energy that the problem minimises is that of the velocities, plus P . bias.
    """
    slope, curvature = 0.0, 0.0
    for t in range(len(pair)):
        r = reaction[t, 0]
        if r != 0.0:
            i, j = pair[t, 0], pair[t, 1]
            px, py = r * row[t, 0], r * row[t, 1]
            qx, qy = row[t, 3] * px, row[t, 3] * py
            u[i, 0] += qx
            u[i, 1] += qy
            u[j, 0] -= px - qx
            u[j, 1] -= py - qy
            slope += row[t, 3] * mass[i] * r * row[t, 2]
    for i in range(len(start)):
        dx, dy = u[i, 0] - start[i, 0], u[i, 1] - start[i, 1]
        slope += mass[i] * (dx * start[i, 0] + dy * start[i, 1])
        curvature += mass[i] * (dx * dx + dy * dy)
    best = max(0.0, -slope / curvature) if curvature > 0.0 else 0.0
    for i in range(len(start)):
        for k in range(2):
            u[i, k] = start[i, k] + best * (u[i, k] - start[i, k])
    for t in range(len(pair)):
        reaction[t, 0] *= best


@kernel
def _extrapolate(beta: float, u: Floats, u_last: Floats) -> None:
    for i in range(len(u)):
        for k in range(2):
            now = u[i, k]
            u[i, k] = now + beta * (now - u_last[i, k])
            u_last[i, k] = now


@kernel
def _sweep(
    busy: int, pair: Indices, row: Floats, soft: Floats, reaction: Floats, u: Floats, beta: float
) -> bool:
    """Set the first ``busy`` rows right, one after the other; returns whether the momentum ``beta`` went uphill."""
    uphill = 0.0
    for t in range(np.uint64(busy)):
        i, j = pair[t, 0], pair[t, 1]
        nx, ny = row[t, 0], row[t, 1]
        ax, ay, bx, by = u[i, 0], u[i, 1], u[j, 0], u[j, 1]
        now = reaction[t, 0]
        ahead = now + beta * (now - reaction[t, 1])
        r = _law(soft[t], row[t, 2], nx * (ax - bx) + ny * (ay - by) - ahead)
        d = r - ahead
        uphill -= d * (r - now)
        reaction[t, 0], reaction[t, 1] = r, now
        px, py = d * nx, d * ny
        qx, qy = row[t, 3] * px, row[t, 3] * py
        u[i, 0], u[i, 1] = ax + qx, ay + qy
        u[j, 0], u[j, 1] = bx - (px - qx), by - (py - qy)
    return uphill > 0.0


@kernel
def _law(soft: float, bias: float, free: float) -> float:
    """What a reaction [m/s] should be, if the row would separate at the speed ``free`` without it."""
    if soft == 0.0:
        r = -free - bias
        return r if r > 0.0 else 0.0
    if soft < 0.0:
        return soft * (bias + free)
    # Below K_N w- / 2 the contact separates, w = -w- - 2 P / K_N; above it the reaction holds it closed.
    return max(-free, -soft * (bias + free))


@kernel
def _look(
    busy: int, pair: Indices, source: Indices, row: Floats, soft: Floats, reaction: Floats, u: Floats
) -> tuple[float, float, int]:
    """Return the residual [m/s] of all rows, its 2-norm, and how many rows are busy now: all that should push join in."""
    worst, square = 0.0, 0.0
    for t in range(len(pair)):
        i, j = pair[t, 0], pair[t, 1]
        now = reaction[t, 0]
        free = row[t, 0] * (u[i, 0] - u[j, 0]) + row[t, 1] * (u[i, 1] - u[j, 1]) - now
        r = _law(soft[t], row[t, 2], free)
        off = abs(r - now)
        if not off <= worst:
            worst = off
        square += off * off
        if t >= busy and r > 0.0:
            for k in range(2):
                pair[t, k], pair[busy, k] = pair[busy, k], pair[t, k]
                reaction[t, k], reaction[busy, k] = reaction[busy, k], reaction[t, k]
            for k in range(4):
                row[t, k], row[busy, k] = row[busy, k], row[t, k]
            source[t], source[busy] = source[busy], source[t]
            busy += 1
    return worst, np.sqrt(square), busy


@kernel
def give_impulses(begin: int, rows: int, number: int, contacts: Contacts, mass: Floats, problem: Problem) -> None:
    """Leave the impulses [N s] of the solution with the ``number`` contacts: rows beyond are tangential."""
    for c in range(begin, begin + number):
        contacts.impulse[c, 1] = 0.0
    for t in range(begin, begin + rows):
        c = begin + problem.source[t]
        impulse = problem.reaction[t, 0] * problem.row[t, 3] * mass[contacts.i[c]]  # share of i = 1 / (a m_i)
        contacts.impulse[c, 0 if t < begin + number else 1] = impulse


@kernel
def keep_impulses(begin: int, end: int, contacts: Contacts, problem: Problem) -> None:
    """Keep the impulses of the contacts ``begin:end`` while they are found once more, up to a wider gap."""
    for c in range(begin, end):
        problem.reaction[c, 1] = contacts.impulse[c, 0]


@kernel
def take_impulses(begin: int, end: int, margin: float, contacts: Contacts, problem: Problem) -> None:
    """Give the impulses that were kept to the same contacts: those with a gap below the former ``margin``, in the same order."""
    kept = begin
    for c in range(begin, end):
        if contacts.gap[c] < margin:
            contacts.impulse[c, 0] = problem.reaction[kept, 1]
            kept += 1


@kernel
def closing_speed(begin: int, end: int, active: Bools, v: Floats) -> float:
    """Sum of the two largest speeds [m/s] among the active people ``begin:end``: no two can close faster."""
    first, second = 0.0, 0.0
    for i in range(begin, end):
        if active[i]:
            square = v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1]
            if not square <= second:
                first, second = max(first, square), min(first, square)
    return np.sqrt(first) + np.sqrt(second)
