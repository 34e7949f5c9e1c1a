"""The floor that each pedestrian of a crowd has: a Voronoi cell that ends at walls, and the density that follows from it.

A pedestrian has all floor in sight that is nearer to them than to anyone else in sight, and within `REACH` (Steffen, Seyfried
2010, doi 10.1016/j.physa.2009.12.015; PedPy's individual cells).  People behind a wall have no part in it.  What lies beyond an
exit line counts as floor: without it everyone's last step would look crowded.

Cells are measured along rays: areas err by 0.3 %, of long and narrow cells by 1 %.
"""

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.wall_grid import WallGrid, is_hidden, walls_near

# m  A pedestrian alone has the best level of service (more than 2.3 m2) in a corner and in a corridor of 0.6 m too.
REACH = 2.0
_NEAR = 1.5  # m  in crowds the first neighbors bound a cell: others are looked at only where they still can
_RAYS = 96


def make_rays() -> Floats:
    """Return the directions (2, K) along which cells are measured."""
    angle = 2.0 * np.pi * (np.arange(_RAYS) + 0.5) / _RAYS
    return np.stack([np.cos(angle), np.sin(angle)])


@kernel
def measure_floor(
    boundary: Boundary,
    grid: WallGrid,
    door_open: Bools,
    env_start: Ints,
    inside: Bools,
    position: Floats,
    rays: Floats,
    nearness: Floats,
    floor: Floats,
) -> None:
    """Write the ``floor`` (P,) [m2] of the people ``inside``, all in the first geometry of ``boundary``.

    Parameters
    ----------
    grid : with the walls nearer than 2 `REACH`.
    door_open : (E, D) of each environment.
    rays : of `make_rays`.
    nearness : (P, K) 1/m, written: one over how far the cell reaches along each ray.
    """
    for e in range(len(env_start) - 1):
        for i in range(index(env_start[e]), index(env_start[e + 1])):
            if not inside[i]:
                continue
            x, y, row = position[i, 0], position[i, 1], nearness[i]
            near = walls_near(grid, 0, x, y)
            row[:] = 1.0 / REACH
            for entry in range(index(near[0]), index(near[1])):
                k = grid.wall[entry]
                door = boundary.wall_door[k]
                if door < 0 or not door_open[e, door]:
                    _end_at_wall(boundary.wall[k], x, y, rays, row)
            for far in range(2):
                low = _NEAR * far
                high = _NEAR if far == 0 else 2.0 * _furthest(row)
                for j in range(index(env_start[e]), index(env_start[e + 1])):
                    dx, dy = position[j, 0] - x, position[j, 1] - y
                    square = dx * dx + dy * dy
                    if not (inside[j] and square > 0.0 and low * low <= square < high * high):
                        continue
                    if is_hidden(grid, near, boundary, door_open[e], x, y, dx, dy):
                        continue
                    sx, sy = 2.0 * dx / square, 2.0 * dy / square
                    for k in range(len(row)):  # along a ray e the middle between both lies at square / (2 d e)
                        row[k] = max(row[k], sx * rays[0, k] + sy * rays[1, k])
            area = 0.0
            for k in range(len(row)):
                area += 1.0 / (row[k] * row[k])
            floor[i] = np.pi * area / len(row)


@inner_kernel
def _furthest(row: Floats) -> float:
    """Return how far [m] a cell reaches."""
    least = row[0]
    for value in row:
        least = min(least, value)
    return 1.0 / least


@inner_kernel
def _end_at_wall(wall: Floats, x: float, y: float, rays: Floats, row: Floats) -> None:
    """End the cell around (x, y) at a wall, along the rays that hit it."""
    ax, ay, bx, by = wall[0, 0] - x, wall[0, 1] - y, wall[1, 0] - x, wall[1, 1] - y
    turn = ax * by - ay * bx
    if turn < 0.0:
        ax, ay, bx, by, turn = bx, by, ax, ay, -turn
    if turn == 0.0:
        return
    count = len(row)
    first = np.arctan2(ay, ax) / (2.0 * np.pi) * count - 0.5  # rays from a to the left until b
    last = np.arctan2(by, bx) / (2.0 * np.pi) * count - 0.5
    if last < first:
        last += count
    for ray in range(int(np.ceil(first)), int(np.floor(last)) + 1):
        k = ray % count
        row[k] = max(row[k], (rays[0, k] * (by - ay) - rays[1, k] * (bx - ax)) / turn)


@kernel
def draw_density(
    env_start: Ints,
    inside: Bools,
    position: Floats,
    nearness: Floats,
    floor: Floats,
    origin: tuple[float, float],
    cell: float,
    density: Floats,
) -> None:
    """Raise the ``density`` [1/m2] (E, rows, columns) of square cells to one over the floor that their middles belong to.

    The cell in which a pedestrian stands is theirs too, however little floor they have.
    """
    rows, columns = density.shape[1], density.shape[2]
    count = nearness.shape[1]  # of rays
    for e in range(len(env_start) - 1):
        for i in range(index(env_start[e]), index(env_start[e + 1])):
            if not inside[i]:
                continue
            x, y = (position[i, 0] - origin[0]) / cell, (position[i, 1] - origin[1]) / cell
            value, reach = 1.0 / floor[i], _furthest(nearness[i]) / cell
            own_row, own_column = min(max(int(y), 0), rows - 1), min(max(int(x), 0), columns - 1)
            density[e, own_row, own_column] = max(density[e, own_row, own_column], value)
            for row in range(max(int(y - reach), 0), min(int(y + reach) + 1, rows)):
                for column in range(max(int(x - reach), 0), min(int(x + reach) + 1, columns)):
                    dx, dy = column + 0.5 - x, row + 0.5 - y
                    k = int(np.arctan2(dy, dx) / (2.0 * np.pi) * count + count) % count
                    if (dx * dx + dy * dy) * (cell * nearness[i, k]) ** 2 <= 1.0:
                        density[e, row, column] = max(density[e, row, column], value)
