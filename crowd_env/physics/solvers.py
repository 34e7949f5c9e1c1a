"""The solver of the rows of NSM1 and NSM2 (`crowd_env.physics.constraints`), down to a true residual.

Projected Gauss-Seidel solves one row after the other; here every sweep starts from an extrapolation of the last two (Nesterov's
momentum, dropped whenever it runs uphill; O'Donoghue and Candès 2015).  In jams that takes half the sweeps of the accelerated
projected gradient, at the same cost a sweep, and far fewer than without momentum.

A small change of a sweep does not prove a small error, so the solver stops on the violation of the laws themselves, in m/s, all
at the same velocities: max_c |r_c - law_c(v)|, which for a unilateral contact is |min(a_c P_c, w_c)|.
"""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Indices
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.constraints import Constraints, Extent

# The momentum may not exceed 1 - this / sqrt(rows): the slowest motions of a jam are as wide as the jam.  Measured from 300 to
# 5000 people: up to 20 % fewer sweeps to 1e-3 of the first residual.
_RESISTANCE = 1.5
# Momentum is held here for ten sweeps: where few sweeps suffice, more of it overshoots.  Measured: up to 12 % fewer sweeps to
# 0.13 m/s, about as many to 0.01 m/s.
_HOLD = 0.9
_ROUNDING = 1e-12  # m/s, added to the limit of the relative residual


class Stopping(NamedTuple):
    """The stopping rule of the solver."""

    tolerance: float  # m/s
    relative: float  # of the residual without any impulse, in the 2-norm; infinite = unused
    max_iterations: int


@inner_kernel
def solve(
    extent: Extent,
    rows: int,
    active_rows: int,
    mass: Floats,
    v: Floats,
    constraints: Constraints,
    compliance: Floats | None,
    stopping: Stopping,
) -> tuple[int, float, bool]:
    """Solve ``rows`` rows of an environment; the first ``active_rows`` are active.

    ``compliance`` is `Constraints.compliance`, or None if all rows are hard: then it is neither tested nor fetched from memory.
    ``v`` holds the velocities without contact and becomes the solution.  `Constraints.reaction` holds a warm start and becomes
    the reactions.  Returns the number of sweeps, the residual in m/s, and whether it is small enough.
    """
    if rows == 0:
        return 0, 0.0, True
    e, slot_start, slot_stop, row_start, _ = extent
    row_stop, start = row_start + rows, v[slot_start:slot_stop]
    pair, source = constraints.pair[row_start:row_stop], constraints.source[row_start:row_stop]
    coefficients, reaction = constraints.coefficients[row_start:row_stop], constraints.reaction[row_start:row_stop]
    if compliance is not None:
        compliance = compliance[row_start:row_stop]
    u = constraints.velocity[slot_start + e : slot_stop + e + 1]
    u_last = constraints.previous_velocity[slot_start + e : slot_stop + e + 1]
    for i in range(slot_stop - slot_start):
        u[i, 0], u[i, 1] = start[i, 0], start[i, 1]
    u[slot_stop - slot_start, 0], u[slot_stop - slot_start, 1] = 0.0, 0.0
    limit = np.inf
    if stopping.relative < np.inf:
        for t in range(rows):
            reaction[t, 1] = reaction[t, 0]
            reaction[t, 0] = 0.0
        _, size, active_rows, _ = _residual(active_rows, pair, source, coefficients, compliance, reaction, u, 0, np.inf)
        limit = stopping.relative * size + _ROUNDING
        for t in range(rows):
            reaction[t, 0] = reaction[t, 1]
    _warm_start(pair, coefficients, reaction, mass[slot_start:slot_stop], start, u)
    residual, size, active_rows, worst = _residual(
        active_rows, pair, source, coefficients, compliance, reaction, u, 0, np.inf
    )
    sweeps, since, beta, least, next_check = 0, 0, 0.0, residual, 1
    # If one row above the tolerance is enough to continue, a check ends at it, and the next check begins there.
    by_worst = compliance is None and limit == np.inf
    most = max(0.5, 1.0 - _RESISTANCE / np.sqrt(active_rows + 1.0))
    while sweeps < stopping.max_iterations and not (residual <= stopping.tolerance and size <= limit):
        _extrapolate(beta, u, u_last)
        uphill = _sweep(active_rows, pair, coefficients, compliance, reaction, u, beta)
        sweeps += 1
        since = 0 if uphill else since + 1
        beta = min(most, max(min(_HOLD, since / (since + 2.0)), since / (since + 3.0)))
        whole = sweeps >= next_check or sweeps == stopping.max_iterations
        if whole or by_worst:
            enough = np.inf if whole else stopping.tolerance
            residual, size, active_rows, worst = _residual(
                active_rows, pair, source, coefficients, compliance, reaction, u, worst, enough
            )
            if np.isnan(residual):  # the next search for contacts reports it
                break
        if whole:
            next_check = sweeps + 1 + sweeps // (1 if by_worst else 12)
            least = min(least, residual)
            # Gauss-Seidel with momentum may diverge: it did in a heap of 16 contacts a body, never in jams (2 a body).  Sweeps
            # without momentum always converge.
            if residual > 100.0 * least:
                since, beta, most, least = 0, 0.0, 0.5 * most, residual
    for i in range(slot_stop - slot_start):
        start[i, 0], start[i, 1] = u[i, 0], u[i, 1]
    return sweeps, residual, residual <= stopping.tolerance and size <= limit


