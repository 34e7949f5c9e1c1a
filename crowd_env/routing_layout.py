"""Where a routing controller decides and what it sees: decision regions, and the layout of its observation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from crowd_env.geometry import Geometry, box
from crowd_env.state import Floats, Ints

_LEAST_AREA = 0.1  # m2  cells of a grid with less floor than that are left out


class DecisionRegions(NamedTuple):
    """Where people are told the same."""

    names: tuple[str, ...]  # R
    area: Floats  # (R,) m2  walkable
    centre: Floats  # (R, 2) m  of what is walkable of it
    locate: Callable[[Floats], Ints]  # positions (K, 2) -> region (K,), the first that holds it; -1 = none


def named_regions(geometry: Geometry, names: Sequence[str]) -> DecisionRegions:
    """Return regions of a plan as decision regions; where they overlap the first one counts.

    Raises
    ------
    ValueError
        If a name is unknown or given twice.
    """
    names = tuple(names)
    check_names("region", names, tuple(geometry.regions))

    floors = [geometry.walkable.intersection(geometry.regions[name]) for name in names]
    centre = np.array([(floor.centroid.x, floor.centroid.y) for floor in floors])
    return DecisionRegions(
        names, np.array([floor.area for floor in floors]), centre, partial(_in_named, geometry, names)
    )


def _in_named(geometry: Geometry, names: tuple[str, ...], position: Floats) -> Ints:
    inside = np.stack([geometry.contains(position, name) for name in names])
    return np.where(inside.any(axis=0), inside.argmax(axis=0), -1).astype(np.int64)


def grid_regions(geometry: Geometry, columns: int, rows: int) -> DecisionRegions:
    """Return the walkable cells of a grid over the bounding box, ``cell-<column>-<row>`` from the lower left, row by row.

    Raises
    ------
    ValueError
        If the grid has no cells.
    """
    if columns < 1 or rows < 1:
        raise ValueError(f"the grid has {columns} x {rows} cells; it must have at least 1 x 1")
    low = np.array(geometry.bounds[:2])
    size = (np.array(geometry.bounds[2:]) - low) / (columns, rows)
    names: list[str] = []
    area: list[float] = []
    centre: list[tuple[float, float]] = []
    number = np.full((rows, columns), -1, dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            corner = low + (column, row) * size
            floor = geometry.walkable.intersection(box(*corner, *(corner + size)))
            if floor.area >= _LEAST_AREA:
                number[row, column] = len(names)
                names.append(f"cell-{column}-{row}")
                area.append(float(floor.area))
                centre.append((floor.centroid.x, floor.centroid.y))

    return DecisionRegions(tuple(names), np.array(area), np.array(centre), partial(_in_grid, low, size, number))


def _in_grid(low: Floats, size: Floats, number: Ints, position: Floats) -> Ints:
    """Return the number of the cell of each position; beyond the grid counts as its border."""
    rows, columns = number.shape
    column, row = np.floor((position - low) / size).astype(np.int64).T
    return number[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]


@dataclass(frozen=True)
class RoutingLayout:
    """Where the parts of an observation are: ``layout["queue"]`` is a slice of columns; all lie in [0, 1], float32.

    ============  ===================  ====================================================================
    part          one for each         value
    ============  ===================  ====================================================================
    ``count``     region               people in it / all N people of the scenario
    ``density``   region               people per walkable m2 / (5 /m2)
    ``speed``     region               mean speed of the people in it / (2 m/s); 0 if there are none
    ``flow``      exit                 people who left by it since the last decision / (s, m of width, 5)
    ``queue``     exit                 people with at most 2.5 m to walk to it / N
    ``told``      route                people inside who were told to take it / N
    ``door``      controlled door      1 = open
    ``inside``    (1)                  people inside / N
    ``time``      (1)                  time / time limit
    ============  ===================  ====================================================================
    """

    regions: tuple[str, ...]
    exits: tuple[str, ...]
    routes: tuple[str, ...]
    doors: tuple[str, ...] = ()

    @property
    def parts(self) -> dict[str, int]:
        """Name -> number of columns, in order."""
        regions, exits = len(self.regions), len(self.exits)
        sizes = {"count": regions, "density": regions, "speed": regions, "flow": exits, "queue": exits}
        return {**sizes, "told": len(self.routes), "door": len(self.doors), "inside": 1, "time": 1}

    @property
    def size(self) -> int:
        """Number of columns in all."""
        return sum(self.parts.values())

    def __getitem__(self, part: str) -> slice:
        """Return the columns of a part."""
        names = list(self.parts)
        if part not in names:
            raise KeyError(f"this observation has no part {part!r}; it has: {', '.join(names)}")
        begin = sum(self.parts[name] for name in names[: names.index(part)])
        return slice(begin, begin + self.parts[part])


def check_names(kind: str, names: tuple[str, ...], known: tuple[str, ...]) -> None:
    """Raise ValueError if a name is unknown or given twice."""
    for name in names:
        if name not in known:
            raise ValueError(f"unknown {kind} {name!r}; known: {', '.join(known) or 'none'}")
        if names.count(name) > 1:
            raise ValueError(f"{kind} {name!r} is named twice; once is enough")
