"""The place: walkable area, walls, exits and named regions, as shapely polygons outside and segment arrays inside.

All segments are oriented with the walkable area to their LEFT, so the outward normal of an exit is to the right of it.
"""

import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry import MultiPolygon, Polygon, box
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Bools, Floats, Ints, joined_starts, segment_lengths
from crowd_env.core.checks import NOT_NEGATIVE, table
from crowd_env.core.checks import number as require_number
from crowd_env.core.checks import text as require_text
from crowd_env.core.files.fingerprint import UNSAID
from crowd_env.geometry.aprons import (
    APRONS,
    add_aprons,
    depths_of_aprons,
    ends_of_aprons,
    sides_of_aprons,
    wanted_depths,
)
from crowd_env.geometry.boundary import clear_exits, ends_together, open_boundary, solid_depth
from crowd_env.geometry.doors import read_doors
from crowd_env.geometry.jambs import NO_ARCS, Arcs, deepen_exits, round_jambs
from crowd_env.geometry.parsing import (
    ROUNDED,
    SLIVER,
    Area,
    Shape,
    parse_exit,
    place,
    read_area,
    read_areas,
    read_exits,
    read_lines,
    require_inside,
    tangents,
)
from crowd_env.geometry.parts import closed_off, is_within, join_near_parts, say_left_out, split_by_exits
from crowd_env.geometry.sheets import (
    SEAM,
    Building,
    Seam,
    Sheet,
    Walls,
    bare_surface,
    laid_out_area,
    places_of_ends,
    require_sheets,
    require_ways_out,
    seam_name,
    sheets_at,
    turned,
    wall_starts,
    walls_of,
)
from crowd_env.geometry.surface import Surface, heights, join_surfaces, level_surface

__all__ = ["Boundary", "Geometry", "box", "join_boundaries", "parse_exit"]

_BENT = 0.1  # m; an opening that is deeper is no line between two jambs
_STRAIGHT = 1.0 - 1e-6  # cosine between two lines of one opening


class Boundary(NamedTuple):
    """Input of the kernels from the geometry; the arrays of G geometries lie one behind the other."""

    wall: Floats  # (W, 2, 2)  m   ends a, b; walkable area to the left of a -> b; the chords of round jambs last
    tangent: Floats  # (W, 2)  unit vector from a to b
    length: Floats  # (W,)    m
    depth: Floats  # (W,)    m   half the thickness of the solid behind the wall, 0.25 m at most
    two_sided: Bools  # (W,)    thin wall inside the area: touches from both sides
    wall_door: Ints  # (W,)    door of its geometry that the wall closes; -1 = it stands for good
    wall_start: Ints  # (G+1,)  first wall of each geometry
    chord_start: Ints  # (G,)    first chord of each geometry: contacts are with its arc, never with a chord
    corner: Floats  # (V, 2)  m   distinct ends of walls: door jambs, corners of obstacles; or the center of a round one
    corner_radius: Floats  # (V,)    m   of a round jamb; 0 = a point
    corner_turn: Floats  # (V,)    sine of the turn between its two walls, > 0: to the left; -1 = none or not two
    corner_door: Ints  # (V,)    door of its geometry that the corner belongs to; -1 = none
    corner_start: Ints  # (G+1,)  first corner of each geometry
    corner_wall_start: Ints  # (V+1,)  corner v ends corner_wall[corner_wall_start[v]:corner_wall_start[v+1]]
    corner_wall: Ints  # (N,)    rows of `wall`
    corner_wall_end: Ints  # (N,)    the end of that wall which lies there: 0 = a, 1 = b
    exit: Floats  # (X, 2, 2)  m   ends a, b; walkable area to the left of a -> b
    apron: Floats  # (X,)    m   depth of the apron behind each exit; 0 = people vanish at the line
    aim: Floats  # (X, 2, 2)  m   the line at the end of the apron, which ways lead to
    exit_start: Ints  # (G+1,)  first exit of each geometry


