"""What was understood of a place, in figures: how large, how wide its exits, where it is narrow, how many people fit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.analysis.figures import listed
from crowd_env.analysis.passages import Passage, narrowest_passages
from crowd_env.analysis.terrain import Terrain, survey
from crowd_env.analysis.ways_out import remarks_on
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import Plain, counted
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parts import closed_off, stuck_bodies
from crowd_env.geometry.placement import lattice
from crowd_env.routing.fields.grid import nearest_nodes
from crowd_env.scenarios.cohorts import People
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.sections import Section

# Beyond these a plan is rarely what it is meant to be.
_WIDE_EXIT, _LARGE, _SMALL = 20.0, 300.0, 2.0  # m
_SIZES = 5  # of bodies that are looked at
_SHOWN = 12  # rows of a kind in a table


@dataclass(frozen=True, eq=False)
class PlanCheck:
    """A place and what follows from it alone, before anyone walks.

    Attributes
    ----------
    name, title
        Of the place.
    geometry
        Its walls, exits, regions and doors; all doors count as open.
    people
        The population.
    position
        (P, 2) m, one draw of where they start; empty if they do not fit.
    radius
        (P,) m, of their bodies.
    cohort
        (P,) to which part of ``people`` they belong.
    terrain
        The distance to the walls.
    widths
        Name of each exit -> its width [m].
    passages
        Name of each exit -> the narrowest passage on the way there; None without a way there from any start.
    unreached
        (polygon, m^2) of the parts from which the smallest body reaches no exit; empty if there is no exit.
    free_area
        m^2, where the center of the smallest body may be.
    room
        Radius of the discs as which people are placed, in radii of their bodies.
    start_area
        m^2, of the regions in which people start; of all if they start anywhere.
    remarks
        A sentence each on what is not plausible.
    sections
        Lines at which people are counted, beside doors and passages.
    """

    name: str
    title: str
    geometry: Geometry
    people: People
    position: Floats
    radius: Floats
    cohort: Ints
    terrain: Terrain
    widths: dict[str, float]
    passages: dict[str, Passage | None]
    unreached: tuple[tuple[Any, float], ...]
    free_area: float
    room: float
    start_area: float
    remarks: tuple[str, ...]
    sections: tuple[Section, ...]

    @cached_property
    def capacity(self) -> int:
        """How many of the largest bodies stand where people start, on a regular lattice: what `run` has room for."""
        radius = self.room * self.people.radius.high
        return sum(len(lattice(self.geometry, radius, region)) for region in start_regions(self.people))

    @property
    def room_words(self) -> str:
        """For about how many people there is room, and where."""
        where = "where they start" if any(part.arrivals is None for part in self.people.parts) else "of the plan"
        return f"about {counted(self.capacity, 'person', 'people')} on the {self.start_area:.1f} m2 {where}"

    @property
    def body(self) -> tuple[float, float]:
        """Diameter of the smallest and the largest body [m]."""
        return 2.0 * self.people.radius.low, 2.0 * self.people.radius.high

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The box (min x, min y, max x, max y) [m] of the walkable area and of what no exit reaches."""
        boxes = np.array([self.geometry.bounds, *(part.bounds for part, _ in self.unreached)])
        x0, y0 = boxes[:, :2].min(axis=0).tolist()
        x1, y1 = boxes[:, 2:].max(axis=0).tolist()
        return x0, y0, x1, y1


def check_plan(
    name: str,
    geometry: Geometry,
    people: People,
    *,
    title: str = "",
    room: float = 1.0,
    seed: int = 0,
    sections: tuple[Section, ...] = (),
) -> PlanCheck:
    """Return what is understood of a place, with or without exits.

    Parameters
    ----------
    room : radius of the discs as which people are placed, in radii of their bodies.
    seed : draws where people start.
    """
    terrain = survey(geometry)
    least = people.radius.low
    remarks = list(_of_size(geometry))
    rng = np.random.default_rng([seed, 0])
    try:
        bodies, position = people.draw(rng, geometry, room)
        radius = bodies.radius
    except ValueError as error:
        radius, position = np.empty(0), np.empty((0, 2))
        remarks.append(f"people cannot be placed: {error}")
    cohort = np.repeat(np.arange(len(people.parts)), [part.people for part in people.parts])
    start_area = sum(geometry.area_of(region) for region in start_regions(people))
    widths = geometry.exit_lengths
    lost = [*geometry.left_out, *(closed_off(geometry.walkable, geometry.ways_on, least) if widths else ())]
    passages = narrowest_passages(geometry, terrain, _starts(terrain, people, geometry, position)) if widths else {}
    there = np.repeat([part.arrivals is None for part in people.parts], [part.people for part in people.parts])
    if len(radius):  # arriving people are not drawn
        position, radius, cohort = position[there], radius[there], cohort[there]
    remarks += _of_exits(geometry, passages, people)
    for exit, far in geometry.close_behind.items():
        way = f"floor begins {far:.2f} m behind exit {exit!r}"
        remarks.append(f"{way}: people vanish halfway, and more pass than through a free door; draw the ground between")
    remarks += _of_stuck(geometry, people) if widths else []
    return PlanCheck(
        name=name,
        title=title,
        geometry=geometry,
        people=people,
        position=position,
        radius=radius,
        cohort=cohort[: len(radius)],
        terrain=terrain,
        widths=widths,
        passages=passages,
        unreached=tuple((part, float(part.area)) for part in lost),
        free_area=float(terrain.free(least).sum()) * terrain.spacing**2,
        room=room,
        start_area=start_area,
        remarks=tuple(remarks),
        sections=sections,
    )


