"""Scenarios in files, TOML or JSON with the same keys: lengths in m, times in s, speeds in m/s, masses in kg.

A file is data: its keys are the fields of `Scenario`, and the checks are the same as in Python.  Nothing is ignored.  A place
with options of its own is a function that returns a `Scenario`.  The plan stands in the file, or in a drawing that it names:
then the file is a project, which adds people, doors, zones and all else to the drawing.  A building has such a plan for each
of its levels.
"""

import json
import tomllib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from shapely.geometry import Polygon

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import (
    POSITIVE,
    NotNegative,
    Plain,
    Positive,
    array,
    at,
    check_keys,
    from_table,
    number,
    table,
)
from crowd_env.core.checks import path as path_of
from crowd_env.core.files.atomic import legible
from crowd_env.core.files.foreign import read_text
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios.buildings import Level, Ramp, Stair, building
from crowd_env.scenarios.cohorts import Cohorts, People
from crowd_env.scenarios.floor_plan import area_on, note_cut_starts, people_on, scenario_on, with_own
from crowd_env.scenarios.plans.floor_plan import ON_ONE_LEVEL, FloorPlan
from crowd_env.scenarios.plans.reading import read_plan
from crowd_env.scenarios.population import Population, population_of
from crowd_env.scenarios.profiles import with_profile
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.shapes import circle, rectangle
from crowd_env.scenarios.starts import check_starts, read_entries, read_starts

SUFFIXES = (".toml", ".json")
OF_BUILDING = ("levels", "stairs", "ramps")
KEYS = ("$schema", *(field.name for field in fields(Scenario)), "cohorts", *OF_BUILDING)

# Table of a file -> its older keys and what they are today.
OLDER = {"": {"groups": "cohorts"}, "population": {"companions": "group_size"}, "pulls": {"companions": "groups"}}

_OF_DRAWING = ("level", "layers", "unit", "origin")  # keys of `Plan` that tell how to read its file
_OWN = ("walkable", "exits", "regions")  # keys that add to a drawing

Line: TypeAlias = list[tuple[float, float]]
OffsetOf: TypeAlias = Callable[[str], Floats]
"""Returns how far a level of a building is moved in the layout, from its name."""


@dataclass(frozen=True)
class Box:
    """A rectangle."""

    box: tuple[float, float, float, float]
    """[low x, low y, high x, high y] in m."""


@dataclass(frozen=True)
class Circle:
    """A circle."""

    circle: tuple[float, float, Positive]
    """[x, y, radius] in m; it has 32 corners."""


AreaOrLine: TypeAlias = str | Line | Box | Circle
Areas: TypeAlias = AreaOrLine | list[AreaOrLine]


@dataclass(frozen=True)
class Plan:
    """The plan: walls, exits, regions and doors; or a drawing, and what stands beside it."""

    file: str = ""
    """a floor plan: WKT, GeoJSON, DXF, JuPedSim or Vadere; what else stands in this table is added to it."""
    level: str | float | None = None
    """the level of the floor plan, where it has several."""
    layers: dict[str, list[str]] | None = None
    """role of layers = their names in a DXF drawing, or words of features such as "indoor=room"; the roles are walkable,
    obstacles, exits, doors, starts, regions and left_out."""
    unit: str | None = None
    """of the coordinates of the floor plan: m, cm, mm, ft or in; all other lengths here are in m."""
    origin: tuple[float, float] = (0.0, 0.0)
    """point [x, y] of the floor plan, in its own unit, that becomes [0, 0]."""
    walkable: Areas | None = None
    """where people can be: an area, or a list of areas that are united."""
    exits: dict[str, AreaOrLine] | None = None
    """name = line on the edge of the walkable area, area that people walk into, or an exit of the floor plan; by default all of
    the floor plan."""
    obstacles: tuple[AreaOrLine, ...] = ()
    """areas that are cut out of the walkable area."""
    thin_walls: tuple[str | Line, ...] = ()
    """walls without thickness."""
    regions: dict[str, Areas] | None = None
    """name = area or list of areas, or a region of the floor plan, for starts, rules and zones."""
    doors: dict[str, str | Line] | None = None
    """name = line across a passage, or the name of an exit that can be closed."""
    jamb_radius: NotNegative = 0.0
    """m, radius of all corners that jut into the walkable area; 0 = sharp."""


