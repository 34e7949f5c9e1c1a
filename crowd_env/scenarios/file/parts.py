"""The parts of a scenario file: shapes, geometry, distributions, groups, routes, rules."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import Shape
from crowd_env.navigation.field import OneWay
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.scenarios.distributions import read_distribution
from crowd_env.scenarios.file.entry import Entry
from crowd_env.scenarios.floor_plan import read_starts
from crowd_env.scenarios.population import Population
from crowd_env.state import Floats

_CORNERS = 32  # of a circle
_MOST_COPIES = 100_000  # of a thing in columns and rows
_DISTRIBUTIONS = ("radius", "mass", "desired_speed", "relaxation_time", "response_time")
GROUP_KEYS = ("count", *_DISTRIBUTIONS, "start_region", "starts", "route", "exits", "name")
GEOMETRY_KEYS = ("walkable", "obstacles", "thin_walls", "exits", "regions", "doors")
_GRID = ("columns", "rows", "step")

Thing = TypeVar("Thing", Route, SpeedZone, ControlRule, DoorEvent, OneWay, Comfort)

# ---------------------------------------------------------------------------------------------------------- geometry


def read_geometry(entry: Entry) -> Geometry:
    """Return the geometry of the table ``geometry``."""
    table = entry.table(GEOMETRY_KEYS, needed=("walkable", "exits"))
    options: dict[str, Any] = {"exits": {name: _line_or_area(one) for name, one in table["exits"].table().items()}}
    if "obstacles" in table:
        options["obstacles"] = [area for one in table["obstacles"].entries() for area in _areas(one)]
    if "thin_walls" in table:
        options["thin_walls"] = [line for one in table["thin_walls"].entries() for line in _lines(one)]
    if "regions" in table:
        options["regions"] = {name: _united(one) for name, one in table["regions"].table().items()}
    if "doors" in table:
        options["doors"] = {name: _line(one) for name, one in table["doors"].table().items()}
    area = _united(table["walkable"])
    with entry.named():
        return Geometry.from_polygon(area, **options)


def _line(entry: Entry) -> Shape:
    """Read a line: WKT (or the name of an exit), or its points."""
    if isinstance(entry.value, str):
        return entry.value
    return np.array([point.point() for point in entry.entries()], dtype=np.float64)


def _lines(entry: Entry) -> list[Shape]:
    """Read a line, possibly many times, in columns and rows."""
    if not isinstance(entry.value, dict):
        return [_line(entry)]
    table = entry.table(("line", *_GRID), needed=("line",))
    points = np.array([point.point() for point in table["line"].entries()], dtype=np.float64)
    return [points + shift for shift in _grid(entry, table)]


def _united(entry: Entry) -> list[Shape]:
    """Read an area or a list of them."""
    several = isinstance(entry.value, list) and not all(_is_point(one) for one in entry.value)
    return [area for one in entry.entries() for area in _areas(one)] if several else _areas(entry)


def _is_point(value: Any) -> bool:
    return isinstance(value, list) and not any(isinstance(one, list | dict | str) for one in value)


def _line_or_area(entry: Entry) -> Shape:
    return _areas(entry)[0] if isinstance(entry.value, dict) else _line(entry)


def _areas(entry: Entry) -> list[Shape]:
    """Read areas: WKT, corners, a box or a circle; the last two possibly many times, in columns and rows."""
    if isinstance(entry.value, str):
        return [entry.value]
    if isinstance(entry.value, list):
        return [np.array([corner.point() for corner in entry.entries()], dtype=np.float64)]
    table = entry.table(("box", "circle", *_GRID))
    if ("box" in table) == ("circle" in table):
        raise entry.error("needs either a 'box' [x0, y0, x1, y1] or a 'circle' [x, y, radius]")
    if "box" in table:
        x0, y0, x1, y1 = (number.number() for number in table["box"].entries(4))
        if not (x0 < x1 and y0 < y1):
            raise table["box"].error(f"is [{x0:g}, {y0:g}, {x1:g}, {y1:g}]; it must be [low x, low y, high x, high y]")
        shape = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    else:
        x, y, radius = (number.number() for number in table["circle"].entries(3))
        if not radius > 0:
            raise table["circle"].error(f"has the radius {radius:g} m; it must be > 0")
        angle = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
        shape = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
    return [shape + shift for shift in _grid(entry, table)]


def _grid(entry: Entry, table: Mapping[str, Entry]) -> Floats:
    """Return the shifts (K, 2) [m] of things that stand in columns and rows."""
    columns, rows = (table[name].whole() if name in table else 1 for name in ("columns", "rows"))
    if columns < 1 or rows < 1:
        raise entry.error(f"has {columns} columns and {rows} rows; there must be at least 1 of each")
    if columns * rows > _MOST_COPIES:
        raise entry.error(f"has {columns} columns and {rows} rows; there can be at most {_MOST_COPIES} things in all")
    if "step" not in table and (columns, rows) != (1, 1):
        raise entry.error("has columns or rows; it also needs the 'step' [x, y] between them")
    if "step" not in table:
        return np.zeros((1, 2))
    x, y = table["step"].point()
    return np.array([(x * column, y * row) for row in range(rows) for column in range(columns)])


# ------------------------------------------------------------------------------------------------------------ people


def read_group(entry: Entry, shared: Mapping[str, Any], folder: Path) -> Population:
    """Return a population; what it does not say itself is as in ``shared``."""
    own = entry.table(GROUP_KEYS)
    merged = Entry({**shared, **entry.value}, entry.source, entry.path).table(GROUP_KEYS)
    if "starts" in own and "start_region" not in own:
        merged.pop("start_region", None)
    options: dict[str, Any] = {name: read_distribution(merged[name]) for name in _DISTRIBUTIONS if name in merged}
    for name in ("start_region", "route", "name"):
        if name in merged:
            options[name] = merged[name].text()
    if "exits" in merged:
        options["exits"] = merged["exits"].texts()
    if "starts" in merged:
        options["starts"] = _starts(merged["starts"], folder)
    if "count" in merged:
        options["count"] = merged["count"].whole()
    elif "starts" in options:
        options["count"] = len(options["starts"])
    else:
        raise entry.error("needs a 'count', or 'starts'")
    with entry.named():
        return Population(**options)


def _starts(entry: Entry, folder: Path) -> Floats:
    """Read positions (K, 2) [m]: a CSV file, or a list of points and of grids of them."""
    if isinstance(entry.value, str):
        with entry.named():
            path = (folder / entry.value).resolve()
            if not path.is_relative_to(folder.resolve()):
                raise ValueError(
                    f"is {entry.value!r}, outside of the folder of the scenario; it must name a file in it"
                )
            return read_starts(path)
    found = [np.empty((0, 2))]
    for one in entry.entries():
        if isinstance(one.value, list):
            found.append(np.array([one.point()]))
        else:
            table = one.table(("first", *_GRID), needed=("first",))
            found.append(table["first"].point() + _grid(one, table))
    return np.concatenate(found)


# ------------------------------------------------------------------------------------------------------------- ways


def read_record(entry: Entry, kind: type[Thing]) -> Thing:
    """Return a route, speed zone, control rule or the like: the keys are the fields of its dataclass."""
    types = get_type_hints(kind)
    needed = [one.name for one in fields(kind) if one.default is MISSING and one.default_factory is MISSING]
    options = {name: _as(types[name], one) for name, one in entry.table(types, needed).items()}
    with entry.named():
        return kind(**options)


def _as(kind: Any, entry: Entry) -> Any:
    """Read an entry as the type of a field says."""
    kinds = [one for one in get_args(kind) if one is not type(None)]
    if get_origin(kind) is Literal:
        return entry.one_of(kinds)
    if get_origin(kind) is UnionType:
        return _as(kinds[0], entry)
    return _READ[kind](entry)


_READ: dict[Any, Callable[[Entry], Any]] = {
    str: Entry.text,
    int: Entry.whole,
    float: Entry.number,
    bool: Entry.flag,
    tuple[str, ...]: Entry.texts,
    tuple[float, float]: Entry.point,
}
