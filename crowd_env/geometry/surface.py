"""How high each point of a place lies, and how fast people walk there: what kernels read of sheets.

A place is one or more sheets in true coordinates: storeys and stairs.  No sheet lies above itself, so a pedestrian is known by
x, y and the number of its sheet.  A sheet is level but for its slopes, each a plane over an area.  Bodies are upright
cylinders: two bodies, or a body and a wall, can touch where they are less than `BODY` apart in height.

For drawing and for ways the sheets are laid out side by side on one plane, each moved by its `offset`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import Polygon

from crowd_env.core.arrays.state import Bools, Floats, Ints, joined_starts, row_starts
from crowd_env.core.kernels.jit import allocating_kernel, inner_kernel

BEHIND = 0.3  # m; a pedestrian this near behind a seam is on the other sheet
BODY = 1.0  # m; two cylinders with feet further apart in height do not touch


@dataclass(frozen=True)
class Slope:
    """A part of a sheet off its level: a flight, a landing, a ramp.

    Attributes
    ----------
    area : its outline, seen from above [m].
    plane : a, b, c of the height z = a x + b y + c [m].
    up, down : walking speed along the slope, relative to that on level floor.
    belt : speed at which it carries people upwards along the slope [m/s]; below 0 it carries them down.
    stepped : whether pedestrians with a speed of their own on stairs walk at that one.
    """

    area: Polygon
    plane: tuple[float, float, float]
    up: float = 1.0
    down: float = 1.0
    belt: float = 0.0
    stepped: bool = False


class Surface(NamedTuple):
    """Input of kernels: the sheets of G places one behind the other, and how high their walls lie."""

    sheet_start: Ints  # (G+1,)  first sheet of each place
    level: Floats  # (S,)    m   height beside the slopes; nan = the sheet is slopes alone
    offset: Floats  # (S, 2)  m   from true coordinates to the layout
    slope_start: Ints  # (S+1,)  first triangle of each sheet
    triangle: Floats  # (T, 3, 2)  m   counterclockwise
    plane: Floats  # (T, 3)  z = a x + b y + c
    up: Floats  # (T,)    speed along the slope, relative to that on level floor
    down: Floats  # (T,)
    belt: Floats  # (T,)    m/s
    stepped: Bools  # (T,)
    wall_start: Ints  # (S+1,)  first wall of each sheet, as rows of `Boundary.wall`; chords of a place come last
    wall_height: Floats  # (W, 2)  m   of the ends of walls
    corner_height: Floats  # (V,)    m
    exit_sheet: Ints  # (X,)    sheet within its place that an exit line is on
    seam_start: Ints  # (G+1,)  first seam of each place, as below; each seam is there twice, once for each sheet
    seam: Floats  # (Y, 2, 2)  m   the sheet that is left lies to the left
    seam_from: Ints  # (Y,)    that sheet within its place
    seam_to: Ints  # (Y,)    the sheet on the other side


def level_surface(walls: int, corners: int, exits: int) -> Surface:
    """Return the surface of a place of one sheet at height 0 with these numbers of walls, corners and exit lines."""
    return Surface(
        sheet_start=np.array([0, 1], dtype=np.int64),
        level=np.zeros(1),
        offset=np.zeros((1, 2)),
        wall_start=np.array([0, walls], dtype=np.int64),
        wall_height=np.zeros((walls, 2)),
        corner_height=np.zeros(corners),
        exit_sheet=np.zeros(exits, dtype=np.int64),
        seam_start=np.zeros(2, dtype=np.int64),
        seam=np.empty((0, 2, 2)),
        seam_from=np.empty(0, dtype=np.int64),
        seam_to=np.empty(0, dtype=np.int64),
        **triangles_of([()])._asdict(),
    )


class Triangles(NamedTuple):
    """The slopes of S sheets as triangles; see `Surface`."""

    slope_start: Ints
    triangle: Floats
    plane: Floats
    up: Floats
    down: Floats
    belt: Floats
    stepped: Bools


def triangles_of(sheets: Sequence[Sequence[Slope]]) -> Triangles:
    """Return the triangles of the slopes of each sheet."""
    corners, of_slope, counts = [np.empty((0, 3, 2))], [np.empty((0, 7))], []
    for slopes in sheets:
        count = 0
        for slope in slopes:
            parts = shapely.get_parts(shapely.constrained_delaunay_triangles(slope.area))
            corners += [shapely.get_coordinates(part)[None, :3] for part in parts]
            of_slope.append(np.tile([*slope.plane, slope.up, slope.down, slope.belt, slope.stepped], (len(parts), 1)))
            count += len(parts)
        counts.append(count)
    numbers = np.concatenate(of_slope)
    triangle = np.concatenate(corners)
    ab, ac = triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    left = ab[:, 0] * ac[:, 1] > ab[:, 1] * ac[:, 0]
    triangle[~left] = triangle[~left, ::-1]
    up, down, belt, stepped = numbers[:, 3:].T.copy()
    return Triangles(row_starts(counts), triangle, numbers[:, :3].copy(), up, down, belt, stepped > 0.0)


def join_surfaces(parts: Sequence[Surface]) -> Surface:
    """Return the surfaces of several places one behind the other."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Surface._fields}
    for starts in ("sheet_start", "slope_start", "wall_start", "seam_start"):
        columns[starts] = joined_starts([getattr(part, starts) for part in parts])
    return Surface(**columns)


Ground = tuple[float, float, int, int]
"""Of one sheet: its offset to the layout (2) [m], and its first wall and one past its last, as rows of `Boundary.wall`."""


