"""Rooms between walls: the floor of a drawing that shows walls alone."""

from collections.abc import Sequence

import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

_THICKEST = 0.45  # m; what is narrower all along, between two lines or within its edge, is wall
_REACH = 0.3  # m; exits are drawn so far from the walls that they close
_GRID = 1e-4  # m; lines that nearly meet do


def rooms_between(walls: Sequence[BaseGeometry], exits: Sequence[BaseGeometry], meters: float) -> list[Polygon]:
    """Return the areas that walls enclose, exits closed; openings in inner walls make one area of several rooms.

    Parameters
    ----------
    walls : edges of walls, columns and furniture, and lines.
    exits : lines and areas, whose edge closes a way out.
    meters : length of a unit of all coordinates.
    """
    bodies = shapely.union_all([wall for wall in walls if wall.area > 0.0])
    lines = [wall.boundary if wall.area > 0.0 else wall for wall in walls]
    lines += [_longer(part, _REACH / meters) for exit in exits for part in shapely.get_parts(exit)]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines, grid_size=_GRID / meters)]))
    return [
        face
        for face in faces
        if 2.0 * face.area > _THICKEST / meters * face.length
        and not shapely.intersects(bodies, face.representative_point())
    ]


def _longer(exit: BaseGeometry, reach: float) -> BaseGeometry:
    """Return a line that is longer at both ends, or the edge of an area."""
    if exit.area > 0.0 or exit.length == 0.0:
        return exit.boundary if exit.area > 0.0 else exit
    points = shapely.get_coordinates(exit)
    ends = [a + (a - b) * reach / LineString([a, b]).length for a, b in (points[:2], points[:-3:-1])]
    return LineString([ends[0], *points[1:-1], ends[1]])
