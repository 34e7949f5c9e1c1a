"""The room of Lin, Ma, Lo, section 3: 15 x 15 m, one exit of 1 m, 100 to 300 people who all want the same speed."""

from collections.abc import Mapping
from typing import Any

from crowd_env.checks import NOT_NEGATIVE, POSITIVE, number
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.routing.route_set import Target
from crowd_env.scenarios.groups import as_people
from crowd_env.scenarios.population import Population, Uniform
from crowd_env.scenarios.scenario import People, Scenario

REFERENCE = "Lin, Ma, Lo: Discrete element crowd model for pedestrian evacuation through an exit, section 3 and Table 1"


def lin_room(
    *,
    count: int = 200,
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
    count : number of people; ignored, like ``desired_speed`` [m/s], if a ``population`` is given.
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
    side, desired_speed = (
        number("lin-room: side", side, POSITIVE, "m"),
        number("lin-room: desired_speed", desired_speed, NOT_NEGATIVE, "m/s"),
    )
    door_width, exit_depth = number("lin-room: door_width", door_width), number("lin-room: exit_depth", exit_depth)
    if not 0 < door_width <= side:
        raise ValueError(f"lin-room: door_width is {door_width:g} m; it must be > 0 and at most the side, {side:g} m")
    if not 0 <= exit_depth <= 5.0:
        raise ValueError(f"lin-room: exit_depth is {exit_depth:g} m; it must be >= 0 and at most 5 m")
    low, high, out = 0.5 * (side - door_width), 0.5 * (side + door_width), side + exit_depth
    area = [box(0.0, 0.0, side, side)]
    if exit_depth > 0.0:
        area.append(box(side, low, out, high))
    geometry = Geometry.from_polygon(area, exits={"door": [(out, low), (out, high)]})
    people = as_people(population) or Population(
        count,
        radius=Uniform(0.25, 0.35),
        mass=Uniform(60.0, 80.0),
        desired_speed=Uniform(desired_speed, desired_speed),
        relaxation_time=Uniform(0.5, 0.5),
    )
    title = f"square room of {side:g} m, one exit of {door_width:g} m, {people.count} people"
    return Scenario("lin-room-v0", geometry, people, time_limit, title, REFERENCE, target, blocked_after)
