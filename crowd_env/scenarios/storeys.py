"""Buildings in one file: all levels of a floor plan together, and the stairs and ramps that it draws between them.

A drawn stair is an area, or the line from its foot to its head, on two levels.  A stair of the generator of
`crowd_env.scenarios.buildings` is fitted into it: straight, or of two flights where only these lead from floor to floor.
"""

import itertools
import math
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain, at, counted, texts
from crowd_env.geometry.parsing import SLIVER, Area, place
from crowd_env.scenarios.buildings import RISERS, TREADS, Built, Ramp, Stair, Way, before, build
from crowd_env.scenarios.floor_plan import PEOPLE, people_on
from crowd_env.scenarios.plans.floor_plan import DrawnStair, FloorPlan, listed
from crowd_env.scenarios.plans.reading import levels_in, read_plan, split_level
from crowd_env.scenarios.project import Project, corners

STOREY = 3.5  # m between levels; drawings of levels give no heights

_SAME = 0.5  # share of an area that two levels have in common, if it is one stair
_FILLED = 0.8  # share of its rectangle that the area of a stair has
_BESIDE = 0.2  # m; bodies do not come nearer to walls
_LOBBY = 1.0  # m of floor before a stair in its own room
_ROOM = 1.0  # m2 of floor beyond a stair to which it must lead
_CORE = 0.1  # m between two flights
_NARROWEST, _WIDEST = 0.6, 50.0  # m, of a flight
_WIDTH = 1.5  # m, of a stair that is drawn as a line without a width
_BENT = 1.05  # a line longer than this times the way between its ends is no straight stair
_SHORT = 0.5  # m by which such a line may end before its floor
_USUAL = Stair("usual", "", "", (0.0, 0.0), 0.0)


def has_storeys(path: str | Path) -> bool:
    """Return whether a floor plan has several levels, of which the path names none.

    Raises
    ------
    ValueError
        If the file cannot be read.
    """
    drawing, level = split_level(path)
    with at(str(drawing)):
        return level is None and len(levels_in(drawing)) > 1


class _Storey(NamedTuple):
    name: str
    height: float  # m
    plan: FloorPlan


def building_in(path: str | Path, exits: Sequence[str] = (), *, beside: Path | None = None, **how: Any) -> Project:
    """Return the levels of a floor plan and the stairs between them as a scenario file.

    Levels that no stair joins to an exit are left out.

    Parameters
    ----------
    path : of a file with several levels, of which none is named.
    exits : on the level nearest to 0, in place of its own.
    beside : the scenario file that names the drawing; by default one in the same folder.
    how : unit, layers and origin, as `read_plan` takes them.

    Raises
    ------
    ValueError
        If the file cannot be read, or no level is joined to another; the message names the file.
    """
    drawing = Path(path)
    numbers = levels_in(drawing)
    with at(str(drawing)):
        texts("exits", exits)
    if not np.isfinite(list(numbers.values())).all():
        numbers = dict(zip(numbers, range(len(numbers)), strict=True))
    ground = min(numbers, key=lambda name: (abs(numbers[name]), numbers[name]))
    storeys = [
        _Storey(name, STOREY * number, read_plan(drawing, exits if name == ground else (), **{**how, "level": name}))
        for name, number in numbers.items()
    ]
    notes = [f"heights of levels are not drawn: taken as {STOREY:g} m apart"]
    ways = _ways_of(storeys, notes)
    joined = _joined(storeys, ways)
    if ways and not joined:
        raise ValueError(
            f"{drawing}: a floor plan needs at least one exit: --exit x1,y1,x2,y2 on level {ground}, which crowd-env plan "
            f"{drawing.name}:{ground} draws"
        )
    if len(joined) < 2:
        read_plan(drawing, exits, **how)  # raises: one has to be chosen
    if len(joined) < len(storeys):
        lost = [storey.name for storey in storeys if storey.name not in joined]
        many = counted(len(lost), "level", "levels")
        notes.append(
            f"left out: {many} that no stair joins to an exit, {listed(lost)}; {drawing.name}:{lost[0]} is one alone"
        )
    storeys = [storey for storey in storeys if storey.name in joined]
    ways = [way for way in ways if way.lower in joined]
    file = Path(os.path.relpath(drawing.absolute(), (beside or drawing).absolute().parent)).as_posix()
    content = {
        "title": f"floor plan {drawing.name}, all levels",
        "levels": _levels(
            storeys, file, {key: one for key, one in how.items() if one is not None}, ground if exits else ""
        ),
        **{f"{kind}s": [_table(way) for way in ways if kind == way.KIND] for kind in ("stair", "ramp")},
        **_people(storeys),
    }
    return Project({key: one for key, one in content.items() if one}, {}, tuple(notes))


def _joined(storeys: Sequence[_Storey], ways: Sequence[Way]) -> set[str]:
    """Return the levels from which stairs lead to an exit."""
    found = {storey.name for storey in storeys if storey.plan.exits}
    for _ in ways:
        found |= {name for way in ways if found & {way.lower, way.upper} for name in (way.lower, way.upper)}
    return found