@dataclass(frozen=True, eq=False)
class Geometry:
    """A walkable area with its walls and exits; build it with `from_polygon` or `from_wkt`.

    Attributes
    ----------
    walkable
        Walkable area [m]; obstacles and polygonal exits are already cut out.
    walls
        (W, 2, 2) straight walls [m], walkable area to the left; behind them thin walls and doors (``two_sided``), and last
        the chords that draw round jambs.
    two_sided
        (W,) whether a wall is a line inside the area, touched from both sides.
    exits
        (X, 2, 2) openings of the boundary [m], walkable area to the left.
    exit_names
        Name of each row of ``exits``; the segments of one exit share a name.
    regions
        Named areas [m] that rules refer to: stairs, decision areas, where people start.
    doors
        Names of the doors.
    door_of_wall
        (W,) row of ``doors`` that a wall closes, which stands only while that door is closed; -1 = it stands for good.
    exits_of_door
        For each door the name of the exit that it closes, or None if it stands inside.
    left_out
        Parts of the drawing without an exit; they are not walkable.
    arcs
        The round jambs.
    apron
        How far behind the jambs of an exit people are bodies [m]; see `crowd_env.geometry.aprons`.
    building
        The sheets of a place of several: all else is then their layout, see `crowd_env.geometry.sheets`.
    """

    walkable: Area
    walls: Floats
    two_sided: Bools
    exits: Floats
    exit_names: tuple[str, ...]
    regions: Mapping[str, Area]
    doors: tuple[str, ...]
    door_of_wall: Ints
    exits_of_door: tuple[str | None, ...]
    left_out: tuple[Polygon, ...] = ()
    arcs: Arcs = NO_ARCS
    apron: float = field(default=0.0, metadata={UNSAID: 0.0})
    building: Building | None = field(default=None, metadata={UNSAID: None})

    @classmethod
    def from_polygon(
        cls,
        walkable: Shape | Sequence[Shape],
        *,
        exits: Mapping[str, Shape] | Iterable[Shape] | Shape = (),
        obstacles: Iterable[Shape] | BaseGeometry = (),
        thin_walls: Iterable[Shape] | BaseGeometry = (),
        regions: Mapping[str, Shape] | None = None,
        doors: Mapping[str, Shape] | None = None,
        jamb_radius: float = 0.0,
        narrowest: float = 0.0,
    ) -> "Geometry":
        """Return the geometry of an area.

        Parameters
        ----------
        walkable
            Polygon with holes, several of them (united), WKT, or (K, 2) corners [m].  Parts less than 1 cm apart are joined;
            parts that have no exit are left out.
        exits
            Name -> exit, or exits alone (then called ``exit-0`` ...).  A line or (2, 2) segment [m] along the boundary opens
            it there; a polygon is cut out of the area and its border with the area becomes the exit.  Either may lie up to
            0.3 m, the thickness of a wall, off the boundary, and is moved onto it.
        obstacles
            Areas cut out of the walkable area, and of the lines of exits.
        thin_walls
            Lines inside the area that are walls without thickness.
        regions
            Name -> area that overlaps the walkable area.
        doors
            Name -> a door: the name of an exit, or a line across a passage inside the area.
        jamb_radius
            Radius [m] of the corners that jut into the area: door jambs, corners of obstacles, the tips of thin walls; 0 for
            sharp ones.  See `crowd_env.geometry.jambs`: passages and doors stay as wide as they are drawn.
        narrowest
            Radius [m] of a body: parts that it cannot leave are left out.

        Raises
        ------
        ValueError
            In one sentence, for any of these that is malformed or in the wrong place.

        Warns
        -----
        UserWarning
            If parts are joined or left out, an exit is moved by more than 1 cm, or an obstacle covers a part of it.
        """
        radius = require_number("jamb_radius", jamb_radius, NOT_NEGATIVE, "m")
        regions = table("regions", {} if regions is None else regions, "names and areas")
        doors = table("doors", {} if doors is None else doors, "names and lines")
        area = join_near_parts(read_area(walkable, "walkable area"), "walkable area")
        drawn, area = area, _without_obstacles(area, read_areas(obstacles, "obstacle"))
        shapes = clear_exits(read_exits(exits), drawn, area)
        area = _without_exit_areas(
            area, {name: s for name, s in shapes.items() if isinstance(s, Polygon | MultiPolygon)}
        )
        walls, exit_rows, exit_names = open_boundary(area, shapes)
        area, left_out = split_by_exits(area, exit_rows)
        if left_out:
            say_left_out(left_out)
        if lost := closed_off(area, exit_rows, narrowest) if narrowest > 0.0 else []:
            say_left_out(lost)
            rest = read_area(shapely.difference(area, shapely.union_all(lost)), "walkable area")
            area, _ = split_by_exits(rest, exit_rows)  # without the crumbs of a slit
            left_out += lost
        if left_out:
            with warnings.catch_warnings():  # its warnings have been given
                warnings.simplefilter("ignore")
                walls, exit_rows, exit_names = open_boundary(area, shapes)
        if radius > 0.0:
            area, shapes = deepen_exits(area, walls, exit_rows, exit_names, radius)
            walls, exit_rows, exit_names = open_boundary(area, shapes)
        thin = _thin_walls(area, left_out, read_lines(thin_walls, "thin wall"))
        arcs, chords = NO_ARCS, np.empty((0, 2, 2))
        if radius > 0.0:
            area, walls, thin, chords, arcs = round_jambs(area, walls, thin, exit_rows, radius)
        leaves, door_of_leaf, exits_of_door = read_doors(doors or {}, area, thin, exit_rows, exit_names)
        fixed, sides = len(walls) + len(thin), [len(walls), len(thin) + len(leaves), len(chords)]
        return cls(
            walkable=area,
            walls=np.concatenate([walls, thin, leaves, chords]),
            two_sided=np.repeat([False, True, False], sides),
            exits=exit_rows,
            exit_names=exit_names,
            regions=_regions(area, left_out, regions or {}, shapes),
            doors=tuple(doors or {}),
            door_of_wall=np.pad(door_of_leaf, (fixed, len(chords)), constant_values=-1),
            exits_of_door=exits_of_door,
            left_out=tuple(left_out),
            arcs=arcs,
        )

    @classmethod
    def from_wkt(cls, text: str, **others: Any) -> "Geometry":
        """Return the geometry of the walkable area in the WKT ``text``; the ``others`` are parameters of `from_polygon`."""
        return cls.from_polygon(require_text("walkable area", text, "well-known text (WKT)"), **others)

    @classmethod
    def from_sheets(cls, sheets: Sequence[Sheet], seams: Sequence[Seam], **others: Any) -> "Geometry":
        """Return the geometry of a building; the ``others`` are parameters of `from_polygon`, in the layout of `laid_out`.

        Raises
        ------
        ValueError
            In one sentence, if a sheet is no floor, two sheets do not meet at their seam, or one has no way out.
        """
        require_sheets(sheets, seams)
        if others.get("jamb_radius"):
            raise ValueError("jamb_radius must be 0 in a building")
        moved = laid_out_area(sheets)
        names = [f"{SEAM}{k}/{side}" for k in range(len(seams)) for side in ("left", "right")]
        lines = [seam.line + sheets[s].offset for seam in seams for s in (seam.left, seam.right)]
        exits = others.pop("exits", {})
        made = cls.from_polygon(moved, exits={**exits, **dict(zip(names, lines, strict=True))}, **others)
        is_seam = np.array([name in names for name in made.exit_names], dtype=bool)
        of_seam = [names.index(name) // 2 for name in made.exit_names if name in names]
        building = Building(tuple(sheets), tuple(seams), made.exits[is_seam], np.array(of_seam, dtype=np.int64))
        left = tuple(name for name in made.exit_names if name not in names)
        require_ways_out(sheets, seams, made.exits[~is_seam])
        return replace(made, exits=made.exits[~is_seam], exit_names=left, building=building)

    def with_regions(self, regions: Mapping[str, Shape]) -> "Geometry":
        """Return the geometry with these regions in place of its own.

        Raises
        ------
        ValueError
            If one is malformed, has the name of an exit, or is nowhere walkable.
        """
        return replace(self, regions=_regions(self.walkable, self.left_out, regions, self.exit_names))

    def turned(self, angle: float, mirrored: bool = False) -> "Geometry":
        """Return the place as `turning` moves it; walls, exits and doors keep their left sides."""
        turn, ends = turning(angle, mirrored), self.arcs.ends
        if mirrored:
            on_post = ends[:, 1:] < 0
            ends = np.where(on_post, ends, ends[:, ::-1])
            ends = np.where(ends < 0, -1, ends ^ 1)

        def lines(rows: Floats) -> Floats:
            return np.ascontiguousarray(turn(rows)[:, :: -1 if mirrored else 1])

        return replace(
            self,
            walkable=shapely.transform(self.walkable, turn),
            walls=lines(self.walls),
            exits=lines(self.exits),
            regions={name: shapely.transform(shape, turn) for name, shape in self.regions.items()},
            left_out=tuple(shapely.transform(shape, turn) for shape in self.left_out),
            arcs=self.arcs._replace(center=turn(self.arcs.center), ends=ends),
            building=None if self.building is None else turned(self.building, turn, lines),
        )

    def walls_when(self, closed: Collection[str] = ()) -> tuple[Floats, Bools]:
        """Return the walls (W, 2, 2) and which are two-sided (W,) while these doors are closed and all others open."""
        numbers = [-1, *(k for k, name in enumerate(self.doors) if name in closed)]
        stands = np.isin(self.door_of_wall, numbers)
        return self.walls[stands], self.two_sided[stands]

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """The bounding box (min x, min y, max x, max y) of the walkable area [m]."""
        return self.walkable.bounds

    @cached_property
    def area(self) -> float:
        """The walkable area [m^2]."""
        return float(self.walkable.area)

    def with_apron(self, apron: float) -> "Geometry":
        """Return the place with aprons that end this far [m] behind the jambs of its exits; 0 = none.

        Raises
        ------
        ValueError
            If it is no number from 0 to 10.
        """
        apron = require_number("apron", apron, APRONS, "m")
        return self if apron == self.apron else replace(self, apron=apron)

    @cached_property
    def apron_depths(self) -> Floats:
        """The depth (X,) [m] of the apron behind each line."""
        drawn = len(self.walls) - self.arcs.chords
        return depths_of_aprons(self.walkable, self.walls[:drawn], self.exits, self.apron)

    @cached_property
    def ways_behind(self) -> Floats:
        """The length (X,) [m] of the ways on each apron: its depth.

        Ways end at the line itself where floor ends the apron before, and where an exit is bent, as around an area.
        """
        return np.where(self._bent | self._shortened, 0.0, self.apron_depths)

    @cached_property
    def _bent(self) -> Bools:
        """(X,) which lines meet another of their exit at an angle."""
        along, _ = tangents(self.exits)
        return np.asarray((self._meet(self.exits) & (along @ along.T < _STRAIGHT)).any(axis=1))

    def _meet(self, ends: Floats) -> Bools:
        """Return (X, X) which lines of one exit have one of their ``ends`` (X, 2, 2) in common."""
        meet = (np.hypot(*(ends[:, None, :, None] - ends[None, :, None]).T) < SLIVER).any(axis=(0, 1))
        return meet & self._same_exit

    @property
    def _same_exit(self) -> Bools:
        """(X, X) which lines are of one exit."""
        names = np.array(self.exit_names)
        return names[:, None] == names

    def openings(self, turn: float = -1.0) -> list[tuple[str, Ints]]:
        """Return the openings of the exits: the name of the exit, and its rows of ``exits``.

        An opening is lines that meet where no wall ends, and turn there by no more than an angle of the cosine ``turn``.
        """
        along, _ = tangents(self.exits)
        ends = self.exits.reshape(-1, 2).copy()
        ends[self._wall_tree.query(shapely.points(ends), predicate="dwithin", distance=SLIVER)[0]] = np.nan
        joined = self._meet(ends.reshape(-1, 2, 2)) & (along @ along.T >= turn) | np.eye(len(along), dtype=bool)
        first = np.arange(len(along))
        while (first != (lower := np.where(joined, first, len(first)).min(axis=1, initial=len(first)))).any():
            first = lower
        return [(self.exit_names[k], np.flatnonzero(first == k)) for k in np.unique(first).tolist()]

    @cached_property
    def _shortened(self) -> Bools:
        """(X,) behind which lines floor ends the apron before."""
        drawn = len(self.walls) - self.arcs.chords
        return self.apron_depths < wanted_depths(self.walls[:drawn], self.exits, self.apron)

    @property
    def close_behind(self) -> dict[str, float]:
        """Name of each exit that another floor lies close behind -> how far [m]: its apron ends halfway.

        The floor on the other side of an area does not count: people leave by the same area there.
        """
        far = 2.0 * self.apron_depths
        touched = shapely.distance(
            shapely.linestrings(ends_of_aprons(self.exits, far))[:, None], shapely.linestrings(self.exits)
        )
        of_area = self._bent | ((touched < SLIVER) & self._same_exit).any(axis=1)
        return {self.exit_names[k]: float(far[k]) for k in np.flatnonzero(self._shortened & (far > 0.0) & ~of_area)}

    def with_ways_to(self, exits: Collection[str]) -> "Geometry":
        """Return the place as if the aprons of these ``exits`` were drawn, on which there are ways: lines are at the ends."""
        return self._with_floor(np.where(np.isin(self.exit_names, list(exits)), self.ways_behind, 0.0))

    def _with_floor(self, depths: Floats) -> "Geometry":
        """Return the place with drawn aprons of these ``depths`` (X,) [m]."""
        drawn = len(self.walls) - self.arcs.chords
        if not depths.any():
            return self
        sides = sides_of_aprons(self.walkable, self.exits, depths)
        return replace(
            self,
            walkable=add_aprons(self.walkable, self.exits, depths),
            walls=np.insert(self.walls, drawn, sides, axis=0),
            two_sided=np.insert(self.two_sided, drawn, np.zeros(len(sides), dtype=bool)),
            door_of_wall=np.insert(self.door_of_wall, drawn, np.full(len(sides), -1)),
            exits=ends_of_aprons(self.exits, depths),
            apron=0.0,
        )

    @cached_property
    def boundary(self) -> Boundary:
        """The arrays that kernels read, for this geometry alone (G = 1), with its aprons."""
        ground = self._with_floor(self.apron_depths)
        walls, two_sided, door_of_wall = ground.walls, ground.two_sided, ground.door_of_wall
        if self._walls is not None:
            walls = self._walls.walls
            two_sided, door_of_wall = two_sided[self._walls.rows], door_of_wall[self._walls.rows]
        straight = len(walls) - self.arcs.chords
        ends = walls[:straight].reshape(-1, 2)
        on_arc = self.arcs.ends[self.arcs.ends >= 0]
        sharp = np.delete(np.arange(len(ends)), on_arc)
        start, members = ends_together((ends if self._walls is None else places_of_ends(self._walls))[sharp])
        members = sharp[members]
        # A leaf shares its ends with no permanent wall.
        doors = door_of_wall[members[start[:-1]] // 2]
        on_post = self.arcs.ends[:, 1] < 0
        members = np.concatenate([members, self.arcs.ends[~on_post].ravel()])
        starts = np.concatenate([start, start[-1] + np.cumsum(np.where(on_post, 0, 2))])
        corner = np.concatenate([ends[members[start[:-1]]], self.arcs.center])
        tangent, length = tangents(walls)
        return Boundary(
            wall=walls,
            tangent=tangent,
            length=length,
            depth=solid_depth(walls, ground.walkable) if self._walls is None else self._walls.depth,
            two_sided=two_sided,
            wall_door=door_of_wall,
            wall_start=np.array([0, len(walls)], dtype=np.int64),
            chord_start=np.array([straight], dtype=np.int64),
            corner=corner,
            corner_radius=np.repeat([0.0, self.arcs.radius], [len(start) - 1, len(on_post)]),
            corner_turn=_turns(starts, members, two_sided, tangent),
            corner_door=np.concatenate([doors, np.full(len(on_post), -1, dtype=np.int64)]),
            corner_start=np.array([0, len(corner)], dtype=np.int64),
            corner_wall_start=starts,
            corner_wall=members // 2,
            corner_wall_end=members % 2,
            exit=self._on_sheets(self.exits),
            apron=self.apron_depths,
            aim=self._on_sheets(ends_of_aprons(self.exits, self.ways_behind)),
            exit_start=np.array([0, len(self.exits)], dtype=np.int64),
        )

    def _on_sheets(self, lines: Floats) -> Floats:
        """Return lines at the exits (X, 2, 2) of the layout in true coordinates."""
        if self.building is None:
            return lines
        of_exit = sheets_at(self.exits.mean(axis=1), self.building.sheets)
        return lines - self.building.offsets[of_exit][:, None]

    @cached_property
    def _walls(self) -> Walls | None:
        """The walls, also of aprons, in true coordinates and by sheet; None = there is one sheet."""
        if self.building is None:
            return None
        ground = self._with_floor(self.apron_depths)
        return walls_of(ground.walls, ground.two_sided, ground.walkable, self.building.sheets, self.building.seams)

    @cached_property
    def surface(self) -> Surface:
        """Sheets and heights, as kernels read them, for this geometry alone (G = 1)."""
        bound = self.boundary
        level = level_surface(len(bound.wall), len(bound.corner), len(bound.exit))
        if self.building is None or self._walls is None:
            return level
        of_corner = bound.corner_wall[bound.corner_wall_start[:-1]], bound.corner_wall_end[bound.corner_wall_start[:-1]]
        seams = self.building
        return bare_surface(self.building.sheets)._replace(
            wall_start=wall_starts(self._walls.sheet, len(self.building.sheets)),
            wall_height=self._walls.height,
            corner_height=self._walls.height[of_corner],
            exit_sheet=sheets_at(self.exits.mean(axis=1), seams.sheets),
            seam_start=np.array([0, len(seams.lines)], dtype=np.int64),
            seam=seams.lines - seams.offsets[seams.from_sheet][:, None],
            seam_from=seams.from_sheet,
            seam_to=seams.to_sheet,
        )

    def sheet_alone(self, s: int) -> "Geometry":
        """Return sheet ``s`` of a building as a place of its own, in true coordinates; its seams are exits."""
        building = self.building
        assert building is not None
        parts = shapely.get_parts(self.walkable)
        mine = parts[sheets_at([part.representative_point().coords[0] for part in parts], building.sheets) == s]
        walls = sheets_at(self.walls.mean(axis=1), building.sheets) == s
        exits = np.flatnonzero(sheets_at(self.exits.mean(axis=1), building.sheets) == s)
        seams = np.flatnonzero(building.from_sheet == s)
        offset = building.offsets[s]

        def moved(shape: Area) -> Area:
            return shapely.transform(shape, lambda points: points - offset)

        return replace(
            self,
            walkable=moved(mine[0] if len(mine) == 1 else MultiPolygon(list(mine))),
            regions={name: moved(region) for name, region in self.regions.items()},
            left_out=(),
            arcs=NO_ARCS,
            walls=self.walls[walls] - offset,
            two_sided=self.two_sided[walls],
            door_of_wall=self.door_of_wall[walls],
            exits=np.concatenate([self.exits[exits], building.lines[seams]]) - offset,
            exit_names=(*(self.exit_names[k] for k in exits.tolist()), *map(seam_name, seams.tolist())),
            building=None,
            apron=0.0,
        )

    @property
    def ways_on(self) -> Floats:
        """The lines (Y, 2, 2) [m] over which people leave a part of the area: exits, and seams to other sheets."""
        return self.exits if self.building is None else np.concatenate([self.exits, self.building.lines])

    @property
    def of_layout(self) -> "Geometry":
        """The layout as a place of one sheet."""
        return replace(self, building=None)

    def laid_out(self, position: Floats, sheet: Ints) -> Floats:
        """Return where points (..., 2) [m] of sheets (...) lie in the layout; of one sheet, the points themselves."""
        return position if self.building is None else position + self.building.offsets[sheet]

    def heights(self, points: Floats, sheet: Ints) -> Floats:
        """Return the heights (K,) [m] of points (K, 2) [m] of sheets (K,), in true coordinates."""
        return np.asarray(heights(self.surface, sheet, np.ascontiguousarray(points)))

    def on_sheets(self, points: Floats) -> tuple[Floats, Ints]:
        """Return the true coordinates (..., 2) [m] of points of the layout, and their sheets (...)."""
        if self.building is None:
            return points, np.zeros(np.shape(points)[:-1], dtype=np.int64)
        sheet = sheets_at(points, self.building.sheets)
        return points - self.building.offsets[sheet], sheet

    @cached_property
    def _wall_tree(self) -> shapely.STRtree:
        return shapely.STRtree(shapely.linestrings(self.walls))

    def contains(self, points: ArrayLike, region: str | None = None) -> Bools:
        """Return (...) whether each of ``points`` (..., 2) [m] lies in the walkable area (or a region) or on its border."""
        xy = np.asarray(points, dtype=np.float64)
        area = self.walkable if region is None else self.regions[region]
        shapely.prepare(area)
        return np.asarray(shapely.intersects_xy(area, xy[..., 0], xy[..., 1]))

    def is_left_out(self, point: ArrayLike) -> bool:
        """Return whether a point (2,) [m] lies in a part of the plan that was left out because it has no exit."""
        at = shapely.Point(np.asarray(point, dtype=np.float64))
        return any(shapely.intersects(part, at) for part in self.left_out)

    def area_of(self, region: str | None = None) -> float:
        """Return the walkable area [m^2], of a region if one is named."""
        if region is None:
            return self.area
        return float(shapely.intersection(self.walkable, self.regions[region], grid_size=ROUNDED).area)

    @cached_property
    def exit_lengths(self) -> dict[str, float]:
        """The length [m] of the lines through which people pass each exit, by its name: of a zone all its open sides."""
        length = segment_lengths(self.exits)
        names = np.array(self.exit_names, dtype=object)
        return {name: float(length[names == name].sum()) for name in dict.fromkeys(self.exit_names)}

    @cached_property
    def exit_widths(self) -> dict[str, float]:
        """The width [m] of each exit by its name, as people see it from one side.

        Connected lines are one opening.  A bent one, such as the sides of a zone that people walk into, is as wide as the
        longer side of the smallest rectangle around it.
        """
        return self.clear_widths()

    def clear_widths(self, body: float = 0.0) -> dict[str, float]:
        """Return the `exit_widths` [m] of doors with the same room for people of a width ``body`` [m].

        Between jambs the middle of a body stays half its width off each of them.  A zone has none: middles enter all along its
        side, as through a door that is wider by a body.
        """
        names = np.array(self.exit_names, dtype=object)
        widths = {}
        for name in dict.fromkeys(self.exit_names):
            lines = shapely.linestrings(self.exits[names == name])
            chains = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(lines)))
            boxes = shapely.get_coordinates(shapely.oriented_envelope(chains), return_index=True)
            sides = [_sides(boxes[0][boxes[1] == k]) for k in range(len(chains))]
            widths[name] = sum(long + (body if short > _BENT else 0.0) for short, long in sides)
        return widths

    def nearest_exit(self, points: ArrayLike) -> Ints:
        """Return (...) the row of ``exits`` nearest in a straight line to each of ``points`` (..., 2)."""
        xy = shapely.points(np.asarray(points, dtype=np.float64))
        return np.argmin(shapely.distance(xy[..., None], shapely.linestrings(self.exits)), axis=-1).astype(np.int64)

    def clearance(self, points: ArrayLike) -> Floats:
        """Return (K,) the distance [m] from each of ``points`` (K, 2) to the nearest wall; inf without walls."""
        xy = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        if not len(self.walls) or not len(xy):
            return np.full(len(xy), np.inf)
        _, distance = self._wall_tree.query_nearest(shapely.points(xy), return_distance=True, all_matches=False)
        return np.asarray(distance)


