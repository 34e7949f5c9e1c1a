"""Projects as text: what was understood of a floor plan, as a scenario file to be edited."""

import json
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import Plain
from crowd_env.geometry.parsing import place
from crowd_env.scenarios.cohorts import People
from crowd_env.scenarios.plans.floor_plan import FloorPlan

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_NAMED = ("exits", "regions", "doors")  # tables of geometry in which each shape has a line


class Project(NamedTuple):
    """A scenario file: what it holds, and what stands beside it."""

    content: Plain
    comments: Plain = MappingProxyType({})  # name of a key, such as geometry.exits.north -> text
    head: tuple[str, ...] = ()  # lines

    @property
    def text(self) -> str:
        """The file."""
        return project_text(self.content, self.comments, self.head)


def project_of(
    path: Path, plan: FloorPlan, people: People, *, own_exits: bool, drawing: Plain, of_all: Plain, others: Plain
) -> Project:
    """Return a scenario file that names the drawing of a floor plan, each line with where it comes from.

    Parameters
    ----------
    path : where the file will lie.
    people : in the start areas of the plan, or anywhere.
    own_exits : whether the exits are given in place of those of the drawing: then their coordinates are written.
    drawing : unit and layers by which the plan was read.
    of_all : fields that all cohorts have.
    others : further keys of the file.
    """
    file = Path(os.path.relpath(plan.path.absolute(), path.absolute().parent)).as_posix()
    exits = {name: corners(shape) if own_exits else name for name, shape in plan.exits.items()}
    shapes = {"exits": exits or None, "regions": {name: name for name in plan.regions} or None}
    geometry = _given({"file": file, "level": plan.level, **drawing, **shapes})
    parts = people.parts
    own = [
        _given(
            {
                "people": one.people,
                "start_region": one.start_region,
                "exits": list(one.exits) or None,
                "route": one.route,
                "arrivals": None
                if one.arrivals is None
                else {"timetable": [list(group) for group in one.arrivals.timetable]},
            }
        )
        for one in parts
    ]
    crowd: Plain = {"population": {**own[0], **of_all}}
    if len(parts) > 1:
        crowd = {**({"population": of_all} if of_all else {}), "cohorts": own}
    comments = {"population": "what all cohorts share"} if len(parts) > 1 else {}
    for group, table in (("exits", plan.exits), ("regions", plan.regions)):
        layers = {name: f" on layer {layer}" for name, layer in plan.layer_of.items()}
        comments |= {f"geometry.{group}.{name}": _about(shape) + layers.get(name, "") for name, shape in table.items()}
    said = f"{plan.title} as it was understood; crowd-env plan {path.name} draws it, docs/scenarios.md lists all keys"
    none = () if plan.exits else ("no exits yet: under [geometry.exits], name = line on the edge, [[2, 8], [3, 8]]",)
    zones = [{"region": name, "factor": factor} for name, factor in plan.speeds.items()]
    ways = {way.name: way for start in plan.starts.values() if (way := start.route)}
    routes = [{"name": name, "exits": list(way.exits), "via": list(way.stops)} for name, way in ways.items()]
    content = {**others, "geometry": geometry, **crowd, "zones": zones, "routes": routes}
    return Project({key: one for key, one in content.items() if one}, comments, (said, *plan.notes, *none))


def _given(table: Plain) -> Plain:
    return {key: value for key, value in table.items() if value is not None}


def project_in(text: str) -> Project:
    """Return the project of a file in TOML, with the comments at its head and behind its keys."""
    comments: dict[str, str] = {}
    head: list[str] = []
    table = ""
    for line in text.splitlines():
        if line.startswith("#"):
            head += [] if table or comments else [line[1:].strip()]
        elif heading := re.match(r"\[\[?([^\]#]+)\]", line):
            table = heading[1].strip() + "."
        elif " # " in line:
            before, _, comment = line.rpartition(" # ")
            with suppress(tomllib.TOMLDecodeError):
                comments |= {f"{table}{key}": comment.strip() for key in tomllib.loads(before)}
    return Project(tomllib.loads(text), comments, tuple(head))


def project_text(content: Plain, comments: Plain | None = None, head: tuple[str, ...] = ()) -> str:
    """Return a scenario file in TOML.

    Parameters
    ----------
    content : its keys and values; None = no key.
    comments : name of a key, such as geometry.exits.north -> text behind it.
    head : lines of comment before all.
    """
    lines = [f"# {line}" for line in head]
    return "\n".join([*lines, *_tables("", content, {} if comments is None else comments)]).lstrip() + "\n"


def _tables(path: str, table: Plain, comments: Plain) -> Iterator[str]:
    """Yield the lines of a table, the tables in it last."""
    given = _given(table)
    inner = {key: value for key, value in given.items() if _stands_apart(path, key, value)}
    for key, value in given.items():
        if key not in inner:
            yield f"{_key(key)} = {_value(value)}{_comment(path + key, comments)}"
    for key, value in inner.items():
        for one in value if isinstance(value, list) else [value]:
            name = f"[{path}{_key(key)}]"
            yield "\n" + (f"[{name}]" if isinstance(value, list) else name) + _comment(path + key, comments)
            yield from _tables(f"{path}{key}.", one, comments)


def _stands_apart(path: str, key: str, value: Any) -> bool:
    """Return whether a value has a heading of its own."""
    if isinstance(value, list):
        return not path and bool(value) and all(isinstance(one, Mapping) for one in value)
    return isinstance(value, Mapping) and bool(value) and (not path or (path == "geometry." and key in _NAMED))


def _comment(name: str, comments: Plain) -> str:
    return f" # {comments[name]}" if name in comments else ""


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _value(value: Any) -> str:
    """Return a text, number, list or table in TOML, which writes all but tables as JSON does."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items() if one is not None) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def corners(shape: BaseGeometry) -> Any:
    """Return a line as its points, an area as WKT."""
    line = shape.geom_type == "LineString"
    return shapely.get_coordinates(shape).tolist() if line else shapely.to_wkt(shape, rounding_precision=6)


def _about(shape: BaseGeometry) -> str:
    """Return how large a shape is and where, for a comment."""
    size = f"area of {shape.area:.3g} m2" if shape.area else f"line of {shape.length:.2f} m"
    return f"{size} around {place(shapely.get_coordinates(shape.centroid)[0].round(2))}"
