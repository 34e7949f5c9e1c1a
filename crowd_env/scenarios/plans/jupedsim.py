"""Projects of JuPedSim: config.json and geometry.wkt of its web editor, and geometry.xml of jpscore, its version 0.

Formats: jupedsim-scenarios 0.11, and the page Geometry of jpscore's documentation.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import Plain, counted, number
from crowd_env.core.files.foreign import read_text
from crowd_env.geometry.parsing import from_wkt
from crowd_env.scenarios.plans.floor_plan import Drawing, Start

_GEOMETRY = "geometry.wkt"  # beside config.json
_LEFT_OUT = {"zones": "speed of zones", "checkpoints": "waiting at checkpoints"}
_OUTSIDE = "-1"  # room behind a transition that leads out


def is_project(content: Any) -> bool:
    """Return whether this is the content of a project of the web editor."""
    return isinstance(content, dict) and isinstance(content.get("distributions"), dict) and "exits" in content


def read_project(content: Plain, path: Path) -> Drawing:
    """Read a project of the web editor: exits are areas that people walk into, distributions start areas.

    Raises
    ------
    ValueError
        If its geometry is missing, or a shape is malformed.
    """
    text = content.get("walkable_area_wkt")
    if text is None:
        beside = (path.with_name(_GEOMETRY), path.with_suffix(".wkt"))
        file = next((one for one in beside if one.is_file()), None)
        if file is None:
            names = " nor ".join(one.name for one in beside)
            raise ValueError(
                f"it is a project of JuPedSim, and its geometry is missing: neither {names} lies beside it"
            )
        text = read_text(file, "the floor plan", "it must be well-known text (WKT)")
    drawing = Drawing(walkable=[from_wkt(text, "walkable area")], unit="m", meters=1.0)
    try:
        for role, key in (
            ("exit", "exits"),
            ("region", "checkpoints"),
            ("region", "zones"),
            ("start", "distributions"),
        ):
            for name, one in content.get(key, {}).items():
                own = Start(one.get("parameters", {}).get("number")) if role == "start" else None
                drawing.add(role, name, Polygon(_points(name, one["coordinates"])), own)
        for journey in (*content.get("journeys", ()), *content.get("journeys_v2", ())):
            first, *_, last = journey["stages"]
            if first in drawing.starts and last in drawing.exits:
                start = drawing.starts[first]
                drawing.starts[first] = start._replace(exits=(*start.exits, last))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"it has another form than a project of JuPedSim's: {error}") from None
    left = [words for key, words in _LEFT_OUT.items() if content.get(key)]
    drawing.notes.append(f"left out: {', '.join(['speeds, radii and response times of distributions', *left])}")
    return drawing


def _points(name: str, corners: Iterable[Any]) -> list[tuple[float, float]]:
    return [(number(f"{name}: x", x), number(f"{name}: y", y)) for x, y in corners]


def read_geometry_xml(path: Path, meters: float | None = None) -> Drawing:
    """Read rooms of subrooms between walls, crossings and transitions; transitions that lead outside are exits.

    Raises
    ------
    ValueError
        If it is no such file, or a subroom is not enclosed.
    """
    text = read_text(path, "the floor plan", "it must be a geometry.xml of JuPedSim", ("an XML file",))
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("it declares entities, which no geometry.xml of JuPedSim does")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"it is no whole XML: {error}") from None
    if root.tag != "geometry" or root.find("rooms") is None:
        raise ValueError(f"its XML begins with {root.tag!r}; a geometry of JuPedSim is 'geometry' with 'rooms'")
    drawing = Drawing(unit=root.get("unit", "m"), meters=1.0)
    transitions = root.findall("transitions/transition")
    stairs, open_rooms = 0, []
    for room in root.findall("rooms/room"):
        for subroom in room.findall("subroom"):
            own = (room.get("id", ""), subroom.get("id", ""))
            walls = [_line(one) for one in subroom.findall("polygon")]
            gaps = [_line(one) for one in room.findall("crossings/crossing") if own[1] in _subrooms(one)]
            gaps += [_line(one) for one in transitions if own in zip(_rooms(one), _subrooms(one), strict=True)]
            floor = shapely.get_parts(shapely.polygonize([shapely.union_all([*walls, *gaps])]))
            drawing.walkable += list(floor)
            open_rooms += [] if len(floor) else [f"subroom {own[1]} of room {own[0]}"]
            drawing.obstacles += walls
            for obstacle in subroom.findall("obstacle"):
                lines = [_line(one) for one in obstacle.findall("polygon")]
                drawing.obstacles += list(shapely.get_parts(shapely.polygonize([shapely.union_all(lines)])))
            stairs += subroom.get("class", "floor") in ("stair", "escalator_up", "escalator_down")
    if open_rooms:
        raise ValueError(f"its walls and doors do not enclose {', '.join(open_rooms[:4])}")
    for one in transitions:
        if _OUTSIDE in _rooms(one):
            name = one.get("caption") or ""
            drawing.add("exit", name if name not in drawing.exits else "", _line(one))
    if stairs:
        drawing.notes.append(f"stairs are floor like any other: {counted(stairs, 'subroom', 'subrooms')}")
    return drawing


def _rooms(door: ElementTree.Element) -> tuple[str, str]:
    return door.get("room1_id", ""), door.get("room2_id", "")


def _subrooms(door: ElementTree.Element) -> tuple[str, str]:
    return door.get("subroom1_id", ""), door.get("subroom2_id", "")


def _line(element: ElementTree.Element) -> BaseGeometry:
    try:
        return LineString([(float(one.get("px", "")), float(one.get("py", ""))) for one in element.findall("vertex")])
    except (ValueError, shapely.errors.ShapelyError) as error:
        name = element.get("caption") or element.get("id") or element.tag
        raise ValueError(f"the vertices of {name} make no line: {error}") from None