@dataclass(frozen=True, kw_only=True)
class Storey(Plan):
    """A level of a building: a plan at a height; all levels share their coordinates."""

    name: str
    """name of the level; also that of a region, all its floor."""
    height: float
    """m, of its floor."""


@dataclass(frozen=True)
class House:
    """A building, in place of the geometry."""

    levels: tuple[Storey, ...]
    """levels of a building, in place of the geometry; names of exits, regions and doors are unique in it."""
    stairs: tuple[Stair, ...] = ()
    """stairs of a building."""
    ramps: tuple[Ramp, ...] = ()
    """ramps of a building."""


def read_scenario(path: Path, changes: Plain | None = None) -> Scenario:
    """Return the scenario in a file, checked: every route leads out, and the people fit.

    ``changes`` are values of keys in the file: "cohorts.0.people", or by the name of a cohort.

    Raises
    ------
    ValueError
        If the file cannot be read, or its content is wrong or unknown.
    """
    try:
        return _read_scenario(path, changes or {})
    except RecursionError:
        raise ValueError(f"{path}: nested too deeply") from None


def _read_scenario(path: Path, changes: Plain) -> Scenario:
    content = read_content(path)
    with at(str(path)):
        for key, value in changes.items():
            _change(content, key, value)
    return scenario_of(content, path)


def scenario_of(content: Plain, path: Path) -> Scenario:
    """Return the scenario of the content of a file at ``path``, checked as `read_scenario` does.

    Raises
    ------
    ValueError
        If something in it is wrong or unknown.
    """
    with at(str(path)):
        content = _today("", content)
        check_keys(str(path), content, KEYS)
        given = None if set(OF_BUILDING) & set(content) else _plan(content)
        apart = ("$schema", "geometry", "population", "cohorts", *OF_BUILDING)
        own: dict[str, Any] = {key: value for key, value in content.items() if key not in apart}
        if isinstance(pulls := own.get("pulls"), Mapping):
            own["pulls"] = _today("pulls", pulls)
        own = {"name": legible(path.stem), **own}
        shapes = {} if given is None else _shapes("geometry", given)
        if given is not None and given.file:
            with at("geometry"):
                plan = with_own(drawing_of(content, path), **{key: shapes.pop(key) for key in _OWN})
            crowd = _people(content, path.parent, partial(area_on, plan), partial(people_on, plan))
            scenario = scenario_on(plan, crowd, beside=shapes, **own)
        else:
            if given is None:
                geometry = _building(content, path)
                offset_of = None if geometry.building is None else geometry.building.offset_of
            else:
                offset_of = None
                with at("geometry"):
                    for key in _OF_DRAWING:
                        if key in content["geometry"]:
                            raise ValueError(f"{key} tells how a drawing is read, and there is no file")
                    for key in ("walkable", "exits"):
                        _needed(shapes, key)
                    geometry = Geometry.from_polygon(**shapes)
            own = _on_levels(own, offset_of)
            crowd = _people(content, path.parent, geometry.area_of, offset_of=offset_of)
            scenario = Scenario(**{"time_limit": 1.0, **own}, geometry=geometry, population=crowd)
            scenario = scenario if "time_limit" in own else scenario.with_enough_time()
            note_cut_starts(scenario)
        _require_ways(scenario)
        return scenario


def drawing_of(content: Plain, path: Path) -> FloorPlan:
    """Return the drawing that the content of a file at ``path`` names, without what stands beside it.

    Raises
    ------
    ValueError
        If it cannot be read or used as a plan.
    """
    return _drawing(_plan(content), path)


