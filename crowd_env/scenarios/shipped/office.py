"""Office buildings of any number of storeys: rooms on a corridor, and a stair in a hall at one end or both."""

from typing import NamedTuple

import numpy as np

from crowd_env.core.checks import Range, number, whole
from crowd_env.geometry.geometry import box
from crowd_env.geometry.parsing import Shape
from crowd_env.routing.route_set import Target
from crowd_env.routing.spec import DoorEvent
from crowd_env.scenarios.buildings import Level, Stair
from crowd_env.scenarios.buildings import building as building_of
from crowd_env.scenarios.cohorts import Cohorts, People
from crowd_env.scenarios.distributions import LogNormal
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario, changed_place

_CORE = 0.25  # m, between two flights
_FREE = 3.0  # m, between the stair and the corridor
_BESIDE = 0.5  # m, more than an exit, on both sides of the stair
_SPARE = 0.2  # m, between an exit and the corner beside it


class Office(NamedTuple):
    """Sizes of an office building.

    The corridor lies along the x axis.  Above the ground floor, which is one foyer, it has rooms on both sides.
    """

    storeys: int = 3
    height: float = 3.5  # m, from storey to storey
    length: float = 18.0  # m, of the corridor
    corridor: float = 2.0  # m, its width
    depth: float = 7.0  # m, of the rooms
    rooms: int = 3  # on each side
    door: float = 1.0  # m, width
    stair: float = 1.2  # m, width of each flight
    exit: float = 1.2  # m, width
    ends: tuple[str, ...] = ("west", "east")  # that have a stair, and an exit on the ground floor

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the storeys, from below."""
        return tuple("ground" if k == 0 else f"storey {k}" for k in range(self.storeys))

    def stairs(self) -> tuple[Stair, ...]:
        """Return the stairs: two flights, up towards the end of the building and back."""
        half = 0.5 * (self.stair + _CORE)
        feet = {"west": (-_FREE, half, 180.0, "u-left"), "east": (self.length + _FREE, half, 0.0, "u-right")}
        return tuple(
            Stair(f"{end} stair {k + 1}", below, above, (x, y), direction, self.stair, turns=turns, core=_CORE)  # type: ignore[arg-type]
            for end, (x, y, direction, turns) in feet.items()
            if end in self.ends
            for k, (below, above) in enumerate(zip(self.names, self.names[1:], strict=False))
        )

    def levels(self) -> tuple[Level, ...]:
        """Return the storeys; a half of the corridor with its rooms is a region."""
        half, side = 0.5 * self.corridor, 0.5 * self.corridor + self.depth
        wide = self.stair + 0.5 * _CORE + self.exit + _BESIDE
        flight = max((one.steps(self.height).flights[0] * one.tread for one in self.stairs()), default=0.0)
        deep = _FREE + flight + self.stair
        both = {"west": (-deep, 0.0), "east": (self.length, self.length + deep)}
        halls = {end: both[end] for end in self.ends}
        floor: list[Shape] = [box(0.0, -side, self.length, side), *(box(a, -wide, b, wide) for a, b in halls.values())]
        walls: list[list[tuple[float, float]]] = []
        each, ends = self.length / self.rooms, (0.0, self.length)
        for up in (-1.0, 1.0):
            for k in range(self.rooms):
                low, high = (k + 0.5) * each - 0.5 * self.door, (k + 0.5) * each + 0.5 * self.door
                walls += [[(k * each, up * half), (low, up * half)], [(high, up * half), ((k + 1) * each, up * half)]]
            walls += [[(k * each, up * half), (k * each, up * side)] for k in range(1, self.rooms)]
            walls += [[(x, up * half), (x, up * min(wide, side))] for x in ends]
        out = {end: a if end == "west" else b for end, (a, b) in halls.items()}
        low = -wide + _SPARE
        exits: dict[str, Shape] = {end: [(x, low), (x, low + self.exit)] for end, x in out.items()}
        return tuple(
            Level(
                name,
                self.height * k,
                floor,
                thin_walls=walls if k else (),
                exits={} if k else exits,
                doors={} if k else {end: end for end in self.ends},
                regions={
                    f"{name}, west": box(0.0, -side, 0.5 * self.length, side),
                    f"{name}, east": box(0.5 * self.length, -side, self.length, side),
                },
            )
            for k, name in enumerate(self.names)
        )


def building(
    *,
    storeys: int = 3,
    stair_width: float = 1.2,
    exit_width: float = 1.2,
    shuts: float = 0.0,
    people: int | None = None,
    population: People | None = None,
    time_limit: float | None = None,
    blocked_after: float | None = None,
    target: Target | None = None,
) -> Scenario:
    """Return an office building with a stair and an exit at either end; that in the east ``shuts`` at a time [s], 0 = never.

    Of 200 people 80 are at a meeting in the west of the uppermost storey; these visitors know the exit in the west alone.

    Raises
    ------
    ValueError
        If an option is out of range, or for what `changed_place` refuses in other options.
    """
    storeys = whole("building: storeys", storeys, Range(1, 50))
    office = Office(
        storeys,
        stair=number("building: stair_width", stair_width, Range(0.8, 3.0)),
        exit=number("building: exit_width", exit_width, Range(0.8, 3.0)),
    )
    shuts = number("building: shuts", shuts, Range(0.0, 600.0))
    top, late, soon = office.names[-1], LogNormal(12.0, 0.5, 45.0), LogNormal(5.0, 0.4, 20.0)
    visitors = Population(80, start_region=f"{top}, west", exits=("west",), response_time=soon, name="visitors")
    shares = np.full(storeys, 120 // storeys)
    shares[: 120 % storeys] += 1
    staff = [
        Population(int(n), start_region=name, response_time=late, name=f"staff, {name}")
        for n, name in zip(shares, office.names, strict=True)
    ]
    place = Scenario(
        "building-v0",
        building_of(office.levels(), office.stairs()),
        Cohorts((visitors, *staff)),
        200.0 + 100.0 * storeys,
        f"office building: {storeys} storeys with a stair and an exit at either end",
        "drawn for this project; stairs of 175 mm by 280 mm, speeds of the SFPE Handbook",
        door_events=() if shuts == 0.0 else (DoorEvent("east", False, at=shuts),),
    )
    given = {"people": people, "population": population, "time_limit": time_limit}
    return changed_place(place, {**given, "blocked_after": blocked_after, "target": target})
