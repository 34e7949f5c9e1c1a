"""Buildings: levels, and the stairs and ramps between them, become a place of several sheets.

Each level is a sheet, and so is each stair, with its flights and landings as slopes.  A level has no floor where a stair is
less than `HEADROOM` and a slab above or below it.  All coordinates are true ones, the same on all levels.

Speeds on stairs are by default from the SFPE Handbook, along the slope, both ways, landings included.
"""

import itertools
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
import shapely
from shapely.geometry import Polygon

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Positive, Range, at, check_fields, known, plain_name, refuse
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import ROUNDED, SLIVER, Area, Shape, place, read_area, read_areas, read_lines
from crowd_env.geometry.sheets import SEAM, Seam, Sheet, lay_out, united
from crowd_env.geometry.surface import BEHIND, Slope

HEADROOM = 2.0  # m; people walk under a stair, or on it under a level, only where it is higher
SLAB = 0.3  # m, thickness of levels and flights
RISERS = Range(0.1, 0.25)  # m
TREADS = Range(0.2, 0.5)  # m
STEEPEST = 0.5  # rise of a ramp over its length

_APART = HEADROOM + SLAB - 1e-6
_LEVEL_SPEED = 84.0  # m/min, of the SFPE Handbook on level floor
_STAIR_SPEED = 51.8  # m/min, times the root of tread over riser
_SLIT = 0.02  # m between two flights with a wall without thickness
_ANOTHER = 1e-3  # m; a riser that differs by more from the one that was given gives a note
_TURNS = Literal["straight", "u-left", "u-right"]
_WIDTHS = Range(0.5, 50.0)
_BELTS = Range(-1.0, 1.0)
_FACTORS = Range(0.0, 2.0, above=True)


def speed_on_stairs(riser: float, tread: float) -> float:
    """Return the speed along the slope relative to that on level floor, at most 1.

    Source: SFPE Handbook of Fire Protection Engineering, hydraulic model of movement: k = 51.8 sqrt(tread / riser).
    """
    return min(1.0, _STAIR_SPEED * math.sqrt(tread / riser) / _LEVEL_SPEED)


@dataclass(frozen=True, eq=False)
class Level:
    """A level: what `Geometry.from_polygon` takes, at a height; names of exits, regions and doors are unique in a building.

    Attributes
    ----------
    name : of the level; also that of a region, all its floor, unless something else has the name.
    height : of its floor [m].
    """

    name: str
    height: float
    walkable: Shape | Sequence[Shape]
    obstacles: Iterable[Shape] = ()
    thin_walls: Iterable[Shape] = ()
    exits: Mapping[str, Shape] = field(default_factory=dict)
    regions: Mapping[str, Shape] = field(default_factory=dict)
    doors: Mapping[str, Shape] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_named("level", self)
        for key in ("exits", "regions", "doors"):
            given = getattr(self, key)
            if given is None:
                object.__setattr__(self, key, {})
            elif not isinstance(given, Mapping):
                refuse(f"level {self.name!r}: {key}", given, "a table of names and shapes")