def _drawing(given: Plan, path: Path) -> FloorPlan:
    drawn = {key: getattr(given, key) for key in _OF_DRAWING}
    return read_plan(path.parent / path_of("file", given.file), beside=_shapes("geometry", given)["exits"], **drawn)


def _building(content: Plain, path: Path) -> Geometry:
    """Return the place of the levels, stairs and ramps in the content of a file."""
    if "geometry" in content:
        raise ValueError("geometry and levels: the plan of a building stands in its levels; give one of them")
    _needed(content, "levels")
    levels, stairs, ramps = (_tables(content, key) for key in OF_BUILDING)
    storeys = [_level(from_table(where, Storey, one), path) for where, one in levels]
    return building(
        storeys,
        [from_table(where, Stair, one) for where, one in stairs],
        [from_table(where, Ramp, one) for where, one in ramps],
    )


def _tables(content: Plain, key: str) -> list[tuple[str, Plain]]:
    """Return the tables of a list, and where each stands."""
    given = content.get(key, [])
    if not isinstance(given, list):
        raise ValueError(f"{key} must be a list of tables: [[{key}]]")
    return [(f"{key}[{k}]", table(f"{key}[{k}]", one, "keys and values")) for k, one in enumerate(given)]


def _level(storey: Storey, path: Path) -> Level:
    where = f"level {storey.name!r}"
    if storey.jamb_radius:
        raise ValueError(f"{where}: jamb_radius is {storey.jamb_radius!r}; in a building all corners are sharp: 0")
    shapes = _shapes(where, storey)
    del shapes["jamb_radius"]
    with at(where):
        if storey.file:
            plan = with_own(_drawing(storey, path), **{key: shapes[key] for key in _OWN})
            for note in plan.notes:
                if not note.startswith(ON_ONE_LEVEL):
                    warnings.warn(f"{where}: {note}", stacklevel=2)
            shapes |= {key: getattr(plan, key) for key in _OWN}
        return Level(storey.name, storey.height, **{**shapes, "walkable": _needed(shapes, "walkable")})


def _on_levels(own: dict[str, Any], offset_of: OffsetOf | None) -> dict[str, Any]:
    """Return fields of a scenario, with sections and attractions moved from their levels to the layout."""
    if offset_of is None:
        return own

    def moved(where: str, one: Any) -> Any:
        given = table(where, one, "keys and values")
        by = offset_of(_needed_level(where, given))
        rest = {key: value for key, value in given.items() if key != "level"}
        with at(where):
            for key, c in (("x", 0), ("y", 1)):
                if key in rest:
                    rest[key] = number(key, rest[key]) + by[c]
            if "line" in rest:
                rest["line"] = (array("line", rest["line"], (None, 2)) + by).tolist()
        return rest

    given = dict(own)
    if isinstance(sections := given.get("sections"), list):
        given["sections"] = [moved(f"sections[{k}]", one) for k, one in enumerate(sections)]
    if isinstance(pulls := given.get("pulls"), Mapping) and isinstance(points := pulls.get("attractions"), list):
        there = [moved(f"pulls.attractions[{k}]", one) for k, one in enumerate(points)]
        given["pulls"] = {**pulls, "attractions": there}
    return given


def _needed_level(where: str, given: Plain) -> str:
    if "level" not in given:
        raise ValueError(f"{where}: key 'level' is missing; in a building it names the level of these coordinates")
    return str(given["level"])


def floor_of(content: Plain, path: Path) -> Geometry:
    """Return the place of the content of a file at ``path`` without exits, doors and people: for one that is not whole yet.

    Raises
    ------
    ValueError
        If the floor is wrong, or what lies on it.
    """
    if set(OF_BUILDING) & set(content):
        return _building(content, path)
    given = _plan(content)
    shapes = _shapes("geometry", given)
    if given.file:
        plan = with_own(drawing_of(content, path), shapes["walkable"], None, shapes["regions"])
        shapes |= {"walkable": plan.walkable, "regions": plan.regions}
    else:
        _needed(shapes, "walkable")
    return Geometry.from_polygon(**{key: value for key, value in shapes.items() if key not in ("exits", "doors")})


