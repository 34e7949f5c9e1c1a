"""Rooms of two papers, and places drawn for this project or after an experiment: each is a function of its sizes."""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, Range, number, whole
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.routing.spec import ControlRule
from crowd_env.routing.speed_map import SpeedZone
from crowd_env.scenarios.cohorts import Cohorts
from crowd_env.scenarios.distributions import LogNormal, Normal, Uniform
from crowd_env.scenarios.population import TABLE_4, Population
from crowd_env.scenarios.scenario import COMMON, FULL_SPEED, Scenario, changed_place
from crowd_env.scenarios.shapes import circle, rectangle

_SLIM = Uniform(0.18, 0.22)  # m
_WALKING = Normal(1.34, 0.26, 0.8, 1.9)  # m/s


def _place(**bounds: Range) -> Callable[[Callable[..., Scenario]], Callable[..., Scenario]]:
    """Return a decorator that checks the numbers of a place, and adds the options `COMMON` to all."""

    def decorate(make: Callable[..., Scenario]) -> Callable[..., Scenario]:
        defaults, title = make.__kwdefaults__ or {}, make.__name__.replace("_", "-")

        @functools.wraps(make)
        def made(**options: Any) -> Scenario:
            sizes = {}
            for name, default in defaults.items():
                check = whole if isinstance(default, int) else number
                sizes[name] = check(f"{title}: {name}", options.get(name, default), bounds[name])
            return changed_place(replace(make(**sizes), **FULL_SPEED), options)

        made.__kwdefaults__ = {**defaults, **dict.fromkeys(COMMON)}  # type: ignore[attr-defined]  # a function has them
        return made

    return decorate


def _grid(thing: ArrayLike, columns: int, rows: int, step: tuple[float, float]) -> list[Floats]:
    """Return points [m] in columns and rows, row by row."""
    return [np.asarray(thing) + np.multiply(step, (column, row)) for row in range(rows) for column in range(columns)]


def _people(people: int, **fields: Any) -> Population:
    return Population(people, **{**TABLE_4, **fields})


def _cohorts(*parts: dict[str, Any], **shared: Any) -> Cohorts:
    return Cohorts(tuple(_people(**shared, **part) for part in parts))


@_place(side=POSITIVE, door_width=POSITIVE)
def room(*, side: float = 5.0, door_width: float = 0.82) -> Scenario:
    """Return a square room with one door in the middle of the wall x = ``side`` [m].

    Pécol et al. 2011, section 4.2: "a square room of side 5 m, where 20 pedestrians want to escape by a door of 82 cm width".
    That the door is centered is assumed; walls are thin and the jambs are hard points.
    """
    low, high = _door("room", side, door_width)
    geometry = Geometry.from_polygon(box(0.0, 0.0, side, side), exits={"door": [(side, low), (side, high)]})
    title = f"square room of {side:g} m, one door of {door_width:g} m, people in a hurry"
    source = "Pécol, Dal Pont, Erlicher, Argoul 2011, section 4.2 and Table 4"
    return Scenario("room-v0", geometry, _people(20), 60.0, title, source)


@_place(side=POSITIVE, door_width=POSITIVE, desired_speed=NOT_NEGATIVE, exit_depth=Range(0.0, 5.0))
def lin_room(
    *, side: float = 15.0, door_width: float = 1.0, desired_speed: float = 1.0, exit_depth: float = 0.0
) -> Scenario:
    """Return a square room [m] with an exit in a wall of thickness ``exit_depth``; all have one ``desired_speed`` [m/s].

    Lin, Ma, Lo, section 3: 15 x 15 m, one exit of 1 m, 100 to 300 people.  The paper does not state their target.
    """
    low, high = _door("lin-room", side, door_width)
    out = side + exit_depth
    passage = [box(side, low, out, high)] if out > side else []
    geometry = Geometry.from_polygon([box(0.0, 0.0, side, side), *passage], exits={"door": [(out, low), (out, high)]})
    speed, tau = Uniform(desired_speed, desired_speed), Uniform(0.5, 0.5)
    people = Population(200, Uniform(0.25, 0.35), Uniform(60.0, 80.0), desired_speed=speed, relaxation_time=tau)
    title = f"square room of {side:g} m, one exit of {door_width:g} m"
    paper = "Lin, Ma, Lo: Discrete element crowd model for pedestrian evacuation through an exit"
    others: dict[str, Any] = {"target": "centre", "blocked_after": 120.0}
    return Scenario("lin-room-v0", geometry, people, 1000.0, title, f"{paper}, section 3 and Table 1", **others)


