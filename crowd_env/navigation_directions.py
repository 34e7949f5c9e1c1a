"""Kernels that turn travel times on a grid into directions for everyone: slope, band along walls, straight lines.

Arrays over nodes have shape (rows, cols); node (i, j) lies at ``origin + spacing * (j, i)``.
"""

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import allocating_kernel, inner_kernel, kernel
from crowd_env.navigation_grid import ANTIDIAGONAL, DIAGONAL, RIGHT, UP, distance_to_segment
from crowd_env.navigation_lookup import ALONE, BLEND, crosses, exit_frame, nearest_on_exit, through_exit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_LEAN = 2.0  # how much a direction turns away from the wall per body radius of depth in the band along it
_GET_AWAY = 0.25  # a straight line parts from a wall in whose band it starts by at least this sine
_KINK = 0.95  # a gradient shorter than this (1 = smooth) averages two ways of equal length that part by over 36 degrees


@inner_kernel
def _walls_within(walls: Floats, x: float, y: float, reach: float, near: Ints) -> int:
    """Write the walls whose bounding box comes within ``reach`` of (x, y) into ``near``; return their number."""
    count = 0
    for w in range(len(walls)):
        if (
            min(walls[w, 0, 0], walls[w, 1, 0]) <= x + reach
            and max(walls[w, 0, 0], walls[w, 1, 0]) >= x - reach
            and min(walls[w, 0, 1], walls[w, 1, 1]) <= y + reach
            and max(walls[w, 0, 1], walls[w, 1, 1]) >= y - reach
        ):
            near[count] = w
            count += 1
    return count


@inner_kernel
def _is_seen(walls: Floats, near: Ints, x: float, y: float, px: float, py: float) -> bool:
    for w in near:
        if crosses(x, y, px, py, walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]):
            return False
    return True


@inner_kernel
def _time_at(time: Floats, i: int, j: int) -> float:
    return time[i, j] if 0 <= i < time.shape[0] and 0 <= j < time.shape[1] else np.nan


@inner_kernel
def _slope(time: Floats, i: int, j: int, di: int, dj: int, spacing: float, upwind: bool) -> float:
    """Return the derivative of ``time`` along one axis, over known nodes only; 0 if there is no neighbour.

    Central if both neighbours are known, else one-sided of second order where there are two nodes, else of first.
    ``upwind`` looks only to the side of the smaller neighbour (the upper one on a tie).
    """
    here, low, high = time[i, j], _time_at(time, i - di, j - dj), _time_at(time, i + di, j + dj)
    if upwind:
        if high < here and not low < high:
            return (high - here) / spacing
        return (here - low) / spacing if low < here else 0.0
    if not np.isnan(low) and not np.isnan(high):
        return (high - low) / (2.0 * spacing)
    if not np.isnan(high):
        next_high = _time_at(time, i + 2 * di, j + 2 * dj)
        slope = (4.0 * high - 3.0 * here - next_high) / (2.0 * spacing)
        return (high - here) / spacing if np.isnan(slope) else slope
    if not np.isnan(low):
        next_low = _time_at(time, i - 2 * di, j - 2 * dj)
        slope = (3.0 * here - 4.0 * low + next_low) / (2.0 * spacing)
        return (here - low) / spacing if np.isnan(slope) else slope
    return 0.0


@allocating_kernel
def descend(time: Floats, spacing: float) -> Floats:
    """Return the unit vector (rows, cols, 2) of steepest descent of ``time`` at all known nodes; 0 elsewhere.

    Known nodes lie at least two spacings from every wall, so neighbours are never on different sides of one.
    """
    rows, cols = time.shape
    direction = np.zeros((rows, cols, 2))
    for i in range(rows):
        for j in range(cols):
            if np.isnan(time[i, j]):
                continue
            norm, ex, ey = 0.0, 0.0, 0.0
            for upwind in (False, True):
                ex = -_slope(time, i, j, 0, 1, spacing, upwind)
                ey = -_slope(time, i, j, 1, 0, spacing, upwind)
                norm = np.sqrt(ex * ex + ey * ey)
                if norm > _KINK:
                    break
            if norm > 1e-6:
                direction[i, j, 0], direction[i, j, 1] = ex / norm, ey / norm
    return direction


