"""Projects as text: what was understood of a floor plan, as a scenario file to be edited."""

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import Plain
from crowd_env.geometry.parsing import place
from crowd_env.scenarios.cohorts import People
from crowd_env.scenarios.plans.floor_plan import FloorPlan

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def project_text(
    path: Path, plan: FloorPlan, people: People, *, own_exits: bool, drawing: Plain, of_all: Plain, others: Plain
) -> str:
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
    return "\n".join(_lines(path, plan, people, own_exits, drawing, of_all, others)) + "\n"


def _lines(
    path: Path, plan: FloorPlan, people: People, own_exits: bool, drawing: Plain, of_all: Plain, others: Plain
) -> Iterator[str]:
    yield f"# {plan.title} as it was understood; crowd-env plan {path.name} draws it, docs/scenarios.md lists all keys"
    yield from (f"# {note}" for note in plan.notes)
    yield from _entries(others)
    yield "\n[geometry]"
    file = os.path.relpath(plan.path.absolute(), path.absolute().parent)
    yield from _entries({"file": Path(file).as_posix(), "level": plan.level, **drawing})
    if plan.exits:
        yield "\n[geometry.exits]"
        for name, shape in plan.exits.items():
            yield f"{_key(name)} = {_value(_corners(shape) if own_exits else name)} # {_about(shape)}"
    else:
        yield "# no exits yet: name = line on the edge, such as north = [[2, 8], [3, 8]]"
    if plan.regions:
        yield "\n[geometry.regions]"
        for name, shape in plan.regions.items():
            yield f"{_key(name)} = {_value(name)} # {_about(shape)}"
    parts = people.parts
    yield "\n[population]" + (" # what all cohorts share" if len(parts) > 1 else "")
    own = [{"people": one.people, "start_region": one.start_region, "exits": one.exits or None} for one in parts]
    yield from _entries(of_all if len(parts) > 1 else {**own[0], **of_all})
    for table in own if len(parts) > 1 else ():
        yield "\n[[cohorts]]"
        yield from _entries(table)


def _entries(table: Plain) -> Iterator[str]:
    yield from (f"{_key(name)} = {_value(value)}" for name, value in table.items() if value is not None)


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _value(value: Any) -> str:
    """Return a text, number, list or table in TOML, which writes all but tables as JSON does."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_entries(value)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def _corners(shape: BaseGeometry) -> Any:
    """Return a line as its points, an area as WKT."""
    line = shape.geom_type == "LineString"
    return shapely.get_coordinates(shape).tolist() if line else shapely.to_wkt(shape, rounding_precision=6)


def _about(shape: BaseGeometry) -> str:
    """Return how large a shape is and where, for a comment."""
    size = f"area of {shape.area:.3g} m2" if shape.area else f"line of {shape.length:.2f} m"
    return f"{size} around {place(shapely.get_coordinates(shape.centroid)[0].round(2))}"
