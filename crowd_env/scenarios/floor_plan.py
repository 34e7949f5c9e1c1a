"""Scenarios on floor plans in files: default starts of the people, and recorded starting positions."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import Plain, at, counted, known, refuse, table, texts
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import SLIVER, Area, read_area, read_exits
from crowd_env.geometry.placement import lattice
from crowd_env.routing.speed_map import SpeedZone
from crowd_env.scenarios.arrivals import Arrivals
from crowd_env.scenarios.cohorts import People, as_people, people_of
from crowd_env.scenarios.plans.floor_plan import FloorPlan, Start, listed
from crowd_env.scenarios.plans.reading import is_name, read_plan
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario

PEOPLE = 20  # on a plan that does not say how many
_FLOOR = 0.9  # share of a start area; walls and columns take less
_CROWDED = 3.0  # people/m^2; more than these may not fit: a file with more means that they come one after the other


def scenario_from_plan(
    path: str | Path,
    *,
    exits: Sequence[str] | Mapping[str, Any] = (),
    unit: str | None = None,
    level: str | float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
    origin: Sequence[float] = (0.0, 0.0),
    people: int | None = None,
    population: People | Plain | Sequence[Any] | None = None,
    time_limit: float | None = None,
    regions: Mapping[str, Any] | None = None,
    obstacles: Sequence[Any] = (),
    thin_walls: Sequence[Any] = (),
    doors: Mapping[str, Any] | None = None,
    **fields: Any,
) -> Scenario:
    """Return a scenario on a floor plan in a file of any kind that `crowd_env.scenarios.plans` reads.

    Parameters
    ----------
    path : the file.
    exits : each "x1,y1,x2,y2" or a LINESTRING on the edge of the plan, or a POLYGON that people walk into; by default the
        exits of the file.  Or name -> shape in meters or an exit of the file, as in a project.
    unit : m, cm, mm, ft or in, of the coordinates of plan and exits; None = meters, unless that is implausible and the file
        names another.
    level : of a file with several, such as GeoJSON; or a part of the path, such as ``house.geojson:1``.
    layers, origin : see `crowd_env.scenarios.plans.reading.read_plan`.
    people : number of people; by default 20, or the file's number.
    population : see `Scenario`; by default people of the default kind, in the start areas of the file if it has any.
    time_limit : s; by default long enough to walk out and to queue at the exits, at least 300 s.
    regions : name -> area [m] beside those of the file, or one of these by another name.
    obstacles, thin_walls, doors : as `Geometry.from_polygon` takes them.
    fields : of `Scenario`, such as zones, rules and sections.

    Raises
    ------
    ValueError
        If the file cannot be read or the plan cannot be used; the message names the file.
    ModuleNotFoundError
        If the library that reads such files is not installed.

    Warns
    -----
    UserWarning
        If shapes are dropped or repaired, and if the plan is so large that it may be in another unit.
    """
    named = exits if isinstance(exits, Mapping) else None
    if named and not all(isinstance(one, str | Sequence | np.ndarray | BaseGeometry) for one in named.values()):
        refuse("exits", exits, "names and their lines, areas or exits of the file")
    how: Plain = {"unit": unit, "level": level, "layers": layers, "origin": origin}
    plan = read_plan(path, () if named else texts("exits", exits), beside=named, **how)
    with at(str(plan.path)):
        plan = with_own(plan, exits=named, regions=regions)
    crowd = as_people(population)
    if crowd is None:
        crowd = people_on(plan, people)
    elif people is not None:
        crowd = crowd.changed(people=people)
    beside = {"obstacles": obstacles, "thin_walls": thin_walls, "doors": doors}
    return scenario_on(plan, crowd, time_limit=time_limit, beside=beside, **fields)


def scenario_on(
    plan: FloorPlan, population: People, *, time_limit: float | None = None, beside: Plain | None = None, **options: Any
) -> Scenario:
    """Return a scenario on a floor plan; ``options`` are fields of `Scenario`, ``beside`` are doors and more of its `Geometry`.

    Raises
    ------
    ValueError
        If the plan cannot be used, or the people do not fit.

    Warns
    -----
    UserWarning
        With the notes of the plan, and for repairs of its walls and exits.
    """
    for note in plan.notes:
        warnings.warn(note, stacklevel=3)
    if not plan.exits:
        raise ValueError(
            f"{plan.path}: a floor plan needs at least one exit: --exit 5,2,5,3, or one in geometry.exits of a project"
        )
    with at(str(plan.path)):
        geometry = Geometry.from_polygon(
            plan.walkable, exits=plan.exits, narrowest=population.radius.low, **(beside or {})
        )
        geometry = geometry.with_regions(_reached(geometry, plan))
        limit = 1.0 if time_limit is None else time_limit
        zones = tuple(SpeedZone(one, factor=by) for one, by in plan.speeds.items() if one in geometry.regions)
        taken = {part.route for part in population.parts}
        routes = {way.name: way for start in plan.starts.values() if (way := start.route) and way.name in taken}
        drawn = {"zones": zones, "routes": tuple(routes.values())}
        given = {"name": plan.name, "title": plan.title, **drawn, **options}
        place = Scenario(**given, geometry=geometry, population=population, time_limit=limit)
        note_cut_starts(place)
        return place.with_enough_time() if time_limit is None else place


def note_cut_starts(place: Scenario) -> None:
    """Warn of start areas of which a notable part is no floor: fewer people stand there than the area seems to hold."""
    for name in dict.fromkeys(part.start_region for part in place.population.parts if part.start_region is not None):
        drawn, floor = place.geometry.regions[name].area, place.geometry.area_of(name)
        if floor < _FLOOR * drawn:
            warnings.warn(f"start area {name!r}: {floor:.3g} m2 of its {drawn:.3g} m2 are floor", stacklevel=3)


def with_own(
    plan: FloorPlan,
    walkable: Any = None,
    exits: Mapping[str, Any] | None = None,
    regions: Mapping[str, Any] | None = None,
) -> FloorPlan:
    """Return a floor plan with more floor and regions, and with these exits in place of its own.

    A name in place of a shape is that of an exit or region of the plan, which then has another name.

    Raises
    ------
    ValueError
        If the plan has no shape of that name, or a shape is wrong.
    """
    for key, shapes in (("exits", exits), ("regions", regions)):
        if shapes is not None:
            table(key, shapes, "names and shapes")
    if walkable is not None:
        floor = shapely.union(plan.walkable, read_area(walkable, "walkable area"))
        plan = replace(plan, walkable=read_area(floor, "walkable area"))
    if exits is not None:
        today = {shape: name for name, shape in exits.items() if isinstance(shape, str) and shape in plan.exits}
        starts = {
            name: start._replace(exits=tuple(today[one] for one in start.exits if one in today))
            for name, start in plan.starts.items()
        }
        plan = replace(plan, exits=read_exits(_taken("exits", exits, plan.exits, plan)), starts=starts)
    own = _taken("regions", {} if regions is None else regions, plan.regions, plan)
    renamed = {
        shape: name for name, shape in (regions or {}).items() if isinstance(shape, str) and shape in plan.regions
    }
    rest = {name: shape for name, shape in plan.regions.items() if name not in renamed}
    return replace(
        plan,
        regions=rest | {name: read_area(shape, f"region {name!r}") for name, shape in own.items()},
        starts={
            renamed.get(name, name): start._replace(via=tuple(renamed.get(one, one) for one in start.via))
            for name, start in plan.starts.items()
        },
        speeds={renamed.get(name, name): factor for name, factor in plan.speeds.items()},
    )


def _taken(key: str, own: Mapping[str, Any], drawn: Mapping[str, Any], plan: FloorPlan) -> dict[str, Any]:
    """Return shapes, with the shapes of the plan for their names."""
    names = {name: shape for name, shape in own.items() if is_name(shape, drawn)}
    for name, shape in names.items():
        if shape not in drawn:
            there = f"its {key} are {listed(drawn, most=12)}" if drawn else f"it has no {key}"
            raise ValueError(f"{key}.{name} is {shape!r}, which {plan.path.name} does not have; {there}")
    return {name: drawn[shape] if name in names else shape for name, shape in own.items()}


def area_on(plan: FloorPlan, region: str | None = None) -> float:
    """Return the walkable area [m2] of a floor plan, or of a region of it.

    Raises
    ------
    ValueError
        If there is no such region.
    """
    shape = plan.walkable if region is None else plan.regions[known("region", region, plan.regions)]
    return float(shapely.intersection(plan.walkable, shape).area)


def _reached(geometry: Geometry, plan: FloorPlan) -> dict[str, Area]:
    """Return the regions with a way to an exit, and the start regions, which must have one."""
    reached = {
        name: shape
        for name, shape in plan.regions.items()
        if name in plan.starts or shapely.intersection(geometry.walkable, shape).area > SLIVER
    }
    lost = {name: shape for name, shape in plan.regions.items() if name not in reached}
    off = [name for name, shape in lost.items() if shapely.intersection(plan.walkable, shape).area <= SLIVER]
    for names, why in ((off, "off the floor"), ([name for name in lost if name not in off], "that no exit reaches")):
        if names:
            regions = counted(len(names), "region", "regions")
            warnings.warn(f"left out: {regions} {why}, {listed(names)}", stacklevel=4)
    return reached


def people_on(plan: FloorPlan, people: int | None = None, **fields: Any) -> People:
    """Return people for a plan: in its start areas, shared out by the numbers of the file or by area, or anywhere.

    Parameters
    ----------
    people : number; by default the file's, if there is room for all at once, else 20, or fewer in small areas.
    fields : of their `Population`; recorded ``starts`` take the place of start areas.
    """
    if fields.get("starts") is not None or not plan.starts:
        return Population(**{"people": PEOPLE if people is None else people, **fields})
    come = people is None and not fields.get("arrivals")
    coming = {name: start for name, start in plan.starts.items() if come and start.arrivals}
    late = [
        Population(
            **{**_goal(start), **fields, "start_region": name},
            people=sum(many for _, many in start.arrivals),
            arrivals=Arrivals(timetable=tuple(start.arrivals)),
        )
        for name, start in coming.items()
    ]
    areas = {name: area_on(plan, name) for name in plan.starts if name not in coming}
    if not areas:
        return people_of(late)
    most = _room(plan, Population(**{"people": 1, **fields}).radius.high, beside=people is None)
    spread = {name: max(1, int(_CROWDED * area)) for name, area in areas.items()}
    room = {name: min(many, most.get(name, many)) for name, many in spread.items()}
    small = [name for name, many in room.items() if not many]
    if small and len(small) < len(room):
        narrow = counted(len(small), "start area", "start areas")
        warnings.warn(
            f"left out: {narrow} that bodies do not fit into beside the others, {listed(small)}", stacklevel=2
        )
        room = {name: many for name, many in room.items() if many}
    said = {name: many for name in room if (many := plan.starts[name].people) is not None}
    if len(said) == len(room) and all(many <= room[name] for name, many in said.items()):
        shares, usual = said, sum(said.values())
    else:
        shares = {name: max(1, round(1000.0 * areas[name] / sum(areas.values()))) for name in room}
        usual = max(min(PEOPLE, sum(room.values())), len(room))
        if people is None:
            shares = {name: max(1, many) for name, many in room.items()}
            if said or usual < PEOPLE:
                said = {name: one.people for name, one in plan.starts.items() if one.people is not None}
                close = f"{PEOPLE} people would stand closer than {_CROWDED:g} a m2"
                wanted = f"the file says {sum(said.values())} people" if said else close
                warnings.warn(f"{wanted}; {usual} start in the start areas of the plan, --people decides", stacklevel=2)
    goals = {name: {} if fields.get("route") else _goal(plan.starts[name]) for name in shares}
    parts = [Population(**{**goals[name], **fields, "people": n, "start_region": name}) for name, n in shares.items()]
    there = people_of(parts).changed(people=usual if people is None else people)
    return people_of([*there.parts, *late])


def _goal(start: Start) -> Plain:
    return {"exits": start.exits} if start.route is None else {"route": start.route.name}


def _room(plan: FloorPlan, radius: float, beside: bool) -> dict[str, int]:
    """Return the capacity of each start area for bodies of ``radius`` [m], beside the people of earlier areas if ``beside``.

    Empty if the drawing makes no valid place.
    """
    areas = [shape for shape in plan.exits.values() if "Polygon" in shape.geom_type]
    starts = {name: plan.regions[name] for name, start in plan.starts.items() if not start.arrivals}
    try:
        with warnings.catch_warnings():  # its warnings appear where the plan becomes a place
            warnings.simplefilter("ignore")
            closed = Geometry.from_polygon(shapely.difference(plan.walkable, shapely.union_all(areas)), regions=starts)
    except (ValueError, shapely.errors.ShapelyError):
        return {}
    centers, taken = shapely.buffer(closed.walkable, -radius), shapely.Point()
    room = {}
    for name, area in starts.items():
        points = shapely.points(lattice(closed, radius, name))
        free = ~shapely.dwithin(points, taken, 2.0 * radius * (1.0 - 1e-9)) if beside else points
        room[name] = int(np.count_nonzero(free))
        if room[name]:
            taken = shapely.union(taken, shapely.intersection(area, centers))
    return room