def _names(storeys: Sequence[_Storey], storey: _Storey, key: str) -> dict[str, str]:
    """Return drawn name -> name in the building; one that two levels have gets that of its level besides."""
    taken = [name for one in storeys for name in getattr(one.plan, key)]
    return {name: name if taken.count(name) == 1 else f"{name} of {storey.name}" for name in getattr(storey.plan, key)}


def _people(storeys: Sequence[_Storey]) -> Plain:
    """Return people in the start areas of all levels, or anywhere."""
    cohorts = [
        {"people": part.people, "start_region": _names(storeys, storey, "regions")[part.start_region]}
        for storey in storeys
        if storey.plan.starts
        for part in people_on(storey.plan).parts
        if part.start_region is not None
    ]
    return {"cohorts": cohorts} if cohorts else {"population": {"people": PEOPLE}}


def _levels(storeys: Sequence[_Storey], file: str, how: Plain, typed: str) -> list[Plain]:
    """Return the tables of levels; the exits of one are typed."""
    tables: list[Plain] = []
    for storey in storeys:
        shapes: dict[str, Plain] = {}
        for key in ("exits", "regions"):
            drawn: Mapping[str, Any] = getattr(storey.plan, key)
            written = key == "exits" and storey.name == typed
            own = _names(storeys, storey, key).items()
            given = {new: corners(drawn[name]) if written else name for name, new in own}
            shapes |= {key: given} if given else {}
        tables.append(
            {"name": storey.name, "height": storey.height, "file": file, "level": storey.name, **how, **shapes}
        )
    return tables


def _table(way: Way) -> Plain:
    """Return the fields of a stair or ramp that are not the usual ones."""
    usual = {one.name: one.default for one in fields(way)}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name in usual
        if (value := getattr(way, name)) != usual[name]
    }


def _ways_of(storeys: Sequence[_Storey], notes: list[str]) -> list[Way]:
    """Return the stairs and ramps that fit where two levels draw one, the others as notes."""
    built: list[Built] = []
    alone = {(s.name, k) for s in storeys for k in range(len(s.plan.stairs))}
    for i, lower in enumerate(storeys):
        for k, drawn in enumerate(lower.plan.stairs):
            there = (
                (upper, n)
                for upper in storeys[i + 1 :]
                for n, one in enumerate(upper.plan.stairs)
                if _is_one(drawn, one)
            )
            upper, n = next(there, (None, 0))
            if upper is None:
                continue
            alone -= {(lower.name, k), (upper.name, n)}
            names = {one.way.name for one in built}
            name = f"{drawn.name or drawn.kind} from {lower.name} to {upper.name}"
            name = next(one for one in (name, *(f"{name}, {m}" for m in range(2, 1000))) if one not in names)
            fit = _fitted(name, drawn, lower, upper, built)
            if fit is None:
                size = " x ".join(f"{side:.1f}" for side in _sides(drawn.shape))
                where = place(shapely.get_coordinates(drawn.shape.centroid)[0].round(2))
                notes.append(
                    f"left out: {name}, {size} m at {where}: none of its forms climbs {upper.height - lower.height:g} m there "
                    "from floor to floor"
                )
            else:
                built.append(fit)
    if alone:
        notes.append(f"left out: {counted(len(alone), 'stair', 'stairs')} on one level alone")
    return [one.way for one in built]


def _is_one(one: DrawnStair, other: DrawnStair) -> bool:
    if one.kind != other.kind:
        return False
    if one.shape.geom_type != "Polygon" or other.shape.geom_type != "Polygon":
        return bool(shapely.hausdorff_distance(one.shape, other.shape) < _SAME)
    return bool(shapely.intersection(one.shape, other.shape).area > _SAME * min(one.shape.area, other.shape.area))


def _frame(shape: Area) -> tuple[Floats, Floats]:
    """Return the middle (2,) of the rectangle of an area, and its longer and shorter side as vectors (2, 2)."""
    frame = shapely.get_coordinates(shapely.oriented_envelope(shape))
    sides = np.diff(frame[:3], axis=0)
    return frame[:4].mean(axis=0), sides[np.argsort(-np.hypot(*sides.T), kind="stable")]


def _sides(shape: Any) -> tuple[float, ...]:
    return (shape.length,) if shape.geom_type == "LineString" else tuple(np.hypot(*_frame(shape)[1].T).tolist())


def _fitted(name: str, drawn: DrawnStair, lower: _Storey, upper: _Storey, others: Sequence[Built]) -> Built | None:
    """Return the form of a stair that leads from floor to floor by the most usual steps, None if there is none."""
    heights = {lower.name: lower.height, upper.name: upper.height}
    forms = _forms(name, drawn, lower.name, upper.name, upper.height - lower.height)
    for way in sorted(forms, key=lambda way: abs(getattr(way, "tread", _USUAL.tread) - _USUAL.tread)):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # risers are whole in a drawing too
                one = build(way, heights)
        except ValueError:
            continue
        ends = zip((lower, upper), one.mouths(), strict=True)
        if all(_leads_on(one, line, storey, drawn, others) for storey, (_, _, line) in ends):
            return one
    return None