@allocating_kernel
def _push(walls: Floats, two_sided: Bools, near: Ints, x: float, y: float, radius: float) -> tuple[float, float]:
    """Return the vector away from the walls nearer than ``radius``, as long as the depth in that band [radii].

    The nearest wall counts and, for concave corners, the nearest one in another direction; the many short walls of a
    round column must not count each.
    """
    px, py = 0.0, 0.0
    for turn in range(2):
        best, qx, qy = 0.0, 0.0, 0.0
        for w in near:
            ax, ay, bx, by = walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]
            ux, uy = bx - ax, by - ay
            square = ux * ux + uy * uy
            if not two_sided[w] and ux * (y - ay) - uy * (x - ax) < -1e-9 * square:
                continue  # the far side of an obstacle
            s = min(max(((x - ax) * ux + (y - ay) * uy) / square, 0.0), 1.0)
            dx, dy = x - ax - s * ux, y - ay - s * uy
            distance = np.sqrt(dx * dx + dy * dy)
            if distance < 1e-6:  # on the wall: the area is to its left
                dx, dy, distance = -uy * 1e-6 / np.sqrt(square), ux * 1e-6 / np.sqrt(square), 1e-6
            depth = (radius - distance) / radius
            along = (dx * px + dy * py) / distance
            if depth > best and (turn == 0 or along < 0.5 * np.sqrt(px * px + py * py)):
                best, qx, qy = depth, depth * dx / distance, depth * dy / distance
        px, py = px + qx, py + qy
    return px, py


@allocating_kernel
def extend_once(
    time: Floats, direction: Floats, inside: Bools, walls: Floats, two_sided: Bools, origin: Floats, spacing: float,
    reach: float, radius: float,
) -> int:  # fmt: skip
    """Give walkable nodes without a time (nan) the least time + distance over known nodes in a window; count them.

    Only known nodes that are seen past all walls count.  With ``radius`` > 0 the direction is that of the nearest known
    node, turned away from the walls the more, the deeper the node lies in the band of that width along them; without it,
    it is the direction to the best known node.
    """
    rows, cols = time.shape
    before, ahead = time.copy(), direction.copy()
    near = np.empty(max(len(walls), 1), dtype=np.int64)
    window = int(np.ceil(reach / spacing))
    given = 0
    for i in range(rows):
        for j in range(cols):
            if not inside[i, j] or not np.isnan(before[i, j]):
                continue
            x, y = origin[0] + j * spacing, origin[1] + i * spacing
            count = _walls_within(walls, x, y, (window + 1) * spacing, near)
            best, least, row, col = np.inf, np.inf, i, j
            for p in range(max(i - window, 0), min(i + window + 1, rows)):
                for q in range(max(j - window, 0), min(j + window + 1, cols)):
                    length = spacing * np.sqrt(float((p - i) ** 2 + (q - j) ** 2))
                    arrival = before[p, q] + length
                    if not (arrival < best or (length < least and radius > 0.0)) or np.isnan(arrival):
                        continue
                    if not _is_seen(walls, near[:count], x, y, origin[0] + q * spacing, origin[1] + p * spacing):
                        continue
                    if (length < least) if radius > 0.0 else (arrival < best):
                        least, row, col = length, p, q
                    best = min(best, arrival)
            if best == np.inf:
                continue
            time[i, j] = best
            given += 1
            ex, ey = (col - j) * spacing / least, (row - i) * spacing / least
            if radius > 0.0:
                px, py = _push(walls, two_sided, near[:count], x, y, radius)
                depth = np.sqrt(px * px + py * py)
                if depth > 1e-9:
                    ex, ey = ahead[row, col, 0], ahead[row, col, 1]
                    inward = min(ex * px + ey * py, 0.0) / (depth * depth)
                    ex, ey = ex + (_LEAN - inward) * px, ey + (_LEAN - inward) * py
            norm = np.sqrt(ex * ex + ey * ey)
            if norm > 1e-9:
                direction[i, j, 0], direction[i, j, 1] = ex / norm, ey / norm
    return given