def _door(name: str, side: float, width: float) -> tuple[float, float]:
    """Return where in the wall of a room a door of this width begins and ends [m]."""
    number(f"{name}: door_width", width, Range(0.0, side, above=True).because("the side of the room"), "m")
    return 0.5 * (side - width), 0.5 * (side + width)


@_place(length=Range(6.0, 60.0), depth=Range(3.0, 60.0), door_width=Range(0.6, 3.0))
def two_exit_hall(*, length: float = 20.0, depth: float = 12.0, door_width: float = 1.0) -> Scenario:
    """Return a hall of ``length`` from exit to exit [m]; all people start in the western half."""
    low, high = (depth - door_width) / 2, (depth + door_width) / 2
    geometry = Geometry.from_polygon(
        rectangle(0.0, 0.0, length, depth),
        exits={"west": [(0.0, low), (0.0, high)], "east": [(length, low), (length, high)]},
        regions={"start": rectangle(0.0, 0.0, length / 2, depth)},
    )
    size = f"hall of {length:.10g} x {depth:.10g} m"
    title = f"{size}, an exit of {door_width:.10g} m in each short wall, the crowd in the western half"
    people = _people(150, start_region="start")
    return Scenario("two-exit-hall-v0", geometry, people, 120.0, title, "drawn for this project")


@_place(width=Range(0.5, 6.0), length=Range(0.2, 20.0))
def bottleneck(*, width: float = 1.0, length: float = 2.8) -> Scenario:
    """Return a passage of ``width`` and ``length`` [m] behind a waiting area."""
    geometry = Geometry.from_polygon(
        [rectangle(-10.0, -3.5, 0.0, 3.5), rectangle(0.0, -width / 2, length, width / 2)],
        exits={"end": [(length, -width / 2), (length, width / 2)]},
        regions={"waiting": rectangle(-10.0, -3.5, -2.0, 3.5)},
    )
    people = _people(60, radius=_SLIM, desired_speed=_WALKING, start_region="waiting")
    title = f"bottleneck of {width:.10g} m, {length:.10g} m long, behind a waiting area"
    source = "after Seyfried et al., Transportation Science 43 (2009), experiment on bottlenecks of 0.8 to 1.2 m; the waiting "
    return Scenario("bottleneck-v0", geometry, people, 180.0, title, f"{source}area is drawn for this project")


@_place(door_width=Range(0.6, 4.0), radius=Range(0.1, 1.0), distance=Range(0.5, 4.0), shift=Range(-2.0, 2.0))
def pillar(*, door_width: float = 1.0, radius: float = 0.3, distance: float = 0.9, shift: float = 0.15) -> Scenario:
    """Return a room with a round pillar at ``distance`` from the wall of the exit, ``shift`` aside of its middle [m]."""
    geometry = Geometry.from_polygon(
        rectangle(0.0, 0.0, 8.0, 8.0),
        obstacles=[circle(8 - distance - radius, 4 + shift, radius)],
        exits={"door": [(8.0, 4 - door_width / 2), (8.0, 4 + door_width / 2)]},
        regions={"back": rectangle(0.0, 0.0, 5.5, 8.0)},
    )
    people = _people(80, start_region="back")
    column = f"a round pillar of {2 * radius:.10g} m stands {distance:.10g} m before it"
    title = f"room of 8 x 8 m, exit of {door_width:.10g} m, {column}"
    paper = "Helbing, Buzna, Johansson, Werner, Transportation Science 39 (2005)"
    source = f"drawn for this project, after the column before an exit of {paper}"
    # Some schemes build arches that hold.
    return Scenario("pillar-v0", geometry, people, 120.0, title, source, blocked_after=30.0)


