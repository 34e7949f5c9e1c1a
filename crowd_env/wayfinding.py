"""Which field leads whom, environment by environment: fastest ways follow the crowd, all ways follow the doors."""

import math
import time as clock
import warnings
from collections.abc import Sequence

import numpy as np

from crowd_env.geometry import Boundary
from crowd_env.navigation import FieldArrays, NavigationField, join_fields, regions_along
from crowd_env.remarching import write_field
from crowd_env.state import Bodies, CrowdState, Floats, Ints
from crowd_env.ways import Ways, add_fields, join_ways, region_masks_of

Place = Ways | NavigationField | None


class Wayfinder:
    """The travel-time fields of a batch.

    Parameters
    ----------
    places : the ways, or the one field, of every geometry.
    geometry_of_env : (E,)
    boundary : of all geometries.
    interval : s, how often a fastest way is found anew, counted from the start of each environment.

    Attributes
    ----------
    field, guidance : what kernels read.
    potential_of_route : (E, R) rows of the fields by which progress is counted, see `crowd_env.ways.Way.potential`.
    seconds : processor time spent on new fields so far.
    marches : fields found anew so far.
    """

    def __init__(
        self, places: Sequence[Place], geometry_of_env: Ints, boundary: Boundary, interval: float = 1.0
    ) -> None:
        if not 0 < interval < np.inf:
            raise ValueError(f"replan_every is {interval!r} s; it must be > 0 and finite")
        self.places, self.interval = list(places), interval
        self.seconds, self.marches = 0.0, 0
        self._geometry_of_env, self._boundary = geometry_of_env, boundary
        joined = join_ways(self.places, geometry_of_env)
        self._fields, self._geometry_of_field, self.guidance, self.potential_of_route = joined
        self.field: FieldArrays = join_fields(self._fields, boundary, self._geometry_of_field)
        self._current: list[Place] = [self.places[g] for g in geometry_of_env]
        self._rows: dict[tuple[int, frozenset[str]], list[int]] = {}
        self._potentials: dict[tuple[int, frozenset[str]], list[int]] = {}
        for e, place in enumerate(self._current):
            if isinstance(place, Ways):
                rows = self.guidance.field_of_route[e, : len(place.ways)]
                self._rows.setdefault(self._key(e, frozenset()), rows.tolist())
                potentials = self.potential_of_route[e, : len(place.ways)]
                self._potentials.setdefault(self._key(e, frozenset()), potentials.tolist())
        self._due = np.zeros(len(geometry_of_env))
        self._dynamic = self._find_dynamic()

    def _find_dynamic(self) -> list[tuple[int, Ways]]:
        """Return the environments whose ways follow the crowd: mostly none, and then nobody has to ask them all."""
        return [(e, place) for e, place in enumerate(self._current) if isinstance(place, Ways) and place.is_dynamic]

    def ways(self, e: int) -> Ways | None:
        """Return the ways of environment ``e`` as its doors stand now."""
        place = self._current[e]
        return place if isinstance(place, Ways) else None

    def restart(self, e: int) -> None:
        """Begin environment ``e`` anew: its fastest ways are due."""
        self._due[e] = 0.0

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next environment is due; None if there is nothing to plan."""
        waits = [max(1, math.ceil((self._due[e] - time[e]) / dt - 1e-9)) for e, _ in self._dynamic if inside[e] > 0]
        return min(waits, default=None)

    def update(self, bodies: Bodies, state: CrowdState) -> None:
        """Find the fastest ways of the environments that are due anew, in place."""
        begin = clock.process_time()
        for e, place in self._dynamic:
            if state.time[e] < self._due[e] - 1e-9:
                continue
            people = slice(int(bodies.env_start[e]), int(bodies.env_start[e + 1]))
            position = state.position[people][state.active[people]]
            for r, way in enumerate(place.ways):
                if way.remarcher is not None:
                    self._write(e, r, way.remarcher.march(position), place)
            self._due[e] = state.time[e] + self.interval
        self.seconds += clock.process_time() - begin

    def _write(self, e: int, r: int, field: NavigationField, place: Ways) -> None:
        first = int(self.field.node_start[self.guidance.field_of_route[e, r]])
        write_field(field, self.field.travel_time, self.field.direction, first)
        if place.rules:
            through = regions_along(field, region_masks_of(field, place.geometry))
            self.field.through[first : first + through.size] = through.ravel()
        self.marches += 1

    def close(self, e: int, closed: frozenset[str]) -> None:
        """Let the ways of environment ``e`` be those while these doors are closed.

        If that locks somebody in, the ways stay as they were, with a warning: people wait at the door.
        """
        place = self.places[self._geometry_of_env[e]]
        if not isinstance(place, Ways):
            return
        try:
            ways = place.when(closed)
        except ValueError as error:
            warnings.warn(f"with {', '.join(sorted(closed))} closed people wait there: {error}", stacklevel=3)
            return
        key = self._key(e, closed)
        if key not in self._rows:
            self._rows[key], self._potentials[key] = add_fields(ways, self._fields)
            added = len(self._fields) - len(self._geometry_of_field)
            self._geometry_of_field += [int(self._geometry_of_env[e])] * added
            before = self.field
            self.field = join_fields(self._fields, self._boundary, self._geometry_of_field)
            for name in ("travel_time", "direction", "through"):  # as they were: some follow their crowd
                known = getattr(before, name)
                getattr(self.field, name)[: len(known)] = known
        self.guidance.field_of_route[e, : len(ways.ways)] = self._rows[key]
        self.potential_of_route[e, : len(ways.ways)] = self._potentials[key]
        self._current[e] = ways
        self._dynamic = self._find_dynamic()
        self._due[e] = 0.0

    def _key(self, e: int, closed: frozenset[str]) -> tuple[int, frozenset[str]]:
        """Fields are shared by the environments of a place, unless they follow the crowd of one."""
        place = self.places[self._geometry_of_env[e]]
        own = isinstance(place, Ways) and place.is_dynamic
        return (e if own else -1 - int(self._geometry_of_env[e])), closed