@kernel
def fill_from_nearest(time: Floats, direction: Floats, inside: Bools, known: Bools, spacing: float) -> None:
    """Lead every walkable node without a direction to the nearest known node, in a straight line."""
    rows, cols = time.shape
    for i in range(rows):
        for j in range(cols):
            if not inside[i, j] or direction[i, j, 0] != 0.0 or direction[i, j, 1] != 0.0:
                continue
            lost = np.isnan(time[i, j])
            p, q, least = i, j, np.inf
            for ring in range(1, max(rows, cols)):
                if ring * ring > least:
                    break
                for k in range(max(i - ring, 0), min(i + ring + 1, rows)):
                    step = 1 if abs(k - i) == ring else 2 * ring
                    for m in range(j - ring, j + ring + 1, step):
                        square = float((k - i) ** 2 + (m - j) ** 2)
                        if 0 <= m < cols and square < least and known[k, m] and (lost or time[k, m] < time[i, j]):
                            p, q, least = k, m, square
            if least < np.inf:
                direction[i, j, 0], direction[i, j, 1] = (q - j) / np.sqrt(least), (p - i) / np.sqrt(least)
                if lost:
                    time[i, j] = time[p, q] + spacing * np.sqrt(least)


@inner_kernel
def passes(walls: Floats, x: float, y: float, tx: float, ty: float, radius: float) -> bool:
    """Return whether a disc of ``radius`` can go straight from (x, y) to (tx, ty).

    It must keep off every wall; from a wall that it overlaps at the start it must get away at once.  (The distance to
    a segment is convex along a line: once it grows, it keeps growing.)
    """
    length = np.sqrt((tx - x) ** 2 + (ty - y) ** 2)
    first = min(0.05 * radius, length)
    share = first / length if length > 0.0 else 0.0
    for w in range(len(walls)):
        ax, ay, bx, by = walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]
        if (
            min(ax, bx) > max(x, tx) + radius
            or max(ax, bx) < min(x, tx) - radius
            or min(ay, by) > max(y, ty) + radius
            or max(ay, by) < min(y, ty) - radius
        ):
            continue
        if crosses(x, y, tx, ty, ax, ay, bx, by):
            return False
        start = distance_to_segment(x, y, ax, ay, bx, by)
        enough = min(radius, start) - 1e-6
        if start < radius:
            grown = min(radius, start + _GET_AWAY * first) - 1e-6
            if distance_to_segment(x + share * (tx - x), y + share * (ty - y), ax, ay, bx, by) < grown:
                return False
        if (
            distance_to_segment(ax, ay, x, y, tx, ty) < enough
            or distance_to_segment(bx, by, x, y, tx, ty) < enough
            or distance_to_segment(tx, ty, ax, ay, bx, by) < enough
        ):
            return False
    return True


@allocating_kernel
def straight_lines(
    time: Floats, direction: Floats, walls: Floats, exits: Floats, rows_of_exits: Ints, origin: Floats,
    spacing: float, radius: float, detour: float,
) -> Ints:  # fmt: skip
    """Return for every node the exit that a disc of ``radius`` reaches in a straight line (-1 = none).

    There ``time`` and ``direction`` become exact.  The line must keep the disc off the walls, or, where the disc stands
    closer than that, must not come any closer; and it must be the best way by the time found so far, which must not exceed
    its length by more than the share ``detour``: then slow ground lies in between.
    """
    rows, cols = time.shape
    direct = np.full((rows, cols), -1, dtype=np.int64)
    for i in range(rows):
        for j in range(cols):
            limit = time[i, j] + spacing
            for k in range(len(exits)):
                ax, ay, ux, uy, width, nx, ny = exit_frame(exits, k)
                x, y = origin[0] + j * spacing, origin[1] + i * spacing
                tx, ty = nearest_on_exit(ax, ay, ux, uy, width, x, y, radius)
                length = np.sqrt((tx - x) ** 2 + (ty - y) ** 2)
                if not length <= limit or (direct[i, j] >= 0 and length >= time[i, j]):
                    continue
                if ux * (y - ay) - uy * (x - ax) < -1e-6:  # behind the exit line
                    continue
                if time[i, j] > (1.0 + detour) * length + 1.5 * spacing:
                    continue
                if not passes(walls, x, y, tx, ty, radius):
                    continue
                direct[i, j] = rows_of_exits[k]
                time[i, j] = length
                ex, ey = through_exit(ax, ay, ux, uy, width, nx, ny, x, y, radius, radius)
                direction[i, j, 0], direction[i, j, 1] = ex, ey
    return direct


