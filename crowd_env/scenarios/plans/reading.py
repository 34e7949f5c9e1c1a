"""One reader a kind of file, and the steps common to all plans: unit, slivers, obstacles."""

import json
import os
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import at, number, refuse
from crowd_env.core.checks import path as path_of
from crowd_env.core.files.foreign import foreign_kind, read_text, require_file
from crowd_env.geometry.boundary import clear_exits
from crowd_env.geometry.parsing import parse_exit, read_area, read_exits
from crowd_env.scenarios.plans.dxf import draw_dxf, read_dxf
from crowd_env.scenarios.plans.floor_plan import Drawing, FloorPlan, Layer, RoleError, listed
from crowd_env.scenarios.plans.geojson import is_geojson, level_name, read_geojson
from crowd_env.scenarios.plans.jupedsim import is_project, read_geometry_xml, read_project
from crowd_env.scenarios.plans.roles import Chosen, ChosenRoles, by_names
from crowd_env.scenarios.plans.rooms import rooms_between
from crowd_env.scenarios.plans.shared_edges import open_doors, walls_between
from crowd_env.scenarios.plans.tidying import apart, regions_in, simplified, tidied, without_obstacles
from crowd_env.scenarios.plans.units import judge_unit, unit_in_meters
from crowd_env.scenarios.plans.vadere import is_vadere, read_vadere
from crowd_env.scenarios.plans.wkt import read_jupedsim_sqlite, read_wkt

Reader = Callable[..., Drawing]
"""Takes a file, how many meters a unit of it is as the user gave it, and, if it is one of `_CHOOSING`, the roles of layers."""


def read_json_plan(path: Path, meters: float | None = None, chosen: Chosen = by_names) -> Drawing:
    """Read a plan of GeoJSON, Vadere or JuPedSim."""
    text = read_text(path, "the floor plan", "a floor plan in this file must be JSON", ("JSON", "GeoJSON"))
    try:
        with at("it is no whole JSON"):
            content = json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if is_geojson(content):
        return read_geojson(content, meters, chosen)
    if chosen is not by_names:
        raise ValueError(_NO_LAYERS)
    if is_vadere(content):
        return read_vadere(content, meters)
    if is_project(content):
        return read_project(content, path)
    raise ValueError(
        "it is JSON, but neither GeoJSON, which is a FeatureCollection, a Feature or a geometry, nor a scenario of Vadere, "
        "which has a 'topography' in 'scenario', nor a project of JuPedSim, which has 'exits' and 'distributions'"
    )


# Suffix -> reader of the file.
READERS: dict[str, Reader] = {
    ".wkt": read_wkt,
    ".geojson": read_json_plan,
    ".dxf": read_dxf,
    ".sqlite": read_jupedsim_sqlite,
    ".scenario": read_json_plan,
    ".json": read_json_plan,
    ".xml": read_geometry_xml,
}
# Kind of content, in a file of another suffix -> its reader.
_BY_CONTENT: dict[str | None, Reader] = {
    None: read_wkt,
    "JSON": read_json_plan,
    "GeoJSON": read_json_plan,
    "a DXF drawing": read_dxf,
    "an SQLite database": read_jupedsim_sqlite,
}
_CHOOSING = (read_dxf, read_json_plan)
_NO_LAYERS = "it has no layers to choose from; DXF drawings and GeoJSON have"
_NARROWEST = 0.3  # m; no exit is narrower
_LARGEST = 60_000_000  # bytes; a plan of a million corners has 40 million of them

PLANS = "WKT (.wkt), GeoJSON, DXF, JuPedSim (.sqlite, .json, .xml) or Vadere (.scenario)"


def is_plan(path: Path) -> bool:
    """Return whether a path is that of a possible floor plan: a file that is no scenario file of crowd_env."""
    path, _ = split_level(path)
    suffix = path.suffix.lower()
    return (
        _is_json_plan(path) if suffix == ".json" else suffix in READERS or (suffix != ".toml" and os.path.exists(path))
    )


def split_level(path: str | Path) -> tuple[Path, str | None]:
    """Return the file and the level that ``house.geojson:1`` names; no level if a file has that name, or none has the other."""
    file, sign, level = str(path).rpartition(":")
    return (
        (Path(file), level)
        if sign and level and os.path.isfile(file) and not os.path.exists(path)
        else (Path(path), None)
    )


