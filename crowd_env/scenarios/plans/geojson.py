"""Floor plans in GeoJSON (RFC 7946): properties define the role of a feature and its level.

Features of OpenStreetMap and of IMDF (Indoor Mapping Data Format, OGC 20-094) are read by their own words.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import shape as shape_of
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import Plain, counted, shown
from crowd_env.core.files.atomic import legible
from crowd_env.geometry.parsing import flat_parts, in_degrees
from crowd_env.scenarios.plans.degrees import Projection, looks_like_degrees
from crowd_env.scenarios.plans.floor_plan import AS_FLOOR, ON_ONE_LEVEL, Door, Drawing, DrawnStair, Layer, listed
from crowd_env.scenarios.plans.roles import FIRST_EXITS, WORDS, Chosen, Said, by_names, role_of_feature, role_of_word
from crowd_env.scenarios.plans.shared_edges import DOOR, NARROW

_LEVELS = ("level", "level_id", "floor", "storey")
_RANGE = re.compile(r"(-?\d+(?:\.\d+)?)\s*-\s*(-?\d+(?:\.\d+)?)")  # 0-2, as of stairs in OpenStreetMap
_MOST_LEVELS = 200  # of a range
UNSAID = "no word"  # layer of features without a word of what they are
_NAMES = ("name", "id", "label", "title")
_STAIRS = ("stairs", "ramp")
_FLOOR = ("walkable", "room", *_STAIRS, "building")
_GEOMETRIES = ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection")


def is_geojson(content: Any) -> bool:
    """Return whether this is the content of a GeoJSON file."""
    return isinstance(content, dict) and content.get("type") in ("FeatureCollection", "Feature", *_GEOMETRIES)


class _Feature(NamedTuple):
    whole: Plain
    table: Plain  # properties
    shape: BaseGeometry | None
    chosen: Chosen

    @property
    def type(self) -> object:
        """The feature_type of IMDF, None in another format."""
        return self.whole.get("feature_type", self.table.get("feature_type"))

    @property
    def said(self) -> Said:
        """What the properties say; floor is an area, or a closed line."""
        area = self.shape is not None and (
            self.shape.geom_type.endswith(("Polygon", "Collection")) or bool(shapely.is_ring(self.shape))
        )
        said = role_of_feature(self.table, self.type, area)
        role = self.chosen(said.words or UNSAID)
        said = said if role is None else said._replace(role=role or "nothing")
        line = said.role in _STAIRS and self.shape is not None and self.shape.geom_type == "LineString"
        return said._replace(role="") if said.role in _FLOOR and not (area or line) else said


def read_geojson(content: Plain, meters: float | None, chosen: Chosen = by_names) -> Drawing:
    """Read features, level by level; polygons that say nothing are walkable if no other is.

    Parameters
    ----------
    meters : how many meters a unit is, as the user gave it.
    chosen : returns the role that a user has chosen for features with a word, such as "indoor=room".

    Raises
    ------
    ValueError
        If a feature is malformed, or its coordinates are in no unit of length and cannot be projected.
    """
    wholes = _features(content)
    shapes = [_shape(whole.get("geometry"), number) for number, whole in enumerate(wholes)]
    features = [_Feature(*one, chosen) for one in zip(wholes, map(_properties, wholes), shapes, strict=True)]
    features, note = _on_ground(features, content.get("crs"), meters)
    on, height, ignored = _levels_of(features)
    number = {name: height.get(name, _height(name)) for levels in on for name in levels}
    names = sorted(number, key=lambda name: (number[name], name))
    drawn = {
        name: _drawing(one for one, levels in zip(features, on, strict=True) if not levels or name in levels)
        for name in names
    }
    drawing = _drawing(features) if len(drawn) < 2 else Drawing()
    drawing.levels = drawn
    for name, one in drawn.items():
        one.storey = number[name]
    for one in (drawing, *drawn.values()):
        one.on_ground = bool(note)
        one.notes[:0] = [said for said in (note, ignored) if said]
    return drawing


def _on_ground(features: list[_Feature], crs: object, meters: float | None) -> tuple[list[_Feature], str]:
    """Return the features in meters if they are in degrees, and a note of it; all have one origin."""
    system = in_degrees("it", str(crs or ""))
    points = shapely.get_coordinates([one.shape for one in features if one.shape is not None])
    standard = any(one.type is not None or "indoor" in one.table for one in features)
    if not len(points) or not (system or (not crs and meters is None and looks_like_degrees(points, standard))):
        return features, ""
    if meters not in (None, 1.0):
        raise ValueError(f"it is in degrees ({system}), which are projected to meters: no other unit applies")
    project = Projection(points)
    ground = (one.shape and shapely.transform(one.shape, project) for one in features)
    return [one._replace(shape=shape) for one, shape in zip(features, ground, strict=True)], project.note


def level_name(level: object) -> str:
    """Return the name of a level: 1 and 1.0 are "1"."""
    try:
        return f"{float(str(level)):g}"
    except ValueError:
        return str(level).strip()


def _height(level: str) -> float:
    try:
        return float(level)
    except ValueError:
        return np.inf


def _levels_of(features: Sequence[_Feature]) -> tuple[list[list[str]], dict[str, float], str]:
    """Return the names of the levels of each feature, none if it is on all, the height of levels, and a note.

    A floor is a level only if all floors are numbers: it may be a covering.
    """
    named, height = _levels_of_imdf(features)
    floors = {name for one in features for name in _listed(one.table.get("floor") or [])}
    covering = any(_numbered(name) is None for name in floors)
    keys = [key for key in _LEVELS if key != "floor" or not covering]
    on = []
    for one in features:
        found: Any = next((one.table[key] for key in keys if one.table.get(key) not in (None, "")), [])
        levels = [named.get(name, name) for name in _listed(found)]
        on.append(levels + (_listed(one.table["repeat_on"]) if levels and one.table.get("repeat_on") else []))
    some = covering and len(floors) > 1
    note = f"floors that are no numbers are no levels: {listed(sorted(map(legible, floors)))}" if some else ""
    return on, height, note


def _levels_of_imdf(features: Sequence[_Feature]) -> tuple[dict[str, str], dict[str, float]]:
    """Return id -> name of each level, and name -> ordinal; the ordinals are the names if the names are not distinct."""
    levels = [(str(one.whole.get("id")), one.table) for one in features if one.type == "level"]
    ordinal = {key: level_name(table.get("ordinal")) for key, table in levels}
    named = {key: _text(table.get("short_name")) or _text(table.get("name")) or ordinal[key] for key, table in levels}
    named = named if len(set(named.values())) == len(named) else ordinal
    return named, {name: _height(ordinal[key]) for key, name in named.items()}


def _listed(levels: Any) -> list[str]:
    """Return the names of levels: of a list, of 0;1, of 0,1, of 0-2."""
    names: list[str] = []
    for level in levels if isinstance(levels, list) else str(levels).split(";"):
        numbers = [_numbered(part) for part in str(level).split(",")]
        names += [level_name(level)] if None in numbers else [name for part in numbers for name in part or ()]
    return names


def _numbered(text: str) -> list[str] | None:
    """Return the names of the levels of a number or a range, None if it is neither."""
    between = _RANGE.fullmatch(text.strip())
    if between is None:
        return [level_name(text)] if np.isfinite(_height(text)) else None
    low, high = sorted(map(float, between.groups()))
    return [f"{low + k:g}" for k in range(int(high - low) + 1)] if high - low < _MOST_LEVELS else None


def _drawing(features: Iterable[_Feature]) -> Drawing:
    drawing = Drawing()
    unmarked: list[_Feature] = []
    seen: Counter[str] = Counter()
    for one in features:
        if one.shape is None:
            continue
        said, shape = one.said, one.shape
        role = "" if said.role in ("nothing", "building") else said.role
        drawing.layers.setdefault(legible(said.words) or UNSAID, Layer(role)).shapes.append(shape)
        if said.role in _STAIRS:
            drawing.stairs += _stairs(one)
        if said.role in _FLOOR and shape.geom_type == "LineString" and not shapely.is_ring(shape):
            continue  # stairs drawn as their line
        if said.role in _FLOOR and shape.geom_type == "LineString":
            shape = shapely.Polygon(shape)
            one = one._replace(shape=shape)
        own = one.table if one.type else {**one.whole, **one.table}  # the id of IMDF is no name
        name = said.name or _name(own, said.role)
        seen[said.role] += 1
        match said.role:
            case "" | "building":
                unmarked.append(one)
            case "nothing":
                pass
            case "elevator":
                drawing.obstacles += [part for part in flat_parts(shape) if part.geom_type == "Polygon"]
            case "exit" if not shape.geom_type.endswith("Point"):
                drawing.add(said.role, name if name not in drawing.exits else "", shape)
            case "door" | "exit" | "entrance" | "opening":
                given, leads_out = one.table.get("width"), said.role != "door"
                width = _width(given)
                if given is not None and width is None and shape.geom_type.endswith("Point"):
                    what = f"{said.role} {name!r}" if name else f"a {said.role.replace('exit', 'way out')}"
                    allowed = f"a width in m of at least {NARROW}: it is {DOOR:.2f} m wide here"
                    drawing.notes.append(f"width {shown(given)} of {what} is not {allowed}")
                at = 0 if one.table.get("category") in FIRST_EXITS else len(drawing.doors)
                drawing.doors[at:at] = [Door(part, name, width, leads_out) for part in flat_parts(shape)]
            case role:
                drawing.add("room" if role == "stairs" and one.table.get("indoor") == "room" else role, name, shape)
    areas = sum(one.shape.geom_type == "Polygon" for one in drawing.stairs)
    lines = len(drawing.stairs) - areas
    for many, words in (
        (areas, AS_FLOOR),
        (lines, f"{ON_ONE_LEVEL}left out where they are lines"),
        (seen["elevator"], "elevators are no floor"),
    ):
        if many:
            drawing.notes.append(f"{words}: {counted(many, 'feature', 'features')}")
    _add_unmarked(drawing, unmarked, bare=seen["walkable"] + seen["room"] == 0)
    return drawing


def _stairs(one: _Feature) -> list[DrawnStair]:
    """Return the stairs of a feature; a line climbs unless its incline is down."""
    assert one.shape is not None
    said, table = one.said, one.table if one.type else {**one.whole, **one.table}
    down = str(one.table.get("incline", "")).strip().startswith(("down", "-"))
    about = _name(table, said.role), said.role.rstrip("s"), _width(one.table.get("width"))
    return [DrawnStair(shapely.reverse(part) if down else part, *about) for part in flat_parts(one.shape)]


def _properties(feature: Plain) -> Plain:
    table = feature.get("properties")
    return table if isinstance(table, Mapping) else {}


def _features(content: Plain) -> list[Plain]:
    match content["type"]:
        case "FeatureCollection":
            features = content.get("features")
            if not isinstance(features, list) or not all(isinstance(one, Mapping) for one in features):
                raise ValueError("'features' of its FeatureCollection must be a list of features")
            if not features:
                raise ValueError("its FeatureCollection has no features: there is nothing to walk on")
            return features
        case "Feature":
            return [content]
    return [{"geometry": content}]


def _shape(geometry: Any, number: int) -> Any:
    if geometry is None:
        return None
    try:
        if _holds_text(geometry.get("coordinates")):
            raise ValueError("a coordinate is a text; all must be numbers")
        shape = shapely.force_2d(shape_of(geometry))
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, shapely.errors.ShapelyError) as error:
        raise ValueError(f"the geometry of features[{number}] is wrong: {error}") from None
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        raise ValueError(f"the geometry of features[{number}] has a coordinate that is not finite")
    return None if shape.is_empty else shape


def _holds_text(thing: Any) -> bool:
    return isinstance(thing, str) or (isinstance(thing, list) and any(map(_holds_text, thing)))


def _text(value: Any) -> str:
    """Return a text, or one of the texts by language that IMDF has."""
    if isinstance(value, Mapping):
        value = value.get("en", next(iter(value.values()), ""))
    return str(value).strip() if isinstance(value, str | int) else ""


def _width(value: Any) -> float | None:
    """Return a width [m]: 0.9, "0.9 m", "90 cm"; None if it is no width of a door."""
    match = re.fullmatch(r"(\d*\.?\d+)\s*(m|cm)?", str(value).strip())
    width = 0.0 if match is None else float(match[1]) * (0.01 if match[2] == "cm" else 1.0)
    return width if width >= NARROW else None


def _name(table: Plain, role: str) -> str:
    """Return the name of a feature, "" if it only repeats its role."""
    for key in _NAMES:
        for own, word in table.items():
            name = _text(word)
            if own.lower() == key and name and role_of_word(name) != role:
                return name
    return ""


def _add_unmarked(drawing: Drawing, unmarked: list[_Feature], bare: bool) -> None:
    """Add polygons that say nothing, and buildings, to a drawing that is ``bare`` of floor; what is left out is noted."""
    left: Counter[str] = Counter()
    for one in unmarked:
        role, _, words = one.said
        assert one.shape is not None
        if bare and (role or not words) and one.shape.geom_type.endswith(("Polygon", "Collection")):
            drawing.walkable.append(one.shape)
        else:
            left[legible(words)[:60]] += 1
    if left:
        (first, count), *others = left.most_common()
        parts = [
            f"{counted(count, 'feature', 'features')} {_with(first)}",
            *(f"{n} {_with(word)}" for word, n in others),
        ]
        drawing.notes.append(f"left out: {listed(parts, 8)}; a property 'kind' may be one of {', '.join(WORDS)}")


def _with(words: str) -> str:
    return f"with {words}" if words else "without a word of what it is"