@inner_kernel
def _warm_start(pair: Indices, coefficients: Floats, reaction: Floats, mass: Floats, start: Floats, u: Floats) -> None:
    """Warm start from the best multiple of the given reactions: the one of least energy, so never worse than zero.

    The energy is that of the velocities, plus P . bias.
    """
    slope, curvature = 0.0, 0.0
    for t in range(len(pair)):
        r = reaction[t, 0]
        if r != 0.0:
            i, j = pair[t, 0], pair[t, 1]
            px, py = r * coefficients[t, 0], r * coefficients[t, 1]
            qx, qy = coefficients[t, 3] * px, coefficients[t, 3] * py
            u[i, 0] += qx
            u[i, 1] += qy
            u[j, 0] -= px - qx
            u[j, 1] -= py - qy
            slope += coefficients[t, 3] * mass[i] * r * coefficients[t, 2]
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
    """Add the momentum ``beta`` to the velocities, and keep their former values."""
    for k in range(u.size):  # one loop over all numbers becomes vector code
        now = u.flat[k]
        u.flat[k] = now + beta * (now - u_last.flat[k])
        u_last.flat[k] = now


@inner_kernel
def _sweep(
    active_rows: int,
    pair: Indices,
    coefficients: Floats,
    compliance: Floats | None,
    reaction: Floats,
    u: Floats,
    beta: float,
) -> bool:
    """Solve the active rows one after the other; returns whether the momentum ``beta`` went uphill."""
    uphill = 0.0
    for t in range(index(active_rows)):
        i, j = pair[t, 0], pair[t, 1]
        nx, ny = coefficients[t, 0], coefficients[t, 1]
        ax, ay, bx, by = u[i, 0], u[i, 1], u[j, 0], u[j, 1]
        now = reaction[t, 0]
        ahead = now + beta * (now - reaction[t, 1])
        free = nx * (ax - bx) + ny * (ay - by) - ahead
        if compliance is not None:
            r = _reaction(compliance[t], coefficients[t, 2], free)
        else:
            r = _hard_reaction(coefficients[t, 2], free)
        d = r - ahead
        uphill -= d * (r - now)
        reaction[t, 0], reaction[t, 1] = r, now
        px, py = d * nx, d * ny
        qx, qy = coefficients[t, 3] * px, coefficients[t, 3] * py
        u[i, 0], u[i, 1] = ax + qx, ay + qy
        u[j, 0], u[j, 1] = bx - (px - qx), by - (py - qy)
    return uphill > 0.0


@inner_kernel
def _hard_reaction(bias: float, free: float) -> float:
    """Return the reaction [m/s] of a hard row, which just keeps it from closing."""
    r = -free - bias
    return r if r > 0.0 else 0.0


@inner_kernel
def _reaction(compliance: float, bias: float, free: float) -> float:
    """Return the reaction [m/s] by the law of a row that would separate at the speed ``free`` without it."""
    if compliance == 0.0:
        return _hard_reaction(bias, free)
    if compliance < 0.0:
        return compliance * (bias + free)
    # Below K_N w- / 2 the contact separates, w = -w- - 2 P / K_N; above it the reaction holds it closed.
    return max(-free, -compliance * (bias + free))


@inner_kernel
def _residual(
    active_rows: int,
    pair: Indices,
    source: Indices,
    coefficients: Floats,
    compliance: Floats | None,
    reaction: Floats,
    u: Floats,
    begin: int,
    enough: float,
) -> tuple[float, float, int, int]:
    """Return the residual [m/s] of all rows, its 2-norm, the size of the active set (all rows that should push join it), and
    the row of the residual.

    The check goes round the active rows from ``begin`` on, and ends at the first error above ``enough`` [m/s]; without one the
    other rows follow.
    """
    worst, square, row, known = 0.0, 0.0, 0, active_rows
    for row_start, row_stop in ((begin, known), (0, begin)):
        for t in range(index(row_start), index(row_stop)):
            off = abs(_wanted(t, pair, coefficients, compliance, reaction, u) - reaction[t, 0])
            square += off * off
            if not off <= worst:
                worst, row = off, int(np.int64(t))
                if not off <= enough:
                    return worst, np.sqrt(square), active_rows, row
    for t in range(index(known), index(len(pair))):
        r = _wanted(t, pair, coefficients, compliance, reaction, u)
        if r > 0.0:
            for k in range(2):
                pair[t, k], pair[active_rows, k] = pair[active_rows, k], pair[t, k]
                reaction[t, k], reaction[active_rows, k] = reaction[active_rows, k], reaction[t, k]
            for k in range(4):
                coefficients[t, k], coefficients[active_rows, k] = coefficients[active_rows, k], coefficients[t, k]
            source[t], source[active_rows] = source[active_rows], source[t]
            square += r * r
            if r > worst:
                worst, row = r, active_rows
            active_rows += 1
    return worst, np.sqrt(square), active_rows, row


@inner_kernel
def _wanted(
    t: int, pair: Indices, coefficients: Floats, compliance: Floats | None, reaction: Floats, u: Floats
) -> float:
    """Return the reaction [m/s] of row ``t`` by its law while all other reactions are fixed."""
    i, j = pair[t, 0], pair[t, 1]
    free = coefficients[t, 0] * (u[i, 0] - u[j, 0]) + coefficients[t, 1] * (u[i, 1] - u[j, 1]) - reaction[t, 0]
    if compliance is not None:
        return _reaction(compliance[t], coefficients[t, 2], free)
    return _hard_reaction(coefficients[t, 2], free)


@inner_kernel
def closing_speed(rank_start: int, rank_stop: int, inside: Indices, v: Floats) -> float:
    """Return the sum of the two largest speeds [m/s] of the people of these ranks, a bound of all closing speeds."""
    fastest, second = 0.0, 0.0
    for rank in range(index(rank_start), index(rank_stop)):
        i = inside[rank]
        square = v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1]
        if not square <= second:
            fastest, second = max(fastest, square), min(fastest, square)
    return np.sqrt(fastest) + np.sqrt(second)
