"""People that come in during an episode: until then they are no bodies, like people that have left.

A person comes in at rest, at its time, on the first free spot of its entrance: where its body overlaps neither a wall nor a
body.  If there is none it waits outside, and so do all behind it at this entrance; the entrance is looked at again every
`CHECK_EVERY`.
"""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints, slots_of
from crowd_env.core.clock import DueClock, next_multiple
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.geometry.entrances import NEVER, Entries, at_the_start
from crowd_env.routing.door_schedule import CHECK_EVERY

_TOUCH = 1e-9  # m, the overlap that recorded starts may have


class EntryState(NamedTuple):
    """The part of a checkpoint from `Entrances`."""

    entries: tuple[Entries, ...]  # of every environment
    queue: tuple[Ints, ...]
    entry_time: Floats  # (P,)
    due: Floats  # (E,)  s


class Entrances:
    """Lets people in at their time, environment by environment.

    Parameters
    ----------
    bodies : of all environments.
    room : radius of the discs as which people are placed, in radii of their bodies.

    Attributes
    ----------
    entry_time : (P,) s, when each person came in: 0 = there at the start; nan = not in yet.
    """

    def __init__(self, bodies: Bodies, room: float) -> None:
        self._bodies, self._room = bodies, room
        counts = np.diff(bodies.env_start)
        self._entries = [at_the_start(0) for _ in counts]
        # People to come, in order, numbered from 0 in each environment.
        self._queue = [np.zeros(0, dtype=np.int64) for _ in counts]
        self.entry_time = np.zeros(len(bodies.radius))
        self._clock = DueClock(len(counts))
        self._watched: list[int] = []  # environments with people to come

    @property
    def are_used(self) -> bool:
        """Whether anybody is still to come."""
        return bool(self._watched)

    @property
    def coming(self) -> Ints:
        """How many people are still to come, waiting ones included (E,)."""
        return np.array([len(queue) for queue in self._queue], dtype=np.int64)

    def times_of(self, e: int, until: float) -> Floats:
        """Return when the people of environment ``e`` came in (N,) [s].

        0 = there at the start; nan = not in, but come ``until`` then [s]; inf = not come.
        """
        entry, due = self.entry_time[slots_of(self._bodies, e)].copy(), self._entries[e].due
        if len(due):
            entry[np.isnan(entry) & (due > until)] = NEVER
        return entry

    def restart(self, e: int, entries: Entries | None, state: CrowdState) -> None:
        """Begin an episode of environment ``e``: people that come later are out."""
        people = slots_of(self._bodies, e)
        self.entry_time[people], self._clock.due[e] = 0.0, 0.0
        self._entries[e] = at_the_start(0)
        if entries is not None and not np.isnan(entries.due).all():
            later = ~np.isnan(entries.due)
            who = np.arange(people.start, people.stop)[later]
            self.entry_time[who], state.active[who], state.present[who] = np.nan, False, False
            state.position[who], state.sheet[who] = entries.first_spots()[later], entries.sheet[entries.first[later]]
            self._entries[e] = entries
        self._line_up(e, np.argsort(self._entries[e].due, kind="stable"))

    def _line_up(self, e: int, order: Ints) -> None:
        self._queue[e] = order[np.isfinite(self._entries[e].due[order])]
        self._watched = [k for k, queue in enumerate(self._queue) if len(queue)]

    def close(self, e: int) -> None:
        """Close the entrances of environment ``e``: its episode is over."""
        if len(self._queue[e]):
            self._line_up(e, self._queue[e][:0])

    def moment(self) -> EntryState:
        """Return a copy of the state."""
        return EntryState(tuple(self._entries), tuple(self._queue), self.entry_time.copy(), self._clock.due.copy())

    def restore(self, then: EntryState) -> None:
        """Restore the state of a copy."""
        self._entries, self._queue = list(then.entries), list(then.queue)
        self._watched = [k for k, queue in enumerate(self._queue) if len(queue)]
        self.entry_time[:], self._clock.due[:] = then.entry_time, then.due

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next environment must be looked at; None if all are in."""
        return self._clock.steps_until_due(self._watched, time, dt)

    def update(self, state: CrowdState, only: int | None = None) -> list[int]:
        """Let in the people that are due and find room; returns the environments that they have entered."""
        entered = []
        for e in self._watched if only is None else [only]:
            now = float(state.time[e])
            if not self._clock.is_due(e, now):
                continue
            entries, queue, begin = self._entries[e], self._queue[e], int(self._bodies.env_start[e])
            due = entries.due[queue]
            come = queue[: np.searchsorted(due, now + 1e-9, side="right")]
            came_in = np.zeros(len(come), dtype=bool)
            if len(come):
                people = slots_of(self._bodies, e)
                is_full = np.zeros(len(entries.spots), dtype=bool)
                _let_in(come, begin, people.stop, entries, self._room, self._bodies.radius, state, is_full, came_in)
            if came_in.any():
                who = begin + come[came_in]
                self.entry_time[who] = now
                self._bodies.response_time[who] += now
                queue = np.concatenate([come[~came_in], queue[len(come) :]])
                self._line_up(e, queue)
                entered.append(e)
            following = entries.due[queue[len(come) - int(came_in.sum()) :][:1]]
            wait = next_multiple(CHECK_EVERY, now) if not came_in.all() else np.inf
            self._clock.due[e] = min([wait, *following.tolist()])
        return entered


@kernel
def _let_in(
    come: Ints,
    begin: int,
    stop: int,
    entries: Entries,
    room: float,
    radius: Floats,
    state: CrowdState,
    is_full: Bools,
    came_in: Bools,
) -> None:
    """Place each of the people that have ``come`` on the first free spot of its entrance, in order.

    ``begin`` and ``stop`` are the slots of the environment, ``is_full`` is written at the first spot of each entrance.
    """
    for k in range(len(come)):
        n = come[k]
        i, start, count = begin + n, entries.start[n], entries.stop[n] - entries.start[n]
        for tried in range(0 if is_full[start] else count):
            spot = start + (entries.first[n] - start + tried) % count
            x, y = entries.spots[spot, 0], entries.spots[spot, 1]
            if _is_free(x, y, entries.sheet[spot], room * radius[i], begin, stop, room, radius, state):
                state.position[i, 0], state.position[i, 1], state.sheet[i] = x, y, entries.sheet[spot]
                state.velocity[i, 0], state.velocity[i, 1], state.spin[i] = 0.0, 0.0, 0.0
                state.active[i] = state.present[i] = came_in[k] = True
                break
        is_full[start] |= not came_in[k]


@inner_kernel
def _is_free(
    x: float, y: float, sheet: int, own: float, begin: int, stop: int, room: float, radius: Floats, state: CrowdState
) -> bool:
    present, position = state.present, state.position
    for j in range(begin, stop):
        if (present[j] or state.active[j]) and state.sheet[j] == sheet:
            reach = own + room * radius[j] - _TOUCH
            dx, dy = position[j, 0] - x, position[j, 1] - y
            if dx * dx + dy * dy < reach * reach:
                return False
    return True
