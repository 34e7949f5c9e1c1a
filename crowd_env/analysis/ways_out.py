"""Which exits people may take: cohorts, routes and the strategy bind them, and doors that never open shut exits."""

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from crowd_env.analysis.passages import distances
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parts import cut_off_by
from crowd_env.scenarios.scenario import Scenario


class WaysOut(NamedTuple):
    """The way of a cohort, the shortest where nothing binds it."""

    route: str
    exits: frozenset[str]  # that it may take, without the ones that are shut for good
    shut: str  # in words, if there is no such exit


def ways_out(place: Scenario, strategy: str | None = None) -> list[WaysOut]:
    """Return the way of each cohort in runs of a ``strategy``; None = the place's."""
    strategy, closed, found = binding(place, strategy), closed_for_good(place), []
    shut = {
        exit for door, exit in zip(place.geometry.doors, place.geometry.exits_of_door, strict=True) if door in closed
    }
    for part in place.population.parts:
        route = place.routes_of(part, strategy)[0]
        exits = frozenset(route.exits or place.exits)
        words = f"{', '.join(sorted(exits))}, which {', '.join(sorted(closed))} shut for good" * (exits <= shut)
        found.append(WaysOut(route.name, exits - shut, words))
    return found


def binding(place: Scenario, strategy: str | None = None) -> str:
    """Return a strategy by which cohorts have a route each: that of a run if it names one."""
    strategy = place.strategy_of_run(strategy)
    return strategy if strategy in place.ways else "shortest"


def closed_for_good(place: Scenario) -> frozenset[str]:
    """Return the names of the doors that are closed and never open."""
    return frozenset(place.closed_doors).difference(event.door for event in place.door_events if event.opens)


def cut_off(place: Scenario, lines: Floats, exits: Collection[str], points: Floats) -> Bools:
    """Return which of ``points`` (K, 2) have no way to ``exits`` if ``lines`` (L, 2, 2) are shut too."""
    walls, two_sided = place.geometry.walls_when(closed_for_good(place))
    shut = np.concatenate([walls[two_sided], lines])
    seams = place.geometry.ways_on[len(place.geometry.exits) :]
    out = np.concatenate([_lines(place.geometry, exits), seams])
    return cut_off_by(shut, place.geometry.walkable, out, points)


def _lines(geometry: Geometry, exits: Collection[str]) -> Floats:
    return geometry.exits[np.isin(geometry.exit_names, [*exits])]


def remarks_on(place: Scenario, strategy: str | None = None) -> Iterator[str]:
    """Yield a sentence on each cohort that has no open exit, or comes in where it leaves at once."""
    for part, ways in zip(place.population.parts, ways_out(place, strategy), strict=True):
        people = f"people of {part.name!r}" if part.name else "people"
        if ways.shut:
            yield f"{people} may leave only by {ways.shut}: they stay inside until a run is cut"
        if part.arrivals is None or part.arrivals.line is None:
            continue
        for exit in sorted(ways.exits):
            away = distances(part.spots(place.geometry, place.room), _lines(place.geometry, [exit]))
            if np.median(away) < 2.0 * place.room * part.radius.high:
                yield f"{people} come in at exit {exit!r} and leave by it at once: give them other exits"
