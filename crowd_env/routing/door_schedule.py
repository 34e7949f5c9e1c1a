"""When doors open and close, environment by environment."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints, slots_of
from crowd_env.core.clock import DueClock, next_multiple
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.spec import DoorEvent

CHECK_EVERY = 0.1  # s


class DoorState(NamedTuple):
    """The part of a checkpoint from a `DoorSchedule`, for every environment."""

    happened: tuple[frozenset[int], ...]  # events
    due: Floats  # (E,)  s


class DoorSchedule:
    """Watches for the events that open and close doors; each happens once an episode.

    Parameters
    ----------
    geometries, closed_at_start, events : of every place; ``closed_at_start`` names the doors that are closed at first.
    geometry_of_env : (E,)
    """

    def __init__(
        self,
        geometries: Sequence[Geometry],
        closed_at_start: Sequence[Sequence[str]],
        events: Sequence[Sequence[DoorEvent]],
        geometry_of_env: Ints,
    ) -> None:
        self._geometries = [geometries[g] for g in geometry_of_env]
        self._closed_at_start = [frozenset(closed_at_start[g]) for g in geometry_of_env]
        self._events = [list(events[g]) for g in geometry_of_env]
        self._happened: list[set[int]] = [set() for _ in geometry_of_env]
        self._clock = DueClock(len(self._events))
        self._watched = [e for e, events in enumerate(self._events) if events]

    def restart(self, e: int) -> frozenset[str]:
        """Reset environment ``e``; returns the doors that are closed."""
        self._happened[e] = set()
        self._clock.due[e] = 0.0
        return self._closed_at_start[e]

    def moment(self) -> DoorState:
        """Return a copy of the state."""
        return DoorState(tuple(map(frozenset, self._happened)), self._clock.due.copy())

    def restore(self, then: DoorState) -> None:
        """Restore the state of a copy."""
        self._happened = [set(events) for events in then.happened]
        self._clock.due[:] = then.due

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next environment must be looked at; None if no door moves any more."""
        # The clock of an empty place stands still.
        waiting = (e for e in self._watched if inside[e] > 0 and len(self._happened[e]) < len(self._events[e]))
        return self._clock.steps_until_due(waiting, time, dt)

    def _next_look(self, e: int, now: float) -> float:
        """Return the next time to check: that of an event, or every `CHECK_EVERY` of the episode while people are counted."""
        pending = [event for k, event in enumerate(self._events[e]) if k not in self._happened[e]]
        times = [event.at for event in pending if event.at is not None]
        if any(event.at is None for event in pending):
            times.append(next_multiple(CHECK_EVERY, now))
        return min(times, default=math.inf)

    def update(self, bodies: Bodies, state: CrowdState, door_open: Bools) -> list[tuple[int, frozenset[str]]]:
        """Apply the events that are due; returns the environments in which a door moves, and their closed doors.

        ``door_open`` (E, D) is the state of the doors, in the order of `Geometry.doors`.
        """
        moved = []
        for e in self._watched:
            events = self._events[e]
            if len(self._happened[e]) == len(events) or not self._clock.is_due(e, state.time[e]):
                continue
            people = slots_of(bodies, e)
            # Padded to the most of any place.
            doors = zip(self._geometries[e].doors, door_open[e].tolist(), strict=False)
            before = closed = frozenset(name for name, is_open in doors if not is_open)
            for k, event in enumerate(events):
                if k not in self._happened[e] and self._is_due(e, event, state, people):
                    self._happened[e].add(k)
                    closed = closed - {event.door} if event.opens else closed | {event.door}
            self._clock.due[e] = self._next_look(e, float(state.time[e]))
            if closed != before:
                moved.append((e, closed))
        return moved

    def _is_due(self, e: int, event: DoorEvent, state: CrowdState, people: slice) -> bool:
        if event.at is not None:
            return bool(state.time[e] >= event.at - 1e-9)
        geometry = self._geometries[e]
        assert event.at_least is not None
        if event.region is not None:
            position = geometry.laid_out(state.position[people], state.sheet[people])[state.active[people]]
            return int(geometry.contains(position, event.region).sum()) >= event.at_least
        rows = [k for k, name in enumerate(geometry.exit_names) if name == event.exit]
        return int(np.isin(state.exit_index[people], rows).sum()) >= event.at_least
