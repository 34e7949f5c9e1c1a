"""Walls near a place: square cells over each geometry, each with the list of walls that come near it; pairs of points.

A wall between two pedestrians hides them from each other.  The cells spare a look at all walls of a building.
"""

import itertools
from typing import NamedTuple

import numpy as np
import shapely

from crowd_env.core.arrays.state import Bools, Floats, Ints, row_starts
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.surface import Ground, Surface

CELL = 1.0  # m
_BEHIND_SEAM = 2.0  # m; people further behind a seam than this are more than a body higher or lower, or nearly
_MOST_CELLS = 1_000_000  # of one geometry: beyond, cells are larger


Near = tuple[int, int]
"""The first entry of `WallGrid.wall` and one past the last of the walls near a point."""


class WallGrid(NamedTuple):
    """The cells of G geometries, one behind the other; rows of a geometry follow each other from its origin upwards."""

    origin: Floats  # (G, 2)  m    lower left corner of the first cell
    size: Floats  # (G,)    m    of a cell
    shape: Ints  # (G, 2)  rows and columns; 0 = there are no cells
    cell_start: Ints  # (G,)    first cell of each geometry
    wall_start: Ints  # (C+1,)  first entry of each cell in `wall`
    wall: Ints  # (K,)    rows of `Boundary.wall`


def make_wall_grid(boundary: Boundary, reach: float | None, surface: Surface | None = None) -> WallGrid:
    """Return the cells of every geometry, each with the walls that are nearer to it than ``reach`` [m]; None = no cells.

    With a ``surface`` there is a grid for each sheet.  It holds the walls of the next sheets near their seams too.

    The leaves of doors are among them, of open ones too: readers of the grid check which are closed.
    """
    starts = boundary.wall_start if surface is None else surface.wall_start
    rows = [np.arange(first, stop) for first, stop in itertools.pairwise(starts)]
    if surface is not None and reach is not None:
        rows = _with_next_sheets(rows, boundary.wall, surface)
    parts = [_grid_of(boundary.wall[row], row, reach) for row in rows]
    cells = [rows * columns for _, _, (rows, columns), _, _ in parts]
    counts = np.concatenate([part[3] for part in parts])
    return WallGrid(
        origin=np.array([part[0] for part in parts]),
        size=np.array([part[1] for part in parts]),
        shape=np.array([part[2] for part in parts], dtype=np.int64),
        cell_start=np.cumsum([0, *cells[:-1]]).astype(np.int64),
        wall_start=row_starts(counts),
        wall=np.concatenate([part[4] for part in parts]).astype(np.int64),
    )


def _with_next_sheets(rows: list[Ints], wall: Floats, surface: Surface) -> list[Ints]:
    """Return the walls of each sheet, and the walls behind its seams that are near them."""
    found = [[row] for row in rows]
    for g, (start, stop) in enumerate(zip(surface.seam_start[:-1], surface.seam_start[1:], strict=True)):
        for k in range(start, stop):
            here, there = (int(surface.sheet_start[g] + of[k]) for of in (surface.seam_from, surface.seam_to))
            seam, walls = shapely.LineString(surface.seam[k]), shapely.linestrings(wall[rows[there]])
            found[here].append(rows[there][shapely.dwithin(walls, seam, _BEHIND_SEAM)])
    return [np.unique(np.concatenate(each)) for each in found]


