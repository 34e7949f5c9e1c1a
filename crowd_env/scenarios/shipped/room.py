"""The room of Pécol et al. 2011, section 4.2: 5 x 5 m, one door of 0.82 m, 20 pedestrians in a hurry."""

from collections.abc import Mapping
from typing import Any

from crowd_env.checks import POSITIVE, number
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.routing.route_set import Target
from crowd_env.scenarios.groups import as_people
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import People, Scenario

# "A square room of side 5 m, where 20 pedestrians want to escape by a door of 82 cm width"; the door is centerd (the paper
# does not say), walls are thin and the jambs are hard points.
REFERENCE = "Pécol, Dal Pont, Erlicher, Argoul 2011, section 4.2 and Table 4"


def room(
    *,
    side: float = 5.0,
    door_width: float = 0.82,
    count: int = 20,
    time_limit: float = 60.0,
    population: People | Mapping[str, Any] | None = None,
    target: Target = "path",
    exit_line: float = 0.0,
) -> Scenario:
    """Return a square room with one door centerd in the wall x = ``side``.

    Parameters
    ----------
    side, door_width : m.
    count : number of people; ignored if a ``population`` is given.
    time_limit : s; people still inside then are unfinished.
    target : what people walk to, see `Scenario`.
    exit_line : m, how far beyond the door (before it if negative) people are counted and removed.

    Raises
    ------
    ValueError
        If a length is not positive or the door is wider than the wall.
    """
    side = number("room: side", side, POSITIVE, "m")
    door_width, exit_line = number("room: door_width", door_width), number("room: exit_line", exit_line)
    if not 0 < door_width <= side:
        raise ValueError(f"room: door_width is {door_width:g} m; it must be > 0 and at most the side, {side:g} m")
    if not -0.5 * side < exit_line <= 5.0:
        raise ValueError(f"room: exit_line is {exit_line:g} m; it must be above {-0.5 * side:g} and at most 5 m")
    geometry = _plan(side, 0.5 * (side - door_width), 0.5 * (side + door_width), exit_line)
    people = as_people(population) or Population(count)
    title = f"square room of {side:g} m, one door of {door_width:g} m, {people.count} people in a hurry"
    return Scenario("room-v0", geometry, people, time_limit, title, REFERENCE, target)


def _plan(side: float, low: float, high: float, exit_line: float) -> Geometry:
    room = box(0.0, 0.0, side, side)
    if exit_line == 0.0:
        return Geometry.from_polygon(room, exits={"door": [(side, low), (side, high)]})
    if exit_line < 0.0:  # people vanish before they reach the door: no one else can get so close to its wall
        return Geometry.from_polygon(room, exits={"door": box(side + exit_line, low, side, high)})
    outside = box(side, -1.0, side + exit_line, side + 1.0)
    walls = [[(side, 0.0), (side, low)], [(side, high), (side, side)]]
    line = [(side + exit_line, -1.0), (side + exit_line, side + 1.0)]
    return Geometry.from_polygon([room, outside], exits={"door": line}, thin_walls=walls)
