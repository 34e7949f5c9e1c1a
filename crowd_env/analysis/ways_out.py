"""Which exits people may take: cohorts, routes and the strategy bind them, and doors that never open shut exits."""

from collections.abc import Collection

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.geometry.parts import cut_off_by
from crowd_env.routing.fields.field import NavigationField
from crowd_env.routing.route_set import field_of
from crowd_env.scenarios.scenario import Scenario


class WaysOut:
    """The exits of each cohort of a place in runs of a ``strategy``; None = the place's.

    Attributes
    ----------
    closed
        Names of the doors that are shut for good.
    shut
        Exit that such a door shuts -> the door.
    allowed, open
        Exits that the people of each cohort may take, and those of them that are not shut.
    """

    def __init__(self, place: Scenario, strategy: str | None = None) -> None:
        self.place, geometry = place, place.geometry
        later = {event.door for event in place.door_events if event.opens}
        self.closed = frozenset(place.closed_doors) - later
        doors = dict(zip(geometry.doors, geometry.exits_of_door, strict=True))
        self.shut = {exit: door for door, exit in doors.items() if door in self.closed and exit is not None}
        strategy = place.strategy_of_run(strategy)
        self.allowed = [
            {exit for route in place.routes_of(part, strategy) for exit in route.exits or place.exits}
            for part in place.population.parts
        ]
        self.open = [allowed - self.shut.keys() for allowed in self.allowed]

    def field(self, cohort: int) -> NavigationField:
        """Return the field of the shortest ways of a cohort that has an open exit."""
        place, radius = self.place, self.place.population.radius
        exits = self.allowed[cohort]
        return field_of(
            place.geometry,
            radius.high,
            exits=None if exits == {*place.exits} else tuple(sorted(exits)),
            min_radius=radius.low,
            goal=None,
            speed=None,
            closed=self.closed,
            one_way=tuple(place.one_way),
        )

    def cut_off(self, lines: Floats, exits: Collection[str], points: Floats) -> Bools:
        """Return which of ``points`` (K, 2) have no way to ``exits`` if ``lines`` (L, 2, 2) are shut too."""
        geometry = self.place.geometry
        walls, two_sided = geometry.walls_when(self.closed)
        ends = geometry.exits[[name in exits for name in geometry.exit_names]]
        return cut_off_by(np.concatenate([walls[two_sided], lines]), geometry.walkable, ends, points)
