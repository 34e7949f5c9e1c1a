"""Reads a user's shapes into valid shapely shapes, or refuses them in one sentence.

Areas are polygons with holes, several of them, well-known text (WKT) or corner coordinates; exits are lines or polygons.
"""

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import plain_name, shown
from crowd_env.core.files.foreign import foreign_kind

Area: TypeAlias = Polygon | MultiPolygon
Shape: TypeAlias = BaseGeometry | str | ArrayLike
"""A shapely geometry, its WKT, or (K, 2) coordinates [m]."""

SLIVER = 1e-6  # m; shorter pieces of wall are dropped
# m; shapes nearer than this are equal but for rounding.  Without it GEOS loses pieces of shapes that share edges.
ROUNDED = 1e-9
_MIN_AREA = 1e-9  # m^2
_DEEPEST = 50  # collections in collections; of tens of thousands GEOS overruns the stack, which ends the process
_MIN_EXIT = 0.02  # m; below this an exit is a slip of the pen (and not distinguishable from the snap tolerance)
_LINES = ("LineString", "LinearRing", "MultiLineString")
_POLYGONS = ("Polygon", "MultiPolygon")
_NOT_FINITE = " has a coordinate that is not finite; all must be numbers in meters"
_SRID = re.compile(r"(?:SRID\s*=\s*(\d+)\s*;\s*)?(.*)", re.IGNORECASE | re.DOTALL)
_DEGREES = ("4326", "4258", "CRS84")
_NO_METERS = re.compile(r"\b(4326|4258|CRS84|3857|3785|900913)\b")
_CURVED = re.compile(r"\b(CURVEPOLYGON|COMPOUNDCURVE|CIRCULARSTRING|MULTISURFACE|MULTICURVE)\b", re.IGNORECASE)
_EXIT_FORMS = "'x1,y1,x2,y2' in meters, 'LINESTRING (x1 y1, x2 y2)' or 'POLYGON ((...))'"


def place(point: ArrayLike) -> str:
    """Return ``point`` (2,) as text for messages: six digits, and in large numbers, as of maps, down to the centimeter."""
    x, y = (f"{round(c, 2):.12g}" if abs(c) >= 1e4 else f"{c:.6g}" for c in np.asarray(point, dtype=float))
    return f"({x}, {y})"


def border_edges(area: Area) -> Floats:
    """Return the straight edges (N, 2, 2) [m] of all rings of ``area``, ring by ring."""
    points, ring = shapely.get_coordinates(shapely.get_rings(shapely.get_parts(area)), return_index=True)
    same = ring[:-1] == ring[1:]
    return np.stack([points[:-1][same], points[1:][same]], axis=1)


def tangents(segments: Floats) -> tuple[Floats, Floats]:
    """Return the unit vectors (N, 2) from end to end of ``segments`` (N, 2, 2) [m], and their lengths (N,) [m]."""
    along = segments[:, 1] - segments[:, 0]
    length = np.hypot(*along.T)
    return along / length[:, None], length


def require_inside(what: str, line: Floats, area: Area, allowed: str) -> None:
    """Raise ValueError, naming the place, if a line (K, 2) [m] leaves ``area`` by more than a hair."""
    outside = shapely.difference(shapely.LineString(line), shapely.buffer(area, SLIVER))
    if not outside.is_empty:
        at = place(shapely.get_coordinates(outside)[-1])
        raise ValueError(f"{what} leaves the walkable area at {at}; it must {allowed}")


def in_degrees(what: str, system: str) -> str:
    """Return the number of a reference system in degrees that its name holds, "" without one.

    Raises
    ------
    ValueError
        If it is that of Web Mercator, which is not in meters on the ground.
    """
    number = _NO_METERS.search(system)
    if number is not None and number[0] not in _DEGREES:
        raise ValueError(
            f"{what} is in Web Mercator ({number[0]}), in which lengths are stretched, by 1.5 in Central Europe; project it "
            "to meters on the ground first, such as UTM"
        )
    return "" if number is None else number[0]


def require_meters(what: str, system: str) -> None:
    """Raise ValueError if the name of a reference system holds the number of one that is not in meters on the ground."""
    number = in_degrees(what, system)
    if number:
        raise ValueError(f"{what} is in degrees ({number}); project it to meters first")