def start_regions(people: People) -> Sequence[str | None]:
    """Return the regions in which people are placed at the start; None = all of the place, which counts alone."""
    regions = dict.fromkeys(part.start_region for part in people.parts if part.starts is None and part.arrivals is None)
    return [None] if None in regions or not regions else [*regions]


def _starts(terrain: Terrain, people: People, geometry: Geometry, position: Floats) -> Floats:
    """Return (rows, cols) how many people start at each node; a cohort is spread evenly over its region."""
    shape = terrain.clearance.shape
    starts = np.zeros(shape)
    begin = 0
    for part in people.parts:
        rows = slice(begin, begin + part.people)
        begin += part.people
        if part.starts is not None or part.arrivals is not None:
            at = position[rows] if len(position) and part.arrivals is None else part.spots(geometry)
            np.add.at(starts, nearest_nodes(at, terrain.origin, terrain.spacing, shape), part.people / len(at))
            continue
        here = terrain.free(part.radius.low)
        if part.start_region is not None:
            row, col = np.nonzero(here)
            points = terrain.origin + terrain.spacing * np.column_stack([col, row])
            here[row, col] = geometry.contains(points, part.start_region)
        starts[here] += part.people / max(int(here.sum()), 1)
    return starts


def _of_size(geometry: Geometry) -> Iterable[str]:
    x0, y0, x1, y1 = geometry.bounds
    across = max(x1 - x0, y1 - y0)
    if not _SMALL <= across <= _LARGE:
        size = f"{x1 - x0:.1f} m x {y1 - y0:.1f} m, which is {'large' if across > _LARGE else 'small'}"
        yield f"the plan is {size}: are its coordinates in meters?"


def _of_exits(geometry: Geometry, passages: dict[str, Passage | None], people: People) -> Iterable[str]:
    least, most = 2.0 * people.radius.low, 2.0 * people.radius.high
    for name, width in geometry.exit_lengths.items():
        exit_is = f"exit {name!r} is {width:.2f} m wide"
        if width < least:
            yield f"{exit_is}, narrower than the smallest body ({least:.2f} m): nobody passes"
            continue
        if width < most:
            yield f"{exit_is}, narrower than the largest bodies ({most:.2f} m)"
        elif width > _WIDE_EXIT:
            yield f"{exit_is}, which is rare: is it meant so?"
        passage = passages[name]
        if passage is None:
            yield f"nobody who starts has a way to exit {name!r}"
        else:
            yield from _of_passage(geometry, passage, width, least, most)


def _of_stuck(geometry: Geometry, people: People) -> Iterable[str]:
    """Say which bodies cannot get out from where they may start."""
    for part in people.parts:
        where = geometry.walkable if part.start_region is None else geometry.regions[part.start_region]
        radii = np.linspace(part.radius.low, part.radius.high, _SIZES).tolist()
        starts = where if part.starts is None and part.arrivals is None else part.spots(geometry)
        for radius, at in stuck_bodies(geometry.walkable, geometry.ways_on, radii, starts):
            yield f"who starts around {spot(geometry, at)} and is {2 * radius:.2f} m wide or more cannot get out"


def _of_passage(geometry: Geometry, passage: Passage, width: float, least: float, most: float) -> Iterable[str]:
    for gap, share in ((passage.gap, passage.behind), (passage.tighter, passage.few)):
        if gap is None or gap.width >= min(most, width):
            continue
        who = "all" if share > 0.995 else f"{100 * share:.2g} % of those"
        bodies = f"the smallest body ({least:.2f} m)" if gap.width < least else f"the largest bodies ({most:.2f} m)"
        yield (
            f"{who} who start pass {gap.width:.2f} m at {spot(geometry, gap.line)} on the way to exit "
            f"{passage.exit!r}, narrower than {bodies}"
        )