def _plan(content: Plain) -> Plan:
    return from_table("geometry", Plan, table("geometry", _needed(content, "geometry"), "keys and values"))


def read_content(path: Path) -> Plain:
    """Return what a scenario file holds; nothing in it is checked.

    Raises
    ------
    ValueError
        If it is no TOML or JSON of keys and values.
    """
    kind = "JSON" if path.suffix.lower() == ".json" else "TOML"
    text = read_text(path, "the scenario", f"a scenario in this file must be {kind}", ("JSON", "GeoJSON"))
    with at(str(path)):
        content = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    return table(f"{path}: the scenario", content, "keys and values")


def _change(content: Any, key: str, value: Any) -> None:
    """Set the value of a dotted key; an entry of a list goes by its name or its number."""
    *tables, last = key.split(".")
    for name in tables:
        content = content[_entry(content, name, key)]
    content[_entry(content, last, key, is_last=True)] = value


def _entry(content: Any, name: str, key: str, is_last: bool = False) -> str | int:
    if isinstance(content, Mapping) and (is_last or name in content):
        return name
    if isinstance(content, list):
        names = [one.get("name") if isinstance(one, Mapping) else None for one in content]
        if name in names:
            return names.index(name)
        if name.isdecimal() and int(name) < len(content):
            return int(name)
    raise ValueError(f"key {key!r} cannot be set: there is no {name!r}")


def _today(name: str, content: Plain) -> Plain:
    """Return a table of a file with the keys of today in place of older ones."""
    older = OLDER[name]
    for key, today in older.items():
        if key in content and today in content:
            raise ValueError(f"{key!r} is the older word for {today!r}; give one of them")
    return {older.get(key, key): value for key, value in content.items()}


def _needed(content: Plain, key: str) -> Any:
    if content.get(key) is None:
        raise ValueError(f"key {key!r} is missing")
    return content[key]


def _shapes(where: str, plan: Plan) -> dict[str, Any]:
    """Return what stands in a file itself, as `Geometry.from_polygon` takes it; ``where`` begins messages."""
    shapes: dict[str, Any] = {}
    for key, value in vars(plan).items():
        named = key in ("exits", "regions", "doors") and isinstance(value, Mapping)
        if key in ("file", *_OF_DRAWING, "name", "height"):
            continue
        if named:
            shapes[key] = {name: _shape(f"{where}.{key}.{name}", one) for name, one in value.items()}
        else:
            shapes[key] = _shape(f"{where}.{key}", value)
    return shapes


def _shape(where: str, value: Any) -> Any:
    """Return an area or line of a file, or a list of them, with polygons in place of tables."""
    if isinstance(value, list) and any(isinstance(one, Mapping | list) for one in value):
        return [_shape(f"{where}[{k}]", one) for k, one in enumerate(value)]
    if not isinstance(value, Mapping):
        return value
    form, size = ("box", 4) if "box" in value else ("circle", 3)
    check_keys(where, value, ("box", "circle"))
    given = value.get(form)
    if not isinstance(given, list) or len(given) != size or len(value) > 1:
        raise ValueError(f"{where}: it must be a box = [low x, low y, high x, high y] or circle = [x, y, radius]")
    numbers = [number(f"{where}.{form}", one) for one in given]
    if form == "circle":
        x, y, radius = numbers
        number(f"{where}: the radius of the circle", radius, POSITIVE, "m")
        return Polygon(circle(x, y, radius))
    x0, y0, x1, y1 = numbers
    if not (x0 < x1 and y0 < y1):
        raise ValueError(f"{where}: box is {given}; it must be [low x, low y, high x, high y]")
    return Polygon(rectangle(x0, y0, x1, y1))


