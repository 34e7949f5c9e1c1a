"""Random starting positions: discs that overlap neither walls nor each other."""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import counted, known
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.geometry.geometry import Geometry

# Equal discs cannot cover more of the plane than a hexagonal packing does.
CLOSEST_PACKING = np.pi / np.sqrt(12.0)
# Random placement one by one jams near 0.547; above this share people are set on a hexagonal lattice instead.
_RANDOM_LIMIT = 0.45
_ROUNDS = 400
_MOST_CELLS = 4e6

Standing = tuple[Floats, Floats]
"""Positions (K, 2) and radii (K,) [m] of people who stand already."""
Walls = tuple[Floats, Bools, Floats]
"""`Boundary.wall`, `Boundary.two_sided` and `Boundary.exit`."""


class Cells(NamedTuple):
    """Square cells over a place, and the people placed in each."""

    last: Ints  # (columns * rows + N,)  last person placed in each cell, then the one placed before each person; -1 = none
    columns: int
    rows: int
    low_x: float  # m
    low_y: float  # m
    size: float  # m


def sample_positions(
    geometry: Geometry,
    radius: Floats,
    rng: np.random.Generator,
    region: str | None = None,
    standing: Standing | None = None,
) -> Floats:
    """Return random positions (N, 2) of discs that overlap neither walls nor each other, nor the people in ``standing``.

    One after the other, each uniform over the free area (Pécol et al. 2011, section 4.2: random initial positions); a crowd
    too dense for that stands on a hexagonal lattice with random holes.

    Raises
    ------
    ValueError
        If they do not fit, or the region is unknown.
    """
    if region is not None:
        known("start region", region, geometry.regions)
    area = geometry.area_of(region)
    cover = float((np.pi * radius**2).sum())
    if cover < _RANDOM_LIMIT * area:
        placed = _place_randomly(geometry, radius, rng, region, standing)
        if placed is not None:
            return placed
    return _place_on_lattice(geometry, radius, rng, region, standing)


@kernel
def _clearances(points: Floats, walls: Walls, clearance: Floats) -> None:
    """Write the distance (K,) of points to the nearest wall, -1 outside (even-odd rule over walls and exits)."""
    for k in range(len(points)):
        clearance[k] = _clearance(points[k, 0], points[k, 1], walls)