def from_wkt(text: str, what: str) -> BaseGeometry:
    """Return the shape written in ``text``; ``what`` names it in errors.

    Raises
    ------
    ValueError
        If the text is not well-known text, or nested too deeply.
    """
    srid, body = _SRID.match(text.lstrip("\ufeff \t\r\n")).groups()  # type: ignore[union-attr]  # matches anything
    require_meters(what, f"SRID {srid}")
    curved = _CURVED.search(body)
    if curved:
        raise ValueError(
            f"{what} is a {curved[0].upper()}; curves are not read, write them as many short straight lines"
        )
    kind = foreign_kind(body[:4096].encode())
    form = "well-known text (WKT), e.g. 'POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0))'"
    if kind is not None:
        raise ValueError(f"{what} is {kind}, not {form}")
    if max(accumulate(1 if sign == "(" else -1 for sign in re.findall("[()]", body)), default=0) > _DEEPEST:
        raise ValueError(f"{what} is nested too deeply: more than {_DEEPEST} parentheses are open at once")
    try:
        with np.errstate(invalid="ignore"):  # the reader of the shape names numbers that are not finite
            return shapely.from_wkt(body)
    except (shapely.errors.ShapelyError, NotImplementedError) as error:
        raise ValueError(
            f"{what} is not {form}: {' '.join(str(error).split()) or 'of a kind that is not read'}"
        ) from None


def fault(polygon: Polygon) -> tuple[str, str]:
    """Return what is wrong with a polygon that is not valid, and where."""
    problem, _, at = shapely.is_valid_reason(polygon).partition("[")
    return problem.lower(), place([float(c) for c in at.rstrip("]").split()[:2]])


def read_area(thing: Shape | Sequence[Shape], what: str) -> Area:
    """Return ``thing`` as one valid polygon or several; touching and overlapping parts are united.

    Raises
    ------
    ValueError
        If it is no area, encloses nothing, crosses itself or holds a coordinate that is not finite.
    """
    shape = _shape(thing, what, Polygon)
    parts = _polygon_parts(shape, what)
    for part in parts:
        _require_finite(part, what)
        if not part.is_valid and shapely.convex_hull(part).area > _MIN_AREA:
            problem, spot = fault(part)
            raise ValueError(f"{what} is not a valid polygon: {problem} at {spot}; its rings may not cross")
    parts = [part for part in parts if part.is_valid and part.area > _MIN_AREA]
    if not parts:
        raise ValueError(f"{what} encloses no area; it needs a polygon of at least three corners not in one line")
    united = shapely.union_all(parts)
    assert isinstance(united, Polygon | MultiPolygon)  # a union of areas
    return united


def read_areas(things: Iterable[Shape] | BaseGeometry, what: str) -> list[Area]:
    """Return every one of ``things`` (or the one shape) as an area."""
    return [read_area(thing, f"{what} {number}") for number, thing in enumerate(as_list(things, f"{what}s"))]


def read_lines(things: Iterable[Shape] | BaseGeometry, what: str) -> list[Floats]:
    """Return the (K, 2) coordinates of every line of ``things`` (or of the one shape)."""
    lines = []
    for number, thing in enumerate(as_list(things, f"{what}s")):
        name = f"{what} {number}"
        shape = _shape(thing, name, LineString)
        if shape.geom_type not in _LINES:
            raise ValueError(f"{name} is a {shape.geom_type}; it must be a LineString or (K, 2) coordinates")
        _require_finite(shape, name)
        lines += [shapely.get_coordinates(part) for part in shapely.get_parts(shape)]
    return lines


def as_list(things: Any, what: str) -> list[Any]:
    """Return ``things`` as a list; a single shape, text or (K, 2) array of coordinates counts as one thing."""
    if isinstance(things, BaseGeometry | str) or _is_coordinates(things):
        return [things]
    if not isinstance(things, Iterable):
        raise ValueError(f"{what} must be a list of shapes, not a {type(things).__name__}")
    return list(things)


def read_exits(exits: Mapping[str, Shape] | Iterable[Shape] | Shape) -> dict[str, BaseGeometry]:
    """Return name -> line or polygon; exits without names are called ``exit-0``, ``exit-1`` ...

    Raises
    ------
    ValueError
        If an exit is neither a line nor a polygon, is shorter than 2 cm or holds a coordinate that is not finite, or its name
        is empty, holds control characters, or is that of another one.
    """
    if isinstance(exits, Mapping):
        named = exits
    else:
        named = {f"exit-{number}": thing for number, thing in enumerate(as_list(exits, "exits"))}
    shapes: dict[str, BaseGeometry] = {}
    for given, thing in named.items():
        name = plain_name("the name of an exit", given)
        if name in shapes:
            raise ValueError(f"two exits have the name {name!r}")
        what = f"exit {name!r}"
        shape = parse_exit(thing) if isinstance(thing, str) else _shape(thing, what, LineString)
        _require_finite(shape, what)
        if shape.geom_type in _POLYGONS:
            shape = read_area(shape, what)
        elif shape.geom_type not in _LINES:
            raise ValueError(f"{what} is a {shape.geom_type}; it must be a line on the boundary or a polygon")
        elif shape.length < _MIN_EXIT:
            at = place(shapely.get_coordinates(shape)[0])
            raise ValueError(f"{what} at {at} has length {shape.length:.3g} m; it must be at least {_MIN_EXIT} m long")
        elif not isinstance(thing, str | BaseGeometry) and len(thing) > 3 and _is_rectangle(shape):
            warnings.warn(f"{what} is a line through corners of a rectangle; an area is a box or POLYGON", stacklevel=4)
        shapes[name] = shape
    return shapes