def _grid_of(wall: Floats, row: Ints, reach: float | None) -> tuple[Floats, float, tuple[int, int], Ints, Ints]:
    """Return origin, cell size, shape, the number of walls of each cell, and these walls, of one geometry."""
    if reach is None or not len(wall):
        return np.zeros(2), CELL, (0, 0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    low, high = wall.min(axis=(0, 1)) - reach, wall.max(axis=(0, 1)) + reach  # people walk beyond the last wall too
    size = max(CELL, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
    columns, rows = (np.floor((high - low) / size).astype(int) + 1).tolist()
    close = np.zeros((rows, columns), dtype=bool)  # only these can be within reach: in a large place they are few
    around = (wall.min(axis=1) - reach - low) / size - 1.0, (wall.max(axis=1) + reach - low) / size + 2.0
    for (j, i), (last_j, last_i) in np.maximum(around, 0.0).astype(int).transpose(1, 0, 2).tolist():
        close[i:last_i, j:last_j] = True
    bottom, left = low[1] + size * np.nonzero(close)[0], low[0] + size * np.nonzero(close)[1]
    cells = shapely.box(left, bottom, left + size, bottom + size)
    cell, near = shapely.STRtree(shapely.linestrings(wall)).query(cells, predicate="dwithin", distance=reach)
    order = np.lexsort((near, cell))
    cell = np.flatnonzero(close)[cell]
    return low, size, (rows, columns), np.bincount(cell, minlength=close.size), row[near[order]]


def pairs_within(points: Floats, distance: float) -> tuple[Ints, Ints]:
    """Return the pairs (M,), (M,) of ``points`` (K, 2) [m] no further apart than ``distance`` [m], each with itself too.

    It is for work done now and then; at every step the lists of neighbors are quicker.
    """
    places = shapely.points(points)
    i, j = shapely.STRtree(places).query(places, predicate="dwithin", distance=distance)
    return i, j


@inner_kernel
def walls_near(grid: WallGrid, g: int, x: float, y: float) -> Near:
    """Return the walls near a point of geometry ``g``."""
    rows, columns = grid.shape[g, 0], grid.shape[g, 1]
    column = int(np.floor((x - grid.origin[g, 0]) / grid.size[g]))
    row = int(np.floor((y - grid.origin[g, 1]) / grid.size[g]))
    if row < 0 or row >= rows or column < 0 or column >= columns:
        return 0, 0
    cell = grid.cell_start[g] + row * columns + column
    return grid.wall_start[cell], grid.wall_start[cell + 1]


@inner_kernel
def is_hidden(
    grid: WallGrid, near: Near, boundary: Boundary, door_open: Bools, x: float, y: float, dx: float, dy: float
) -> bool:
    """Whether one of these walls stands between (x, y) and the point (dx, dy) [m] from there; an open door is transparent."""
    for entry in range(index(near[0]), index(near[1])):
        if _hides(grid.wall[entry], boundary, door_open, x, y, dx, dy):
            return True
    return False


@inner_kernel
def is_in_sight(boundary: Boundary, ground: Ground, door_open: Bools, x: float, y: float, dx: float, dy: float) -> bool:
    """Whether no wall of the sheet, however far, stands between (x, y) and the point (dx, dy) [m] from there."""
    for k in range(index(ground[2]), index(ground[3])):
        if _hides(k, boundary, door_open, x, y, dx, dy):
            return False
    return True


@inner_kernel
def _hides(k: int, boundary: Boundary, door_open: Bools, x: float, y: float, dx: float, dy: float) -> bool:
    """Whether wall ``k`` stands between (x, y) and the point (dx, dy) from there."""
    wall, wall_door = boundary.wall, boundary.wall_door
    ax, ay = wall[k, 0, 0] - x, wall[k, 0, 1] - y
    bx, by = wall[k, 1, 0] - x, wall[k, 1, 1] - y
    from_a, from_b = dx * ay - dy * ax, dx * by - dy * bx
    if from_a * from_b > 0.0:
        return False  # both ends on one side of the line of sight
    here, there = ax * by - ay * bx, (ax - dx) * (by - dy) - (ay - dy) * (bx - dx)
    if here * there > 0.0:
        return False  # both people on one side of the wall
    return not (wall_door[k] >= 0 and door_open[wall_door[k]])


@inner_kernel
def free_paths(
    grid: WallGrid, near: Near, wall: Floats, x: float, y: float, ex: float, ey: float, most: float
) -> tuple[float, float]:
    """Return the free lengths [m] from (x, y) along a unit vector, and back, up to one of these walls, at most ``most``.

    Open doors stop it too: overtaking through a doorway is impossible.
    """
    forth, back = most, most
    for entry in range(index(near[0]), index(near[1])):
        k = grid.wall[entry]
        ax, ay = wall[k, 0, 0] - x, wall[k, 0, 1] - y
        bx, by = wall[k, 1, 0] - x, wall[k, 1, 1] - y
        from_a, from_b = ex * ay - ey * ax, ex * by - ey * bx
        if from_a * from_b > 0.0 or from_a == from_b:
            continue  # the wall is on one side of the ray, or along it
        share = from_a / (from_a - from_b)
        distance = (ax + share * (bx - ax)) * ex + (ay + share * (by - ay)) * ey
        if 0.0 < distance < forth:
            forth = distance
        if 0.0 < -distance < back:
            back = -distance
    return forth, back
