"""Repair of drawings: slivers, corners drawn twice, obstacles and regions that lie elsewhere."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import counted
from crowd_env.geometry.parsing import Area, fault, flat_parts, place, read_area
from crowd_env.scenarios.plans.floor_plan import listed

THICK = 0.02  # m; of a wall that is drawn as a line
_THIN = 0.01  # m; narrower parts are not walkable
_NOTHING = 1e-6  # m^2; an obstacle smaller than this is none
_SAME = 1e-9  # share of the area
_MANY = 5_000  # corners; more of them are finer than people can see ...
_AWAY = 0.005  # m; ... and corners nearer than this to the line of their neighbors are left out
_MOST = 20_000  # corners; the ways out take seconds to find for every ten thousand, and more in large plans


def tidied(
    shapes: Sequence[BaseGeometry], what: str, notes: list[str], thinnest: float = _THIN, *, crossing: bool = False
) -> list[BaseGeometry]:
    """Return the parts of ``shapes`` [m] without slivers; outlines that only touch themselves are made valid.

    So are outlines that cross themselves, if they may be ``crossing``: each loop is an area of its own.  Other faults are left
    to the reader of the shapes.
    """
    parts = [one for shape in shapes for one in flat_parts(shape)]
    kept, slivers, mended = [], [], []
    for part in parts:
        if part.geom_type != "Polygon" or part.is_empty or not np.isfinite(shapely.get_coordinates(part)).all():
            kept.append(part)
        elif _is_sliver(part, thinnest):
            slivers.append(part)
        elif part.is_valid:
            kept.append(part)
        else:
            valid = _mended(part, crossing)
            kept += valid or [part]
            mended += [part] if valid else []
    themselves = ("outline that runs along itself", "outlines that run along themselves")
    if crossing:
        themselves = ("outline that meets itself", "outlines that meet themselves")
    if slivers:
        at = place(shapely.get_coordinates(slivers[0])[0])
        notes.append(f"{what}: left out {counted(len(slivers), 'sliver', 'slivers')}, such as at {at}")
    if mended:
        notes.append(f"{what}: mended {counted(len(mended), *themselves)}, such as at {fault(mended[0])[1]}")
    return kept


def simplified(shapes: Sequence[BaseGeometry], notes: list[str]) -> list[BaseGeometry]:
    """Return the shapes [m] with fewer corners if they have very many.

    Raises
    ------
    ValueError
        If they still have too many.
    """
    before = int(shapely.get_num_coordinates(shapes).sum())
    if before <= _MANY:
        return list(shapes)
    fewer = [_simplified(shape) for shape in shapes]
    after = int(shapely.get_num_coordinates(fewer).sum())
    if after > _MOST:
        raise ValueError(
            f"the plan has {before} corners, and {after} where those are left out that move no wall by {1000 * _AWAY:g} mm; "
            f"at most {_MOST} are read: simplify it, in QGIS by Vector > Geometry Tools > Simplify, in Python by "
            "shapely.simplify(plan, 0.05)"
        )
    if after < before:
        notes.append(f"the plan has {before} corners: simplified to {after}, by which no wall moves by more than 5 mm")
    return fewer


def _simplified(shape: BaseGeometry) -> BaseGeometry:
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        return shape  # reading it gives the better message
    quick = shapely.simplify(shape, _AWAY, preserve_topology=False)
    return quick if shapely.is_valid(quick) and not quick.is_empty else shapely.simplify(shape, _AWAY)


def without_obstacles(walkable: Area, obstacles: Sequence[BaseGeometry], notes: list[str]) -> Area:
    """Return ``walkable`` [m] without the obstacles; obstacles elsewhere are noted.

    Raises
    ------
    ValueError
        If no walkable area is left.
    """
    parts = _walls(tidied(obstacles, "obstacles", notes, thinnest=0.0, crossing=True), notes)
    holes = [read_area(part, f"obstacle {k}") for k, part in enumerate(parts) if _is_area(part)]
    if not holes:
        return walkable
    outside = [hole for hole, meets in zip(holes, shapely.intersects(walkable, holes), strict=True) if not meets]
    if outside:
        at = place(shapely.get_coordinates(outside[0])[0])
        lost = counted(len(outside), "obstacle", "obstacles")
        notes.append(f"left out: {lost} outside of the walkable area, such as at {at}")
    rest = shapely.get_parts(shapely.difference(walkable, shapely.union_all(holes)))
    polygons = [part for part in rest if part.geom_type == "Polygon" and not _is_sliver(part, _THIN)]
    if not polygons:
        raise ValueError("the obstacles leave no walkable area")
    if len(polygons) < len(rest):
        lost = counted(len(rest) - len(polygons), "sliver", "slivers")
        notes.append(f"left out: {lost} between obstacles and walls")
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


def _walls(parts: Sequence[BaseGeometry], notes: list[str]) -> list[BaseGeometry]:
    """Return the parts of obstacles [m] with walls in place of lines, and without points."""
    lines = [part for part in parts if part.length > 0.0 and part.geom_type in ("LineString", "LinearRing")]
    areas = [part for part in parts if part.geom_type == "Polygon"]
    if lines:
        notes.append(f"obstacles: {counted(len(lines), 'line', 'lines')} taken as walls {THICK:g} m thick")
    points = len(parts) - len(lines) - len(areas)
    if points:
        notes.append(f"left out: {points} {'obstacle that is a point' if points == 1 else 'obstacles that are points'}")
    return [*areas, *(shapely.buffer(line, 0.5 * THICK, cap_style="square", join_style="mitre") for line in lines)]


def apart(exits: Mapping[str, BaseGeometry], notes: list[str]) -> dict[str, BaseGeometry]:
    """Return the exits [m] without overlaps of their areas: the common part of two belongs to the first."""
    found: dict[str, BaseGeometry] = {}
    for name, shape in exits.items():
        others = [other for other in found if _is_valid_area(found[other])] if _is_valid_area(shape) else []
        for other in others:
            common = shapely.intersection(shape, found[other])
            if common.area > _NOTHING:
                shape = shapely.difference(shape, found[other])
                at = place(shapely.get_coordinates(common.representative_point())[0])
                notes.append(
                    f"exits {other!r} and {name!r} overlap at {at}: what they have in common is left to {other!r}"
                )
        if not others or shape.area > _NOTHING:
            found[name] = shape
    return found


def _is_valid_area(shape: BaseGeometry) -> bool:
    return shape.geom_type in ("Polygon", "MultiPolygon") and shape.is_valid


def regions_in(
    walkable: Area, regions: Mapping[str, BaseGeometry], starts: Collection[str], notes: list[str]
) -> dict[str, Area]:
    """Return the regions that lie in ``walkable`` [m], at least with a piece; the others are noted.

    The names ``starts`` are of start areas.

    Raises
    ------
    ValueError
        If a region crosses itself or is not finite.
    """
    found: dict[str, Area] = {}
    lost = []
    for name, shape in regions.items():
        parts = [part for part in tidied([shape], f"region {name!r}", notes) if _is_area(part)]
        area = read_area(shapely.GeometryCollection(parts), f"region {name!r}") if parts else None
        if area is None or shapely.intersection(area, walkable).area <= _NOTHING:
            lost.append(name)
        else:
            found[name] = area
    for names, words in (
        ([name for name in lost if name not in starts], ("region", "regions")),
        ([name for name in lost if name in starts], ("start area", "start areas")),
    ):
        if names:
            note = f"left out: {counted(len(names), *words)} with nothing of the walkable area, {listed(names)}"
            nowhere = words[0] == "start area" and not any(name in found for name in starts)
            notes.append(note + ": pedestrians start anywhere on the plan" * nowhere)
    return found


def _is_sliver(part: Polygon, thinnest: float) -> bool:
    """Return whether a polygon is narrower than ``thinnest`` [m] all along, or encloses nothing."""
    around = part.exterior.length
    area = abs(part.area) if part.is_valid else shapely.make_valid(part).area
    return bool(area <= _NOTHING or 2.0 * area < thinnest * around)


def _is_area(part: BaseGeometry) -> bool:
    return part.geom_type == "Polygon" and not part.is_empty and not (part.is_valid and part.area <= _NOTHING)


def _mended(part: Polygon, crossing: bool) -> list[Polygon]:
    """Return a polygon with an outline that touches or retraces itself as valid ones; none if it may not cross itself."""
    for method in ("linework", "structure"):  # the second cuts holes that run along the rim
        shape = shapely.make_valid(part, method=method, keep_collapsed=method == "linework")
        valid = [one for one in flat_parts(shape) if one.geom_type == "Polygon"]
        total = sum(one.area for one in valid)
        if crossing or abs(total - part.area) <= _SAME * total:
            return valid
    return []
