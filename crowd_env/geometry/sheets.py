"""The sheets of a building, laid out side by side on one plane, and their way back to true coordinates.

All that reads a `Geometry` reads the layout: an area in as many parts as there are sheets, with walls, exits and regions as of
any place.  A seam is a line on which two sheets meet; in the layout it lies twice.  Kernels alone read true coordinates.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.core.checks import known
from crowd_env.geometry.boundary import solid_depth
from crowd_env.geometry.parsing import SLIVER, Area, place, tangents
from crowd_env.geometry.surface import BEHIND, BODY, Slope, Surface, heights, level_surface, triangles_of

GAP = 5.0  # m between sheets in the layout: two aprons of the usual depth
SEAM = "seam "  # begins the name of a seam in the layout, where it is an opening of the border
_ONE_HEIGHT = 1e-3  # m; ends of walls are looked up this near to their place
_AROUND = 2.5 * BODY  # m; further from a seam than this no floor of the other sheet is at the height of a body


@dataclass(frozen=True, eq=False)
class Sheet:
    """A storey or a stair.

    Attributes
    ----------
    name : of the sheet.
    area : walkable area in true coordinates [m].
    level : height [m] of all that is no slope; nan = there are slopes alone.
    slopes : parts off the level.
    offset : (2,) from true coordinates to the layout [m].
    """

    name: str
    area: Area
    level: float = float("nan")
    slopes: tuple[Slope, ...] = ()
    offset: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Seam:
    """A line on which two sheets meet.

    Attributes
    ----------
    line : (2, 2) true coordinates [m], from end to end.
    left, right : numbers of the sheets on either side.
    """

    line: Floats
    left: int
    right: int


def bare_surface(sheets: Sequence[Sheet]) -> Surface:
    """Return the surface of one building without walls and exits."""
    return level_surface(0, 0, 0)._replace(
        sheet_start=np.array([0, len(sheets)], dtype=np.int64),
        level=np.array([sheet.level for sheet in sheets], dtype=np.float64),
        offset=np.array([sheet.offset for sheet in sheets], dtype=np.float64),
        wall_start=np.zeros(len(sheets) + 1, dtype=np.int64),
        **triangles_of([sheet.slopes for sheet in sheets])._asdict(),
    )


def lay_out(areas: Sequence[Area]) -> Floats:
    """Return offsets (S, 2) [m] that set areas side by side, in rows about as wide as they are high together."""
    low = np.array([area.bounds[:2] for area in areas])
    size = np.array([area.bounds[2:] for area in areas]) - low + GAP
    widest = max(float(np.sqrt(np.prod(size, axis=1).sum() * 1.5)), float(size[:, 0].max()))
    at, x, y, tallest = np.zeros((len(areas), 2)), 0.0, 0.0, 0.0
    for k, (width, height) in enumerate(size.tolist()):
        if x > 0.0 and x + width > widest:
            x, y, tallest = 0.0, y + tallest, 0.0
        at[k] = x, y
        x, tallest = x + width, max(tallest, height)
    return at + low[0] - low  # the first sheet keeps its place


def laid_out_area(sheets: Sequence[Sheet]) -> Area:
    """Return the area of the layout."""
    return shapely.MultiPolygon(
        [part for sheet in sheets for part in shapely.get_parts(_moved(sheet.area, sheet, 1.0))]
    )


def sheets_at(points: ArrayLike, sheets: Sequence[Sheet]) -> Ints:
    """Return the sheet (...) in whose box of the layout ``points`` (..., 2) [m] lie, or the nearest box."""
    xy = np.asarray(points, dtype=np.float64)
    boxes = [shapely.box(*np.add(sheet.area.bounds, [*sheet.offset, *sheet.offset])) for sheet in sheets]
    return np.argmin(shapely.distance(np.asarray(shapely.points(xy))[..., None], boxes), axis=-1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Building:
    """What a place of several sheets holds besides its layout.

    Attributes
    ----------
    sheets : with their offsets.
    seams : where they meet.
    lines : (Y, 2, 2) the openings of seams in the layout [m], walkable area to the left; two for each seam.
    seam : (Y,) the seam of each.
    """

    sheets: tuple[Sheet, ...]
    seams: tuple[Seam, ...]
    lines: Floats
    seam: Ints

    @property
    def offsets(self) -> Floats:
        """The offsets (S, 2) of the sheets [m]."""
        return np.array([sheet.offset for sheet in self.sheets], dtype=np.float64)

    def offset_of(self, name: str) -> Floats:
        """Return the offset (2,) [m] of the sheet of this name; ValueError if it is unknown."""
        names = [sheet.name for sheet in self.sheets]
        return self.offsets[names.index(known("level", name, names))]

    @property
    def from_sheet(self) -> Ints:
        """The sheet (Y,) that each of ``lines`` is on."""
        return sheets_at(self.lines.mean(axis=1), self.sheets)

    @property
    def to_sheet(self) -> Ints:
        """The sheet (Y,) that each of ``lines`` leads to."""
        both = np.array([(seam.left, seam.right) for seam in self.seams])[self.seam]
        return np.where(both[:, 0] == self.from_sheet, both[:, 1], both[:, 0])


def openings(exits: Floats, building: Building | None) -> Floats:
    """Return the lines (K, 2, 2) of the layout through which people leave its parts: exits, then seams."""
    return exits if building is None else np.concatenate([exits, building.lines])


class Walls(NamedTuple):
    """The walls of a building in the order of its sheets."""

    walls: Floats  # (W, 2, 2)  m   true coordinates
    rows: Ints  # (W,)  which of the walls of the layout each is a piece of
    sheet: Ints  # (W,)
    depth: Floats  # (W,)  m   see `Boundary.depth`
    height: Floats  # (W, 2)  m   of their ends


def walls_of(walls: Floats, ground: Area, sheets: Sequence[Sheet], seams: Sequence[Seam]) -> Walls:
    """Return the walls (W, 2, 2) of the layout in true coordinates, cut where slopes begin and end.

    ``ground`` is the walkable area of the layout with its aprons.
    """
    pieces, rows = _cut_at_slopes(walls, sheets)
    sheet = sheets_at(pieces.mean(axis=1), sheets)
    order = np.argsort(sheet, kind="stable")
    pieces, rows, sheet = pieces[order], rows[order], sheet[order]
    offset = np.array([one.offset for one in sheets])[sheet]
    along, _ = tangents(pieces)
    inwards = 1e-4 * np.stack([-along[:, 1], along[:, 0]], axis=1)
    off = np.stack([pieces[:, 0] + 1e-4 * along + inwards, pieces[:, 1] - 1e-4 * along + inwards], axis=1)
    surface, true = bare_surface(sheets), pieces - offset[:, None]
    height = heights(surface, np.repeat(sheet, 2), (off - offset[:, None]).reshape(-1, 2)).reshape(-1, 2)
    depth = np.zeros(len(pieces))
    parts = shapely.get_parts(ground)
    of_part = sheets_at([part.representative_point().coords[0] for part in parts], sheets)
    for s, one in enumerate(sheets):
        here = sheet == s
        floor = [_moved(part, one, -1.0) for part in parts[of_part == s]]
        for seam in seams:
            if s in (seam.left, seam.right):
                other = sheets[seam.right if s == seam.left else seam.left].area
                floor.append(shapely.intersection(other, shapely.LineString(seam.line).buffer(_AROUND)))
        if here.any():
            depth[here] = solid_depth(true[here], shapely.union_all(floor))
    return Walls(true, rows, sheet, depth, height)


def _moved(shape: Area, sheet: Sheet, sign: float) -> Area:
    return shapely.transform(shape, lambda points: points + sign * np.array(sheet.offset))


def _cut_at_slopes(walls: Floats, sheets: Sequence[Sheet]) -> tuple[Floats, Ints]:
    """Return the walls, cut where they pass from one slope to another, and the row of each piece."""
    borders = [_moved(slope.area, sheet, 1.0).boundary for sheet in sheets for slope in sheet.slopes]
    if not borders:
        return walls, np.arange(len(walls))
    tree, pieces, rows = shapely.STRtree(borders), [], []
    for row, (a, b) in enumerate(walls):
        length = float(np.hypot(*(b - a)))
        line = shapely.LineString([a, b])
        at = {0.0, length}
        for border in tree.query(line, predicate="dwithin", distance=SLIVER):
            ends = shapely.get_coordinates(borders[border])
            on = ends[shapely.dwithin(shapely.points(ends), line, SLIVER)]
            at |= {float(s) for s in (on - a) @ (b - a) / length if SLIVER < s < length - SLIVER}
        cuts = sorted(at)
        cuts = [cuts[0], *(s for before, s in itertools.pairwise(cuts) if s - before > SLIVER)]
        points = [a if s == 0.0 else b if s == length else a + (b - a) * (s / length) for s in cuts]
        pieces += [np.array(pair) for pair in itertools.pairwise(points)]
        rows += [row] * (len(points) - 1)
    return np.array(pieces), np.array(rows, dtype=np.int64)


def places_of_ends(walls: Walls) -> Floats:
    """Return where the ends of walls lie (2 W, 2) for the search of common corners: each height has a plane of its own."""
    ends = walls.walls.reshape(-1, 2)
    height, order = walls.height.ravel(), np.argsort(walls.height, axis=None, kind="stable")
    level = np.empty(len(height))
    level[order] = np.cumsum(np.diff(height[order], prepend=height[order][:1]) > _ONE_HEIGHT)
    span = float(np.ptp(ends[:, 0])) + 1.0 if len(ends) else 1.0
    return ends + np.column_stack([span * level, np.zeros(len(ends))])


def require_seams(sheets: Sequence[Sheet], seams: Sequence[Seam]) -> None:
    """Raise ValueError unless each seam lies on the border of both of its sheets, at one height, and turns them apart."""
    surface = bare_surface(sheets)
    for seam in seams:
        names = f"{sheets[seam.left].name!r} and {sheets[seam.right].name!r}"
        where = f"the seam between {names} at {place(seam.line[0])}"
        found = [heights(surface, np.full(2, s), seam.line) for s in (seam.left, seam.right)]
        if np.abs(found[0] - found[1]).max() > 0.01:
            raise ValueError(
                f"{where}: one is at {found[0][0]:.2f} m, the other at {found[1][0]:.2f} m; they must meet"
            )
        for s, side in ((seam.left, 1.0), (seam.right, -1.0)):
            along, _ = tangents(seam.line[None])
            middle = seam.line.mean(axis=0)
            across = side * np.array([-along[0, 1], along[0, 0]])
            if not shapely.intersects_xy(sheets[s].area, *(middle + 0.05 * across)):
                raise ValueError(f"{where}: {sheets[s].name!r} does not begin there")
            if shapely.intersects_xy(sheets[s].area, *(middle - (BEHIND - 0.05) * across)):
                raise ValueError(f"{where}: {sheets[s].name!r} goes on behind it; cut it out there")


def wall_starts(sheet: Ints, count: int) -> Ints:
    """Return where the walls of each of ``count`` sheets begin (S+1,), from the sheet of each wall in order."""
    return row_starts(np.bincount(sheet, minlength=count))
