"""Which exits people may take: cohorts, routes and the strategy bind them, and doors that never open shut exits."""

from collections.abc import Collection, Iterator

import numpy as np

from crowd_env.analysis.passages import distances
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
        Exits that the people of each cohort may take, and the ones among these that are not shut.
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
        shut = np.concatenate([walls[two_sided], lines])
        return cut_off_by(shut, geometry.walkable, self.lines(exits), points)

    def lines(self, exits: Collection[str]) -> Floats:
        """Return the lines (L, 2, 2) [m] of some exits."""
        geometry = self.place.geometry
        return geometry.exits[[name in exits for name in geometry.exit_names]]


def remarks_on(place: Scenario, strategy: str | None = None) -> Iterator[str]:
    """Yield a sentence on each cohort that has no open exit, or comes in where it leaves at once."""
    ways = WaysOut(place, strategy)
    for k, part in enumerate(place.population.parts):
        people = f"people of {part.name!r}" if part.name else "people"
        if not ways.open[k]:
            only = [f"exit {exit!r}, which door {ways.shut[exit]!r} shuts for good" for exit in sorted(ways.allowed[k])]
            yield f"{people} may leave only by {', '.join(only)}: they stay inside until a run is cut"
        elif part.arrivals is not None and part.arrivals.line is not None:
            spots = part.spots(place.geometry, place.room)
            for exit in sorted(ways.open[k]):
                if np.median(distances(spots, ways.lines([exit]))) < 2.0 * place.room * part.radius.high:
                    yield f"{people} come in at exit {exit!r} and leave by it at once: give them other exits"
