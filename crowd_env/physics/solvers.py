"""Solving the rows of NSM1 and NSM2 (`crowd_env.physics.constraints`) to a true residual.

Projected Gauss-Seidel sets one row right after the other.  "accelerated" starts every sweep from an extrapolation of the last
two (Nesterov's momentum, dropped whenever it runs uphill; O'Donoghue and Candès 2015).  In jams that takes half the sweeps of
the accelerated projected gradient, each at the same price, and far fewer than without momentum.

A step that changes little is no proof of a small error, so the solver stops on the violation of the laws themselves, in m/s,
all at the same velocities: max_c |r_c - law_c(v)|, which for a unilateral contact is |min(a_c P_c, w_c)|.
"""

from typing import Literal, NamedTuple

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.physics.constraints import Indices, Problem
from crowd_env.state import Floats

SolverName = Literal["auto", "gauss-seidel", "accelerated"]
SOLVERS = ("auto", "gauss-seidel", "accelerated")
# The momentum may not exceed 1 - this / sqrt(rows): the slowest motions of a jam are as wide as the jam.  Measured from 300 to
# 5000 people: up to 20 % fewer sweeps to 1e-3 of the first residual.
_RESISTANCE = 1.5
_ROUNDING = 1e-12  # m/s, no relative residual below it is asked for


class Stopping(NamedTuple):
    """When to stop, and how to go on."""

    tolerance: float  # m/s
    relative: float  # of the residual without any impulse, in the 2-norm; infinite = not asked for
    max_iterations: int
    accelerated: bool  # with momentum


@inner_kernel
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
    soft: Floats | None,
    law: Stopping,
) -> tuple[int, float, bool]:
    """Solve ``rows`` rows from ``begin`` on, of the people ``first:last``; the first ``busy`` of them are taken up at once.

    ``soft`` is `Problem.soft`, or None if all rows are hard: then nobody has to ask each, nor fetch it from memory.
    ``v`` holds the velocities without contact and becomes the solution; `Problem.reaction` holds a start and becomes the
    reactions.  Returns the number of sweeps, the residual in m/s, and whether it is small enough.
    """
    if rows == 0:
        return 0, 0.0, True
    pair, source = problem.pair[begin : begin + rows], problem.source[begin : begin + rows]
    row, reaction, start = problem.row[begin : begin + rows], problem.reaction[begin : begin + rows], v[first:last]
    if soft is not None:
        soft = soft[begin : begin + rows]
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
            # Momentum on one-after-the-other is not sure to converge: it ran away in a heap of 16 contacts a person, never in
            # jams (2 a person).  Without it the sweeps are.
            if residual > 100.0 * least:
                since, beta, most, least = 0, 0.0, 0.5 * most, residual
    for i in range(last - first):
        start[i, 0], start[i, 1] = u[i, 0], u[i, 1]
    return sweeps, residual, residual <= law.tolerance and size <= limit


@inner_kernel
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


@inner_kernel
def _extrapolate(beta: float, u: Floats, u_last: Floats) -> None:
    for i in range(len(u)):
        for k in range(2):
            now = u[i, k]
            u[i, k] = now + beta * (now - u_last[i, k])
            u_last[i, k] = now


@inner_kernel
def _sweep(
    busy: int, pair: Indices, row: Floats, soft: Floats | None, reaction: Floats, u: Floats, beta: float
) -> bool:
    """Set the first ``busy`` rows right, one after the other; returns whether the momentum ``beta`` went uphill."""
    uphill = 0.0
    for t in range(index(busy)):
        i, j = pair[t, 0], pair[t, 1]
        nx, ny = row[t, 0], row[t, 1]
        ax, ay, bx, by = u[i, 0], u[i, 1], u[j, 0], u[j, 1]
        now = reaction[t, 0]
        ahead = now + beta * (now - reaction[t, 1])
        free = nx * (ax - bx) + ny * (ay - by) - ahead
        if soft is not None:
            r = _law(soft[t], row[t, 2], free)
        else:
            r = _hard(row[t, 2], free)
        d = r - ahead
        uphill -= d * (r - now)
        reaction[t, 0], reaction[t, 1] = r, now
        px, py = d * nx, d * ny
        qx, qy = row[t, 3] * px, row[t, 3] * py
        u[i, 0], u[i, 1] = ax + qx, ay + qy
        u[j, 0], u[j, 1] = bx - (px - qx), by - (py - qy)
    return uphill > 0.0


@inner_kernel
def _hard(bias: float, free: float) -> float:
    """The reaction of a hard row: as much as keeps it from closing."""
    r = -free - bias
    return r if r > 0.0 else 0.0


@inner_kernel
def _law(soft: float, bias: float, free: float) -> float:
    """What a reaction [m/s] should be, if the row would separate at the speed ``free`` without it."""
    if soft == 0.0:
        return _hard(bias, free)
    if soft < 0.0:
        return soft * (bias + free)
    # Below K_N w- / 2 the contact separates, w = -w- - 2 P / K_N; above it the reaction holds it closed.
    return max(-free, -soft * (bias + free))


@inner_kernel
def _look(
    busy: int, pair: Indices, source: Indices, row: Floats, soft: Floats | None, reaction: Floats, u: Floats
) -> tuple[float, float, int]:
    """Return the residual [m/s] of all rows, its 2-norm, and how many rows are busy now: all that should push join in."""
    worst, square = 0.0, 0.0
    for t in range(len(pair)):
        i, j = pair[t, 0], pair[t, 1]
        now = reaction[t, 0]
        free = row[t, 0] * (u[i, 0] - u[j, 0]) + row[t, 1] * (u[i, 1] - u[j, 1]) - now
        if soft is not None:
            r = _law(soft[t], row[t, 2], free)
        else:
            r = _hard(row[t, 2], free)
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


@inner_kernel
def closing_speed(first: int, last: int, inside: Indices, v: Floats) -> float:
    """Sum of the two largest speeds [m/s] among the people in the places ``first:last``: no two can close faster."""
    fastest, second = 0.0, 0.0
    for place in range(index(first), index(last)):
        i = inside[place]
        square = v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1]
        if not square <= second:
            fastest, second = max(fastest, square), min(fastest, square)
    return np.sqrt(fastest) + np.sqrt(second)
