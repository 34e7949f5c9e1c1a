"""Where a routing controller decides: named regions of the scenario, storeys and stairs, or the cells of a grid."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import refuse
from crowd_env.geometry.geometry import Geometry, box

_LEAST_AREA = 0.1  # m2  cells of a grid with less floor than that are left out


class DecisionRegions(NamedTuple):
    """Where all people are sent along the same route."""

    names: tuple[str, ...]  # R
    area: Floats  # (R,) m2  walkable
    center: Floats  # (R, 2) m  of its walkable part
    locate: Callable[[Floats], Ints]  # positions (K, 2) -> region (K,), the first that holds it; -1 = none


def named_regions(geometry: Geometry, names: Sequence[str]) -> DecisionRegions:
    """Return regions of a geometry as decision regions; where they overlap the first one counts."""
    floors = {name: geometry.walkable.intersection(geometry.regions[name]) for name in names}
    return _regions(floors, partial(_first_that_holds, geometry, tuple(names)))


def sheets_of(geometry: Geometry) -> tuple[str, ...]:
    """Return the names of the storeys and stairs of a building; of another place none."""
    sheets = () if geometry.building is None else geometry.building.sheets
    return tuple(sheet.name for sheet in sheets if sheet.name in geometry.regions)


def grid_regions(geometry: Geometry, grid: Sequence[int]) -> DecisionRegions:
    """Return the walkable cells of a grid over the bounding box, ``cell-<column>-<row>`` from the lower left, row by row.

    Parameters
    ----------
    grid : number of columns and of rows.

    Raises
    ------
    ValueError
        If these are no two whole numbers >= 1, or if no cell of the grid has 0.1 m2 of floor.
    """
    numbers = list(grid) if isinstance(grid, list | tuple | np.ndarray) else []
    if len(numbers) != 2 or not all(
        type(n) is not bool and isinstance(n, int | np.integer) and n >= 1 for n in numbers
    ):
        refuse("grid", grid, "two whole numbers >= 1, columns and rows: grid=(4, 2)")
    columns, rows = (int(n) for n in numbers)
    low = np.array(geometry.bounds[:2])
    size = (np.array(geometry.bounds[2:]) - low) / (columns, rows)
    too_small = ValueError(
        f"no cell of a grid of {columns} x {rows} has {_LEAST_AREA:g} m2 of floor: one measures "
        f"{size[0]:.3g} x {size[1]:.3g} m; take fewer columns and rows"
    )
    if size.prod() < _LEAST_AREA:
        raise too_small  # before millions of them are cut out
    floors: dict[str, Any] = {}
    number = np.full((rows, columns), -1, dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            corner = low + (column, row) * size
            floor = geometry.walkable.intersection(box(*corner, *(corner + size)))
            if floor.area >= _LEAST_AREA:
                number[row, column] = len(floors)
                floors[f"cell-{column}-{row}"] = floor
    if not floors:
        raise too_small
    return _regions(floors, partial(_cell_of, low, size, number))


def _regions(floors: Mapping[str, Any], locate: Callable[[Floats], Ints]) -> DecisionRegions:
    """Return the decision regions with these walkable parts."""
    center = np.array([(floor.centroid.x, floor.centroid.y) for floor in floors.values()])
    return DecisionRegions(tuple(floors), np.array([floor.area for floor in floors.values()]), center, locate)


# Functions of the module, not closures: these can be pickled.
def _first_that_holds(geometry: Geometry, names: tuple[str, ...], position: Floats) -> Ints:
    """Return the first of the named regions (K,) that holds a position (K, 2); -1 = none."""
    inside = np.stack([geometry.contains(position, name) for name in names])
    return np.where(inside.any(axis=0), inside.argmax(axis=0), -1).astype(np.int64)


def _cell_of(low: Floats, size: Floats, number: Ints, position: Floats) -> Ints:
    """Return the number (K,) of the cell of a grid that a position (K, 2) lies in; -1 = none."""
    rows, columns = number.shape
    column, row = np.floor((position - low) / size).astype(np.int64).T
    return np.asarray(number[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)], dtype=np.int64)
