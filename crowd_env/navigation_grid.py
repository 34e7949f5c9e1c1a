"""Kernels over the nodes of a grid: distance to walls, lines that walls cross, parts that are connected.

Arrays over nodes have shape (rows, cols); node (i, j) lies at ``origin + spacing * (j, i)``.
"""

import numpy as np
from numpy.typing import NDArray

from crowd_env._jit import allocating_kernel, inner_kernel
from crowd_env.navigation_lookup import crosses

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

RIGHT, UP, DIAGONAL, ANTIDIAGONAL = 1, 2, 4, 8  # lines between the nodes of the cell right of and above a node


@inner_kernel
def distance_to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance [m] from (x, y) to segment a-b."""
    ux, uy = bx - ax, by - ay
    square = ux * ux + uy * uy
    s = 0.0
    if square > 0.0:
        s = min(max(((x - ax) * ux + (y - ay) * uy) / square, 0.0), 1.0)
    return np.sqrt((ax + s * ux - x) ** 2 + (ay + s * uy - y) ** 2)


@allocating_kernel
def capped_distance(segments: Floats, rows: int, cols: int, origin: Floats, spacing: float, cap: float) -> Floats:
    """Return the distance of every node to the nearest of ``segments`` (W, 2, 2), or ``cap`` if that is nearer [m]."""
    nearest = np.full((rows, cols), cap)
    for w in range(len(segments)):
        ax, ay, bx, by = segments[w, 0, 0], segments[w, 0, 1], segments[w, 1, 0], segments[w, 1, 1]
        i0 = max(int((min(ay, by) - cap - origin[1]) / spacing), 0)
        i1 = min(int((max(ay, by) + cap - origin[1]) / spacing) + 2, rows)
        j0 = max(int((min(ax, bx) - cap - origin[0]) / spacing), 0)
        j1 = min(int((max(ax, bx) + cap - origin[0]) / spacing) + 2, cols)
        for i in range(i0, i1):
            for j in range(j0, j1):
                distance = distance_to_segment(origin[0] + j * spacing, origin[1] + i * spacing, ax, ay, bx, by)
                nearest[i, j] = min(nearest[i, j], distance)
    return nearest


@allocating_kernel
def blocked_lines(walls: Floats, rows: int, cols: int, origin: Floats, spacing: float) -> NDArray[np.uint8]:
    """Return for every node which of the four lines of its cell (bits `RIGHT` ... `ANTIDIAGONAL`) a wall crosses."""
    blocked = np.zeros((rows, cols), dtype=np.uint8)
    for w in range(len(walls)):
        ax, ay, bx, by = walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]
        i0 = max(int((min(ay, by) - origin[1]) / spacing) - 1, 0)
        i1 = min(int((max(ay, by) - origin[1]) / spacing) + 2, rows)
        j0 = max(int((min(ax, bx) - origin[0]) / spacing) - 1, 0)
        j1 = min(int((max(ax, bx) - origin[0]) / spacing) + 2, cols)
        for i in range(i0, i1):
            for j in range(j0, j1):
                x0, y0 = origin[0] + j * spacing, origin[1] + i * spacing
                x1, y1 = x0 + spacing, y0 + spacing
                if distance_to_segment(x0, y0, ax, ay, bx, by) > 2.0 * spacing:
                    continue
                if crosses(ax, ay, bx, by, x0, y0, x1, y0):
                    blocked[i, j] |= RIGHT
                if crosses(ax, ay, bx, by, x0, y0, x0, y1):
                    blocked[i, j] |= UP
                if crosses(ax, ay, bx, by, x0, y0, x1, y1):
                    blocked[i, j] |= DIAGONAL
                if crosses(ax, ay, bx, by, x1, y0, x0, y1):
                    blocked[i, j] |= ANTIDIAGONAL
    return blocked


@allocating_kernel
def with_fringe(free: Bools, allowed: Bools) -> Bools:
    """Return ``free`` and its side-by-side neighbours that are ``allowed``."""
    rows, cols = free.shape
    wider = free.copy()
    for i in range(rows):
        for j in range(cols):
            if allowed[i, j] and not free[i, j]:
                beside = (i > 0 and free[i - 1, j]) or (i + 1 < rows and free[i + 1, j])
                wider[i, j] = beside or (j > 0 and free[i, j - 1]) or (j + 1 < cols and free[i, j + 1])
    return wider


@allocating_kernel
def connected_parts(free: Bools, seeds: Bools) -> Ints:
    """Return a label per node: 1 = connected to a seed (side by side), 2, 3 ... other parts, 0 = not free."""
    rows, cols = free.shape
    label = np.zeros((rows, cols), dtype=np.int64)
    stack = np.empty(rows * cols, dtype=np.int64)
    size, latest = 0, 1
    for n in range(rows * cols):
        if seeds[n // cols, n % cols] and free[n // cols, n % cols]:
            label[n // cols, n % cols] = 1
            stack[size] = n
            size += 1
    following = 0
    while True:
        while size > 0:
            size -= 1
            i, j = stack[size] // cols, stack[size] % cols
            for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                p, q = i + di, j + dj
                if 0 <= p < rows and 0 <= q < cols and free[p, q] and label[p, q] == 0:
                    label[p, q] = latest
                    stack[size] = p * cols + q
                    size += 1
        while following < rows * cols:
            i, j = following // cols, following % cols
            if free[i, j] and label[i, j] == 0:
                break
            following += 1
        if following == rows * cols:
            return label
        latest += 1
        label[following // cols, following % cols] = latest
        stack[0], size = following, 1