@_place(width=Range(0.8, 6.0))
def l_corridor(*, width: float = 2.0) -> Scenario:
    """Return a corridor of ``width`` [m] with a corner."""
    geometry = Geometry.from_polygon(
        [rectangle(0.0, 0.0, 12.0, width), rectangle(12 - width, 0.0, 12.0, 12.0)],
        exits={"end": [(12 - width, 12.0), (12.0, 12.0)]},
        regions={"start": rectangle(0.0, 0.0, 6.0, width)},
    )
    people = _people(20, desired_speed=_WALKING, start_region="start")
    title = f"corridor of {width:.10g} m with a corner of 90 degrees"
    source = "the corner of RiMEA test 6 (persons walking around a corner, corridor of 2 m), with arms of 12 m"
    return Scenario("l-corridor-v0", geometry, people, 60.0, title, source)


@_place(width=Range(1.0, 6.0))
def t_junction(*, width: float = 2.4) -> Scenario:
    """Return two corridors of ``width`` [m] that meet and lead on as one."""
    geometry = Geometry.from_polygon(
        [rectangle(-9.0, 0.0, 9.0, width), rectangle(-width / 2, width, width / 2, width + 8)],
        exits={"end": [(-width / 2, width + 8), (width / 2, width + 8)]},
        regions={"left": rectangle(-9.0, 0.0, -3.5, width), "right": rectangle(3.5, 0.0, 9.0, width)},
    )
    left, right = ({"name": f"from the {side}", "start_region": side} for side in ("left", "right"))
    people = _cohorts(left, right, people=30, desired_speed=_WALKING)
    title = f"two streams merge where corridors of {width:.10g} m meet"
    paper = "Zhang, Klingsch, Schadschneider, Seyfried, J. Stat. Mech. P06004 (2011)"
    source = f"after the T-junction of {paper}, corridors of 2.4 m; lengths drawn for this project"
    return Scenario("t-junction-v0", geometry, people, 90.0, title, source)


@_place(width=Range(1.5, 10.0), length=Range(12.0, 60.0))
def counter_flow(*, width: float = 4.0, length: float = 20.0) -> Scenario:
    """Return a corridor of ``width`` and ``length`` [m] in which two streams walk towards each other."""
    geometry = Geometry.from_polygon(
        rectangle(0.0, 0.0, length, width),
        exits={"west": [(0.0, 0.0), (0.0, width)], "east": [(length, 0.0), (length, width)]},
        regions={"left": rectangle(0.5, 0.0, 5.5, width), "right": rectangle(length - 5.5, 0.0, length - 0.5, width)},
    )
    one = {"name": "eastwards", "start_region": "left", "route": "east"}
    other = {"name": "westwards", "start_region": "right", "route": "west"}
    people = _cohorts(one, other, people=15, radius=_SLIM, desired_speed=_WALKING)
    title = f"two streams walk towards each other in a corridor of {length:.10g} x {width:.10g} m"
    test = "counterflow in a corridor is also test 8 of IMO MSC.1/Circ.1533, with other dimensions"
    return Scenario("counter-flow-v0", geometry, people, 120.0, title, f"drawn for this project; {test}")


@_place(length=Range(10.0, 500.0), width=Range(1.0, 20.0))
def footbridge(*, length: float = 81.0, width: float = 4.0) -> Scenario:
    """Return a deck of ``length`` and ``width`` [m], along x from one support to the other, with people all over it."""
    geometry = Geometry.from_polygon(
        box(0.0, 0.0, length, width),
        exits={"far end": [(length, 0.0), (length, width)]},
    )
    # By the relation of envs/footbridge/gait.py so fast that the mean stride is that of the deck, with the spread of 2005.
    people = _people(160, radius=Uniform(0.15, 0.19), desired_speed=Normal(1.61, 0.37, 0.8, 2.6))
    title = f"footbridge, {length:.10g} x {width:.10g} m, people all over it walk to one end"
    source = "north span of the London Millennium Bridge; the deck sways under crowd_env.envs.footbridge"
    return Scenario("footbridge-v0", geometry, people, 300.0, title, source)


