"""Round jambs: corners of walls that jut into the walkable area become arcs.

The arc around a corner has its center inside the solid and is tangent to both walls, which end where it begins.  The walkable
area grows by the corner that is cut off.  An exit line in a wall moves outwards to the narrowest place between its two jambs,
so that the width of the door does not change.  A thin wall, which has no inside, ends in a round post as far out as its tip
was.

Contacts are with the arc itself.  For sight, ways, pictures and the test of the walkable area it is a row of chords, which lie
in the solid, less than 1/800 of the radius behind it.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import LinearRing, LineString, MultiLineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.geometry.boundary import ends_together, rings_of
from crowd_env.geometry.parsing import SLIVER, Area, place, tangents

_CHORDS = 32  # of half a turn
_KEPT = 1e-5  # m; the length left of a wall between two arcs that meet, to keep its direction
_ROUNDING = 1e-9  # m, m2


class Arcs(NamedTuple):
    """The round jambs (A,) of a geometry, which all have one radius.

    ``ends`` (A, 2) holds which ends of walls, as rows of ``walls.reshape(-1, 2)``, lie on each: where the wall before it stops
    and the wall behind it starts; of a post the end of its thin wall, in its center, and -1.
    """

    radius: float  # m
    center: Floats  # (A, 2)  m
    ends: Ints  # (A, 2)
    chords: int  # number of walls, the last ones, that draw them


NO_ARCS = Arcs(0.0, np.empty((0, 2)), np.empty((0, 2), dtype=np.int64), 0)


def deepen_exits(
    area: Area, walls: Floats, exits: Floats, names: tuple[str, ...], radius: float
) -> tuple[Area, dict[str, BaseGeometry]]:
    """Return ``area`` with every exit that has a jutting jamb moved outwards to where its arcs will end, and the exits.

    Raises
    ------
    ValueError
        If such an exit is bent or touches another, or the place behind it is walkable.
    """
    lines: dict[str, list[Floats]] = {}
    strips = []
    for row, name in zip(exits, names, strict=True):
        along = (row[1] - row[0]) / np.hypot(*(row[1] - row[0]))
        out = np.array([along[1], -along[0]])
        turns = [0.0]
        for wall in walls[_same(walls[:, 1], row[0])]:
            turns.append(_turn(wall[1] - wall[0], out))
        for wall in walls[_same(walls[:, 0], row[1])]:
            turns.append(_turn(-out, wall[1] - wall[0]))
        depth = radius * np.tan(0.5 * max(turns))
        if depth > SLIVER:
            at = place(row.mean(axis=0))
            if _same(exits[:, 1], row[0]).any() or _same(exits[:, 0], row[1]).any():
                raise ValueError(
                    f"jamb_radius is {radius:g} m, but exit {name!r} is bent or touches another exit at {at}; "
                    "round jambs need exits that are straight lines, each by itself"
                )
            strip = Polygon([row[0], row[1], row[1] + depth * out, row[0] + depth * out])
            if shapely.area(shapely.intersection(strip, area)) > SLIVER:
                raise ValueError(
                    f"jamb_radius is {radius:g} m, but behind exit {name!r} at {at} less than {depth:.3g} m are solid; "
                    "round jambs need a wall as thick as their radius"
                )
            strips.append(
                Polygon([row[0] - SLIVER * out, row[1] - SLIVER * out, *np.array(strip.exterior.coords)[2:4]])
            )
            row = row + depth * out
        lines.setdefault(name, []).append(row)
    deeper = shapely.union_all([area, *strips]) if strips else area
    assert isinstance(deeper, Polygon | MultiPolygon)
    return deeper, {
        name: LineString(rows[0]) if len(rows) == 1 else MultiLineString(rows) for name, rows in lines.items()
    }


class Rounded(NamedTuple):
    """A place with round jambs."""

    area: Area
    walls: Floats  # (W, 2, 2)  m
    thin: Floats  # (T, 2, 2)  m   thin walls
    chords: Floats  # (C, 2, 2)  m   that draw the arcs
    arcs: Arcs


class _Corners(NamedTuple):
    """The corners (A,) that jut into the area."""

    point: Floats  # (A, 2)  m
    joints: Ints  # (A, 2)  ends of the walls before and behind, see `Arcs.ends`
    turn: Floats  # (A,)    rad
    cut: Floats  # (A,)    m   that an arc takes of either wall
    before: Floats  # (A, 2)  unit vectors of the two walls
    behind: Floats  # (A, 2)


def round_jambs(area: Area, walls: Floats, thin: Floats, exits: Floats, radius: float) -> Rounded:
    """Return area, walls and thin walls with round jambs.

    Corners where more than two walls meet, and the kinks of thin walls, stay sharp.

    Raises
    ------
    ValueError
        If the radius is too large for a corner; the sentence names the tightest, and the largest radius there.
    """
    corners = _jutting_corners(walls, thin, radius)
    corner, joints, cut = corners.point, corners.joints, corners.cut
    along, length = tangents(walls)
    taken = np.zeros((len(walls), 2))
    taken[joints // 2, joints % 2] = cut[:, None]
    _require_walls(corner, joints, taken.sum(axis=1), length, radius)
    _require_solid(area, corners, radius)
    taken *= np.minimum(1.0, (length - _KEPT) / np.maximum(taken.sum(axis=1), 1e-300))[:, None]
    center = corner - cut[:, None] * corners.before + radius * _right_of(corners.before)
    short = walls.copy()
    short[:, 0] += taken[:, :1] * along
    short[:, 1] -= taken[:, 1:] * along
    first, last = short.reshape(-1, 2)[joints[:, 0]], short.reshape(-1, 2)[joints[:, 1]]
    arcs = [_arc(c, a, b, t) for c, a, b, t in zip(center, first, last, corners.turn, strict=True)]
    rounded = _with_arcs(area, corner, arcs)
    thin, posts, post_ends = _posts(area, thin, walls, exits, radius)
    circles = [_arc(c, c - (radius, 0), c - (radius, 0), 2 * np.pi) for c in posts]
    if circles:
        rounded = shapely.difference(rounded, shapely.union_all([Polygon(circle) for circle in circles]))
    assert isinstance(rounded, Polygon | MultiPolygon)
    on_post = np.column_stack([2 * len(walls) + post_ends, np.full(len(posts), -1)])
    drawn = [np.stack([points[:-1], points[1:]], axis=1) for points in (*arcs, *circles)]
    chords = np.concatenate([np.empty((0, 2, 2)), *drawn])
    made = Arcs(radius, np.concatenate([center, posts]), np.concatenate([joints, on_post]), len(chords))
    return Rounded(rounded, short, thin, chords, made)


def _jutting_corners(walls: Floats, thin: Floats, radius: float) -> _Corners:
    """Return the corners of two walls that jut into the area."""
    ends = np.concatenate([walls, thin]).reshape(-1, 2)
    start, members = ends_together(ends)
    pairs = [np.sort(members[a:b]) for a, b in pairwise(start)]
    # Of two walls, both one-sided, one stops there (an odd row of ``ends``) and one starts (an even row).
    joints = np.array(
        [
            pair if pair[0] % 2 else pair[::-1]
            for pair in pairs
            if len(pair) == 2 and pair[1] < 2 * len(walls) and sum(pair) % 2
        ],
        dtype=np.int64,
    ).reshape(-1, 2)
    along, _ = tangents(walls)
    turn = np.array([_turn(along[a // 2], along[b // 2]) for a, b in joints])
    cut = radius * np.tan(0.5 * turn)
    jutting = cut > SLIVER
    joints = joints[jutting]
    before, behind = along[joints[:, 0] // 2], along[joints[:, 1] // 2]
    return _Corners(ends[joints[:, 0]], joints, turn[jutting], cut[jutting], before, behind)


def _require_solid(area: Area, corners: _Corners, radius: float) -> None:
    """Refuse arcs that open the solid to a walkable place behind it."""

    def open_behind(r: float) -> np.ndarray:
        away = (r / radius * corners.cut)[:, None]
        first, last = corners.point - away * corners.before, corners.point + away * corners.behind
        kites = np.stack([first, corners.point, last, first + r * _right_of(corners.before)], axis=1)
        return shapely.area(shapely.intersection(shapely.polygons(kites), area)) > _ROUNDING

    if open_behind(radius).any():
        most = _largest(lambda r: not open_behind(r).any(), radius)
        k = int(np.argmax(open_behind(1.001 * most)))
        raise ValueError(_too_large(radius, corners.point[k], most))


def _right_of(vectors: Floats) -> Floats:
    return np.column_stack([vectors[:, 1], -vectors[:, 0]])


def _same(points: Floats, point: Floats) -> np.ndarray:
    return np.hypot(*(points - point).T) < _ROUNDING


def _turn(before: Floats, behind: Floats) -> float:
    """Return by how much [rad] a border turns right, away from the walkable area; 0 if it turns left: the corner is hollow."""
    cross, dot = before[0] * behind[1] - before[1] * behind[0], before @ behind
    return max(0.0, float(np.arctan2(-cross, dot)))


def _require_walls(corner: Floats, joints: Ints, taken: Floats, length: Floats, radius: float) -> None:
    """Refuse arcs that take more of a wall than its length."""
    share = length / np.maximum(taken, 1e-300)
    fits = share[joints // 2].min(axis=1)
    if (taken > length + _ROUNDING).any():
        k = int(np.argmin(fits))
        raise ValueError(_too_large(radius, corner[k], radius * float(fits[k])))


def _largest(fits: Callable[[float], bool], radius: float) -> float:
    """Return the largest radius below ``radius`` that ``fits``."""
    low, high = 0.0, radius
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _too_large(radius: float, corner: Floats, most: float) -> str:
    most = np.floor(1e4 * most + 1e-6) / 1e4
    return (
        f"jamb_radius is {radius:g} m, too large for the walls at the corner {place(corner)}; it must be <= {most:g} m"
    )


def _arc(center: Floats, first: Floats, last: Floats, turn: float) -> Floats:
    """Return points (K+1, 2) from ``first`` to ``last`` around ``center``, to the right."""
    count = int(np.ceil(turn / np.pi * _CHORDS))
    angle = -turn * np.arange(1, count) / count
    x, y = first - center
    middle = center + np.column_stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)])
    return np.concatenate([first[None], middle, last[None]])


def _with_arcs(area: Area, corner: Floats, arcs: list[Floats]) -> Area:
    """Return ``area`` with points of its border replaced by arcs."""
    arc_at = {tuple(point): points for point, points in zip(corner.tolist(), arcs, strict=True)}
    polygons = []
    for rings in rings_of(area):
        shell, *holes = (
            LinearRing(np.concatenate([arc_at.get(tuple(point), np.array([point])) for point in ring.tolist()]))
            for ring in rings
        )
        polygons.append(Polygon(shell, holes))
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


def _posts(area: Area, thin: Floats, walls: Floats, exits: Floats, radius: float) -> tuple[Floats, Floats, Ints]:
    """Return the thin walls up to the posts at their free ends, the centers (B, 2) of the posts, and which end each is."""
    thin = thin.copy()
    lines, border = shapely.linestrings(thin), shapely.linestrings(np.concatenate([walls, exits]))
    centers, ends = [], []
    for k, wall in enumerate(thin.copy()):
        others = shapely.multilinestrings([*np.delete(lines, k), *border])
        length = float(np.hypot(*(wall[1] - wall[0])))
        free = [bool(shapely.distance(shapely.Point(tip), others) > SLIVER) for tip in wall]
        for end in np.flatnonzero(free):
            tip, back = wall[end], (wall[1 - end] - wall[end]) / length

            def fits(r: float, tip: Floats = tip, back: Floats = back, longest: float = length / sum(free)) -> bool:
                away = shapely.distance(shapely.Point(tip + r * back), shapely.boundary(area))
                return bool(r + _KEPT <= longest and away >= r - _ROUNDING)

            if not fits(radius):
                raise ValueError(_too_large(radius, tip, _largest(fits, radius)))
            thin[k, end] = tip + radius * back
            centers.append(thin[k, end])
            ends.append(2 * k + end)
    return thin, np.array(centers).reshape(-1, 2), np.array(ends, dtype=np.int64)
