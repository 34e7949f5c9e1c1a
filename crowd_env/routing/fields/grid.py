"""The nodes of a grid: distance to walls, lines that walls cross, connected parts, an even flow between them.

Arrays over nodes have shape (rows, cols); node (i, j) lies at ``origin + spacing * (j, i)``.
"""

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.routing.fields.lookup import crosses

_AROUND = 8  # nodes
_ENOUGH = 1e-4  # share of the sources that may be left unbalanced
_MOST = 4000  # steps of conjugate gradients
RIGHT, UP, DIAGONAL, ANTIDIAGONAL = 1, 2, 4, 8  # lines between the nodes of the cell right of and above a node


def node_points(origin: Floats, spacing: float, shape: tuple[int, ...]) -> Floats:
    """Return where the nodes lie (rows, cols, 2) [m]."""
    rows, cols = shape
    return np.stack(np.meshgrid(origin[0] + spacing * np.arange(cols), origin[1] + spacing * np.arange(rows)), axis=-1)


def nearest_nodes(position: Floats, origin: Floats, spacing: float, shape: tuple[int, ...]) -> tuple[Ints, Ints]:
    """Return rows and columns (...) of the nodes nearest to ``position`` (..., 2) [m]; beside the grid, of its edge nodes."""
    rows, cols = shape
    nearest = np.rint((position - origin) / spacing).astype(np.int64)
    return np.clip(nearest[..., 1], 0, rows - 1), np.clip(nearest[..., 0], 0, cols - 1)


def nearest_known(position: Floats, values: Floats, origin: Floats, spacing: float) -> tuple[Ints, Ints]:
    """Return rows and columns (K,) of the nodes nearest to ``position`` (K, 2) [m] among nodes with a value, not nan."""
    row, col = nearest_nodes(position, origin, spacing, values.shape)
    reach = np.arange(-_AROUND, _AROUND + 1)
    around = np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
    around = around[np.argsort((around**2).sum(axis=1), kind="stable")]
    lost = np.flatnonzero(np.isnan(values[row, col]))
    near = np.clip(np.column_stack([row, col])[lost, None] + around, 0, np.array(values.shape) - 1)
    found = ~np.isnan(values[near[..., 0], near[..., 1]])
    best = near[np.arange(len(lost)), np.argmax(found, axis=1)]
    row[lost], col[lost] = best.T
    for k in lost[~found.any(axis=1)]:  # seldom: most people are a body from free floor
        rows, cols = np.nonzero(~np.isnan(values))
        nearest = np.argmin((rows - row[k]) ** 2 + (cols - col[k]) ** 2) if len(rows) else 0
        row[k], col[k] = (rows[nearest], cols[nearest]) if len(rows) else (row[k], col[k])
    return row, col