@_place(width=Range(1.5, 10.0))
def crossing(*, width: float = 4.0) -> Scenario:
    """Return two corridors of ``width`` [m] that cross, with a stream in each."""
    low, high = -width / 2, width / 2
    geometry = Geometry.from_polygon(
        [rectangle(-10.0, low, 10.0, high), rectangle(low, -10.0, high, 10.0)],
        exits={"east": [(10.0, low), (10.0, high)], "north": [(low, 10.0), (high, 10.0)]},
        regions={"west": rectangle(-10.0, low, -5.5, high), "south": rectangle(low, -10.0, high, -5.5)},
    )
    one = {"name": "eastwards", "start_region": "west", "route": "east"}
    other = {"name": "northwards", "start_region": "south", "route": "north"}
    people = _cohorts(one, other, people=20, radius=_SLIM, desired_speed=_WALKING)
    title = f"two streams cross at right angles where corridors of {width:.10g} m meet"
    paper = "Cao, Seyfried, Zhang, Holl, Song, J. Stat. Mech. 033404 (2017)"
    source = f"after the crossing of 90 degrees of {paper}, corridors of 4 m; lengths drawn for this project"
    return Scenario("crossing-v0", geometry, people, 90.0, title, source)


@_place(door_width=Range(0.6, 2.0), rows=Range(1, 12))
def classroom(*, door_width: float = 0.9, rows: int = 6) -> Scenario:
    """Return ``rows`` of desks for two on both sides of a middle aisle, and the teacher's desk; the door in m."""
    left, right = (_grid(rectangle(x, 2.9, x + 1.6, 3.3), 1, rows, (0.0, 1.2)) for x in (1.0, 3.9))
    geometry = Geometry.from_polygon(
        rectangle(0.0, 0.0, 6.5, 3 + 1.2 * rows),
        obstacles=[*left, *right, rectangle(2.6, 0.7, 3.9, 1.3)],
        exits={"door": [(6.5, 0.8), (6.5, 0.8 + door_width)]},
    )
    seats = np.array([seat for x in (1.4, 4.3) for seat in _grid((x, 3.65), 2, rows, (0.8, 1.2))])
    speed, late = Uniform(1.0, 1.6), LogNormal(3.0, 0.5, 12.0)
    people = _people(4 * rows, radius=_SLIM, desired_speed=speed, response_time=late, starts=seats)
    title = f"classroom with {4 * rows} seats at desks, one door of {door_width:.10g} m"
    drawn = "drawn for this project: desks of 1.6 x 0.4 m for two, 0.8 m between the rows, a middle aisle of 1.3 m"
    return Scenario("classroom-v0", geometry, people, 90.0, title, drawn)


@_place(exit_width=Range(0.8, 3.0))
def supermarket(*, exit_width: float = 1.6) -> Scenario:
    """Return shelves in two blocks, tills, and a barrier between them and the entrance; both exits in m."""
    geometry = Geometry.from_polygon(
        rectangle(0.0, 0.0, 24.0, 16.0),
        obstacles=[
            *_grid(rectangle(1.8, 5.6, 2.7, 9.6), 8, 2, (2.7, 5.6)),
            *_grid(rectangle(10.0, 2.2, 10.6, 4.0), 6, 1, (1.6, 0.0)),
        ],
        thin_walls=[[(8.4, 0.0), (8.4, 3.0), (10.0, 3.0)]],
        exits={"entrance": [(3.0, 0.0), (3 + exit_width, 0.0)], "tills": [(14.0, 0.0), (14 + exit_width, 0.0)]},
        regions={"shelves": rectangle(0.0, 5.0, 24.0, 16.0), "checkout": rectangle(9.4, 1.8, 20.0, 4.4)},
    )
    people = _cohorts(
        {"people": 90, "name": "shopping", "start_region": "shelves", "response_time": LogNormal(8.0, 0.6, 40.0)},
        {"people": 15, "name": "at the tills", "start_region": "checkout", "response_time": LogNormal(4.0, 0.5, 20.0)},
        desired_speed=Uniform(0.8, 1.5),
    )
    title = "supermarket of 24 x 16 m with shelves, an entrance and an exit behind the tills"
    drawn = "drawn for this project: shelves of 4.0 x 0.9 m, aisles of 1.8 m, tills 1.0 m apart"
    return Scenario("supermarket-v0", geometry, people, 180.0, title, drawn)