def _file_and_level(path: str | Path, level: str | float | None) -> tuple[Path, str | None]:
    """Return the file, and the name of the level that is given or a part of the path."""
    file, named = split_level(path)
    chosen = named if level is None else level
    return file, None if chosen is None else level_name(chosen)


def read_plan(
    path: str | Path,
    exits: Sequence[str] = (),
    *,
    unit: str | None = None,
    level: str | float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
    origin: Sequence[float] = (0.0, 0.0),
    beside: Mapping[str, Any] | None = None,
) -> FloorPlan:
    """Return the floor plan in a file.

    Parameters
    ----------
    path : .wkt, .geojson, .dxf, .sqlite or .xml (JuPedSim), .scenario (Vadere) or .json (Vadere, GeoJSON, JuPedSim).
    exits : each "x1,y1,x2,y2" or a LINESTRING on the edge of the plan, or a POLYGON that people walk into; they replace the
        exits of the file.
    unit : m, cm, mm, ft or in, of the coordinates of plan and exits; None = meters, unless that is implausible and the file
        names another.  Degrees become meters about the middle of the file, in which exits are then.
    level : one level of a file that names levels, such as GeoJSON; or a part of the path, ``house.geojson:1``.
    layers : role -> layers of a DXF drawing, or words of features of GeoJSON such as "indoor=room", as
        `crowd_env.scenarios.plans.roles.ChosenRoles` takes them.
    origin : (2,) point of the file that becomes (0, 0), in its units; of a file in degrees in meters.
    beside : name -> line or area [m] of exits that stand beside the file: they too close the openings of its walls.

    Raises
    ------
    ValueError
        If the file cannot be read or used as a plan; the message names it.
    ModuleNotFoundError
        If the library that reads such files is not installed.
    """
    path, level = _file_and_level(path_of("the file of the floor plan", path), level)
    meters = None if unit is None else unit_in_meters(unit)
    try:
        require_file(path)
        _require_size(path)
        drawing = _at_level(_read(path, meters, layers), path, level)
        if exits:
            if drawing.exits:
                left_out = f"the exits of the file are left out for those that are given: {listed(drawing.exits)}"
                drawing.notes.append(left_out)
            drawing.closing += drawing.exits.values()
            drawing.exits = {f"exit-{number}": parse_exit(text) for number, text in enumerate(exits)}
            drawing.doors = [replace(door, leads_out=False) for door in drawing.doors]
        drawn = _plan(path, drawing, meters, _point(origin), {} if beside is None else beside, bool(exits))
        return replace(drawn, level=level)
    except RoleError as error:
        raise RoleError(f"{path}: {error.lacks}", error.how) from None
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(str(path)) else f"{path}: {message}") from None
    except shapely.errors.ShapelyError as error:
        raise ValueError(f"{path}: its shapes cannot be cut and united: {error}") from None


def levels_in(path: str | Path) -> dict[str, float]:
    """Return name -> number of the storey of each level of a file, not finite without one; none if it names none.

    Raises
    ------
    ValueError
        If the file cannot be read.
    """
    path, _ = split_level(path)
    levels = _read(path, None, None, draw=True).levels if _reader(path) is read_json_plan else {}
    return {name: level.storey for name, level in levels.items()}


def drawn_layers(
    path: str | Path,
    *,
    unit: str | None = None,
    level: str | float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
    meters: float | None = None,
    origin: Sequence[float] = (0.0, 0.0),
) -> dict[str, Layer]:
    """Return what a file draws in each of its layers [m], even where it makes no plan yet.

    Parameters are as for `read_plan`; ``meters`` is how long a plan of this file takes a unit.

    Raises
    ------
    ValueError
        If the file cannot be read.
    ModuleNotFoundError
        If the library that reads such files is not installed.
    """
    path, level = _file_and_level(path, level)
    meters = meters if unit is None else unit_in_meters(unit)
    drawing = _at_level(_read(path, meters, layers, draw=True), path, level)
    shapes = [shape for layer in drawing.layers.values() for shape in layer.shapes]
    if meters is None and shapes and not drawing.on_ground:
        x0, y0, x1, y1 = shapely.total_bounds(shapes).tolist()
        meters, _ = judge_unit((x0, y0, x1, y1), 0.0, drawing.unit, drawing.meters)
    return {
        name: replace(one, shapes=_scaled(one.shapes, meters or 1.0, _point(origin)))
        for name, one in drawing.layers.items()
    }