def _turns(start: Ints, ends: Ints, two_sided: Bools, tangent: Floats) -> Floats:
    """Return `Boundary.corner_turn`; at corner v lie the ``ends[start[v]:start[v + 1]]``, of wall k 2 k and 2 k + 1."""
    turn = np.full(len(start) - 1, -1.0)
    of_two = np.flatnonzero(np.diff(start) == 2)
    pairs = ends[start[of_two, None] + [0, 1]]
    plain = (pairs.sum(axis=1) % 2 == 1) & ~two_sided[pairs // 2].any(axis=1)
    pairs = pairs[plain]
    into, out = pairs[pairs % 2 == 1] // 2, pairs[pairs % 2 == 0] // 2
    sine = tangent[into, 0] * tangent[out, 1] - tangent[into, 1] * tangent[out, 0]
    is_tip = (tangent[into] * tangent[out]).sum(axis=1) < -_STRAIGHT  # beside a stair: of a wall without thickness
    turn[of_two[plain]] = np.where(is_tip, -1.0, sine)
    return turn


def _sides(corners: Floats) -> tuple[float, float]:
    """Return the shorter and the longer side of a rectangle, which may be a line."""
    lengths = np.hypot(*np.diff(corners, axis=0).T)
    return (0.0 if len(lengths) < 2 else float(lengths.min())), float(lengths.max())


def turning(angle: float, mirrored: bool = False) -> Callable[[Floats], Floats]:
    """Return a function that turns points (..., 2) [m] by an ``angle`` [rad] to the left, about (0, 0).

    Where ``mirrored``, it first mirrors them at the axis of x.
    """
    side = -1.0 if mirrored else 1.0
    axes = np.array([[np.cos(angle), np.sin(angle)], [-side * np.sin(angle), side * np.cos(angle)]])
    return lambda points: points @ axes


def nearest_among(segments: Floats) -> Callable[[Floats], Ints]:
    """Return a function from points (K, 2) [m] to the row (K,) of the nearest of some ``segments`` (S, 2, 2) [m]."""
    return partial(_nearest, shapely.STRtree(shapely.linestrings(segments)))


def _nearest(tree: shapely.STRtree, points: Floats) -> Ints:
    if len(tree.geometries) == 1:
        return np.zeros(len(points), dtype=np.int64)
    return np.asarray(tree.nearest(shapely.points(points)), dtype=np.int64)


def join_boundaries(geometries: Sequence[Geometry]) -> Boundary:
    """Return the boundaries of ``geometries`` one behind the other, as one batch reads them."""
    parts = [place.boundary for place in geometries]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Boundary._fields}
    for rows in ("wall", "corner", "exit", "corner_wall"):
        columns[f"{rows}_start"] = joined_starts([getattr(part, f"{rows}_start") for part in parts])
    first_wall = np.repeat(columns["wall_start"][:-1], [len(part.corner_wall) for part in parts])
    return Boundary(
        **columns
        | {
            "corner_wall": columns["corner_wall"] + first_wall,
            "chord_start": columns["chord_start"] + columns["wall_start"][:-1],
        }
    )