@dataclass(frozen=True)
class Stair:
    """A stair between two levels, straight or of two flights with a landing half-way."""

    KIND: ClassVar = "stair"
    name: str
    """name of the stair; also that of a region, all its floor."""
    lower: str
    """name of the level at its foot."""
    upper: str
    """name of the level at its head."""
    foot: tuple[float, float]
    """[x, y] in m, the middle of the line on the lower level at which it begins."""
    direction: float
    """degrees, in which its first flight climbs: 0 = along x, 90 = along y."""
    width: Annotated[float, _WIDTHS] = 1.2
    """m, of each flight."""
    riser: Annotated[float, RISERS] = 0.175
    """m, rounded so that a whole number of risers makes the height."""
    tread: Annotated[float, TREADS] = 0.28
    """m; a flight is as long as its risers have treads."""
    turns: _TURNS = "straight"
    """straight; or u-left or u-right: the second flight goes back beside the first, on this side of people that climb."""
    landing: Annotated[float, Range(0.0, 50.0)] | None = None
    """m, depth of the landing half-way: the width by default; of a straight stair none by default."""
    core: Annotated[float, Range(0.0, 50.0)] = 0.25
    """m between two flights beside each other; 0 = a thin wall."""
    up: Annotated[float, _FACTORS] | None = None
    """speed upwards along the slope, relative to that on level floor; by riser and tread by default."""
    down: Annotated[float, _FACTORS] | None = None
    """speed downwards, likewise."""
    belt: Annotated[float, _BELTS] = 0.0
    """m/s, of an escalator: its steps carry people up along the slope, below 0 down; people walk on it besides."""

    def __post_init__(self) -> None:
        _check_named("stair", self)
        if self.turns != "straight" and self.landing is not None and self.landing < 0.5:
            raise ValueError(f"stair {self.name!r}: landing is {self.landing:g} m; people turn on 0.5 m or more")

    def steps(self, rise: float) -> "Steps":
        """Return the steps of the stair over a ``rise`` [m].

        Raises
        ------
        ValueError
            If no whole number of allowed risers makes it.
        """
        flights = 1 if self.turns == "straight" and not self.landing else 2
        count = max(round(rise / self.riser), flights)
        count += rise / count > RISERS.high
        riser = rise / count
        if riser not in RISERS:
            raise ValueError(
                f"stair {self.name!r} climbs {rise:.3g} m by {count} risers of {riser:.3g} m; they must be {RISERS} m"
            )
        first = count if flights == 1 else (count + 1) // 2
        return Steps((first, count - first)[:flights], riser, self.tread)

    def pieces(self, base: float, top: float) -> "Iterator[Piece]":
        """Yield its flights and landings between two heights [m]."""
        steps, half = self.steps(top - base), 0.5 * self.width
        speed = speed_on_stairs(steps.riser, steps.tread)
        factors = speed if self.up is None else self.up, speed if self.down is None else self.down, self.belt, True
        end, middle = steps.flights[0] * steps.tread, base + steps.flights[0] * steps.riser
        yield Piece((0.0, end), (-half, half), (base, middle), *factors)
        if len(steps.flights) == 1:
            return
        back = steps.flights[1] * steps.tread
        depth = self.width if self.landing is None else self.landing
        if self.turns == "straight":
            yield Piece((end, end + depth), (-half, half), (middle, middle), *factors)
            yield Piece((end + depth, end + depth + back), (-half, half), (middle, top), *factors)
            return
        core, side = max(self.core, _SLIT), 1.0 if self.turns == "u-left" else -1.0
        beside, beyond = side * (half + core), side * (half + core + self.width)
        yield Piece((end, end + depth), _sorted(-side * half, beyond), (middle, middle), *factors)
        yield Piece((end, end - back), _sorted(beside, beyond), (middle, top), *factors)
        yield Piece((max(0.0, end - back), end), _sorted(side * half, beside), None)


@dataclass(frozen=True)
class Ramp:
    """A straight ramp between two levels, on which people walk as on level floor unless speeds are given."""

    KIND: ClassVar = "ramp"
    name: str
    """name of the ramp; also that of a region, all its floor."""
    lower: str
    """name of the level at its foot."""
    upper: str
    """name of the level at its head."""
    foot: tuple[float, float]
    """[x, y] in m, the middle of the line on the lower level at which it begins."""
    direction: float
    """degrees, in which it climbs: 0 = along x, 90 = along y."""
    length: Positive
    """m, seen from above; at least twice the height."""
    width: Annotated[float, _WIDTHS] = 2.0
    """m."""
    up: Annotated[float, _FACTORS] = 1.0
    """speed upwards along the slope, relative to that on level floor."""
    down: Annotated[float, _FACTORS] = 1.0
    """speed downwards, likewise."""

    def __post_init__(self) -> None:
        _check_named("ramp", self)

    def pieces(self, base: float, top: float) -> "Iterator[Piece]":
        """Yield its floor between two heights [m].

        Raises
        ------
        ValueError
            If it is too steep.
        """
        if top - base > STEEPEST * self.length:
            raise ValueError(
                f"ramp {self.name!r} climbs {top - base:.3g} m over {self.length:g} m; it must be at least "
                f"{(top - base) / STEEPEST:.3g} m long, or a stair"
            )
        yield Piece((0.0, self.length), (-0.5 * self.width, 0.5 * self.width), (base, top), self.up, self.down)


Way: TypeAlias = Stair | Ramp