def _read(path: Path, meters: float | None, layers: Mapping[str, Sequence[str]] | None, draw: bool = False) -> Drawing:
    reader = _reader(path)
    if layers is not None and reader not in _CHOOSING:
        raise ValueError(_NO_LAYERS)
    if not layers:
        return draw_dxf(path, meters) if draw and reader is read_dxf else reader(path, meters)
    chosen = ChosenRoles(layers)
    if draw:
        return (draw_dxf if reader is read_dxf else reader)(path, meters, chosen)
    try:
        return reader(path, meters, chosen)
    finally:
        chosen.require_all()  # this is the cause of what follows


def _at_level(drawing: Drawing, path: Path, level: str | None) -> Drawing:
    """Return the drawing of the chosen level.

    Raises
    ------
    ValueError
        If there is no such level, or there are several and none is named.
    """
    names = listed(drawing.levels, most=12)
    if level is not None:
        if level not in drawing.levels:
            raise ValueError(
                f"it has no level {level!r}; {f'its levels are {names}' if names else 'it names no levels'}"
            )
        return drawing.levels[level]
    if len(drawing.levels) > 1:
        first = next(iter(drawing.levels))
        lacks = f"it has {len(drawing.levels)} levels ({names}), and people walk on one"
        raise RoleError(lacks, f"choose one, such as {path.name}:{first}, or level={first!r} in Python")
    return drawing