@inner_kernel
def ground_of(surface: Surface, g: int, sheet: int) -> Ground:
    """Return the ground of a sheet of place ``g``."""
    s = surface.sheet_start[g] + sheet
    return surface.offset[s, 0], surface.offset[s, 1], surface.wall_start[s], surface.wall_start[s + 1]


@inner_kernel
def has_sheets(surface: Surface, g: int) -> bool:
    """Whether place ``g`` has more than one sheet, or a slope."""
    first, stop = surface.sheet_start[g], surface.sheet_start[g + 1]
    return stop - first > 1 or surface.slope_start[stop] > surface.slope_start[first]


@inner_kernel
def slope_at(surface: Surface, s: int, x: float, y: float) -> int:
    """Return the triangle of sheet ``s`` (of all places) that a point lies on; -1 = level.

    On a sheet of slopes alone, a point beside them belongs to the nearest.
    """
    best, nearest = -1, -1e-9 if surface.level[s] == surface.level[s] else -np.inf
    triangle = surface.triangle
    for t in range(surface.slope_start[s], surface.slope_start[s + 1]):
        inside = np.inf
        for k in range(3):
            ax, ay = triangle[t, k, 0], triangle[t, k, 1]
            tx, ty = triangle[t, (k + 1) % 3, 0] - ax, triangle[t, (k + 1) % 3, 1] - ay
            inside = min(inside, (tx * (y - ay) - ty * (x - ax)) / np.sqrt(tx * tx + ty * ty))
        if inside > nearest:
            best, nearest = t, inside
    return best


@inner_kernel
def sheet_beyond(surface: Surface, g: int, sheet: int, x: float, y: float, reach: float = BEHIND) -> int:
    """Return the sheet of a point reached from ``sheet`` of place ``g``: the next one, up to ``reach`` [m] behind a seam."""
    for k in range(surface.seam_start[g], surface.seam_start[g + 1]):
        if surface.seam_from[k] == sheet:
            ax, ay = surface.seam[k, 0, 0], surface.seam[k, 0, 1]
            tx, ty = surface.seam[k, 1, 0] - ax, surface.seam[k, 1, 1] - ay
            length = np.sqrt(tx * tx + ty * ty)
            behind = (ty * (x - ax) - tx * (y - ay)) / length
            along = (tx * (x - ax) + ty * (y - ay)) / length
            if 0.0 < behind < reach and 0.0 < along < length:
                return surface.seam_to[k]
    return sheet


@inner_kernel
def height_at(surface: Surface, s: int, x: float, y: float) -> float:
    """Return the height [m] of a point of sheet ``s`` (of all places)."""
    t = slope_at(surface, s, x, y)
    if t < 0:
        return surface.level[s]
    return surface.plane[t, 0] * x + surface.plane[t, 1] * y + surface.plane[t, 2]


@inner_kernel
def rise_at(surface: Surface, s: int, x: float, y: float, ex: float, ey: float) -> float:
    """Return the rise per meter, seen from above, at a point of sheet ``s`` along a unit vector."""
    t = slope_at(surface, s, x, y)
    return 0.0 if t < 0 else surface.plane[t, 0] * ex + surface.plane[t, 1] * ey


@inner_kernel
def speed_at(
    surface: Surface, s: int, x: float, y: float, ex: float, ey: float, own_up: float, own_down: float
) -> tuple[float, float]:
    """Return the horizontal speed on sheet ``s`` along a unit vector, relative to that on level floor, and a belt's in m/s.

    Speeds of stairs are along the slope, so the horizontal one is v cos(angle).  Across a slope people walk as on level floor,
    in between by the share of the steepest direction.  A pedestrian's speeds on stairs, relative to
    its speed on level floor, are nan where they are the stair's.
    """
    t = slope_at(surface, s, x, y)
    if t < 0:
        return 1.0, 0.0
    rise = surface.plane[t, 0] * ex + surface.plane[t, 1] * ey
    steepest = np.sqrt(surface.plane[t, 0] ** 2 + surface.plane[t, 1] ** 2)
    relative, own = (surface.up[t], own_up) if rise > 0.0 else (surface.down[t], own_down)
    if surface.stepped[t] and own == own:
        relative = own
    along = 1.0 / np.sqrt(1.0 + rise * rise)
    if steepest == 0.0:  # a landing: the speed of its stair, and no belt
        return 1.0 + (relative - 1.0), 0.0
    share = rise / steepest
    return (1.0 + (relative - 1.0) * abs(share)) * along, surface.belt[t] * share * along


@allocating_kernel
def heights(surface: Surface, sheet: Ints, points: Floats) -> Floats:
    """Return the heights (K,) [m] of ``points`` (K, 2) on sheets (K,), numbered within the first place."""
    found = np.empty(len(points))
    for k in range(len(points)):
        found[k] = height_at(surface, sheet[k], points[k, 0], points[k, 1])
    return found


@allocating_kernel
def slopes_at(surface: Surface, s: int, points: Floats) -> Ints:
    """Return the triangles (K,) that ``points`` (K, 2) of sheet ``s`` lie on; -1 = level."""
    found = np.empty(len(points), dtype=np.int64)
    for k in range(len(points)):
        found[k] = slope_at(surface, s, points[k, 0], points[k, 1])
    return found


@inner_kernel
def are_level(one: float, other: float) -> bool:
    """Whether two bodies at these heights [m] can touch."""
    return abs(one - other) < BODY


@inner_kernel
def is_wall_near(surface: Surface, k: int, along: float, length: float, height: float) -> bool:
    """Whether a body at a ``height`` [m] can touch wall ``k`` (of all places) at the place ``along`` [m] its ``length``."""
    share = min(max(along / length, 0.0), 1.0)
    return are_level((1.0 - share) * surface.wall_height[k, 0] + share * surface.wall_height[k, 1], height)
