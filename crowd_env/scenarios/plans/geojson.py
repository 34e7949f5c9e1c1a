"""Floor plans in GeoJSON (RFC 7946): properties or the name of a feature define its role and its level."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape as shape_of

from crowd_env.core.checks import Plain, counted
from crowd_env.geometry.parsing import require_meters
from crowd_env.scenarios.plans.floor_plan import Drawing
from crowd_env.scenarios.plans.roles import WORDS, role_of_layer, role_of_word

_KEYS = ("role", "kind", "type", "layer", "class", "category", "usage", "function", "name")
_LEVELS = ("level", "level_id", "floor", "storey")
_RANGE = re.compile(r"(-?\d+)\s*-\s*(-?\d+)")  # 0-2, as of stairs in OpenStreetMap
_NAMES = ("name", "id", "label", "title")
_GEOMETRIES = ("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection")


def is_geojson(content: Any) -> bool:
    """Return whether this is the content of a GeoJSON file."""
    return isinstance(content, dict) and content.get("type") in ("FeatureCollection", "Feature", *_GEOMETRIES)


def read_geojson(content: Plain) -> Drawing:
    """Read features, level by level; polygons without a role are walkable if no other is."""
    require_meters("it", str(content.get("crs", "")))
    features = list(enumerate(_features(content)))
    on = [_levels(_properties(feature)) for _, feature in features]
    names = sorted({name for levels in on for name in levels}, key=_height)
    drawn = {
        name: _drawing(one for one, levels in zip(features, on, strict=True) if not levels or name in levels)
        for name in names
    }
    drawing = _drawing(features) if len(drawn) < 2 else Drawing()
    drawing.levels = drawn
    return drawing


def level_name(level: object) -> str:
    """Return the name of a level: 1 and 1.0 are "1"."""
    try:
        return f"{float(str(level)):g}"
    except ValueError:
        return str(level).strip()


def _height(level: str) -> tuple[float, str]:
    try:
        return float(level), level
    except ValueError:
        return np.inf, level


def _levels(table: Plain) -> list[str]:
    """Return the names of the levels of a feature; none if it has no level, and is on all."""
    found: Any = next((table[key] for key in _LEVELS if table.get(key) not in (None, "")), [])
    names: list[str] = []
    for level in found if isinstance(found, list) else str(found).split(";"):
        between = _RANGE.fullmatch(str(level).strip())
        ends = [] if between is None else sorted(map(int, between.groups()))
        names += map(str, range(ends[0], ends[1] + 1)) if ends and ends[1] - ends[0] < 200 else [level_name(level)]
    return names


def _drawing(features: Iterable[tuple[int, Plain]]) -> Drawing:
    drawing = Drawing()
    unmarked: list[Any] = []
    for number, feature in features:
        table = _properties(feature)
        shape = _shape(feature.get("geometry"), number)
        if shape is None:
            continue
        role, name = _role(table)
        name = name or _name({**feature, **table})
        if role is None:
            unmarked.append(shape)
        else:
            drawing.add(role, name if role != "exit" or name not in drawing.exits else "", shape)
    _add_unmarked(drawing, unmarked)
    return drawing


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


def _role(table: Plain) -> tuple[str | None, str]:
    """Return the role from the properties, and the name that a layer gives: jps-exits-north."""
    for key in _KEYS:
        for own, word in table.items():
            if own.lower() == key and isinstance(word, str):
                role = role_of_word(word)
                if role is not None:
                    return role, ""
                layer = role_of_layer(word)
                if layer is not None:
                    return layer
    return None, ""


def _name(table: Plain) -> str:
    for key in _NAMES:
        for own, word in table.items():
            name = str(word).strip() if isinstance(word, str | int) else ""
            if own.lower() == key and name and role_of_word(name) is None:
                return name
    return ""


def _add_unmarked(drawing: Drawing, unmarked: list[Any]) -> None:
    polygons = [shape for shape in unmarked if shape.geom_type.endswith(("Polygon", "Collection"))]
    left = len(unmarked) if drawing.walkable else len(unmarked) - len(polygons)
    if not drawing.walkable:
        drawing.walkable += polygons
    if left:
        drawing.notes.append(
            f"left out: {counted(left, 'feature', 'features')} without a word of what it is; a property 'kind' may be one of "
            f"{', '.join(WORDS)}"
        )
