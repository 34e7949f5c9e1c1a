"""Travel times and directions for the nodes that the march left out: along walls, in corners, in gaps.

Arrays over nodes have shape (rows, cols); node (i, j) lies at ``origin + spacing * (j, i)``.
"""

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.kernels.jit import allocating_kernel, inner_kernel, kernel
from crowd_env.routing.fields.grid import capped_distance
from crowd_env.routing.fields.lookup import crosses, exit_frame, through_exit
from crowd_env.routing.fields.string_pulling import Targets, aim, passes

BEFORE = 2.5  # spacings before a seam, within which people walk straight over it
_LEAN = 2.0  # how much a direction turns away from the wall per body radius of depth in the band along it


@inner_kernel
def _walls_within(walls: Floats, x: float, y: float, reach: float, near: Ints) -> int:
    """Write the walls with a bounding box within ``reach`` of (x, y) into ``near``; return their number."""
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
def _is_seen(walls: Floats, near: Ints, count: int, x: float, y: float, px: float, py: float) -> bool:
    for n in range(count):
        w = near[n]
        if crosses(x, y, px, py, walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]):
            return False
    return True


@inner_kernel
def _push(
    walls: Floats, two_sided: Bools, near: Ints, count: int, x: float, y: float, radius: float
) -> tuple[float, float]:
    """Return the vector away from the walls nearer than ``radius``, as long as the depth in that band [radii].

    The nearest wall counts and, for concave corners, the nearest one in another direction; the many short walls of a
    round column must not count each.
    """
    px, py = 0.0, 0.0
    for turn in range(2):
        best, qx, qy = 0.0, 0.0, 0.0
        for n in range(count):
            w = near[n]
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


@kernel
def extend_once(
    time: Floats, direction: Floats, target: Ints, targets: Targets, inside: Bools, walls: Floats, two_sided: Bools,
    origin: Floats, spacing: float, reach: float, radius: float, before: Floats, near: Ints,
) -> int:  # fmt: skip
    """Give walkable nodes without a time (nan) the least time + distance over known nodes in a window; count them.

    Only known nodes that are seen past all walls count.  With ``radius`` > 0 a node leads straight to the target of the
    nearest known node, if that gets away from the walls at once.  Otherwise it takes the direction at the edge of the band of
    that width along the walls, turned away from them by its depth in the band.  Without ``radius`` it takes the direction to
    the best known node.  ``before`` is a copy of ``time``; ``near`` (W,) is scratch.
    """
    rows, cols = time.shape
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
                    if not _is_seen(walls, near, count, x, y, origin[0] + q * spacing, origin[1] + p * spacing):
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
                n = target[row, col]
                if n >= 0:
                    ax, ay, length, tx, ty = aim(targets, n, x, y)
                    if length < np.inf and passes(targets.walls, x, y, tx, ty, radius):
                        time[i, j], target[i, j] = length, n
                        direction[i, j, 0], direction[i, j, 1] = ax, ay
                        continue
                px, py = _push(walls, two_sided, near, count, x, y, radius)
                depth = np.sqrt(px * px + py * py)
                if depth > 1e-9:
                    ex, ey = direction[row, col, 0], direction[row, col, 1]
                    if n >= 0:
                        ax, ay, length, _, _ = aim(targets, n, x + radius * px, y + radius * py)
                        if length < np.inf:
                            ex, ey, time[i, j] = ax, ay, length + radius * depth
                    inward = min(ex * px + ey * py, 0.0) / (depth * depth)
                    ex, ey = ex + (_LEAN - inward) * px, ey + (_LEAN - inward) * py
            norm = np.sqrt(ex * ex + ey * ey)
            if norm > 1e-9:
                direction[i, j, 0], direction[i, j, 1] = ex / norm, ey / norm
    return given


def fill_from_nearest(time: Floats, direction: Floats, inside: Bools, known: Bools, spacing: float) -> None:
    """Lead every walkable node without a direction to the nearest known node, in a straight line."""
    lost = inside & (direction[..., 0] == 0.0) & (direction[..., 1] == 0.0)
    if lost.any():  # seldom: most places need not wait until this is compiled
        _fill(time, direction, inside, known, spacing)


@kernel
def _fill(time: Floats, direction: Floats, inside: Bools, known: Bools, spacing: float) -> None:
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


@allocating_kernel
def carried_along(time: Floats, value: Floats) -> Floats:
    """Return for every node the ``value`` of the place where the way from it ends: it is constant along ways.

    Upwind differences of grad(value) . grad(time) = 0 (Adalsteinsson and Sethian 1999, eq 16), so that carried values lie
    between the least and the greatest value at the ends.  Nodes outside (nan) keep their own.
    """
    rows, cols = time.shape
    carried = value.copy()
    for n in np.argsort(time.ravel()):  # nan last
        i, j = n // cols, n % cols
        here = time[i, j]
        if np.isnan(here):
            break
        total, weights = 0.0, 0.0
        for axis in range(2):
            least, k, m = here, i, j
            for step in (-1, 1):
                p, q = (i + step, j) if axis == 0 else (i, j + step)
                if 0 <= p < rows and 0 <= q < cols and time[p, q] < least:  # false for nan
                    least, k, m = time[p, q], p, q
            total += (here - least) * carried[k, m]
            weights += here - least
        if weights > 0.0:
            carried[i, j] = total / weights
    return carried


def lead_over_seams(
    seams: Floats, time: Floats, direction: Floats, target: Ints, origin: Floats, spacing: float, radius: float
) -> None:
    """Let people right before ``seams`` (Y, 2, 2) walk straight over them, in place, where no straight line leads there."""
    for k in range(len(seams)):
        near = capped_distance(seams[k : k + 1], time.shape, origin, spacing, BEFORE * spacing)
        least = np.nanmin(np.where(near < 0.999 * BEFORE * spacing, time, np.nan), initial=np.inf)
        close = (near < 0.999 * BEFORE * spacing) & (target < 0) & (time < least + 4.0 * BEFORE * spacing)
        lead_over(seams[k : k + 1], close, origin, spacing, radius, direction)


@kernel
def lead_over(seam: Floats, close: Bools, origin: Floats, spacing: float, radius: float, direction: Floats) -> None:
    """Write the ``direction`` (rows, cols, 2) straight over a ``seam`` (1, 2, 2) of all ``close`` nodes."""
    frame = exit_frame(seam, 0)
    for i in range(close.shape[0]):
        for j in range(close.shape[1]):
            if close[i, j]:
                x, y = origin[0] + j * spacing, origin[1] + i * spacing
                direction[i, j, 0], direction[i, j, 1] = through_exit(frame, x, y, radius, radius)
