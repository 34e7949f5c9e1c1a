"""Reading a travel-time field at a place: the functions that physics calls for every pedestrian at every step.

All functions are free of allocation; ``f`` is the row of the field within the batch.  In a building a route has a row for each
sheet, one behind the other, in true coordinates.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.surface import Ground

# Depth [body radii] in front of the exit line within which the aim moves beyond the line: deep enough to lead no body
# along the line, shallow enough to lead no body closer to a door jamb than its radius allows.
_DOORSTEP = 0.25


BLEND = -1  # cell: interpolate between its walkable corners
ALONE = -2  # cell: a wall runs through it, or no corner is walkable; follow a single node


class FieldArrays(NamedTuple):
    """Input of the kernels from the navigation fields; the nodes of F fields lie one behind the other."""

    geometry: Ints  # (F,)    geometry that each field is made for
    node_start: Ints  # (F+1,)  first node of each field; nodes run row by row
    shape: Ints  # (F, 2)  rows (y), columns (x)
    origin: Floats  # (F, 2)  m   place of node [0, 0]
    spacing: Floats  # (F,)    m   between nodes
    travel_time: Floats  # (M,)    s   to the exit line, at 1 m/s; nan outside of the walkable area
    behind: Floats  # (F,)    s   from there to the end of the apron, which directions lead to
    direction: Floats  # (M, 2)  unit vector along the shortest path; 0 outside
    direct: Ints  # (M,)    row of Boundary.exit reached in a straight line; -1 = none
    cell: NDArray[np.int16]  # (M,)    cell right of and above: exit that all its corners are direct to, BLEND, ALONE
    margin: Floats  # (F,)    m   kept from the ends of an exit in the aim; nan = the body's radius
    through: Ints  # (M,)    bit k: the way from here leads through region k


Frame = tuple[float, float, float, float, float, float, float]
"""Of an exit: end a (2), the vector from there to end b (2), its length, and the unit vector out (2)."""


@inner_kernel
def exit_frame(exit_line: Floats, k: int) -> Frame:
    """Return the frame of exit ``k``."""
    ax, ay = exit_line[k, 0, 0], exit_line[k, 0, 1]
    ux, uy = exit_line[k, 1, 0] - ax, exit_line[k, 1, 1] - ay
    width = np.sqrt(ux * ux + uy * uy)
    return ax, ay, ux, uy, width, uy / width, -ux / width


@inner_kernel
def nearest_on_exit(frame: Frame, x: float, y: float, radius: float) -> tuple[float, float]:
    """Return the point of an exit, shrunk by ``radius`` at both ends, nearest to (x, y); its middle if too narrow."""
    ax, ay, ux, uy, width, _, _ = frame
    if width <= 2.0 * radius:
        return ax + 0.5 * ux, ay + 0.5 * uy
    s = ((x - ax) * ux + (y - ay) * uy) / width
    s = min(max(s, radius), width - radius) / width
    return ax + s * ux, ay + s * uy


@inner_kernel
def through_exit(frame: Frame, x: float, y: float, radius: float, margin: float) -> tuple[float, float]:
    """Return the unit vector that leads a disc at (x, y) out through an exit (walkable area to its left)."""
    ax, ay, _, _, _, nx, ny = frame
    tx, ty = nearest_on_exit(frame, x, y, margin)
    depth = (ax - x) * nx + (ay - y) * ny  # in front of the line; negative beyond it
    beyond = max(_DOORSTEP * radius - depth, 0.0)
    dx, dy = tx - x + beyond * nx, ty - y + beyond * ny
    distance = np.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        return nx, ny
    return dx / distance, dy / distance


@inner_kernel
def crosses(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> bool:
    """Return whether segments a-b and c-d cross each other; touching is not crossing."""
    c_side = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    d_side = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    if not ((c_side > 1e-12 and d_side < -1e-12) or (c_side < -1e-12 and d_side > 1e-12)):
        return False
    a_side = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    b_side = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return (a_side > 1e-12 and b_side < -1e-12) or (a_side < -1e-12 and b_side > 1e-12)


@inner_kernel
def _cell(u: float, count: int) -> tuple[int, float]:
    """Return the cell of grid coordinate ``u`` along an axis of ``count`` nodes, and the place within it (0..1).

    Places outside of the grid (and nan) are moved onto its border.
    """
    u = min(u, count - 1.0) if u > 0.0 else 0.0
    n = min(int(u), count - 2)
    return n, u - n


@inner_kernel
def _sees(walls: Floats, w0: int, w1: int, x: float, y: float, px: float, py: float) -> bool:
    """Return whether none of walls w0..w1 runs between (x, y) and (px, py)."""
    for w in range(w0, w1):
        if crosses(x, y, px, py, walls[w, 0, 0], walls[w, 0, 1], walls[w, 1, 0], walls[w, 1, 1]):
            return False
    return True


@inner_kernel
def _best_corner(travel_time: Floats, first: int, cols: int) -> int:
    """Return the corner of the cell with the least travel time; one of them is walkable."""
    best, least = first, np.inf
    for c in range(4):
        node = first + (c >> 1) * cols + (c & 1)
        if travel_time[node] < least:  # false for nan
            best, least = node, travel_time[node]
    return best


@inner_kernel
def _nearest_node(travel_time: Floats, start: int, rows: int, cols: int, i0: int, j0: int) -> int:
    """Return the walkable node nearest to node [i0, j0], found in growing rings; -1 if the field has none."""
    best, best_square = -1, np.inf
    for ring in range(max(rows, cols)):
        if best >= 0 and ring * ring > best_square:
            break
        for i in range(max(i0 - ring, 0), min(i0 + ring + 1, rows)):
            step = 1 if abs(i - i0) == ring else 2 * ring
            for j in range(j0 - ring, j0 + ring + 1, step):
                square = float((i - i0) ** 2 + (j - j0) ** 2)
                if 0 <= j < cols and square < best_square and travel_time[start + i * cols + j] < np.inf:
                    best, best_square = start + i * cols + j, square
    return best


@inner_kernel
def _time_of_nearest(field: FieldArrays, f: int, x: float, y: float, first: int) -> float:
    """Return the travel time at (x, y) by the known node nearest to its cell; nan if the field has none."""
    cols, start, h = field.shape[f, 1], field.node_start[f], field.spacing[f]
    node = _nearest_node(
        field.travel_time, start, field.shape[f, 0], cols, (first - start) // cols, (first - start) % cols
    )
    if node < 0:
        return np.nan
    px, py = field.origin[f, 0] + (node - start) % cols * h, field.origin[f, 1] + (node - start) // cols * h
    return field.travel_time[node] + np.sqrt((px - x) ** 2 + (py - y) ** 2)


@inner_kernel
def _walls(boundary: Boundary, g: int, ground: Ground | None) -> tuple[int, int]:
    if ground is None:
        return boundary.wall_start[g], boundary.wall_start[g + 1]
    return ground[2], ground[3]


@inner_kernel
def _node_for(
    field: FieldArrays, boundary: Boundary, f: int, x: float, y: float, first: int, ground: Ground | None
) -> int:
    """Return the one node to follow in a cell that a wall runs through or that has no walkable corner; -1 = none.

    Of the corners on this side of the wall it is the nearest one; of a cell outside of the area, the nearest node at all.
    """
    cols = field.shape[f, 1]
    start, h = field.node_start[f], field.spacing[f]
    i, j = (first - start) // cols, (first - start) % cols
    w0, w1 = _walls(boundary, field.geometry[f], ground)
    best, least = -1, np.inf
    for hidden in (False, True):  # better a node behind the wall than none
        for c in range(4):
            node = first + (c >> 1) * cols + (c & 1)
            px, py = field.origin[f, 0] + (j + (c & 1)) * h, field.origin[f, 1] + (i + (c >> 1)) * h
            square = (px - x) ** 2 + (py - y) ** 2
            known = field.travel_time[node] < np.inf  # false for nan
            if known and square < least and (hidden or _sees(boundary.wall, w0, w1, x, y, px, py)):
                best, least = node, square
        if best >= 0:
            return best
    return _nearest_node(field.travel_time, start, field.shape[f, 0], cols, i, j)


@inner_kernel
def quick_cell(
    start: int, rows: int, cols: int, left: float, bottom: float, spacing: float, x: float, y: float
) -> tuple[int, float, float]:
    """Return the first node of the cell that (x, y) lies in, and the place within it, right and up (0..1)."""
    j, u = _cell((x - left) / spacing, cols)
    i, v = _cell((y - bottom) / spacing, rows)
    return start + i * cols + j, u, v


@inner_kernel
def blended_direction(direction: Floats, first: int, cols: int, u: float, v: float) -> tuple[bool, float, float]:
    """Return whether the ways of the walkable corners of a cell agree on one, and its unit vector."""
    low, high = (1.0 - v) * (1.0 - u), v * (1.0 - u)  # corners outside of the area have direction 0, i.e. no weight
    ex = low * direction[first, 0] + high * direction[first + cols, 0]
    ey = low * direction[first, 1] + high * direction[first + cols, 1]
    low, high = (1.0 - v) * u, v * u
    ex += low * direction[first + 1, 0] + high * direction[first + cols + 1, 0]
    ey += low * direction[first + 1, 1] + high * direction[first + cols + 1, 1]
    norm = np.sqrt(ex * ex + ey * ey)
    if norm > 1e-3:
        return True, ex / norm, ey / norm
    return False, 0.0, 0.0  # two ways of equal length


@inner_kernel
def way_at(
    field: FieldArrays, boundary: Boundary, f: int, x: float, y: float, radius: float, ground: Ground | None = None
) -> tuple[float, float, float]:
    """Return the unit vector of the way out at (x, y) for a disc of ``radius`` [m] by field ``f``, and its length [m].

    The length is the travel time at 1 m/s [s].  Without a field they are (0, 0) and nan.  ``ground`` is that of the sheet;
    None = the place has one.
    """
    rows, cols = field.shape[f, 0], field.shape[f, 1]
    if cols == 0:
        return 0.0, 0.0, np.nan
    first, u, v = quick_cell(
        field.node_start[f], rows, cols, field.origin[f, 0], field.origin[f, 1], field.spacing[f], x, y
    )
    k = field.cell[first]
    if k >= 0:
        margin = field.margin[f]
        margin = margin if margin >= 0.0 else radius
        frame = exit_frame(boundary.aim, k)
        ex, ey = through_exit(frame, x, y, radius, margin)
        tx, ty = nearest_on_exit(frame, x, y, margin)
        return ex, ey, np.sqrt((tx - x) ** 2 + (ty - y) ** 2) - field.behind[f]
    if k == BLEND:
        plain, ex, ey = blended_direction(field.direction, first, cols, u, v)
        length = _blended_time(field.travel_time, first, cols, u, v)
        if not (plain and length >= 0.0):
            node = _best_corner(field.travel_time, first, cols)
            if not plain:  # two ways of equal length: take one
                ex, ey = field.direction[node, 0], field.direction[node, 1]
            if not length >= 0.0:
                length = field.travel_time[node]
            if not length >= 0.0:  # beside a wall, where a march on so fine a grid keeps out
                length = _time_of_nearest(field, f, x, y, first)
        return ex, ey, length
    node = _node_for(field, boundary, f, x, y, first, ground)
    if node < 0:
        return 0.0, 0.0, np.nan
    return field.direction[node, 0], field.direction[node, 1], field.travel_time[node]


@inner_kernel
def _blended_time(travel_time: Floats, first: int, cols: int, u: float, v: float) -> float:
    """Return the travel time between the walkable corners of a cell, nan if they are too far."""
    total, weights = 0.0, 0.0
    for c in range(4):
        time = travel_time[first + (c >> 1) * cols + (c & 1)]
        weight = (u if c & 1 else 1.0 - u) * (v if c >> 1 else 1.0 - v)
        if time < np.inf:  # false for nan
            total += weight * time
            weights += weight
    return total / weights if weights > 1e-3 else np.nan


@kernel
def direction_at(
    field: FieldArrays, boundary: Boundary, f: int, x: float, y: float, radius: float
) -> tuple[float, float]:
    """Return the unit vector of the way out at (x, y) for a disc of ``radius`` [m] by field ``f``; (0, 0) without one."""
    ex, ey, _ = way_at(field, boundary, f, x, y, radius)
    return ex, ey


@kernel
def travel_time_at(
    field: FieldArrays, boundary: Boundary, f: int, x: float, y: float, radius: float, ground: Ground | None = None
) -> float:
    """Return the length of the way out from (x, y) [m], i.e. the travel time at 1 m/s [s]; nan without a field."""
    _, _, length = way_at(field, boundary, f, x, y, radius, ground)
    return length