class Steps(NamedTuple):
    """The steps of a stair."""

    flights: tuple[int, ...]  # risers of each
    riser: float  # m
    tread: float  # m

    def __str__(self) -> str:
        """Say them as an architect does."""
        angle = math.degrees(math.atan2(self.riser, self.tread))
        return (
            f"{' + '.join(map(str, self.flights))} risers of {1000 * self.riser:.1f} mm, treads of "
            f"{1000 * self.tread:.0f} mm, {angle:.1f} degrees"
        )


class Piece(NamedTuple):
    """A rectangle of a stair: along the direction in which it climbs from the foot, and to the left of it."""

    along: tuple[float, float]  # m
    across: tuple[float, float]  # m
    height: tuple[float, float] | None  # m   at both ends of ``along``; None = no floor, between two flights
    up: float = 1.0
    down: float = 1.0
    belt: float = 0.0
    stepped: bool = False


class Built(NamedTuple):
    """A stair or ramp in true coordinates."""

    way: Way
    slopes: tuple[Slope, ...]
    between: tuple[Polygon, ...]  # flights
    foot: Floats  # (2, 2)  m   the level lies to the left
    head: Floats  # (2, 2)  m   likewise

    @property
    def area(self) -> Area:
        """Its floor."""
        return read_area(
            shapely.union_all([slope.area for slope in self.slopes], grid_size=ROUNDED), repr(self.way.name)
        )

    def over(self, level: str, height: float) -> Area:
        """Return where a level at a height [m] has no floor: above it, under it, and between its flights."""
        near = [_between(slope, height - _APART, height + _APART) for slope in self.slopes]
        return shapely.union_all([*near, *(self.between if level in (self.way.lower, self.way.upper) else ())])

    def mouths(self) -> tuple[tuple[str, str, Floats], ...]:
        """Return what each end is called, its level and its line."""
        return ("foot", self.way.lower, self.foot), ("head", self.way.upper, self.head)


def building(levels: Sequence[Level], stairs: Sequence[Stair] = (), ramps: Sequence[Ramp] = ()) -> Geometry:
    """Return the place of these levels, and of the stairs and ramps between them.

    Raises
    ------
    ValueError
        If something is malformed, in the wrong place or too steep, if two things have one name or overlap, or
        if a level has no way out.

    Warns
    -----
    UserWarning
        If risers are not as high as given, and as `Geometry.from_polygon` does.
    """
    ways: tuple[Way, ...] = (*stairs, *ramps)
    _require_names(levels, ways)
    height = {level.name: level.height for level in levels}
    built = [build(way, height) for way in ways]
    _require_ways_out(levels, ways)
    _require_ways_apart(built)
    floors = [_floor_of(level, built) for level in levels]
    if len(levels) == 1:
        return floors[0].with_regions({levels[0].name: floors[0].walkable, **floors[0].regions})
    _require_levels_apart(levels, floors)
    sheets = [
        *(Sheet(level.name, floor.walkable, level.height) for level, floor in zip(levels, floors, strict=True)),
        *(Sheet(one.way.name, one.area, slopes=one.slopes) for one in built),
    ]
    number = {sheet.name: s for s, sheet in enumerate(sheets)}
    seams = [Seam(line, number[level], number[one.way.name]) for one in built for _, level, line in one.mouths()]
    floor_of = {sheet.name: sheet.area for sheet in sheets}
    sheets, seams, joined = united(sheets, seams)
    laid = lay_out([sheet.area for sheet in sheets])
    sheets = [replace(sheet, offset=tuple(offset)) for sheet, offset in zip(sheets, laid.tolist(), strict=True)]
    offsets = laid[joined]
    shapes: dict[str, Any] = {"exits": {}, "regions": {}, "doors": {}, "thin_walls": []}
    for level, floor, offset in zip(levels, floors, offsets, strict=False):
        _add_shapes(shapes, level, floor, offset)
    taken = {*shapes["exits"], *shapes["regions"]}
    whole = {
        name: shapely.transform(area, lambda points, by=offset: points + by)
        for (name, area), offset in zip(floor_of.items(), offsets, strict=True)
        if name not in taken
    }
    return Geometry.from_sheets(sheets, seams, **{**shapes, "regions": {**whole, **shapes["regions"]}})


def _check_named(kind: str, thing: Any) -> None:
    object.__setattr__(thing, "name", plain_name(f"{kind}: name", thing.name))
    check_fields(f"{kind} {thing.name!r}", thing)
    if isinstance(thing, Stair | Ramp) and len(thing.foot) != 2:
        refuse(f"{kind} {thing.name!r}: foot", thing.foot, "[x, y] in m")


