"""Walls along the edges that rooms share, and the doors in these and other walls."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient
from shapely.ops import substring

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import counted
from crowd_env.geometry.parsing import Area, border_edges, place, tangents
from crowd_env.scenarios.plans.floor_plan import Door
from crowd_env.scenarios.plans.tidying import THICK

_SAME = 0.01  # m; edges nearer to each other are one
_SHORT = 0.1  # m; shorter pieces are no common edge
_BESIDE = 0.3  # m; a door may be drawn this far from its wall, in the room ...
_WALL = 0.5  # m; ... and a wall is this thick at the most
DOOR = 0.9  # m; width of a door that is a point
NARROW = 0.3  # m; nothing narrower is a door
_BEHIND = 0.1  # m; behind the wall, where an obstacle is no way out
_ALONG = 0.7  # cosine; a door that lies flatter to a wall is in it


def walls_between(
    areas: Sequence[BaseGeometry],
    rooms: Collection[int],
    doors: Sequence[Door],
    obstacles: Sequence[BaseGeometry],
    notes: list[str],
) -> list[BaseGeometry]:
    """Return walls along the edges that rooms share with other areas, if a door is drawn on one; else a note.

    Parameters
    ----------
    areas : walkable [m].
    rooms : rows of ``areas``; other areas are open to each other.
    doors : in meters.
    obstacles : an edge that one is drawn along has its walls.
    """
    sound = [k for k, area in enumerate(areas) if area.geom_type.endswith("Polygon") and area.is_valid]
    if len(sound) < 2 or not rooms:
        return []
    shapes = [areas[k] for k in sound]
    edges = [shapely.boundary(shape) for shape in shapes]
    drawn = _grown(shapely.union_all([one for one in obstacles if one.is_valid]), _SAME)
    lines: list[BaseGeometry] = []
    common: dict[frozenset[int], float] = {}
    for i, j in shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=_SAME).T.tolist():
        if i == j or sound[i] not in rooms:
            continue
        within = _along(edges[i], _grown(shapes[j], _SAME))
        if _along(shapely.union_all(within), drawn):
            continue
        lines += within
        shared = _along(edges[i], _grown(edges[j], _SAME))
        if shared:
            common[frozenset((i, j))] = sum(line.length for line in shared)
    walls = shapely.union_all(lines)
    length = round(sum(common.values()), 1)
    share = f"{counted(len(frozenset().union(*common)), 'room', 'rooms')} share edges of {length:g} m in all"
    if not any(shapely.dwithin(walls, _measured(one)[0], 2 * _SAME if one.leads_out else _BESIDE) for one in doors):
        notes += [f"{share}: taken as open floor; draw doors on them to get walls"] * bool(common)
        return []
    notes += [f"{share}: taken as walls {THICK:g} m thick"] * bool(common)
    outer = shapely.boundary(_grown(_grown(shapely.union_all(shapes), _SAME), -_SAME))
    on_edge = shapely.union_all(_along(walls, _grown(outer, _SAME)))  # of areas that overlap
    return [_grown(shapely.difference(walls, _grown(on_edge, 0.1 * _SAME)), 0.5 * THICK, "square")]


def _grown(shape: BaseGeometry, by: float, cap: str = "flat") -> BaseGeometry:
    return shapely.buffer(shape, by, cap_style=cap, join_style="mitre")


def _along(edge: BaseGeometry, near: BaseGeometry) -> list[LineString]:
    """Return the stretches of ``edge`` that run within ``near``, grown by a hair, without their ends beyond it."""
    found = shapely.line_merge(shapely.intersection(edge, near))
    lines = [part for part in shapely.get_parts(found) if part.length > _SHORT]
    return [line if line.is_closed else substring(line, _SAME, line.length - _SAME) for line in lines]


class _Wall(NamedTuple):
    """A straight edge of the walkable area where a door is."""

    at: Floats  # (2,) m   middle of the door, on the edge
    along: Floats  # (2,)
    outward: Floats  # (2,)
    width: float  # m   of the door
    thickness: float  # m   up to the walkable area behind the wall; inf = none


def open_doors(
    walkable: Area, doors: Sequence[Door], obstacles: Sequence[BaseGeometry], notes: list[str]
) -> tuple[Area, list[tuple[str, LineString]]]:
    """Return ``walkable`` with its doors open, and the names and lines of the exits among them; other doors are noted.

    A door opens the wall that it is drawn in or beside, up to 0.5 m thick, as wide as it is drawn.
    """
    if not doors:
        return walkable, []
    edges = _Edges(walkable)
    passages: list[BaseGeometry] = []
    exits: list[tuple[str, LineString]] = []
    blind, lost = [], []
    for door in doors:
        wall = edges.wall_of(door)
        if wall is None:
            lost += [] if edges.stands_open(door) else [door]
            continue
        along, out = 0.5 * wall.width * wall.along, wall.outward
        if np.isfinite(wall.thickness):
            near, far = wall.at - 2 * _SAME * out, wall.at + (wall.thickness + 2 * _SAME) * out
            passages.append(Polygon([near - along, near + along, far + along, far - along]))
        elif not any(shapely.intersects_xy(one, *(wall.at + (_WALL + _BEHIND) * out)) for one in obstacles):
            ends = wall.at - along, wall.at + along
            exits += [(door.name, LineString(ends))] * door.leads_out
            blind += [ends] * (not door.leads_out)
    notes += [f"{counted(len(passages), 'door is', 'doors are')} open"] * bool(passages)
    if lost:
        at = place(shapely.get_coordinates(shapely.centroid(lost[0].shape))[0])
        notes.append(f"left out: {counted(len(lost), 'door', 'doors')} away from all walls, such as at {at}")
    if blind:
        at = " to ".join(map(place, blind[0]))
        notes.append(
            f"{counted(len(blind), 'door', 'doors')} on the outer edge, no exit unless it is named one, such as from {at}"
        )
    opened = shapely.union_all([walkable, *passages]) if passages else walkable
    return opened, exits


class _Edges:
    """The straight edges of a walkable area, to find the wall of a door."""

    def __init__(self, walkable: Area) -> None:
        self.walkable = walkable
        parts = shapely.get_parts(shapely.simplify(walkable, 0.9 * _SAME))
        self.ends = border_edges(shapely.MultiPolygon([orient(part) for part in parts]))
        self.along, self.length = tangents(self.ends)
        self.tree = shapely.STRtree(shapely.linestrings(self.ends))
        shapely.prepare(walkable)

    def stands_open(self, door: Door) -> bool:
        """Return whether a door is on floor between walls that are as far apart as it is wide."""
        middle, _, width = _measured(door)
        return bool(self.walkable.covers(middle) and self._near(middle, 0.5 * width + _BESIDE).size)

    def _near(self, middle: shapely.Point, within: float) -> np.ndarray:
        """Return the edges within a distance [m], the nearest first."""
        rows = self.tree.query(middle, predicate="dwithin", distance=within)
        return rows[np.argsort(shapely.distance(middle, self.tree.geometries[rows]), kind="stable")]

    def wall_of(self, door: Door) -> _Wall | None:
        """Return the wall that a door is in, None if there is none near."""
        middle, axis, width = _measured(door)
        inside = shapely.contains_properly(self.walkable, middle)
        for row in self._near(middle, _BESIDE if inside else _WALL):
            along = self.along[row]
            out = np.array([along[1], -along[0]])
            if axis is None or abs(out @ axis) < _ALONG:
                start = self.ends[row, 0]
                s = np.clip(along @ (shapely.get_coordinates(middle)[0] - start), 0.0, self.length[row])
                at = start + s * along
                thickness = self._thickness(at, out)
                low, high = self._stretch(row, at, along, thickness, out)
                if high - low > 0.5 * width:  # else on a curve
                    width = min(width, high - low)
                    at = at + np.clip(0.0, low + 0.5 * width, high - 0.5 * width) * along
                return _Wall(at, along, out, width, thickness)
        return None

    def _thickness(self, at: Floats, out: Floats) -> float:
        """Return how far behind an edge [m] the walkable area begins again, inf if it does not within a wall."""
        beam = LineString([at, at + (_WALL + _SAME) * out])
        start = shapely.Point(at)
        found = (shapely.distance(part, start) for part in shapely.get_parts(shapely.intersection(beam, self.walkable)))
        return min((float(away) for away in found if away > 1e-6), default=np.inf)

    def _stretch(self, row: int, at: Floats, along: Floats, thickness: float, out: Floats) -> tuple[float, float]:
        """Return from where to where along an edge [m from ``at``] there is a straight wall, on both of its sides."""
        rows = [row]
        if np.isfinite(thickness):
            behind = self._near(shapely.Point(at + thickness * out), 2 * _SAME)
            rows += [k for k in behind.tolist() if self.along[k] @ along < -_ALONG][:1]
        reach = np.sort([(self.ends[k] - at) @ along for k in rows], axis=1)
        return float(reach[:, 0].max()), float(reach[:, 1].min())


def _measured(door: Door) -> tuple[shapely.Point, Floats | None, float]:
    """Return the middle of a door, the direction along it (2,), None of a point, and its width [m]."""
    frame = shapely.get_coordinates(shapely.oriented_envelope(door.shape))
    middle = shapely.Point(0.5 * (frame.min(axis=0) + frame.max(axis=0)))
    if len(frame) < 2:
        return middle, None, DOOR if door.width is None else door.width
    sides = np.diff(frame, axis=0)
    longest = sides[np.argmax(np.hypot(*sides.T))]
    length = float(np.hypot(*longest))
    return middle, longest / length, length