@allocating_kernel
def cell_kinds(time: Floats, direct: Ints, blocked: NDArray[np.uint8]) -> Ints:
    """Return for the cell right of and above every node how to look up in it: an exit, `BLEND` or `ALONE`.

    It is an exit if all walkable corners reach that exit in a straight line.
    """
    rows, cols = time.shape
    kind = np.full((rows, cols), ALONE, dtype=np.int64)
    for i in range(rows - 1):
        for j in range(cols - 1):
            a, b = not np.isnan(time[i, j]), not np.isnan(time[i, j + 1])
            c, d = not np.isnan(time[i + 1, j]), not np.isnan(time[i + 1, j + 1])
            lines = blocked[i, j]
            split = (lines & RIGHT and a and b) or (lines & UP and a and c) or (blocked[i, j + 1] & UP and b and d)
            split = split or (blocked[i + 1, j] & RIGHT and c and d)
            split = split or (lines & DIAGONAL and a and d) or (lines & ANTIDIAGONAL and b and c)
            if split or not (a or b or c or d):
                continue
            least, most = np.iinfo(np.int64).max, -1
            for p, q, walkable in ((i, j, a), (i, j + 1, b), (i + 1, j, c), (i + 1, j + 1, d)):
                if walkable:
                    least, most = min(least, direct[p, q]), max(most, direct[p, q])
            kind[i, j] = most if least == most else BLEND
    return kind


@allocating_kernel
def regions_on_the_way(time: Floats, direction: Floats, region: Ints) -> Ints:
    """Return for every node the regions (bits of ``region``) that the way from it leads through, its own included.

    The way is walked for 16 spacings along the directions, then goes on as from the node it has come nearest to; where that
    one is not reached sooner, as from the neighbour that is reached soonest.
    """
    rows, cols = time.shape
    through = region.copy()
    order = np.argsort(time.ravel())  # nan last
    for n in order:
        i, j = n // cols, n % cols
        if np.isnan(time[i, j]):
            break
        y, x, p, q = float(i), float(j), i, j
        for _ in range(16):
            ex, ey = _direction_between(direction, x, y)
            if ex == 0.0 and ey == 0.0:
                break
            x, y = min(max(x + ex, 0.0), cols - 1.0), min(max(y + ey, 0.0), rows - 1.0)
            k, m = int(y + 0.5), int(x + 0.5)
            if np.isnan(time[k, m]):
                break
            p, q = k, m
            through[i, j] |= region[p, q]
        if not time[p, q] < time[i, j]:
            least, p, q = time[i, j], i, j
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, cols)):
                    if time[k, m] < least:
                        least, p, q = time[k, m], k, m
        through[i, j] |= through[p, q]
    return through


@inner_kernel
def _direction_between(direction: Floats, x: float, y: float) -> tuple[float, float]:
    """Return the direction at column ``x`` and row ``y``, between the nodes; (0, 0) where there is none."""
    rows, cols = direction.shape[0], direction.shape[1]
    i, j = min(int(y), rows - 2), min(int(x), cols - 2)
    v, u = y - i, x - j
    ex, ey = 0.0, 0.0
    for c in range(4):
        weight = (u if c & 1 else 1.0 - u) * (v if c >> 1 else 1.0 - v)
        ex += weight * direction[i + (c >> 1), j + (c & 1), 0]
        ey += weight * direction[i + (c >> 1), j + (c & 1), 1]
    norm = np.sqrt(ex * ex + ey * ey)
    return (ex / norm, ey / norm) if norm > 1e-3 else (0.0, 0.0)
