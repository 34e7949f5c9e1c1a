"""The parts of an area: parts that nearly touch are joined, parts without an exit are left out.

Each change gives a note (a warning): nothing that is drawn disappears silently.
"""

import warnings
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.geometry.parsing import ROUNDED, Area, place

_EXACT = 0.999  # of a body has to fit
GAP = 0.01  # m; parts nearer to each other than this were meant to touch
_INTO = 1e-6  # m; how far a corner is moved into the other part, so that the two overlap


class NoWayOut(UserWarning):
    """People in a part of the area reach no exit."""


def join_near_parts(area: Area, what: str) -> Area:
    """Return ``area`` with parts joined that lie less than 1 cm apart: their corners there are moved onto the other part."""
    parts = list(shapely.get_parts(area))
    if len(parts) < 2:
        return area
    snapped = shapely.union_all(parts, grid_size=ROUNDED)
    if len(shapely.get_parts(snapped)) < len(parts):  # rounding alone leaves such pieces between two parts
        return join_near_parts(snapped, what)
    tree = shapely.STRtree(parts)
    first, second = tree.query(parts, predicate="dwithin", distance=GAP)
    near = [(int(i), int(j)) for i, j in zip(first, second, strict=True) if i != j]
    moved = list(parts)
    for i, j in near:
        closer = _onto(moved[i], parts[j])
        if closer.is_valid and closer.area > 0:
            moved[i] = closer
    joined = shapely.union_all(moved) if near else area
    assert isinstance(joined, Polygon | MultiPolygon)
    missing = len(parts) - len(shapely.get_parts(joined))
    if missing <= 0:
        return area
    i, j = near[0]
    gap = round(1000 * float(shapely.distance(parts[i], parts[j])), 2)
    at = place(shapely.get_coordinates(shapely.shortest_line(parts[i], parts[j]))[0])
    warnings.warn(f"{what}: parts that lie less than 1 cm apart are joined, such as {gap:g} mm at {at}", stacklevel=4)
    return joined


def _onto(part: Polygon, other: Polygon) -> Polygon:
    """Return ``part`` with its corners that lie near to ``other`` moved just into it."""

    def move(points: Floats) -> Floats:
        away = shapely.distance(other, shapely.points(points))
        points = points.copy()
        for k in np.flatnonzero((away > 0) & (away <= GAP)):
            target = shapely.get_coordinates(shapely.shortest_line(shapely.Point(points[k]), other))[1]
            points[k] = target + _INTO * (target - points[k]) / away[k]
        return points

    return shapely.transform(part, move)


def split_by_exits(area: Area, openings: Floats) -> tuple[Area, list[Polygon]]:
    """Return the parts of ``area`` with an exit among ``openings`` (X, 2, 2), and the parts without."""
    parts = list(shapely.get_parts(area))
    if len(parts) < 2 or not len(openings):
        return area, []
    middles = shapely.points(openings.mean(axis=1))
    reached = np.zeros(len(parts), dtype=bool)
    reached[shapely.STRtree(parts).query_nearest(middles, all_matches=True)[1]] = True
    kept, lost = ([parts[k] for k in np.flatnonzero(of)] for of in (reached, ~reached))
    if not lost:
        return area, []
    return (kept[0] if len(kept) == 1 else MultiPolygon(kept)), lost


def closed_off(area: Area, openings: Floats, radius: float, share: float = 0.9) -> list[Polygon]:
    """Return the parts of ``area`` with no way for a disc of ``radius`` [m] to any of the exits ``openings`` (X, 2, 2).

    Only passages clearly too narrow count, narrower than a ``share`` of the disc; passages in between are left to the grid
    of ways.
    """
    narrow = share * radius
    centers = list(shapely.get_parts(shapely.buffer(area, -narrow)))
    if len(centers) < 2:
        return []
    near = shapely.STRtree(centers).query(
        shapely.linestrings(openings), predicate="dwithin", distance=narrow * (1.0 + 1e-6) + GAP
    )[1]
    lost = [center for k, center in enumerate(centers) if k not in set(near.tolist())]
    if not lost or len(lost) == len(centers):
        return []
    around = shapely.intersection(shapely.buffer(shapely.union_all(lost), narrow), area)
    return [part for part in shapely.get_parts(around) if part.geom_type == "Polygon" and part.area > np.pi * radius**2]


def stuck_bodies(
    area: Area, openings: Floats, radii: Iterable[float], starts: Area | Floats
) -> Iterator[tuple[float, tuple[float, float]]]:
    """Yield the smallest of the ascending ``radii`` [m] that gets stuck, and a place (x, y) [m], of each part of the area.

    Only parts count that hold some of ``starts``, an area or points (K, 2).
    """
    where = shapely.multipoints(starts) if isinstance(starts, np.ndarray) else starts
    told: list[Polygon] = []
    for radius in radii:
        for part in closed_off(area, openings, radius, _EXACT):
            here = shapely.intersection(part, where)
            if not here.is_empty and not any(part.intersects(known) for known in told):
                told.append(part)
                at = here.representative_point()
                yield radius, (at.x, at.y)


def say_left_out(parts: Sequence[Polygon]) -> None:
    """Warn that no exit can be reached from these parts."""
    largest = max(parts, key=lambda part: part.area)
    total = sum(part.area for part in parts)
    where = place(shapely.get_coordinates(largest.representative_point())[0])
    what = "a part" if len(parts) == 1 else f"{len(parts)} parts"
    around = f"{'' if len(parts) == 1 else 'in all, the largest '}around {where}"
    text = f"no exit can be reached from {what} of {total:.3g} m2 {around}: left out"
    warnings.warn(text, NoWayOut, stacklevel=4)


def is_within(shape: Area, parts: Iterable[Polygon]) -> bool:
    """Return whether a shape lies in one of these parts, at least with a piece of it."""
    return any(shapely.intersection(shape, part).area > 0 for part in parts)


def cut_off_by(lines: Floats, area: Area, exits: Floats, points: Floats) -> Bools:
    """Return which of the points (K, 2) have no way to ``exits`` (X, 2, 2) if ``lines`` (L, 2, 2) across passages are shut."""
    shut = shapely.difference(area, shapely.buffer(shapely.MultiLineString([*lines]), 0.02))
    free = [part for part in shapely.get_parts(shut) if shapely.dwithin(part, shapely.MultiLineString([*exits]), 0.05)]
    return np.asarray(~shapely.intersects_xy(shapely.union_all(free), *points.T))
