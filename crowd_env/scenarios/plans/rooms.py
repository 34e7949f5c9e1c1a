"""Rooms between walls: the floor of a drawing that shows walls alone."""

from collections.abc import Iterable, Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import counted
from crowd_env.geometry.parsing import flat_parts, place
from crowd_env.scenarios.plans.floor_plan import RoleError
from crowd_env.scenarios.plans.lines import GAP, open_line
from crowd_env.scenarios.plans.tidying import THICK

_THICKEST = 0.45  # m; what is narrower all along, between two lines or within its edge, is wall
_REACH = 0.3  # m; exits are drawn so far from the walls that they close ...
_WALL = 0.5  # m; ... and so far from the room that they lead out of, in its wall or on the other face
_GRID = 1e-4  # m; lines that nearly meet do
_SAME = 1e-3  # m; what is nearer than this to a line lies on it
_MOST = 0.5  # share of the hull of all walls; a closed line around less than this is no outline of a building


def rooms_between(
    layers: str,
    drawn: Sequence[BaseGeometry],
    exits: Sequence[BaseGeometry],
    doors: Sequence[BaseGeometry],
    notes: list[str],
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Return the areas that walls [m] enclose, exits closed, and the obstacles in and around them.

    Openings in inner walls make one area of several rooms.  A closed line is the outline of a room if an exit or a door lies
    along it, else a body such as a wall, a column or a table.  If that leaves no room, the outermost closed lines are outlines.

    Parameters
    ----------
    layers : names of the layers of walls.
    drawn : edges of walls, columns and furniture, and lines.
    exits : lines and areas, with edges that close a way out; they open the wall that they lie on.
    doors : lines, areas and points.

    Raises
    ------
    RoleError
        If the walls enclose no room.
    """
    walls, exits, ways = _flat(drawn), _flat(exits), _flat([*exits, *doors])
    bodies, lines = ([wall for wall in walls if (wall.area > 0.0) == area] for area in (True, False))
    edges = [*lines, *(body.boundary for body in bodies)]
    thin = [body for body in bodies if _is_wall(body)]
    thick = [body for body in bodies if not _is_wall(body)]
    solid = [body for body in thick if not shapely.covers(shapely.buffer(body.boundary, _WALL + _SAME), ways).any()]
    hull = shapely.convex_hull(shapely.union_all(edges)).area
    while not (found := _rooms(edges, [*thin, *solid], exits, notes))[0]:
        inner = _within_others(solid)
        if shapely.union_all([body for k, body in enumerate(solid) if k not in inner]).area <= _MOST * hull:
            chains = shapely.get_parts(shapely.line_merge(shapely.union_all(lines)))
            where = (
                [f"of the longest {open_line(max(chains, key=lambda line: line.length), 1.0)}"] if len(chains) else []
            )
            lacks = f"the walls on {layers} enclose no room: each opening that leads out needs an exit across it"
            raise RoleError("; ".join([lacks, *where]), "--exit gives one, or --layers exits=NAME")
        solid = [solid[k] for k in inner]
    areas = counted(len(found[0]), "area", "areas")
    notes.append(f"no layer says where people walk: floor is what the walls enclose, {areas}")
    if solid:
        largest = max(solid, key=lambda one: one.area)
        at = place(shapely.get_coordinates(largest.representative_point())[0])
        count = counted(len(solid), "closed line", "closed lines")
        notes.append(f"{count} on {layers} taken as solid, the largest of {largest.area:.3g} m2 around {at}")
    return found


def _rooms(
    edges: Sequence[BaseGeometry], bodies: Sequence[BaseGeometry], exits: Sequence[BaseGeometry], notes: list[str]
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Return the faces between edges that are neither bodies nor walls, and the bodies and walls beside and within them."""
    drawn, leading = shapely.union_all(edges), shapely.union_all(exits)
    lines = shapely.union_all([*edges, *(one for exit in exits for one in _closing(exit, drawn))], grid_size=_GRID)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    full = shapely.union_all(bodies)
    rooms = [face for face in faces if not (_is_wall(face) or shapely.intersects(full, face.representative_point()))]
    floor, thin = shapely.union_all(rooms), shapely.union_all([face for face in faces if _is_wall(face)])
    ways = shapely.union_all([part for exit in exits for part in _ways_through(exit, thin, floor)])
    pieces = shapely.get_parts(lines)
    middles = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
    within = shapely.intersects(shapely.buffer(floor, -GAP), middles) & ~shapely.dwithin(leading, middles, _SAME)
    inner = shapely.line_merge(shapely.union_all(pieces[within]))
    if within.any():
        count = counted(len(shapely.get_parts(inner)), "line", "lines")
        notes.append(f"obstacles: {count} taken as walls {THICK:g} m thick")
    walls = shapely.buffer(inner, 0.5 * THICK, cap_style="flat", join_style="mitre")
    obstacles = [*(shapely.difference(body, ways) for body in bodies), walls]
    return _flat([shapely.union_all([floor, ways], grid_size=_GRID)]), _flat(obstacles)


def _ways_through(exit: BaseGeometry, walls: BaseGeometry, floor: BaseGeometry) -> list[BaseGeometry]:
    """Return the ways through a wall [m] from the floor to an exit in it or on its other face."""
    if exit.area > 0.0 or shapely.covers(shapely.buffer(floor.boundary, GAP), exit):
        return []
    sides = [shapely.buffer(exit, side * _WALL, single_sided=True) for side in (1.0, -1.0)]
    cut = _flat([shapely.intersection(side, walls) for side in sides])
    return [part for part in cut if shapely.dwithin(part, [exit, floor], _SAME).all()]


def _closing(exit: BaseGeometry, walls: BaseGeometry) -> list[BaseGeometry]:
    """Return the edge of an area; or a line, and how it reaches the walls beside it."""
    if exit.area > 0.0:
        return [exit.boundary]
    beside = [shapely.shortest_line(end, walls) for end in shapely.get_parts(exit.boundary)]
    return [exit, *(one for one in beside if one.length <= _REACH)]


def _is_wall(area: BaseGeometry) -> bool:
    return bool(2.0 * area.area <= _THICKEST * area.length)


def _within_others(bodies: Sequence[BaseGeometry]) -> set[int]:
    """Return the rows of bodies that lie within larger ones."""
    inner, outer = shapely.STRtree(bodies).query(shapely.point_on_surface(bodies), predicate="intersects")
    area = shapely.area(bodies)
    return set(inner[area[outer] > area[inner]].tolist())


def _flat(shapes: Iterable[BaseGeometry]) -> list[BaseGeometry]:
    return [part for shape in shapes for part in flat_parts(shapely.make_valid(shape)) if not part.is_empty]