def _people(
    content: Plain,
    folder: Path,
    area_of: Callable[[str | None], float],
    usual: Callable[..., People] | None = None,
    offset_of: OffsetOf | None = None,
) -> People:
    """Return the people of a file.

    Parameters
    ----------
    area_of : returns the area [m2] of a start region; None = of all floor.
    usual : makes the people of a floor plan from fields that name neither cohorts nor a start.
    offset_of : of a building.
    """
    shared = table("population", content.get("population", {}), "keys and values")
    if "cohorts" not in content:
        if usual is None:
            _needed(content, "population")
        if usual is None or {"starts", "start_region", "density"} & set(shared):
            return _population(shared, "population", folder, area_of, offset_of)
        with at("population"):
            from_table("population", Population, {"people": 1, **_today("population", shared)})
            return usual(**with_profile(_today("population", shared)))
    for key in ("people", "starts", "name"):
        if key in shared:
            raise ValueError(f"population: {key!r} is a matter of each cohort; write it there")
    cohorts = content["cohorts"] if isinstance(content["cohorts"], list) else [content["cohorts"]]
    parts = []
    for k, cohort in enumerate(cohorts):
        own = table(f"cohorts[{k}]", cohort, "keys and values")
        elsewhere = {"start_region"} if "starts" in own and "start_region" not in own else ()
        of_all = {name: value for name, value in shared.items() if name not in elsewhere}
        parts.append(_population({**of_all, **with_profile(own)}, f"cohorts[{k}]", folder, area_of, offset_of))
    with at("cohorts"):
        return Cohorts(tuple(parts))


def _population(
    given: Plain, key: str, folder: Path, area_of: Callable[[str | None], float], offset_of: OffsetOf | None
) -> Population:
    starts = given.get("starts")
    if "density" in given:
        if "people" in given:
            raise ValueError(f"{key}: people or density, not both")
        density = number(f"{key}.density", given["density"], POSITIVE, "/m2")
        region = given.get("start_region")
        with at(key):
            many = max(1, round(density * area_of(region)))
        given = {"people": many, **{name: value for name, value in given.items() if name != "density"}}
    if isinstance(starts, str):
        with at(f"{key}.starts"):
            given = {**given, "starts": read_starts(_beside(folder, starts))}
    if isinstance(arrivals := given.get("arrivals"), Mapping) and "file" in arrivals:
        with at(f"{key}.arrivals"):
            check_keys("arrivals", arrivals, ("file",))
            times, starts = read_entries(_beside(folder, arrivals["file"]))
        given = {**given, "arrivals": {"times": times.tolist()}, "starts": starts}
    if offset_of is None:
        with at(key):
            return population_of(key, _today("population", given))
    level = given.get("level")
    with at(key):
        people = population_of(key, _today("population", {name: one for name, one in given.items() if name != "level"}))
        if people.starts is None and (people.arrivals is None or people.arrivals.line is None):
            if level is not None:
                raise ValueError("level is for starts and lines of arrivals; start_region names the level of others")
            return people
        by = offset_of(_needed_level(key, given))
        return people.moved(lambda points: points + by)


def _beside(folder: Path, name: Any) -> Path:
    """Return the path of a file in or below the folder of the scenario."""
    path = (folder / path_of("file", name)).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise ValueError(f"is {name!r}, outside of the folder of the scenario; it must name a file in it")
    return path


def _require_ways(scenario: Scenario) -> None:
    """Raise ValueError if a route leads nowhere, or people do not fit; recorded starts have to suit the largest bodies.

    People wait at doors that open later: these count as open.
    """
    later = {event.door for event in scenario.door_events if event.opens}
    scenario.route_set().when(frozenset(scenario.closed_doors) - later)
    room = scenario.room
    for part in scenario.population.parts:
        if part.starts is not None:
            widest = np.full(len(part.starts), room * part.radius.high)
            check_starts(scenario.geometry, part.starts, widest, at_once=part.arrivals is None)
    scenario.population.draw(np.random.default_rng(0), scenario.geometry, room)