def _leads_on(one: Built, line: Floats, storey: _Storey, drawn: DrawnStair, others: Sequence[Built]) -> bool:
    """Return whether floor lies before an end of a stair, from which people get off its own area."""
    cut = shapely.union_all([built.over(storey.name, storey.height) for built in (*others, one)])
    free = shapely.difference(storey.plan.walkable, cut)
    strip = before(line)
    if shapely.difference(strip, shapely.buffer(free, 1e-3)).area > SLIVER:
        return False
    for part in shapely.get_parts(shapely.buffer(free, -_BESIDE)):
        if shapely.dwithin(part, strip, _BESIDE + 0.05) and shapely.difference(part, drawn.shape).area > _ROOM:
            return True
    return False


def _forms(name: str, drawn: DrawnStair, lower: str, upper: str, rise: float) -> Iterator[Way]:
    """Yield stairs or ramps that fill what is drawn."""
    risers = max(round(rise / _USUAL.riser), math.ceil(rise / RISERS.high))
    if drawn.shape.geom_type == "LineString":
        foot, head = shapely.get_coordinates(drawn.shape)[[0, -1]]
        run = math.dist(foot, head)
        if run > 0.0 and drawn.shape.length < _BENT * run:
            ahead, width = (head - foot) / run, drawn.width or _WIDTH
            for low, high in itertools.product((0.0, _SHORT), repeat=2):
                start, length = foot - low * ahead, low + run + high
                yield from _straight(name, drawn.kind, lower, upper, start, ahead, length, width, risers)
        return
    if drawn.shape.area < _FILLED * shapely.oriented_envelope(drawn.shape).area:
        return
    middle, sides = _frame(drawn.shape)
    lengths = np.hypot(*sides.T)
    for deep, across in ((0, 1), (1, 0)):
        for sign in (1.0, -1.0):
            ahead, depth, width = sign * sides[deep] / lengths[deep], float(lengths[deep]), float(lengths[across])
            foot = middle - 0.5 * depth * ahead
            yield from _straight(name, drawn.kind, lower, upper, foot, ahead, depth, width, risers)
            if drawn.kind == "stair":
                yield from _turning(name, lower, upper, foot, ahead, depth, width, risers)


def _straight(
    name: str, kind: str, lower: str, upper: str, foot: Floats, ahead: Floats, depth: float, width: float, risers: int
) -> Iterator[Way]:
    about: dict[str, Any] = {"direction": _degrees(ahead), "width": round(width, 3)}
    if not _NARROWEST <= width <= _WIDEST:
        return
    if kind == "ramp":
        yield Ramp(name, lower, upper, _point(foot), length=round(depth, 3), **about)
        return
    for lobbies in (0.0, 2 * _LOBBY, _LOBBY):
        tread = (depth - lobbies) / risers
        if lobbies and tread > _USUAL.tread:
            lobbies, tread = depth - risers * _USUAL.tread, _USUAL.tread
        at_foot = (0.0, lobbies) if lobbies == _LOBBY else (0.5 * lobbies,)
        if tread in TREADS:
            for before_it in at_foot:
                yield Stair(name, lower, upper, _point(foot + before_it * ahead), tread=round(tread, 4), **about)


def _turning(
    name: str, lower: str, upper: str, foot: Floats, ahead: Floats, depth: float, width: float, risers: int
) -> Iterator[Stair]:
    flight, run = 0.5 * (width - _CORE), (risers + 1) // 2
    if not _NARROWEST <= flight <= _WIDEST:
        return
    landing = min(flight, 2.0)
    for lobby in (0.0, _LOBBY):
        tread = (depth - landing - lobby) / run
        if lobby and tread > _USUAL.tread:
            lobby, tread = depth - landing - run * _USUAL.tread, _USUAL.tread
        for turns, side in (("u-left", 1.0), ("u-right", -1.0)):
            if tread in TREADS:
                aside = -side * 0.5 * (flight + _CORE) * np.array([-ahead[1], ahead[0]])
                shape: dict[str, Any] = {
                    "turns": turns,
                    "landing": round(landing, 3),
                    "core": _CORE,
                    "tread": round(tread, 4),
                }
                at_foot = _point(foot + lobby * ahead + aside)
                yield Stair(name, lower, upper, at_foot, _degrees(ahead), round(flight, 3), **shape)


def _degrees(ahead: Floats) -> float:
    return round(math.degrees(math.atan2(ahead[1], ahead[0])), 3) % 360.0


def _point(point: Floats) -> tuple[float, float]:
    x, y = point.round(3).tolist()
    return x, y
