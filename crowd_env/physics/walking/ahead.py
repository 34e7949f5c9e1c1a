"""Quantities of the people seen, relative to one pedestrian: arrays of a block of people, eight values in an instruction.

Quantities that depend on no heading are written once; each trial heading is one more pass over them, without a branch.  They
share one array, so the compiler knows their places; of as many arrays it could not exclude overlaps.
"""

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.behaviors.headway import CALM, Headway
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.physics.walking.around import FARTHEST, time_gap_of
from crowd_env.physics.workspace import BLOCK, Batch

# Places of quantities of a block in `Walkers.ahead`: columns of `Walkers.record`, later overwritten by relative quantities.
_X, _Y, _REACH = 0, BLOCK, 2 * BLOCK  # m    relative position; sum of the two radii
_U, _V = 3 * BLOCK, 4 * BLOCK  # m/s  velocity
_WAY_X, _WAY_Y, _GIVES_WAY = 5 * BLOCK, 6 * BLOCK, 7 * BLOCK
_ROOM, _FORESEEN, _PER_TIME = 5 * BLOCK, 6 * BLOCK, 7 * BLOCK  # gap less c s [m], c t_a [s], 1 / (T + c t_a) [1/s]
_PER_BESIDE = 8 * BLOCK  # 1/s  1 / (c T_y)
_OFF = 9 * BLOCK  # m    distance of i from the way of a pedestrian that waits for i; infinite if it does not wait
_ASIDE = 10 * BLOCK  # side step because of each, as a tangent
_PACE = 10 * BLOCK  # m/s  that each allows along a heading
_LEAST = 11 * BLOCK  # the least of them: one number
_LANES = 8
_MAGNITUDE = int(np.iinfo(np.int64).max)  # all bits of a float but its sign
_INFINITE = int(np.array([np.inf]).view(np.int64)[0])
_HALFWAY = float(np.exp(-0.5 * FARTHEST))


@inner_kernel
def compare(i: int, seen: tuple[int, int], ahead: Floats, batch: Batch, params: Headway) -> float:
    """Write the quantities of at most a block of `Walkers.seen` relative to ``i``; returns the side step (left > 0)."""
    walkers, position, velocity = batch.workspace.walkers, batch.state.position, batch.state.velocity
    places, record, way_x, way_y = walkers.seen, walkers.record, walkers.way_x[i], walkers.way_y[i]
    x, y, r, u, v = position[i, 0], position[i, 1], batch.bodies.radius[i], velocity[i, 0], velocity[i, 1]
    count, stop, time_gap = index(seen[1] - seen[0]), _padded(seen), time_gap_of(i, batch, params)
    for m in range(count):
        n = places[index(seen[0]) + m]
        for quantity in range(index(8)):
            ahead[m + quantity * index(BLOCK)] = record[n, quantity]
    for m in range(count, index(stop)):  # padding: so far behind that it has no effect
        ahead[m + index(_X)], ahead[m + index(_Y)] = x - 1e6 * way_x, y - 1e6 * way_y
    foresight, per_length = params.anticipation, 1.0 / params.length
    beside = params.beside * (time_gap / CALM) ** 2
    for m in range(stop):
        dx, dy, reach = ahead[m + _X] - x, ahead[m + _Y] - y, ahead[m + _REACH] + r
        ju, jv, jx, jy = ahead[m + _U], ahead[m + _V], ahead[m + _WAY_X], ahead[m + _WAY_Y]
        distance = np.sqrt(dx * dx + dy * dy)
        closing = ((u - ju) * dx + (v - jv) * dy) / distance
        far = max(distance - reach - foresight * closing, 0.0) * per_length
        along = way_x * jx + way_y * jy
        same, against = max(along, 0.0), max(-along, 0.0)
        size = params.strength * (1.0 + params.oncoming * against) * _fading(min(far, FARTHEST))
        size = size if far <= FARTHEST else 0.0
        sideways = way_x * (dy + foresight * jv) - way_y * (dx + foresight * ju)
        # Away from the foreseen place; to the right if it is straight ahead, or for oncoming people slightly to the right.
        ahead[m + _ASIDE] = size if sideways < -params.keep_right * against else -size
        # A pedestrian that gives way waits if i is further ahead on its way than it is on the way of i.
        waits = (ahead[m + _GIVES_WAY] > 0.0) & (along > 0.0) & (-(dx * jx + dy * jy) > dx * way_x + dy * way_y)
        ahead[m + _OFF] = abs(dy * jx - dx * jy) if waits else np.inf
        ahead[m + _X], ahead[m + _Y], ahead[m + _REACH] = dx, dy, reach
        ahead[m + _ROOM], ahead[m + _FORESEEN] = distance - reach - same * params.standing, same * foresight
        ahead[m + _PER_TIME] = 1.0 / (time_gap + same * foresight)
        ahead[m + _PER_BESIDE] = 1.0 / max(same * beside, 1e-9)
    a, b, c, d = 0.0, 0.0, 0.0, 0.0  # four independent sums, for the processor's pipeline
    for m in range(_ASIDE, _ASIDE + stop, 4):
        a, b, c, d = a + ahead[m], b + ahead[m + 1], c + ahead[m + 2], d + ahead[m + 3]
    return (a + b) + (c + d)


