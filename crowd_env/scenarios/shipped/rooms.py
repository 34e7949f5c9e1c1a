"""The square rooms of two papers, with one exit in the middle of a wall.

Pécol et al. 2011, section 4.2: "a square room of side 5 m, where 20 pedestrians want to escape by a door of 82 cm width".  The
door is centered (the paper does not say), walls are thin and the jambs are hard points.

Lin, Ma, Lo, section 3: 15 x 15 m, one exit of 1 m, 100 to 300 people who all want the same speed.
"""

from collections.abc import Mapping
from typing import Any

from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, Range, number
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.routing.route_set import Target
from crowd_env.scenarios.groups import People, as_people
from crowd_env.scenarios.population import Population, Uniform
from crowd_env.scenarios.scenario import Scenario

PECOL = "Pécol, Dal Pont, Erlicher, Argoul 2011, section 4.2 and Table 4"
LIN = "Lin, Ma, Lo: Discrete element crowd model for pedestrian evacuation through an exit, section 3 and Table 1"


def room(
    *,
    side: float = 5.0,
    door_width: float = 0.82,
    people: int = 20,
    time_limit: float = 60.0,
    population: People | Mapping[str, Any] | None = None,
    target: Target = "path",
    exit_line: float = 0.0,
) -> Scenario:
    """Return a square room with one door centered in the wall x = ``side``.

    Parameters
    ----------
    side, door_width : m.
    people : number of people; ignored if a ``population`` is given.
    time_limit : s; people still inside then are unfinished.
    target : what people walk to, see `Scenario`.
    exit_line : m, how far beyond the door (before it if negative) people are counted and removed.

    Raises
    ------
    ValueError
        If a length is not positive or the door is wider than the wall.
    """
    side, low, high = _door("room", side, door_width)
    exit_line = number("room: exit_line", exit_line, Range(-0.5 * side, 5.0, above=True), "m")
    area, line, walls = [box(0.0, 0.0, side, side)], [(side, low), (side, high)], []
    if exit_line < 0.0:  # people vanish before they reach the door: no one else can get so close to its wall
        line = box(side + exit_line, low, side, high)
    elif exit_line > 0.0:
        area.append(box(side, -1.0, side + exit_line, side + 1.0))
        walls = [[(side, 0.0), (side, low)], [(side, high), (side, side)]]
        line = [(side + exit_line, -1.0), (side + exit_line, side + 1.0)]
    geometry = Geometry.from_polygon(area, exits={"door": line}, thin_walls=walls)
    crowd = as_people(population) or Population(people)
    title = f"square room of {side:g} m, one door of {door_width:g} m, {crowd.people} people in a hurry"
    return Scenario("room-v0", geometry, crowd, time_limit, title, PECOL, target)


def lin_room(
    *,
    people: int = 200,
    desired_speed: float = 1.0,
    side: float = 15.0,
    door_width: float = 1.0,
    exit_depth: float = 0.0,
    target: Target = "centre",
    time_limit: float = 1000.0,
    blocked_after: float = 120.0,
    population: People | Mapping[str, Any] | None = None,
) -> Scenario:
    """Return a square room with an exit in the middle of the wall x = ``side``.

    Parameters
    ----------
    people : number of people; ignored, like ``desired_speed`` [m/s], if a ``population`` is given.
    side, door_width : m.
    exit_depth : m, how thick the wall is: people are out at x = side + exit_depth.
    target : what people walk to, see `Scenario`; the paper does not say.
    time_limit : s.
    blocked_after : s without anyone getting out, after which the exit counts as blocked.

    Raises
    ------
    ValueError
        If a length is out of range.
    """
    side, low, high = _door("lin-room", side, door_width)
    speed = number("lin-room: desired_speed", desired_speed, NOT_NEGATIVE, "m/s")
    out = side + number("lin-room: exit_depth", exit_depth, Range(0.0, 5.0), "m")
    area = [box(0.0, 0.0, side, side)]
    if out > side:
        area.append(box(side, low, out, high))
    geometry = Geometry.from_polygon(area, exits={"door": [(out, low), (out, high)]})
    crowd = as_people(population) or Population(
        people,
        radius=Uniform(0.25, 0.35),
        mass=Uniform(60.0, 80.0),
        desired_speed=Uniform(speed, speed),
        relaxation_time=Uniform(0.5, 0.5),
    )
    title = f"square room of {side:g} m, one exit of {door_width:g} m, {crowd.people} people"
    return Scenario("lin-room-v0", geometry, crowd, time_limit, title, LIN, target, blocked_after)


def _door(name: str, side: float, width: float) -> tuple[float, float, float]:
    """Return the side of a room and where in it a door of this width begins and ends, checked [m]."""
    side = number(f"{name}: side", side, POSITIVE, "m")
    width = number(f"{name}: door_width", width, Range(0.0, side, above=True).because("the side of the room"), "m")
    return side, 0.5 * (side - width), 0.5 * (side + width)
