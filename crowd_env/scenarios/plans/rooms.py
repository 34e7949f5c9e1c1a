"""Rooms between walls: the floor of a drawing that shows walls alone."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import shapely
from shapely.geometry import LineString, Point
from shapely.geometry.base import BaseGeometry

from crowd_env.geometry.parsing import flat_parts
from crowd_env.scenarios.plans.lines import GAP
from crowd_env.scenarios.plans.tidying import THICK

_THICKEST = 0.45  # m; what is narrower all along, between two lines or within its edge, is wall
_REACH = 0.3  # m; exits are drawn so far from the walls that they close ...
_WALL = 0.5  # m; ... and so far from the room that they lead out of, in its wall or on the other face
_GRID = 1e-4  # m; lines that nearly meet do
_SAME = 1e-3  # m; what is nearer than this to a line lies on it
_MOST = 0.5  # share of the hull of all walls; a closed line around less than this is no outline of a building


class Rooms(NamedTuple):
    """What walls enclose, in meters."""

    floor: list[BaseGeometry]
    obstacles: list[BaseGeometry]  # walls and other bodies
    solid: list[BaseGeometry]  # bodies that are thicker than a wall
    lines: int  # walls that are lines within the floor


def rooms_between(walls: Sequence[BaseGeometry], exits: Sequence[BaseGeometry], doors: Sequence[BaseGeometry]) -> Rooms:
    """Return the areas that walls [m] enclose, exits closed; openings in inner walls make one area of several rooms.

    A closed line is the outline of a room if an exit or a door lies along it, else a body such as a wall, a column or a table.
    If that leaves no room, the outermost closed lines are outlines.

    Parameters
    ----------
    walls : edges of walls, columns and furniture, and lines.
    exits : lines and areas, whose edge closes a way out; they open the wall that they lie on.
    doors : lines, areas and points.
    """
    parts, ways = _flat(walls), _flat([*exits, *doors])
    edges = [part.boundary if part.area > 0.0 else part for part in parts]
    hull = shapely.convex_hull(shapely.GeometryCollection(edges)).area
    bodies = [part for part in parts if part.area > 0.0]
    closed = [body for body in bodies if not _is_wall(body)]
    solid = [body for body in closed if not shapely.covers(shapely.buffer(body.boundary, _WALL + _SAME), ways).any()]
    thin = [body for body in bodies if _is_wall(body)]
    while True:
        found = _rooms(edges, [*thin, *solid], _flat(exits))
        inner = set() if found.floor else _within_others(solid)
        outer = [body for k, body in enumerate(solid) if k not in inner]
        if found.floor or shapely.union_all(outer).area <= _MOST * hull:
            return found._replace(solid=solid)
        solid = [solid[k] for k in inner]


def _rooms(edges: Sequence[BaseGeometry], bodies: Sequence[BaseGeometry], exits: Sequence[BaseGeometry]) -> Rooms:
    """Return the faces between edges that are neither bodies nor walls, and the walls within them."""
    drawn = shapely.union_all(edges)
    lines = shapely.union_all([*edges, *(one for exit in exits for one in _closing(exit, drawn))], grid_size=_GRID)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    full = shapely.union_all(bodies)
    free = [face for face in faces if not shapely.intersects(full, face.representative_point())]
    floor = shapely.union_all([face for face in free if not _is_wall(face)])
    thin = shapely.union_all([face for face in faces if _is_wall(face)])
    ways = shapely.union_all([_way_through(exit, thin, floor) for exit in exits])
    pieces = shapely.get_parts(lines)
    middles = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
    within = shapely.intersects(shapely.buffer(floor, -GAP), middles)
    within &= shapely.distance(shapely.union_all(exits), middles) > _SAME if exits else True
    inner = shapely.line_merge(shapely.union_all(pieces[within]))
    walls = shapely.buffer(inner, 0.5 * THICK, cap_style="flat", join_style="mitre")
    obstacles = [shapely.difference(body, ways) for body in bodies]
    return Rooms(
        _flat([shapely.union_all([floor, ways], grid_size=_GRID)]),
        [*obstacles, *_flat([walls])],
        [],
        len(_flat([inner])),
    )


def _way_through(exit: BaseGeometry, walls: BaseGeometry, floor: BaseGeometry) -> BaseGeometry:
    """Return the way through a wall [m] from the floor to an exit in it or on its other face, empty without one."""
    if exit.area > 0.0 or exit.length == 0.0 or shapely.covers(shapely.buffer(floor.boundary, GAP), exit):
        return Point()
    sides = [shapely.buffer(exit, side * _WALL, single_sided=True) for side in (1.0, -1.0)]
    cut = _flat([shapely.intersection(side, walls) for side in sides])
    return shapely.union_all([part for part in cut if all(shapely.dwithin(part, one, _SAME) for one in (exit, floor))])


def _closing(exit: BaseGeometry, walls: BaseGeometry) -> Iterable[BaseGeometry]:
    """Return the edge of an area; or a line that is longer at both ends, and reaches the walls beside it."""
    if exit.area > 0.0 or exit.length == 0.0:
        return [exit.boundary if exit.area > 0.0 else exit]
    points = shapely.get_coordinates(exit)
    ends = [a + (a - b) * _REACH / LineString([a, b]).length for a, b in (points[:2], points[:-3:-1])]
    beside = [shapely.shortest_line(Point(point), walls) for point in points[[0, -1]]]
    return [LineString([ends[0], *points[1:-1], ends[1]]), *(one for one in beside if 0.0 < one.length <= _REACH)]


def _is_wall(area: BaseGeometry) -> bool:
    return bool(2.0 * area.area <= _THICKEST * area.length)


def _within_others(bodies: Sequence[BaseGeometry]) -> set[int]:
    """Return the rows of bodies that lie within larger ones."""
    inner, outer = shapely.STRtree(bodies).query(shapely.point_on_surface(bodies), predicate="intersects")
    area = shapely.area(bodies)
    return set(inner[area[outer] > area[inner]].tolist())


def _flat(shapes: Iterable[BaseGeometry]) -> list[BaseGeometry]:
    return [part for shape in shapes for part in flat_parts(shapely.make_valid(shape)) if not part.is_empty]