@_place(rows=Range(2, 30), vomitory=Range(0.9, 3.0))
def stadium_sector(*, rows: int = 10, vomitory: float = 1.8) -> Scenario:
    """Return two blocks of ``rows`` of seats, stepped aisles, a cross aisle in front; exits of ``vomitory`` [m] in front."""
    top, half = 2.0 + 0.8 * rows, vomitory / 2
    geometry = Geometry.from_polygon(
        rectangle(0.0, 0.0, 19.6, top),
        # The backs of the seats, and the rail before the first row.
        thin_walls=_grid([(1.2, 2.0), (9.2, 2.0)], 2, rows, (9.2, 0.8)),
        exits={
            "front-left": [(5.2 - half, 0.0), (5.2 + half, 0.0)],
            "front-right": [(14.4 - half, 0.0), (14.4 + half, 0.0)],
            "back": [(9.2, top), (10.4, top)],
        },
        regions={"steps": _grid(rectangle(0.0, 2.0, 1.2, top), 3, 1, (9.2, 0.0))},
    )
    seats = np.array([seat for x in (1.625, 10.825) for seat in _grid((x, 2.4), 14, rows, (0.55, 0.8))])
    speed, late = Uniform(0.9, 1.5), LogNormal(6.0, 0.6, 40.0)
    people = _people(28 * rows, radius=_SLIM, desired_speed=speed, response_time=late, starts=seats)
    title = f"stadium sector: {rows} rows of 28 seats, stepped aisles, two vomitories in front and one at the back"
    steps = "on steps 0.6 of the speed on the flat, about what Fruin, Pedestrian Planning and Design (1971), gives for stairs"
    source = f"drawn for this project: seats 0.55 m apart, rows 0.8 m deep, aisles of 1.2 m; {steps}"
    zones = (SpeedZone("steps", factor=0.6),)
    return Scenario("stadium-sector-v0", geometry, people, 300.0, title, source, zones=zones)


@_place(door_width=Range(0.6, 2.0), exit_width=Range(0.8, 2.0))
def floor(*, door_width: float = 0.9, exit_width: float = 1.2) -> Scenario:
    """Return eight rooms on both sides of a corridor, walls of 0.2 m with doors of ``door_width`` [m] through them."""
    low, high = 7 - exit_width / 2, 7 + exit_width / 2
    room = rectangle(0.0, 0.0, 5.8, 5.8)
    geometry = Geometry.from_polygon(
        [
            *_grid(room, 4, 2, (6.0, 8.2)),
            rectangle(0.0, 6.0, 23.8, 8.0),
            *_grid(rectangle(3.6, 5.8, 3.6 + door_width, 6.0), 4, 2, (6.0, 2.2)),
        ],
        exits={"west": [(0.0, low), (0.0, high)], "east": [(23.8, low), (23.8, high)]},
        regions={
            "south-offices": _grid(room, 4, 1, (6.0, 0.0)),
            "north-offices": _grid(rectangle(6.0, 8.2, 11.8, 14.0), 3, 1, (6.0, 0.0)),
            "meeting-room": rectangle(0.0, 8.2, 5.8, 14.0),
            "west-end": rectangle(0.0, 6.0, 4.0, 8.0),
        },
    )
    late, soon = LogNormal(12.0, 0.5, 45.0), LogNormal(5.0, 0.4, 20.0)
    people = _cohorts(
        {"people": 20, "name": "south offices", "start_region": "south-offices", "response_time": late},
        {"people": 15, "name": "north offices", "start_region": "north-offices", "response_time": late},
        {"people": 25, "name": "meeting", "start_region": "meeting-room", "response_time": soon},
        radius=_SLIM,
        desired_speed=_WALKING,
    )
    # When the western end is crowded, people elsewhere go east.
    rule = ControlRule("west-end", at_least=12, below=6, route="east", commits=True)
    title = "office floor: seven offices and a meeting room on a corridor with an exit at each end"
    drawn = f"drawn for this project: rooms of 5.8 x 5.8 m, corridor of 2 m, doors of {door_width:.10g} m"
    return Scenario("floor-v0", geometry, people, 180.0, title, drawn, rules=(rule,))
