"""The sheets of a building, laid out side by side on one plane, and their way back to true coordinates.

All that reads a `Geometry` reads the layout: an area in as many parts as there are sheets, with walls, exits and regions as of
any place.  A seam is a line on which two sheets meet; in the layout it lies twice.  Kernels alone read true coordinates.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Bools, Floats, Ints, row_starts
from crowd_env.core.checks import known
from crowd_env.geometry.boundary import rings_of, solid_depth
from crowd_env.geometry.parsing import SLIVER, Area, place, read_area, tangents
from crowd_env.geometry.surface import BEHIND, BODY, Slope, Surface, heights, level_surface, triangles_of

GAP = 5.0  # m between sheets in the layout: two aprons of the usual depth
SEAM = "seam "  # begins the name of a seam in the layout, where it is an opening of the border
_SAME_HEIGHT = 1e-6  # m; level sheets whose heights differ by less are one floor
_SHORTEST = 0.02  # m
_OVERLAP = 1e-4  # m2
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

    @property
    def title(self) -> str:
        """Its name, of a level with its height."""
        return f"{self.name}  {self.level:+.2f} m" if self.level == self.level else self.name

    @property
    def floors(self) -> list[Area]:
        """The level and the slopes, each a plane."""
        slopes = [slope.area for slope in self.slopes]
        return slopes if np.isnan(self.level) else [shapely.difference(self.area, shapely.union_all(slopes)), *slopes]

    @property
    def middle(self) -> float:
        """The height [m] of the level, or half-way between the lowest and the highest of the slopes."""
        planes = (shapely.get_coordinates(one.area) @ one.plane[:2] + one.plane[2] for one in self.slopes)
        return self.level if self.level == self.level else float(np.quantile(np.concatenate([*planes]), (0, 1)).mean())


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

    def slows(self, points: Floats) -> Bools:
        """Return whether ``points`` (..., 2) [m] of the layout are on slopes that slow people: on stairs."""
        found = np.zeros(points.shape[:-1], dtype=bool)
        for sheet in self.sheets:
            for slope in sheet.slopes:
                if min(slope.up, slope.down) < 1.0:
                    found |= shapely.intersects_xy(slope.area, *np.moveaxis(points - np.array(sheet.offset), -1, 0))
        return found

    @property
    def letters(self) -> list[str]:
        """A letter (Y,) for each of ``lines``, the same at both ends of a seam: A to Z, then A1 to Z1 ..."""
        return [chr(ord("A") + k % 26) + str(k // 26 or "") for k in self.seam.tolist()]

    @property
    def from_sheet(self) -> Ints:
        """The sheet (Y,) that each of ``lines`` is on."""
        return sheets_at(self.lines.mean(axis=1), self.sheets)

    @property
    def to_sheet(self) -> Ints:
        """The sheet (Y,) that each of ``lines`` leads to."""
        both = np.array([(seam.left, seam.right) for seam in self.seams], dtype=np.int64).reshape(-1, 2)[self.seam]
        return np.where(both[:, 0] == self.from_sheet, both[:, 1], both[:, 0])


def turned(building: Building, turn: Callable[[Floats], Floats], lines: Callable[[Floats], Floats]) -> Building:
    """Return a building as ``turn`` moves points (..., 2), and ``lines`` lines (..., 2, 2) with their left sides."""

    def moved(sheet: Sheet) -> Sheet:
        slopes = (
            replace(
                slope,
                area=shapely.transform(slope.area, turn),
                plane=(*turn(np.array(slope.plane[:2])), slope.plane[2]),
            )
            for slope in sheet.slopes
        )
        offset = tuple(turn(np.array(sheet.offset)).tolist())
        return replace(sheet, area=shapely.transform(sheet.area, turn), slopes=tuple(slopes), offset=offset)

    seams = tuple(replace(seam, line=lines(seam.line[None])[0]) for seam in building.seams)
    return replace(building, sheets=tuple(map(moved, building.sheets)), seams=seams, lines=lines(building.lines))


def as_plain(building: Building) -> dict[str, Any]:
    """Return the sheets and seams as plain data, as recordings keep them."""
    return {
        "sheets": [
            {
                "name": one.name,
                "area": one.area.wkt,
                "level": None if np.isnan(one.level) else one.level,
                "offset": list(one.offset),
                "slopes": [
                    [slope.area.wkt, list(slope.plane), slope.up, slope.down, slope.belt, slope.stepped]
                    for slope in one.slopes
                ],
            }
            for one in building.sheets
        ],
        "seams": [[np.asarray(one.line).tolist(), one.left, one.right] for one in building.seams],
    }


def from_plain(data: Mapping[str, Any]) -> tuple[list[Sheet], list[Seam]]:
    """Return the sheets and seams of `as_plain`."""
    sheets = [
        Sheet(
            one["name"],
            shapely.from_wkt(one["area"]),
            float("nan") if one["level"] is None else one["level"],
            tuple(Slope(shapely.from_wkt(area), tuple(plane), *others) for area, plane, *others in one["slopes"]),
            tuple(one["offset"]),
        )
        for one in data["sheets"]
    ]
    return sheets, [Seam(np.array(line, dtype=np.float64), left, right) for line, left, right in data["seams"]]


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


def seam_name(k: int) -> str:
    """Return the name of line ``k`` of `Building.lines` as an exit of its sheet."""
    return f"{SEAM}{k}"


def laid_out_area(sheets: Sequence[Sheet]) -> Area:
    """Return the area of the layout."""
    return shapely.MultiPolygon(
        [part for sheet in sheets for part in shapely.get_parts(_moved(sheet.area, sheet, 1.0))]
    )


def sheets_at(points: ArrayLike, sheets: Sequence[Sheet]) -> Ints:
    """Return the sheet (...) on which ``points`` (..., 2) [m] of the layout lie, or the nearest."""
    xy = np.asarray(points, dtype=np.float64)
    boxes = [shapely.box(*np.add(sheet.area.bounds, [*sheet.offset, *sheet.offset])) for sheet in sheets]
    flat = np.asarray(shapely.points(xy)).reshape(-1, 1)
    away = shapely.distance(flat, boxes)
    unclear = (away <= 0.0).sum(axis=1) != 1  # boxes of turned sheets overlap
    if unclear.any():
        away[unclear] = shapely.distance(flat[unclear], [_moved(sheet.area, sheet, 1.0) for sheet in sheets])
    return np.argmin(away, axis=1).astype(np.int64).reshape(xy.shape[:-1])


class Walls(NamedTuple):
    """The walls of a building in the order of its sheets."""

    walls: Floats  # (W, 2, 2)  m   true coordinates
    rows: Ints  # (W,)  which of the walls of the layout each is a piece of
    sheet: Ints  # (W,)
    depth: Floats  # (W,)  m   see `Boundary.depth`
    height: Floats  # (W, 2)  m   of their ends


def walls_of(walls: Floats, two_sided: Bools, ground: Area, sheets: Sequence[Sheet], seams: Sequence[Seam]) -> Walls:
    """Return the walls (W, 2, 2) of the layout in true coordinates, cut where slopes begin and end.

    ``ground`` is the walkable area of the layout with its aprons.  The walls of a sheet follow each other as in its area
    alone: sums over them are the same.
    """
    pieces, rows = _cut_at_slopes(walls, sheets)
    sheet = sheets_at(pieces.mean(axis=1), sheets)
    place_of = np.full(len(pieces), np.inf)
    for s, one in enumerate(sheets):
        drawn = np.flatnonzero((sheet == s) & ~two_sided[rows])
        place_of[drawn] = _places_on_border(pieces[drawn].mean(axis=1) - one.offset, one.area)
    order = np.lexsort((place_of, sheet))
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


def _places_on_border(points: Floats, area: Area) -> Floats:
    """Return where on the border of an area, counted along its rings, points (K, 2) lie; inf = nowhere."""
    edges = np.concatenate(
        [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in itertools.chain(*rings_of(area))]
    )
    lines = shapely.linestrings(edges)
    of_point, edge = shapely.STRtree(lines).query(shapely.points(points), predicate="dwithin", distance=SLIVER)
    found = np.full(len(points), np.inf)
    share = shapely.line_locate_point(lines[edge], shapely.points(points)[of_point], normalized=True)
    np.minimum.at(found, of_point, edge + share)
    return found


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


def united(sheets: Sequence[Sheet], seams: Sequence[Seam]) -> tuple[list[Sheet], list[Seam], Ints]:
    """Return the sheets and seams of a building with level floor that is one storey as one sheet, before they are laid out.

    Level sheets at one height that share a seam are one, a ramp that does not rise among them.  The third is the new number
    (S,) of each sheet.
    """
    plain, first = [_leveled(sheet) for sheet in sheets], np.arange(len(sheets))
    inner = [
        not plain[seam.left].slopes
        and not plain[seam.right].slopes
        and abs(plain[seam.left].level - plain[seam.right].level) < _SAME_HEIGHT
        for seam in seams
    ]
    for seam in itertools.compress(seams, inner):
        low, high = sorted(first[[seam.left, seam.right]].tolist())
        first[first == high] = low
    kept, number = np.unique(first, return_inverse=True)
    parts = [[plain[s].area for s in np.flatnonzero(first == k)] for k in kept]
    made = [
        plain[k]
        if len(areas) == 1
        else replace(plain[k], area=read_area(areas, f"level {plain[k].name!r}").normalize())
        for k, areas in zip(kept.tolist(), parts, strict=True)
    ]
    outer = itertools.compress(seams, [not within for within in inner])
    ends = [replace(seam, left=int(number[seam.left]), right=int(number[seam.right])) for seam in outer]
    return made, ends, number.astype(np.int64)


def _leveled(sheet: Sheet) -> Sheet:
    """Return a sheet without slopes, if none of them rises or has speeds of its own, and all are at one height."""
    heights_of = {slope.plane[2] for slope in sheet.slopes} | ({sheet.level} if sheet.level == sheet.level else set())
    flat = all(
        (*slope.plane[:2], slope.up, slope.down, slope.belt) == (0.0, 0.0, 1.0, 1.0, 0.0) for slope in sheet.slopes
    )
    return replace(sheet, level=heights_of.pop(), slopes=()) if flat and len(heights_of) == 1 else sheet


def require_sheets(sheets: Sequence[Sheet], seams: Sequence[Seam]) -> None:
    """Raise ValueError, in one sentence, unless sheets are floors and each seam joins two of them that meet there."""
    for sheet in sheets:
        _require_sheet(sheet)
    moved = [_moved(sheet.area, sheet, 1.0) for sheet in sheets]
    for one, other in np.transpose(shapely.STRtree(moved).query(moved, predicate="intersects")).tolist():
        if one < other:
            raise ValueError(
                f"{sheets[one].name!r} and {sheets[other].name!r} overlap in the layout; set them apart by lay_out"
            )
    surface = bare_surface(sheets)
    for k, seam in enumerate(seams):
        _require_seam(k, seam, sheets)
        names = f"{sheets[seam.left].name!r} and {sheets[seam.right].name!r}"
        where = f"the seam between {names} at {place(seam.line[0])}"
        length = float(np.hypot(*(seam.line[1] - seam.line[0])))
        if not length >= _SHORTEST:
            raise ValueError(f"{where} is {length:.3g} m long; it must be at least {_SHORTEST} m")
        points = np.vstack([seam.line, seam.line.mean(axis=0)])
        for s in (seam.left, seam.right):
            away = shapely.distance(shapely.boundary(sheets[s].area), shapely.points(points))
            if away.max() > 0.01:
                at = place(points[int(np.argmax(away))])
                raise ValueError(f"{where}: at {at} it is {away.max():.2g} m off the border of {sheets[s].name!r}")
        found = [heights(surface, np.full(2, s), seam.line) for s in (seam.left, seam.right)]
        if not np.abs(found[0] - found[1]).max() <= 0.01:
            worst = int(np.argmax(np.abs(found[0] - found[1])))
            raise ValueError(
                f"{where}: one is at {found[0][worst]:.2f} m, the other at {found[1][worst]:.2f} m; they must meet"
            )
        along, _ = tangents(seam.line[None])
        for s, side in ((seam.left, 1.0), (seam.right, -1.0)):
            across = side * np.array([-along[0, 1], along[0, 0]])
            if not shapely.intersects_xy(sheets[s].area, *(points[2] + 0.05 * across)):
                raise ValueError(f"{where}: {sheets[s].name!r} does not begin there")
            if shapely.intersects_xy(sheets[s].area, *(points[2] - (BEHIND - 0.05) * across)):
                raise ValueError(f"{where}: {sheets[s].name!r} goes on behind it; cut it out there")


def _require_sheet(sheet: Sheet) -> None:
    name = f"sheet {sheet.name!r}"
    read_area(sheet.area, name)
    if not sheet.slopes and not np.isfinite(sheet.level):
        raise ValueError(f"{name}: level is {sheet.level:g} m; a sheet without slopes needs a height")
    for k, slope in enumerate(sheet.slopes):
        read_area(slope.area, f"slope {k} of {name}")
        if not np.isfinite(slope.plane).all():
            raise ValueError(f"slope {k} of {name}: plane is {slope.plane}; it must be three finite numbers")
        if not 0.0 < min(slope.up, slope.down) <= max(slope.up, slope.down) < np.inf:
            raise ValueError(f"slope {k} of {name}: speeds are {slope.up:g} and {slope.down:g}; they must be above 0")
        for other in sheet.slopes[:k]:
            common = shapely.intersection(slope.area, other.area)
            if common.area > _OVERLAP:
                at = place(shapely.get_coordinates(common.representative_point())[0])
                raise ValueError(f"{name}: two of its slopes overlap at {at}; a sheet may not lie above itself")
    if np.isnan(sheet.level):
        bare = shapely.difference(sheet.area, shapely.union_all([slope.area for slope in sheet.slopes]).buffer(0.1))
        if bare.area > _OVERLAP:
            at = place(shapely.get_coordinates(bare.representative_point())[0])
            raise ValueError(f"{name}: no slope covers {at}, and it has no level")


def _require_seam(k: int, seam: Seam, sheets: Sequence[Sheet]) -> None:
    for s in (seam.left, seam.right):
        if not isinstance(s, int | np.integer) or not 0 <= s < len(sheets):
            raise ValueError(f"seam {k} names sheet {s}; there are 0 to {len(sheets) - 1}")
    if seam.left == seam.right:
        raise ValueError(f"seam {k} joins {sheets[seam.left].name!r} to itself; it must join two sheets")
    if np.shape(seam.line) != (2, 2) or not np.isfinite(seam.line).all():
        raise ValueError(
            f"seam {k}: its line is {np.asarray(seam.line).tolist()}; it must be two points of finite numbers"
        )


def require_ways_out(sheets: Sequence[Sheet], seams: Sequence[Seam], exits: Floats) -> None:
    """Raise ValueError if a sheet has neither an exit nor seams that lead to one of the ``exits`` (X, 2, 2) of the layout."""
    reached = set(sheets_at(exits.mean(axis=1), sheets).tolist())
    while more := {s for seam in seams if len(ends := {seam.left, seam.right} - reached) == 1 for s in ends}:
        reached |= more
    lost = [sheet.name for s, sheet in enumerate(sheets) if s not in reached]
    if lost and len(exits):
        raise ValueError(f"no exit can be reached from {lost[0]!r}; a stair or an exit must lead out")


def wall_starts(sheet: Ints, count: int) -> Ints:
    """Return where the walls of each of ``count`` sheets begin (S+1,), from the sheet of each wall in order."""
    return row_starts(np.bincount(sheet, minlength=count))