def join_all_surfaces(geometries: Sequence[Geometry]) -> Surface:
    """Return the surfaces of ``geometries`` one behind the other, as one batch reads them."""
    return join_surfaces([place.surface for place in geometries])


def _without_obstacles(area: Area, obstacles: list[Area]) -> Area:
    for number, obstacle in enumerate(obstacles):
        if not shapely.intersects(area, obstacle):
            at = place(shapely.get_coordinates(obstacle.representative_point())[0])
            raise ValueError(f"obstacle {number} around {at} lies outside of the walkable area; it must overlap it")
    return _difference(area, obstacles, "the obstacles leave no walkable area")


def _without_exit_areas(area: Area, polygons: Mapping[str, Area]) -> Area:
    names = list(polygons)
    for i, name in enumerate(names):
        for other in names[:i]:
            common = shapely.intersection(polygons[name], polygons[other])
            if common.area > SLIVER:
                at = place(shapely.get_coordinates(common.representative_point())[0])
                raise ValueError(f"exits {other!r} and {name!r} overlap at {at}; exits must be apart")
    return _difference(area, list(polygons.values()), "the exits leave no walkable area")


def _difference(area: Area, holes: list[Area], error: str) -> Area:
    if not holes:
        return area
    rest = shapely.difference(area, shapely.union_all(holes))
    parts = [p for p in shapely.get_parts(rest) if p.geom_type == "Polygon" and p.area > SLIVER]
    if not parts:
        raise ValueError(error)
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _thin_walls(area: Area, left_out: list[Polygon], lines: list[Floats]) -> Floats:
    segments = [np.empty((0, 2, 2))]
    for number, line in enumerate(lines):
        if left_out and not shapely.intersects(area, shapely.LineString(line)):
            continue
        require_inside(f"thin wall {number}", line, area, "lie inside")
        ends = np.stack([line[:-1], line[1:]], axis=1)
        segments.append(ends[segment_lengths(ends) > SLIVER])
        if not len(segments[-1]):
            raise ValueError(f"thin wall {number} at {place(line[0])} has no length; it needs two different points")
    return np.concatenate(segments)


def _regions(
    area: Area, left_out: Sequence[Polygon], regions: Mapping[str, Shape], exits: Collection[str]
) -> dict[str, Area]:
    shapes = {}
    for name, thing in regions.items():
        if name in exits:
            raise ValueError(f"region {name!r} has the name of an exit; names of regions and exits must differ")
        shape = read_area(thing, f"region {name!r}")
        if shapely.intersection(area, shape, grid_size=ROUNDED).area <= SLIVER:
            at = place(shapely.get_coordinates(shape.representative_point())[0])
            if is_within(shape, left_out):
                raise ValueError(f"region {name!r} around {at} lies in a part that no exit reaches; open an exit there")
            raise ValueError(f"region {name!r} around {at} lies outside of the walkable area; it must overlap it")
        shapes[name] = shape
    return shapes
