"""The field of each pedestrian, environment by environment: fastest ways follow the crowd, all ways follow the doors."""

import time
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, CrowdState, Floats, Ints, slots_of
from crowd_env.core.clock import DueClock
from crowd_env.geometry.geometry import Boundary
from crowd_env.routing.arrays import add_fields, join_routes
from crowd_env.routing.fields.field import NavigationField, by_sheet, join_fields, rows_in_batch
from crowd_env.routing.fields.fundamental_diagram import FundamentalDiagram
from crowd_env.routing.fields.lookup import FieldArrays
from crowd_env.routing.route_set import RouteSet

Place = RouteSet | NavigationField | None


_Key = tuple[int, frozenset[str]]  # the ways, see `RoutePlanner._key`, and the closed doors


class PlannerState(NamedTuple):
    """The part of a checkpoint from a `RoutePlanner`."""

    known: tuple[_Key, ...]  # keys of the fields that have been made, in their order
    closed: tuple[frozenset[str], ...]  # closed doors for the ways of each environment
    field_of_route: Ints  # (E, R)
    found: dict[int, tuple[np.ndarray, ...]]  # travel times, directions and cells of the fields that follow a crowd
    due: Floats  # (E,)  s


class RoutePlanner:
    """The travel-time fields of a batch.

    Parameters
    ----------
    places : the ways, or the one field, of every geometry.
    geometry_of_env : (E,)
    boundary : of all geometries.
    keep_distance : whether people do.

    Attributes
    ----------
    field, guidance : input of the kernels.
    potential_of_route : (E, R) rows of the fields by which progress is counted, see
        `crowd_env.routing.route_set.RouteField.potential`.
    fields, geometry_of_field : the fields that ``field`` joins, and the geometry of each.
    seconds : processor time spent on new fields so far.
    marches : number of fields found again so far.
    """

    def __init__(
        self,
        places: Sequence[Place],
        geometry_of_env: Ints,
        boundary: Boundary,
        *,
        keep_distance: bool = False,
    ) -> None:
        self.places = list(places)
        self._keep_distance = keep_distance
        self.seconds, self.marches = 0.0, 0
        self._geometry_of_env, self._boundary = geometry_of_env, boundary
        ways = [self._ways(place) if isinstance(place, RouteSet) else place for place in self.places]
        joined = join_routes(ways, geometry_of_env)
        self.fields, self.geometry_of_field, self.guidance, self.potential_of_route = joined
        self.field: FieldArrays = join_fields(self.fields, boundary, self.geometry_of_field)
        self._current: list[Place] = [ways[g] for g in geometry_of_env]
        self._closed: list[frozenset[str]] = [frozenset() for _ in self._current]
        self._rows: dict[_Key, tuple[list[int], list[int]]] = {}  # of the fields of the routes, and of their potentials
        for e, place in enumerate(self._current):
            if isinstance(place, RouteSet):
                count = len(place.routes)
                rows = self.guidance.field_of_route[e, :count].tolist(), self.potential_of_route[e, :count].tolist()
                self._rows.setdefault(self._key(e, frozenset()), rows)
        self._first_rows, self._first_fields = dict(self._rows), len(self.fields)
        self._clock = DueClock(len(geometry_of_env))
        self._dynamic = self._find_dynamic()

    def _ways(self, place: RouteSet, closed: frozenset[str] = frozenset()) -> RouteSet:
        """Return the ways of a place while these doors are closed, for people as they walk here."""
        return place.when(closed).spread if self._keep_distance else place.when(closed)

    def _find_dynamic(self) -> list[tuple[int, RouteSet]]:
        """Return the environments with routes that follow the crowd: mostly none, and then none has to be looked at."""
        return [(e, place) for e, place in enumerate(self._current) if isinstance(place, RouteSet) and place.is_dynamic]

    def route_set(self, e: int) -> RouteSet | None:
        """Return the ways of environment ``e`` as its doors stand now."""
        place = self._current[e]
        return place if isinstance(place, RouteSet) else None

    def restart(self, e: int) -> None:
        """Reset environment ``e``: all its doors are open, and its fastest ways are due."""
        if self._closed[e]:
            self.close(e, frozenset())
        self._clock.due[e] = 0.0

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next environment is due; None if there is nothing to plan."""
        return self._clock.steps_until_due((e for e, _ in self._dynamic if inside[e] > 0), time, dt)

    def update(self, bodies: Bodies, state: CrowdState, only: int | None = None) -> None:
        """Find the fastest ways of the environments that are due again, or of ``only`` one of them, in place."""
        if not self._dynamic:
            return
        begin = time.process_time()
        for e, place in self._dynamic:
            if only not in (None, e) or not self._clock.is_due(e, state.time[e]):
                continue
            people = slots_of(bodies, e)
            if not state.active[people].any():
                continue
            present = np.arange(people.start, people.stop)[state.present[people]]
            position = place.geometry.laid_out(state.position[present], state.sheet[present])
            walking = self._walking(bodies, present)
            fields = [(r, way.congestion) for r, way in enumerate(place.routes) if way.congestion is not None]
            for r, congestion in fields:
                self._write(e, r, congestion.march(position, walking))
            self._clock.due[e] = state.time[e] + max(congestion.every for _, congestion in fields)
        self.seconds += time.process_time() - begin

    def _walking(self, bodies: Bodies, people: Ints) -> FundamentalDiagram:
        """Return how these people walk in a crowd, in the mean."""
        radius, speed = float(bodies.radius[people].mean()), float(bodies.desired_speed[people].mean())
        return FundamentalDiagram(radius, speed, self._keep_distance)

    def _write(self, e: int, r: int, field: NavigationField) -> None:
        first, exits = int(self.guidance.field_of_route[e, r]), self._boundary.exit_start[self._geometry_of_env[e]]
        for row, part in enumerate(by_sheet(field), first):
            assert part is not None
            travel_time, direction, cell = _of_field(self.field, row)
            travel_time[:], direction[:] = part.travel_time.ravel() - field.behind, part.direction.reshape(-1, 2)
            cell[:] = rows_in_batch(part.cell, exits)
        self.marches += 1

    def close(self, e: int, closed: frozenset[str]) -> None:
        """Set the ways of environment ``e`` to the ways with these doors closed.

        If that locks people in, the routes stay as they were, with a warning: they wait at the door.
        """
        place = self.places[self._geometry_of_env[e]]
        if not isinstance(place, RouteSet):
            return
        try:
            route_set = self._ways(place, closed)
        except ValueError as error:
            warnings.warn(f"with {', '.join(sorted(closed))} closed people wait there: {error}", stacklevel=3)
            return
        key = self._key(e, closed)
        if key not in self._rows:
            self._add(key, route_set, int(self._geometry_of_env[e]))
            before = self.field
            self.field = join_fields(self.fields, self._boundary, self.geometry_of_field)
            for name in ("travel_time", "direction", "cell"):  # as they were: some follow their crowd
                known = getattr(before, name)
                getattr(self.field, name)[: len(known)] = known
        count = len(route_set.routes)
        self.guidance.field_of_route[e, :count], self.potential_of_route[e, :count] = self._rows[key]
        self._current[e], self._closed[e] = route_set, closed
        self._dynamic = self._find_dynamic()
        self._clock.due[e] = 0.0

    def _add(self, key: _Key, route_set: RouteSet, geometry: int) -> None:
        self._rows[key] = add_fields(route_set, self.fields)
        self.geometry_of_field += [geometry] * (len(self.fields) - len(self.geometry_of_field))

    def moment(self) -> PlannerState:
        """Return a copy of the ways as they are."""
        own = []
        for (owner, _), (rows, _) in self._rows.items():
            if owner >= 0 and isinstance(place := self._current[owner], RouteSet):
                own += [row + s for row in rows for s in range(len(place.geometry.surface.level))]
        found = {row: tuple(array.copy() for array in _of_field(self.field, row)) for row in own}
        return PlannerState(
            tuple(self._rows), tuple(self._closed), self.guidance.field_of_route.copy(), found, self._clock.due.copy()
        )

    def restore(self, then: PlannerState) -> None:
        """Let the ways be as they were, and every field where it was."""
        if tuple(self._rows) != then.known:
            self._rows = dict(self._first_rows)
            del self.fields[self._first_fields :], self.geometry_of_field[self._first_fields :]
            for owner, closed in then.known[len(self._rows) :]:
                g = int(self._geometry_of_env[owner]) if owner >= 0 else -1 - owner
                place = self.places[g]
                assert isinstance(place, RouteSet)  # others have no doors
                self._add((owner, closed), self._ways(place, closed), g)
            self.field = join_fields(self.fields, self._boundary, self.geometry_of_field)
        for row, values in then.found.items():
            for array, known in zip(_of_field(self.field, row), values, strict=True):
                array[:] = known
        self.guidance.field_of_route[:] = then.field_of_route
        for e, closed in enumerate(then.closed):
            place = self.places[self._geometry_of_env[e]]
            self._closed[e] = closed
            self._current[e] = route_set = self._ways(place, closed) if isinstance(place, RouteSet) else place
            if isinstance(route_set, RouteSet):
                self.potential_of_route[e, : len(route_set.routes)] = self._rows[self._key(e, closed)][1]
        self._dynamic = self._find_dynamic()
        self._clock.due[:] = then.due

    def _key(self, e: int, closed: frozenset[str]) -> _Key:
        """Fields are shared by the environments of a place, unless they follow the crowd of one."""
        place = self.places[self._geometry_of_env[e]]
        own = isinstance(place, RouteSet) and place.is_dynamic
        return (e if own else -1 - int(self._geometry_of_env[e])), closed


def _of_field(field: FieldArrays, row: int) -> tuple[Floats, Floats, np.ndarray]:
    """Return views of the parts of a field that change when its ways are found again."""
    nodes = slice(int(field.node_start[row]), int(field.node_start[row + 1]))
    return field.travel_time[nodes], field.direction[nodes], field.cell[nodes]