def _is_rectangle(line: BaseGeometry) -> bool:
    corners = Polygon(shapely.get_coordinates(line))
    return corners.area > 0.999 * shapely.oriented_envelope(corners).area > _MIN_AREA


def parse_exit(text: str) -> BaseGeometry:
    """Return the exit written in ``text``: ``x1,y1,x2,y2`` [m], ``LINESTRING (...)`` or ``POLYGON (...)``.

    Raises
    ------
    ValueError
        If the text has none of these forms, or a number is not finite.
    """
    if text.strip()[:1].isalpha() and "(" in text:
        shape = from_wkt(text, f"exit {text!r}")
        if shape.geom_type not in _LINES + _POLYGONS:
            raise ValueError(f"exit {text!r} is a {shape.geom_type}; it must be {_EXIT_FORMS}")
        return shapely.force_2d(shape)
    try:
        x1, y1, x2, y2 = (float(number) for number in text.split(","))
    except ValueError:
        raise ValueError(f"exit {text!r} is not understood; it must be {_EXIT_FORMS}") from None
    if not np.isfinite([x1, y1, x2, y2]).all():
        raise ValueError(f"exit {text!r}{_NOT_FINITE}")
    return LineString([(x1, y1), (x2, y2)])


def _require_finite(shape: BaseGeometry, what: str) -> None:
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        raise ValueError(f"{what}{_NOT_FINITE}")


def _is_coordinates(thing: Any) -> bool:
    try:
        return np.asarray(thing).dtype.kind in "fiuO" and np.asarray(thing, dtype=float).ndim == 2
    except (TypeError, ValueError):
        return False


def _shape(thing: Any, what: str, kind: type[Polygon] | type[LineString]) -> BaseGeometry:
    """Return ``thing`` as a flat shapely geometry; coordinates become a ``kind``."""
    if isinstance(thing, BaseGeometry):
        return shapely.force_2d(thing)
    if isinstance(thing, str):
        return shapely.force_2d(from_wkt(thing, what))
    if _is_coordinates(thing):
        coordinates = np.asarray(thing, dtype=float)
        least = 3 if kind is Polygon else 2
        if coordinates.shape[1] != 2 or len(coordinates) < least:
            raise ValueError(
                f"{what} has coordinates of shape {coordinates.shape}; they must be (K, 2) with K >= {least}"
            )
        if not np.isfinite(coordinates).all():
            raise ValueError(f"{what}{_NOT_FINITE}")
        return kind(coordinates)
    if kind is Polygon and isinstance(thing, Sequence | np.ndarray):
        return shapely.GeometryCollection([_shape(part, f"part {i} of {what}", kind) for i, part in enumerate(thing)])
    raise ValueError(f"{what} is {shown(thing)}; it must be a list of points [x, y], WKT or a shapely geometry")


def _polygon_parts(shape: BaseGeometry, what: str) -> list[Polygon]:
    """Return the polygons of a shape; points and lines that stand beside polygons in a collection are left out."""
    allowed = "a POLYGON, a MULTIPOLYGON or a GEOMETRYCOLLECTION of them"
    parts = flat_parts(shape)
    polygons = [part for part in parts if part.geom_type == "Polygon"]
    if parts and not polygons:
        if shape.geom_type == "GeometryCollection":
            what, shape = f"a part of {what}", parts[0]
        raise ValueError(f"{what} is a {shape.geom_type}; it must be {allowed}")
    if len(polygons) < len(parts):
        kinds = sorted({part.geom_type for part in parts if part.geom_type != "Polygon"})
        left_out = len(parts) - len(polygons)
        warnings.warn(f"{what}: {left_out} parts that enclose nothing are left out ({', '.join(kinds)})", stacklevel=4)
    return polygons


def flat_parts(shape: BaseGeometry) -> list[BaseGeometry]:
    """Return the parts of a shape, and their parts."""
    if shape.geom_type != "GeometryCollection" and not shape.geom_type.startswith("Multi"):
        return [shape]
    return [one for part in shapely.get_parts(shape) for one in flat_parts(part)]
