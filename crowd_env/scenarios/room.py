"""The room of Pécol et al. 2011, section 4.2: 5 x 5 m, one door of 0.82 m, 20 pedestrians in a hurry."""

from crowd_env.geometry import Geometry
from crowd_env.population import Population
from crowd_env.scenario import Scenario

# "A square room of side 5 m, where 20 pedestrians want to escape by a door of 82 cm width"; the door is centred (the paper
# does not say), walls are thin and the jambs are hard points.
REFERENCE = "Pécol, Dal Pont, Erlicher, Argoul 2011, section 4.2 and Table 4"


def room(
    *,
    side: float = 5.0,
    door_width: float = 0.82,
    count: int = 20,
    time_limit: float = 60.0,
    population: Population | None = None,
) -> Scenario:
    """Return a square room with one door centred in the wall x = ``side``.

    Parameters
    ----------
    side, door_width : m.
    count : number of people; ignored if a ``population`` is given.
    time_limit : s; whoever is still inside then is unfinished.

    Raises
    ------
    ValueError
        If a length is not positive or the door is wider than the wall.
    """
    if not side > 0:
        raise ValueError(f"room: side is {side:g} m; it must be > 0")
    if not 0 < door_width <= side:
        raise ValueError(f"room: door_width is {door_width:g} m; it must be > 0 and at most the side, {side:g} m")
    low, high = 0.5 * (side - door_width), 0.5 * (side + door_width)
    geometry = Geometry.from_polygon(
        [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)],
        exits={"door": [(side, low), (side, high)]},
    )
    people = population or Population(count)
    title = f"square room of {side:g} m, one door of {door_width:g} m, {people.count} people in a hurry"
    return Scenario("room-v0", geometry, people, time_limit, title, REFERENCE)
