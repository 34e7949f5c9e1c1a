"""Floor plans and recorded positions in files: in which unit they are, and whether they can be what they say."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.checks import known, texts
from crowd_env.checks import path as path_of
from crowd_env.files.csv_table import read_table
from crowd_env.files.foreign import read_text
from crowd_env.geometry.geometry import Geometry, parse_exit
from crowd_env.geometry.parsing import from_wkt
from crowd_env.navigation.domain import require_grid
from crowd_env.scenarios.groups import People
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Floats

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}

# A plan larger than this is rare, and one in centimeters always is: a warning asks for the unit ...

_WIDE_EXIT, _LARGE = 20.0, 300.0  # m
# ... and beyond this no plan is accepted.
_WIDEST_EXIT, _LARGEST = 200.0, 3000.0  # m
_SMALL = 1.0  # m

_READ = (
    "a floor plan is read from well-known text (WKT), e.g. POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0)), or from a scenario file "
    "(.toml, .json)"
)


def scenario_from_wkt(
    path: str | Path,
    exits: Sequence[str],
    population: People,
    *,
    time_limit: float = 300.0,
    unit: str | None = None,
) -> Scenario:
    """Return a scenario on a floor plan in well-known text (WKT): polygons with holes.

    Parameters
    ----------
    path : text file with a POLYGON, MULTIPOLYGON or GEOMETRYCOLLECTION.
    exits : each "x1,y1,x2,y2" or a LINESTRING on the edge of the plan, or a POLYGON that people walk into.
    unit : m, cm or mm, of the coordinates of plan and exits; None = meters, if they can be.

    Raises
    ------
    ValueError
        If the file cannot be read or the plan cannot be used; the message names the file.

    Warns
    -----
    UserWarning
        If no unit is given and the plan is so large that it may be in another one.
    """
    path, exits = path_of("the file of the floor plan", path), texts("exits", exits)
    meters = unit_in_meters(unit)
    text = read_text(path, "the floor plan", _READ)
    if not exits:
        raise ValueError(f"{path}: a floor plan needs at least one exit, for example --exit 5,2,5,3")
    try:
        area = _scaled(from_wkt(text, "walkable area"), meters)
        doors = [_scaled(parse_exit(one), meters) for one in exits]
        if unit is None:
            _ask_for_unit(area, doors)
        geometry = Geometry.from_polygon(area, exits=doors)
        require_grid(geometry, population.radius.low)
        geometry = geometry.without_closed_off(population.radius.low, doors)
        return Scenario(path.stem, geometry, population, time_limit, title=f"floor plan {path.name}")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def unit_in_meters(unit: str | None) -> float:
    """Return how many meters a unit of length is; None = the meter.

    Raises
    ------
    ValueError
        If it is unknown.
    """
    return 1.0 if unit is None else _METRES[known("unit", unit, _METRES)]


def _scaled(shape: BaseGeometry, meters: float) -> BaseGeometry:
    return shape if meters == 1.0 else shapely.transform(shape, lambda points: meters * points)


def _ask_for_unit(area: BaseGeometry, exits: Sequence[BaseGeometry]) -> None:
    """Warn if a plan taken as one in meters may be in centimeters, and refuse one that must be in another unit.

    Raises
    ------
    ValueError
        If nothing so large or so small is a building.
    """
    if not area.area > 0 or not np.isfinite(shapely.get_coordinates(area)).all():
        return  # reading the shapes gives the better message
    x0, y0, x1, y1 = area.bounds
    across = max(x1 - x0, y1 - y0)
    widest = max((float(door.length) for door in exits if "Line" in door.geom_type), default=0.0)
    seen = f"taken as meters, the plan is {x1 - x0:.4g} m x {y1 - y0:.4g} m"
    seen += f" and an exit {widest:.4g} m wide" if widest > _WIDE_EXIT else ""
    if across > _LARGEST or widest > _WIDEST_EXIT:
        raise ValueError(f"{seen}: is it in mm or cm? Then say --unit mm or --unit cm; --unit m if it is in meters")
    if across < _SMALL:
        raise ValueError(f"{seen}: is it in km or degrees? It must be in m, cm or mm; --unit m if it is in meters")
    if across > _LARGE or widest > _WIDE_EXIT:
        warnings.warn(f"{seen}: is it in cm? Then say --unit cm; --unit m if it is in meters", stacklevel=3)


def read_starts(path: str | Path) -> Floats:
    """Return recorded starting positions (K, 2) [m] from a CSV file with the columns ``x`` and ``y``.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column, or holds something that is not a number; file and line are named.
    """
    table = read_table(path, "the starting positions", ("x", "y"), "meters", "a person")
    if "frame" in table.columns:
        raise ValueError(
            f"{table.path}: with a column 'frame' this is a trajectory; starting positions are one line a person: keep the "
            "rows of one frame, such as the first, and leave out the column"
        )
    return np.array([[table.number(row, name, f"person {row.number}") for name in ("x", "y")] for row in table.rows])