def _reader(path: Path) -> Reader:
    """Return the reader of a file: by its suffix, else by its content.

    Raises
    ------
    ValueError
        If the file cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in READERS:
        return READERS[suffix]
    try:
        with path.open("rb") as file:
            kind = foreign_kind(file.read(4096))
    except OSError as error:
        raise ValueError(f"cannot read the floor plan {path}: {error.strerror or error}") from None
    if kind not in _BY_CONTENT:
        forms = f"well-known text, {PLANS}, or from a scenario file (.toml, .json)"
        raise ValueError(f"{path} is {kind}; a floor plan is read from {forms}")
    return _BY_CONTENT[kind]


def _require_size(path: Path) -> None:
    """Raise ValueError if a file is so large that reading it would take minutes."""
    size = os.path.getsize(path) if os.path.isfile(path) else 0
    if size > _LARGEST:
        raise ValueError(
            f"the file has {size / 1e6:.0f} MB; at most {_LARGEST / 1e6:.0f} are read: keep the outline of the floor, its "
            "obstacles and exits, and leave out the rest of the drawing"
        )


def _is_json_plan(path: Path) -> bool:
    """Return whether a JSON file holds a plan; False too if it cannot be read."""
    try:
        _require_size(path)
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return False
    return is_vadere(content) or is_geojson(content) or is_project(content)


def _point(origin: Sequence[float]) -> tuple[float, float]:
    if np.shape(origin) != (2,):
        refuse("origin", origin, "[x, y]")
    return number("origin: x", origin[0]), number("origin: y", origin[1])


def _plan(
    path: Path,
    drawing: Drawing,
    meters: float | None,
    origin: tuple[float, float],
    beside: Mapping[str, Any],
    given: bool,
) -> FloorPlan:
    """Return a drawing as a plan in meters; ``given`` = its exits are not from the file."""
    notes = list(drawing.notes)
    if not (drawing.walkable or drawing.walls):
        raise ValueError("; ".join(["it has no area to walk on", *notes]))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        if meters is None:
            meters, note = _judged(drawing)
            notes += [note] if note else []
        own = _named(drawing.exits, meters, origin)
        if given and meters < 1.0 and all(shape.length < _NARROWEST for shape in own.values()):
            own = drawing.exits
            notes.append(f"exits taken in meters: in units of the file none is {_NARROWEST} m wide")
        floor, drawn_obstacles = (_scaled(shapes, meters, origin) for shapes in (drawing.walkable, drawing.obstacles))
        doors = [replace(door, shape=_scaled([door.shape], meters, origin)[0]) for door in drawing.doors]
        if drawing.walls:
            shapes = {name: one for name, one in beside.items() if not is_name(one, own)}
            closing = [*own.values(), *_scaled(drawing.closing, meters, origin), *read_exits(shapes).values()]
            openings = [door.shape for door in doors]
            floor, drawn_obstacles = rooms_between(drawing.walls, drawn_obstacles, closing, openings, notes)
        floor, obstacles = simplified(floor, notes), simplified(drawn_obstacles, notes)
        drawn = read_area(_collected(floor, notes), "walkable area")
        walls = walls_between(floor, drawing.rooms, doors, obstacles, notes)
        walkable = without_obstacles(drawn, [*obstacles, *walls], notes)
        walkable, leaving = open_doors(walkable, doors, obstacles, notes)
        regions = regions_in(walkable, _named(drawing.regions, meters, origin), drawing.starts, notes)
        found = Drawing(exits=own)
        for name, line in leaving:
            found.add("exit", "" if name in found.exits else name, line)
        exits = clear_exits(apart(found.exits, notes), drawn, walkable)
    notes += [str(warning.message) for warning in said if issubclass(warning.category, UserWarning)]
    names = {name: f"{name} (area)" if name in exits else name for name in regions}  # no region has the name of an exit
    starts = {
        names[name]: start._replace(
            exits=tuple(one for one in start.exits if one in exits),
            via=tuple(names[one] for one in start.via if one in names),
        )
        for name, start in drawing.starts.items()
        if name in regions
    }
    speeds = {names[name]: factor for name, factor in drawing.speeds.items() if name in names}
    regions = {names[name]: shape for name, shape in regions.items()}
    layer_of = {names.get(name, name): one for name, one in drawing.layer_of.items() if not (given and name in exits)}
    stairs = tuple(one._replace(shape=_scaled([one.shape], meters, origin)[0]) for one in drawing.stairs)
    about: dict[str, Any] = {"notes": tuple(notes), "meters": meters, "layer_of": layer_of}
    return FloorPlan(path, walkable, exits, regions, starts, speeds, stairs=stairs, **about)


def is_name(shape: Any, drawn: Collection[str]) -> bool:
    """Return whether what stands for a shape is a name: of one ``drawn`` in the file, or no WKT and no coordinates."""
    return isinstance(shape, str) and (shape in drawn or not set(shape) & set("(,"))


def _judged(drawing: Drawing) -> tuple[float, str]:
    """Return how many meters a unit of the drawing is, and a note about it."""
    points = shapely.get_coordinates(drawing.walkable or drawing.obstacles)
    empty = not drawing.walls and not shapely.area(drawing.walkable).sum() > 0
    if drawing.on_ground or empty or not np.isfinite(points).all():
        return 1.0, ""  # reading the shapes gives the better message
    lines = [shape.length for shape in drawing.exits.values() if "Line" in shape.geom_type]
    bounds = (*points.min(axis=0), *points.max(axis=0))
    return judge_unit(bounds, max(lines, default=0.0), drawing.unit, drawing.meters)


def _scaled(shapes: Iterable[BaseGeometry], meters: float, origin: tuple[float, float]) -> list[BaseGeometry]:
    flat = [shapely.force_2d(shape) for shape in shapes]
    if meters == 1.0 and origin == (0.0, 0.0):
        return flat
    return [shapely.transform(shape, lambda points: meters * (points - origin)) for shape in flat]


def _named(shapes: Mapping[str, BaseGeometry], meters: float, origin: tuple[float, float]) -> dict[str, BaseGeometry]:
    return dict(zip(shapes, _scaled(shapes.values(), meters, origin), strict=True))


def _collected(shapes: list[BaseGeometry], notes: list[str]) -> BaseGeometry:
    """Return the walkable parts as one shape, without slivers if there are other parts."""
    parts = tidied(shapes, "walkable area", notes)
    if _nested([part for part in parts if part.geom_type == "Polygon" and part.is_valid]):
        within = "an outline lies within another one, and is walkable too; draw as an obstacle what is a hole"
        notes.append(f"walkable area: {within}")
    if not any(part.geom_type == "Polygon" for part in parts):
        parts = shapes  # reading them gives the better message
    return parts[0] if len(parts) == 1 else shapely.GeometryCollection(parts)


def _nested(areas: Sequence[BaseGeometry]) -> bool:
    """Return whether an area lies within another one, away from its outline."""
    if len(areas) < 2:
        return False
    outer, inner = shapely.STRtree(areas).query(areas, predicate="contains_properly")
    return bool((outer != inner).any())