@inner_kernel
def distance_to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance [m] from (x, y) to segment a-b."""
    ux, uy = bx - ax, by - ay
    square = ux * ux + uy * uy
    s = 0.0
    if square > 0.0:
        s = min(max(((x - ax) * ux + (y - ay) * uy) / square, 0.0), 1.0)
    return np.sqrt((ax + s * ux - x) ** 2 + (ay + s * uy - y) ** 2)


def capped_distance(segments: Floats, shape: tuple[int, ...], origin: Floats, spacing: float, cap: float) -> Floats:
    """Return the distance of every node to the nearest of ``segments`` (W, 2, 2), or ``cap`` if that is nearer [m]."""
    nearest = np.full(shape, cap)
    _lower_to_distance(segments, origin, spacing, cap, nearest)
    return nearest


@kernel
def _lower_to_distance(segments: Floats, origin: Floats, spacing: float, cap: float, nearest: Floats) -> None:
    """Lower ``nearest`` (rows, cols) [m] to the distance to segments wherever that is less than ``cap``."""
    rows, cols = nearest.shape
    for w in range(len(segments)):
        ax, ay, bx, by = segments[w, 0, 0], segments[w, 0, 1], segments[w, 1, 0], segments[w, 1, 1]
        i0, i1 = window(ay, by, cap, origin[1], spacing, rows)
        j0, j1 = window(ax, bx, cap, origin[0], spacing, cols)
        for i in range(i0, i1):
            for j in range(j0, j1):
                distance = distance_to_segment(origin[0] + j * spacing, origin[1] + i * spacing, ax, ay, bx, by)
                nearest[i, j] = min(nearest[i, j], distance)


@inner_kernel
def window(a: float, b: float, reach: float, origin: float, spacing: float, count: int) -> tuple[int, int]:
    """Return first and last + 1 of the ``count`` nodes of an axis that come within ``reach`` of a...b [m]."""
    first = int((min(a, b) - reach - origin) / spacing)
    last = int((max(a, b) + reach - origin) / spacing) + 2
    return max(first, 0), min(last, count)


def blocked_lines(walls: Floats, shape: tuple[int, ...], origin: Floats, spacing: float) -> NDArray[np.uint8]:
    """Return for every node which of the four lines of its cell (bits `RIGHT` ... `ANTIDIAGONAL`) a wall crosses."""
    blocked = np.zeros(shape, dtype=np.uint8)
    _block_lines(walls, origin, spacing, blocked)
    return blocked


@kernel
def _block_lines(walls: Floats, origin: Floats, spacing: float, blocked: NDArray[np.uint8]) -> None:
    rows, cols = blocked.shape
    for w in range(len(walls)):
        ax, ay, bx, by = walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]
        i0, i1 = window(ay, by, spacing, origin[1], spacing, rows)
        j0, j1 = window(ax, bx, spacing, origin[0], spacing, cols)
        for i in range(i0, i1):
            for j in range(j0, j1):
                x, y = origin[0] + j * spacing, origin[1] + i * spacing
                if distance_to_segment(x, y, ax, ay, bx, by) > 2.0 * spacing:
                    continue
                for line in range(4):  # from the node, or for the last one from its right neighbor
                    x0, x1 = (x + spacing if line == 3 else x), (x if line == 1 or line == 3 else x + spacing)
                    y1 = y if line == 0 else y + spacing
                    if crosses(ax, ay, bx, by, x0, y, x1, y1):
                        blocked[i, j] |= 1 << line


def with_fringe(free: Bools, allowed: Bools) -> Bools:
    """Return ``free`` and its side-by-side neighbors that are ``allowed``."""
    wider = free.copy()
    wider[1:] |= free[:-1]
    wider[:-1] |= free[1:]
    wider[:, 1:] |= free[:, :-1]
    wider[:, :-1] |= free[:, 1:]
    return free | (wider & allowed)


def connected_parts(free: Bools, seeds: Bools) -> Ints:
    """Return a label per node: 1 = connected to a seed (side by side), 2, 3 ... other parts, 0 = not free.

    Nodes side by side in a row form a run; connected runs of successive rows take the least number of all.
    """
    starts = free.copy()
    starts[:, 1:] &= ~free[:, :-1]
    run = np.where(free, (np.cumsum(starts, dtype=np.int32) - 1).reshape(free.shape), -1)
    touch = free[1:] & free[:-1]
    touch[:, 1:] &= ~touch[:, :-1]  # once where runs begin to lie side by side
    upper, lower = run[:-1][touch], run[1:][touch]
    part = np.arange(np.count_nonzero(starts))
    while (part[upper] != part[lower]).any():
        least = np.minimum(part[upper], part[lower])
        for side in (upper, lower):
            np.minimum.at(part, part[side], least)
        while (part != part[part]).any():
            part = part[part]
    number = np.zeros(len(part), dtype=np.int64)
    number[part[run[seeds & free]]] = 1
    others = (part == np.arange(len(part))) & (number == 0)
    number[others] = 2 + np.arange(np.count_nonzero(others))
    return np.append(number[part], 0)[run]


@kernel
def drain(beside: Ints, ends: Bools, phi: Floats, scratch: Floats) -> None:
    """Write the potential ``phi`` (K,) of `crowd_env.routing.fields.drain`, by conjugate gradients.

    ``beside`` (K, 4) are the neighbors of each node; the node itself stands for a neighbor behind a wall.  ``ends`` (K,) are
    the nodes next to the way out.  ``scratch`` (3, K) is 1 at first.
    """
    left, step, out = scratch
    square = float(len(phi))
    enough = _ENOUGH * _ENOUGH * square
    for _ in range(_MOST):
        if square <= enough:
            break
        along = 0.0
        for k in range(len(phi)):
            others = step[beside[k, 0]] + step[beside[k, 1]] + step[beside[k, 2]] + step[beside[k, 3]]
            out[k] = (5.0 if ends[k] else 4.0) * step[k] - others
            along += step[k] * out[k]
        share, before, square = square / along, square, 0.0
        for k in range(len(phi)):
            phi[k] += share * step[k]
            left[k] -= share * out[k]
            square += left[k] * left[k]
        for k in range(len(phi)):
            step[k] = left[k] + square / before * step[k]


def near(nodes: Bools, reach: float) -> Bools:
    """Return which nodes (rows, cols) lie within ``reach`` [nodes] of one of ``nodes``; outside of the grid there is none."""
    pad, (rows, cols) = int(reach), nodes.shape
    padded, found = np.pad(nodes, pad), np.zeros_like(nodes)
    steps = range(-pad, pad + 1)
    for p, q in ((p, q) for p in steps for q in steps if p * p + q * q <= reach * reach):
        found |= padded[pad + p : pad + p + rows, pad + q : pad + q + cols]
    return found