def _sorted(one: float, other: float) -> tuple[float, float]:
    return min(one, other), max(one, other)


def _require_names(levels: Sequence[Level], ways: Sequence[Way]) -> None:
    if not levels:
        raise ValueError("a building needs at least one level")
    names: list[str] = []
    for kind, things in (("level", levels), ("stair or ramp", ways)):
        for thing in things:
            if thing.name in names:
                raise ValueError(
                    f"{kind} {thing.name!r}: a level, stair or ramp before has this name; it must be unique"
                )
            names.append(thing.name)
    for kind in ("exits", "regions", "doors"):
        of_name: dict[str, str] = {}
        for level in levels:
            for name in getattr(level, kind):
                if name in of_name:
                    raise ValueError(
                        f"levels {of_name[name]!r} and {level.name!r} both have {name!r} among their {kind}; names must be "
                        "unique in a building"
                    )
                of_name[name] = level.name


def build(way: Way, height: Mapping[str, float]) -> Built:
    """Return a stair or ramp in true coordinates between levels at these heights [m], by their names.

    Raises
    ------
    ValueError
        If a level is unknown, or it cannot climb so high.

    Warns
    -----
    UserWarning
        If risers are not as high as given.
    """
    what = f"{way.KIND} {way.name!r}"
    base, top = (height[known("level", name, height, f"{what}: ")] for name in (way.lower, way.upper))
    if base > top or (base == top and isinstance(way, Stair)):
        raise ValueError(
            f"{what} climbs from {way.lower!r} at {base:g} m to {way.upper!r} at {top:g} m; the upper level must be higher"
        )
    turn = math.radians(way.direction)
    ahead = np.round([math.cos(turn), math.sin(turn)], 12)
    frame, foot = np.array([ahead, [-ahead[1], ahead[0]]]), np.array(way.foot, dtype=np.float64)

    def corners(piece: Piece) -> Floats:
        (a, b), (c, d) = piece.along, piece.across
        return foot + np.array([(a, c), (b, c), (b, d), (a, d)]) @ frame

    if isinstance(way, Stair):
        steps = way.steps(top - base)
        if abs(steps.riser - way.riser) > _ANOTHER:
            warnings.warn(f"{what}: {steps}, for a height of {top - base:g} m", stacklevel=3)
    pieces = list(way.pieces(base, top))
    slopes = []
    for piece in pieces:
        if piece.height is not None:
            (a, b), (low, high) = piece.along, piece.height
            gradient = (high - low) / (b - a) * ahead
            at_foot = low - (high - low) / (b - a) * a - float(gradient @ foot)
            slopes.append(Slope(Polygon(corners(piece)), (*gradient.tolist(), at_foot), *piece[3:]))
    between = tuple(Polygon(corners(piece)) for piece in pieces if piece.height is None)
    flights = [piece for piece in pieces if piece.height is not None]
    ends = [corners(flights[0])[[0, 3]], corners(flights[-1])[[1, 2]]]
    if flights[-1].along[0] < flights[-1].along[1]:  # goes on ahead
        ends[1] = ends[1][::-1]
    return Built(way, tuple(slopes), between, *ends)


def _require_ways_out(levels: Sequence[Level], ways: Sequence[Way]) -> None:
    out = {level.name for level in levels if level.exits}
    for _ in ways:
        out |= {name for way in ways if out & {way.lower, way.upper} for name in (way.lower, way.upper)}
    for level in levels:
        if level.name not in out:
            raise ValueError(
                f"level {level.name!r} has no way out: it has no exit, and no stair or ramp joins it to a level with one"
            )


def _require_ways_apart(built: Sequence[Built]) -> None:
    for one, other in itertools.combinations(built, 2):
        for a, b in itertools.product(one.slopes, other.slopes):
            common = shapely.intersection(a.area, b.area, grid_size=ROUNDED)
            if common.area > SLIVER:
                points = shapely.get_coordinates(common)
                apart = np.column_stack([points, np.ones(len(points))]) @ (np.array(a.plane) - b.plane)
                if apart.min() < _APART and apart.max() > -_APART:
                    where = place(shapely.get_coordinates(common.representative_point())[0])
                    raise ValueError(
                        f"{one.way.KIND} {one.way.name!r} and {other.way.KIND} {other.way.name!r} overlap at {where}; "
                        f"they must lie beside each other, or {HEADROOM + SLAB:g} m one above the other"
                    )