@inner_kernel
def _padded(seen: tuple[int, int]) -> int:
    """Return the size of a block, rounded up to whole vector instructions."""
    return (seen[1] - seen[0] + _LANES - 1) // _LANES * _LANES


@inner_kernel
def _fading(x: float) -> float:
    """Return exp(-x) to a relative 1e-14, for x from 0 to `FARTHEST`; unlike the library's it is vectorised, by eight."""
    y = (0.5 * FARTHEST - x) * (1.0 / 16.0)  # up to 1/4: a Taylor series, to the 16th
    y2 = y * y
    y4 = y2 * y2
    low = (1.0 + y) + y2 * (0.5 + y * (1.0 / 6.0))
    middle = (1.0 / 24.0 + y * (1.0 / 120.0)) + y2 * (1.0 / 720.0 + y * (1.0 / 5040.0))
    high = (1.0 / 40320.0 + y * (1.0 / 362880.0)) + y2 * (1.0 / 3628800.0 + y * (1.0 / 39916800.0))
    return _HALFWAY * (low + y4 * (middle + y4 * high)) ** 16


@inner_kernel
def speed_behind(
    i: int,
    seen: tuple[int, int],
    ex: float,
    ey: float,
    width: float,
    passes: bool,
    whose: bool,
    ahead: Floats,
    batch: Batch,
    params: Headway,
) -> tuple[float, int]:
    """Return the speed [m/s] of ``i`` behind the people in and beside the strip along (ex, ey), and the slot that limits it.

    If ``i`` ``passes``, no pedestrian beside the strip counts.
    The slot is found only if ``whose``; it is ``i`` without a limit.  A single block needs the results of `compare`.
    """
    walkers, bits = batch.workspace.walkers, ahead.view(np.int64)
    slowest, leader, least_beside = walkers.speed[i], i, np.inf if passes else 0.0
    for block in range(seen[0], seen[1], BLOCK):
        part = (block, min(block + BLOCK, seen[1]))
        if seen[1] - seen[0] > BLOCK:
            compare(i, part, ahead, batch, params)
        least = _allow(_padded(part), ex, ey, width, params.keep_up, least_beside, ahead, bits)
        bits[_LEAST] = least
        if ahead[_LEAST] < slowest:
            slowest, m = ahead[_LEAST], index(_PACE)
            while whose and bits[m] != least:
                m += index(1)
            leader = walkers.slot[walkers.seen[index(block) + m - index(_PACE)]]
    return max(slowest, 0.0), leader


@inner_kernel
def _allow(
    stop: int, ex: float, ey: float, width: float, keep_up: float, least_beside: float, ahead: Floats, bits: Ints
) -> int:
    """Write the speed that each pedestrian of a block allows along (ex, ey), infinite if any; returns the bits of the least."""
    least = _INFINITE
    for m in range(stop):
        dx, dy, half, off = ahead[m + _X], ahead[m + _Y], width * ahead[m + _REACH], ahead[m + _OFF]
        beyond = abs(dy * ex - dx * ey) - half  # of the strip
        onward = max(ahead[m + _U] * ex + ahead[m + _V] * ey, 0.0)
        pace = (ahead[m + _ROOM] + ahead[m + _FORESEEN] * onward) * ahead[m + _PER_TIME]
        passing = max(max(pace, beyond * ahead[m + _PER_BESIDE]), max(keep_up * onward, least_beside))
        pace = pace if beyond < 0.0 else passing
        counts = (dx * ex + dy * ey > 0.0) & (off >= half) & ((beyond < 0.0) | (off == np.inf))
        ahead[m + _PACE] = pace if counts else np.inf
    for m in range(stop):
        least = min(least, _in_order(bits[m + _PACE]))
    return _in_order(least)


@inner_kernel
def _in_order(bits: int) -> int:
    """Map the bits of a float to an integer in the order of floats, and back: floats have no vector minimum."""
    return bits ^ ((bits >> 63) & _MAGNITUDE)