def spot(geometry: Geometry, points: ArrayLike) -> str:
    """Return where the middle of points (..., 2) is, to the centimeter; in a building on which storey, in true coordinates."""
    (x, y), sheet = geometry.on_sheets(np.reshape(points, (-1, 2)).mean(axis=0))
    storey = "" if geometry.building is None else f"{geometry.building.sheets[sheet].name} "
    return f"{storey}({x:.2f}, {y:.2f})"


def check_place(scenario: Scenario, seed: int = 0) -> PlanCheck:
    """Return what is understood of a scenario."""
    check = check_plan(
        scenario.name,
        scenario.geometry,
        scenario.population,
        title=scenario.title,
        room=scenario.room,
        seed=seed,
        sections=scenario.sections,
    )
    return replace(check, remarks=(*check.remarks, *remarks_on(scenario)))


def plain_check(check: PlanCheck) -> Plain:
    """Return what is known of a place, ready for JSON: lengths in meters, areas in square meters."""
    geometry = check.geometry

    def plain_exit(name: str, width: float) -> Plain:
        lines = geometry.exits[[other == name for other in geometry.exit_names]].tolist()
        found = check.passages[name]
        narrowest = None
        if found is not None:
            gap = {"width": found.gap.width, "line": found.gap.line.tolist()}
            narrowest = {**gap, "is_exit": found.is_exit, "share_of_people": found.behind}
        return {"name": name, "width": width, "lines": lines, "narrowest_passage": narrowest}

    return {
        "name": check.name,
        "bounds": list(geometry.bounds),
        "area": geometry.area,
        "exits": [plain_exit(*exit) for exit in check.widths.items()],
        "regions": {name: geometry.area_of(name) for name in geometry.regions},
        "doors": list(geometry.doors),
        "sections": {one.name: one.length_on(geometry) for one in check.sections},
        "not_reached": [{"area": area, "at": _inside(part)} for part, area in check.unreached],
        "people": check.people.people,
        "body_diameter": list(check.body),
        "free_area": check.free_area,
        "capacity": check.capacity,
        "remarks": list(check.remarks),
    }


def cells(check: PlanCheck) -> dict[str, str]:
    """Return the rows of the table of a place: label -> cell."""
    geometry = check.geometry
    x0, y0, x1, y1 = geometry.bounds
    lost = [f"{area:.3g} m2 around {spot(geometry, _inside(part))}" for part, area in check.unreached]
    exits = [f"{name} {width:.2f} m" for name, width in check.widths.items()]
    rows = {
        "plan": f"{geometry.area:.1f} m2 in {x1 - x0:.2f} m x {y1 - y0:.2f} m{_of_sheets(geometry)}",
        "  x, y": f"{x0:.2f} to {x1:.2f} m, {y0:.2f} to {y1:.2f} m",
        "exits": _rows(exits) if exits else "none yet: give --exit x1,y1,x2,y2, points on the edge",
        "narrowest passage": _rows([_passage(check, name) for name in check.passages]),
        "regions": _rows([f"{name} {geometry.area_of(name):.1f} m2" for name in geometry.regions]),
        "doors": _rows(list(geometry.doors)),
        "sections": _rows([f"{one.name} {one.length_on(geometry):.2f} m" for one in check.sections]),
        "no exit reaches": _rows(lost),
        "people": f"{counted(check.people.people, 'person', 'people')}, bodies {body_width(check)} wide",
        "room for": check.room_words,
        "  centers of bodies": f"{check.free_area:.1f} m2",
        "check": _rows(check.remarks),
    }
    return {label: cell for label, cell in rows.items() if cell}


def _of_sheets(geometry: Geometry) -> str:
    if geometry.building is None:
        return ""
    sheets = geometry.building.sheets
    levels = sum(sheet.level == sheet.level for sheet in sheets)
    return (
        f": {counted(levels, 'level', 'levels')} and {counted(len(sheets) - levels, 'stair', 'stairs')}, side by side"
    )


def body_width(check: PlanCheck) -> str:
    """Return the diameters of bodies in words."""
    least, most = check.body
    return f"{least:.2f} m" if most - least < 1e-9 else f"{least:.2f} to {most:.2f} m"


def _rows(items: Sequence[str]) -> str:
    return listed(items, _SHOWN, "\n")


def _inside(part: Any) -> list[float]:
    at = part.representative_point()
    return [at.x, at.y]


def _passage(check: PlanCheck, name: str) -> str:
    passage = check.passages[name]
    if passage is None:
        return f"to {name}: no way"
    share = 100.0 * passage.behind
    where = (
        "the exit itself"
        if passage.is_exit
        else f"at {spot(check.geometry, passage.gap.line)}, for {share:.0f} % of the people"
    )
    return f"to {name}: {passage.gap.width:.2f} m, {passage.gap.width / check.body[1]:.1f} bodies, {where}"