def _require_levels_apart(levels: Sequence[Level], floors: Sequence[Geometry]) -> None:
    for i, j in itertools.combinations(range(len(levels)), 2):
        apart = abs(levels[i].height - levels[j].height)
        common = shapely.intersection(floors[i].walkable, floors[j].walkable, grid_size=ROUNDED)
        if apart < _APART and common.area > SLIVER:
            where = place(shapely.get_coordinates(common.representative_point())[0])
            raise ValueError(
                f"levels {levels[i].name!r} and {levels[j].name!r} overlap at {where} with {apart:g} m between them; they "
                f"must lie beside each other, or {HEADROOM + SLAB:g} m one above the other"
            )


def _floor_of(level: Level, built: Sequence[Built]) -> Geometry:
    """Return a level as a place of its own in true coordinates; the ends of stairs are exits."""
    with at(f"level {level.name!r}"):
        area = read_area(level.walkable, "walkable area")
        cut = shapely.union_all([one.over(level.name, level.height) for one in built])
        if shapely.intersects(area, cut):
            area = read_area(shapely.difference(area, cut, grid_size=ROUNDED), "floor beside the stairs")
        mouths = {
            f"{SEAM}{one.way.name}/{end}": (one, end, line)
            for one in built
            for end, of_level, line in one.mouths()
            if of_level == level.name
        }
        free = shapely.difference(area, shapely.union_all(read_areas(level.obstacles, "obstacle")), grid_size=ROUNDED)
        for one, end, line in mouths.values():
            lacking = shapely.difference(before(line), shapely.buffer(free, 1e-3))
            if lacking.area > SLIVER:
                where = place(shapely.get_coordinates(lacking.representative_point())[0])
                raise ValueError(
                    f"the {end} of {one.way.KIND} {one.way.name!r} misses its floor at {where}; floor must lie before all of "
                    "its width"
                )
        floor = Geometry.from_polygon(
            area,
            exits={**level.exits, **{name: line for name, (_, _, line) in mouths.items()}},
            obstacles=level.obstacles,
            thin_walls=level.thin_walls,
            regions=level.regions,
            doors=level.doors,
        )
        return floor


def before(line: Floats) -> Area:
    """Return the strip of a level that has to be floor before an end of a stair."""
    return shapely.buffer(shapely.LineString(line), BEHIND, cap_style="flat", single_sided=True)


def _between(slope: Slope, low: float, high: float) -> Area:
    """Return where a slope is between two heights [m]."""
    a, b, c = slope.plane
    steepness = math.hypot(a, b)
    if steepness < 1e-9:
        return slope.area if low < c < high else Polygon()
    up = np.array([a, b]) / steepness
    reach = 2.0 * slope.area.length
    middle = shapely.get_coordinates(slope.area.centroid)[0]
    here = float(up @ middle) * steepness + c
    ends = np.clip([(low - here) / steepness, (high - here) / steepness], -reach, reach)
    aside = reach * np.array([-up[1], up[0]])
    band = Polygon(
        [middle + s * up + side for s, side in zip(ends.repeat(2), (aside, -aside, -aside, aside), strict=True)]
    )
    return shapely.intersection(slope.area, band, grid_size=ROUNDED)


def _add_shapes(shapes: dict[str, Any], level: Level, floor: Geometry, offset: Floats) -> None:
    """Add what a level holds to the shapes of the layout."""

    def moved(shape: Any) -> Any:
        return shapely.transform(shape, lambda points: points + offset)

    names = np.array(floor.exit_names, dtype=object)
    for name in dict.fromkeys(level.exits):
        if (lines := floor.exits[names == name]).size:
            shapes["exits"][name] = moved(shapely.multilinestrings(list(lines)))
    for door, exit_name in zip(floor.doors, floor.exits_of_door, strict=True):
        given = level.doors[door]
        line = moved(shapely.LineString(read_lines([given], door)[0])) if exit_name is None else exit_name
        shapes["doors"][door] = line
    shapes["regions"] |= {name: moved(area) for name, area in floor.regions.items()}
    thin = floor.walls[floor.two_sided & (floor.door_of_wall < 0)]
    shapes["thin_walls"] += [moved(line) for line in shapely.linestrings(thin)]