@inner_kernel
def _clearance(x: float, y: float, walls: Walls) -> float:
    """Return the distance of (x, y) to the nearest wall, -1 outside."""
    wall, two_sided, exit_line = walls
    nearest, inside = np.inf, False
    for w in range(len(wall)):
        ax, ay, bx, by = wall[w, 0, 0], wall[w, 0, 1], wall[w, 1, 0], wall[w, 1, 1]
        if not two_sided[w] and (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
        square = (bx - ax) ** 2 + (by - ay) ** 2
        along = min(max(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / square, 0.0), 1.0)
        dx, dy = ax + along * (bx - ax) - x, ay + along * (by - ay) - y
        nearest = min(nearest, dx * dx + dy * dy)
    for w in range(len(exit_line)):
        ax, ay, bx, by = exit_line[w, 0, 0], exit_line[w, 0, 1], exit_line[w, 1, 0], exit_line[w, 1, 1]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return np.sqrt(nearest) if inside else -1.0


def _usable(geometry: Geometry, points: Floats, region: str | None, standing: Standing | None) -> Floats:
    """Distance (K,) of points to walls and to people already placed; -1 outside of the area or region."""
    clearance = np.empty(len(points))
    _clearances(points, _walls_of(geometry), clearance)
    if region is not None:
        clearance[~geometry.contains(points, region)] = -1.0
    if standing is not None:
        _keep_off(points, *standing, clearance)
    return clearance


def keeps_clear(geometry: Geometry, points: Floats, radius: float, region: str | None = None) -> Bools:
    """Return at which points (K, 2) a body of ``radius`` [m] overlaps no wall, and its center lies in the region."""
    return np.asarray(_usable(geometry, np.ascontiguousarray(points), region, None) >= radius - 1e-9)


def _walls_of(geometry: Geometry) -> Walls:
    """Return what people keep off at the start; seams too, since others may stand behind them."""
    walls, two_sided = geometry.walls, geometry.two_sided
    if geometry.building is not None:
        seams = geometry.building.lines
        walls, two_sided = np.concatenate([walls, seams]), np.pad(two_sided, (0, len(seams)))
    return walls, two_sided, geometry.exits


@kernel
def _keep_off(points: Floats, position: Floats, radius: Floats, clearance: Floats) -> None:
    for k in range(len(points)):
        for j in range(len(radius)):
            gap = np.hypot(points[k, 0] - position[j, 0], points[k, 1] - position[j, 1]) - radius[j]
            clearance[k] = min(clearance[k], gap)


def _place_randomly(
    geometry: Geometry, radius: Floats, rng: np.random.Generator, region: str | None, standing: Standing | None
) -> Floats | None:
    low_x, low_y, high_x, high_y = geometry.bounds if region is None else geometry.regions[region].bounds
    # Cells a body wide, or wider in places so large that there would be many more of them than people.
    size = max(2.0 * float(radius.max()), float(np.sqrt((high_x - low_x) * (high_y - low_y) / _MOST_CELLS)))
    columns, rows = int((high_x - low_x) / size) + 1, int((high_y - low_y) / size) + 1
    count = len(radius)
    cells = Cells(np.full(columns * rows + count, -1, dtype=np.int64), columns, rows, low_x, low_y, size)
    placed = np.zeros((count, 2))
    anywhere = region is None and standing is None
    done = 0
    for _ in range(_ROUNDS):
        points = rng.random((16 + 3 * count, 2))
        points *= (high_x - low_x, high_y - low_y)
        points += (low_x, low_y)
        clearance = _NOT_KNOWN if anywhere else _usable(geometry, points, region, standing)
        done = _accept(points, clearance, _walls_of(geometry), radius, placed, done, cells)
        if done == count:
            return placed
    return None


_NOT_KNOWN = np.empty(0)


@kernel
def _accept(
    points: Floats, clearance: Floats, walls: Walls, radius: Floats, placed: Floats, done: int, cells: Cells
) -> int:
    """Give each next person the first candidate point where it fits; returns the number placed.

    Parameters
    ----------
    points, clearance : (K, 2) m, (K,) m to walls and people already placed, -1 = not usable; empty = only walls matter,
        found here for as many points as needed.
    radius, placed, done : (N,) m, (N, 2) m and the number placed by now.
    """
    last, columns, rows, low_x, low_y, size = cells
    table = columns * rows
    for k in range(len(points)):
        if done == len(radius):
            break
        x, y = points[k, 0], points[k, 1]
        if len(clearance) > 0 and clearance[k] < radius[done]:
            continue
        column, row = int((x - low_x) / size), int((y - low_y) / size)
        free = True
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                j = last[r * columns + c]
                while j >= 0 and free:
                    limit = radius[j] + radius[done]
                    free = (x - placed[j, 0]) ** 2 + (y - placed[j, 1]) ** 2 >= limit * limit
                    j = last[table + j]
        if free and len(clearance) == 0:
            free = _clearance(x, y, walls) >= radius[done]
        if free:
            placed[done, 0], placed[done, 1] = x, y
            last[table + done] = last[row * columns + column]
            last[row * columns + column] = done
            done += 1
    return done


def lattice(geometry: Geometry, radius: float, region: str | None = None) -> Floats:
    """Return where (K, 2) bodies of ``radius`` [m] can stand on the lattice of crowds too dense for random placement."""
    return _lattice(geometry, radius, (0.0, 0.0), region, None)


def _lattice(
    geometry: Geometry, radius: float, offset: tuple[float, float], region: str | None, standing: Standing | None
) -> Floats:
    """Return the points (K, 2) of a hexagonal lattice on which discs of ``radius`` [m] fit, moved by ``offset`` (2,) [m]."""
    low_x, low_y, high_x, high_y = geometry.bounds if region is None else geometry.regions[region].bounds
    step, height = _steps(radius)
    x, y = np.meshgrid(
        np.arange(low_x + radius + offset[0], high_x, step), np.arange(low_y + radius + offset[1], high_y, height)
    )
    x[1::2] += 0.5 * step
    points = np.column_stack([x.ravel(), y.ravel()])
    return points[_usable(geometry, points, region, standing) >= radius - 1e-12]


def _steps(radius: float) -> tuple[float, float]:
    """Return how far discs of ``radius`` are apart in a row of the lattice, and how far its rows."""
    step = 2.0 * radius * (1.0 + 1e-9)
    return step, step * float(np.sqrt(0.75))


def _place_on_lattice(
    geometry: Geometry, radius: Floats, rng: np.random.Generator, region: str | None, standing: Standing | None
) -> Floats:
    widest = float(radius.max())
    step, height = _steps(widest)
    shift = rng.uniform(0.0, 1.0, 2) * (step, height)
    most = 0
    for offset in ((0.0, 0.0), tuple(shift)):  # flush with the walls first: nothing holds more
        points = _lattice(geometry, widest, offset, region, standing)
        most = max(most, len(points))
        if len(points) >= len(radius):
            return points[rng.permutation(len(points))[: len(radius)]]
    beside = "" if standing is None else f" beside {len(standing[1])} already placed"
    raise ValueError(
        f"{counted(len(radius), 'person does', 'people do')} not fit without overlap into "
        f"{geometry.area_of(region):.1f} m2: with bodies of radius {radius.min():.2f} to {radius.max():.2f} m "
        f"a regular lattice holds {most} there{beside}"
    )


def closest_pair(position: Floats, radius: Floats) -> tuple[int, int, float]:
    """Return the two discs with the smallest gap, and that gap [m]; (0, 0, inf) for fewer than two."""
    order = np.argsort(position[:, 0], kind="stable")
    return _closest_pair(position, radius, order, 2.0 * float(np.max(radius, initial=0.0)))


@kernel
def _closest_pair(position: Floats, radius: Floats, order: Ints, widest: float) -> tuple[int, int, float]:
    """Look from each disc, from left to right, only as far as a smaller gap can be."""
    best_i, best_j, best = 0, 0, np.inf
    for m in range(len(order)):
        i = order[m]
        for n in range(m + 1, len(order)):
            j = order[n]
            if position[j, 0] - position[i, 0] - widest > best:
                break
            distance = np.hypot(position[i, 0] - position[j, 0], position[i, 1] - position[j, 1])
            gap = distance - radius[i] - radius[j]
            if gap < best:
                best_i, best_j, best = min(i, j), max(i, j), gap
    return best_i, best_j, best
