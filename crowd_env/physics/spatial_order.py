"""Spatial sorting of large crowds: neighbors in space are neighbors in memory.

Callers see people in their slots.  The physics of a large environment works on copies, sorted by cells of half a meter, row by
row, again every half second.  In slot order, nearly every access to a neighbor in a crowd of 100,000 missed the processor's
caches.  The memory order changes the order of sums and so their last digits; it depends only on the environment's clock and
positions.
"""

from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints
from crowd_env.core.clock import DueClock, next_multiple
from crowd_env.core.kernels.jit import index, kernel
from crowd_env.physics.allocation import arrays_of_people
from crowd_env.physics.contacts import Contacts, order_of_contacts, rows_of
from crowd_env.physics.neighbors.lists import NeighborList, invalidate_lists
from crowd_env.physics.workspace import Batch, Command, History, Results, set_command

MANY = 1000  # people from which on an environment is sorted: fewer fit in the caches
EVERY = 0.5  # s
_CELL = 0.5  # m


class Order(NamedTuple):
    """The order of people and the time of the next sort: what a checkpoint keeps of a `SortedCrowd`."""

    slot: Ints  # (P,)
    due: Floats  # (E,)  s


class SortedCrowd:
    """Working copies of a batch, in spatial order where an environment is large.

    Parameters
    ----------
    batch : in slot order, as callers see it.  Its arrays with one row a pedestrian are never replaced.

    Attributes
    ----------
    slot : (P,) slot of each pedestrian in the order of the copies; the slots of one environment stay together.
    batch : with the copies, as the physics sees it.
    """

    def __init__(self, batch: Batch) -> None:
        bodies, state, results = batch.bodies, batch.state, batch.results
        self._in_slots = batch
        self._first_turn = batch.history.lookup_turn.copy()  # in slots
        self._large = np.flatnonzero(np.diff(bodies.env_start) >= MANY).tolist()
        self._small = _stretches(np.diff(bodies.env_start) < MANY, bodies.env_start)  # keep their order
        self._clock = DueClock(len(state.time))
        self.slot: Ints = np.arange(len(bodies.radius))
        self.batch = batch._replace(
            bodies=Bodies._make([*(array.copy() for array in bodies[:-1]), bodies.env_start]),
            state=CrowdState._make([*(array.copy() for array in state[:-1]), state.time]),
            results=Results._make([*(array.copy() for array in results[:-1]), results.diagnostics]),
            history=batch.history._replace(followed=batch.history.followed.copy()),
        )

    @staticmethod
    def is_needed(bodies: Bodies) -> bool:
        """Whether any environment is large."""
        return bool((np.diff(bodies.env_start) >= MANY).any())

    def restart(self, e: int) -> None:
        """Return environment ``e`` to slot order, to be sorted before the next step: it has other people."""
        people = self._people(e)
        self.slot[people] = np.arange(people.start, people.stop)
        self._in_slots.history.lookup_turn[people] = self._first_turn[people]
        self._clock.due[e] = 0.0

    def order(self) -> Order:
        """Return a copy of the order."""
        return Order(self.slot.copy(), self._clock.due.copy())

    def restore(self, order: Order) -> None:
        """Restore an order; the caller restores the history, which lies in that order."""
        self.slot[:], self._clock.due[:] = order
        self.gather_bodies(slice(None))

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return the number of steps until the next environment is due; None if there is none."""
        return self._clock.steps_until_due((e for e in self._large if inside[e] > 0), time, dt)

    def update(self, contacts: Contacts, neighbors: NeighborList) -> None:
        """Sort the environments that are due, and renumber their contacts."""
        time = self._in_slots.state.time
        for e in self._large:
            if self._clock.is_due(e, time[e]):
                self._sort(e, contacts, rows_of(e, contacts, neighbors))
                invalidate_lists(neighbors, e)
                self._clock.due[e] = next_multiple(EVERY, float(time[e]))

    def _sort(self, e: int, contacts: Contacts, rows: slice) -> None:
        people, state = self._people(e), self._in_slots.state
        slots = self.slot[people]
        order = _order_of_space(state.position[slots], state.active[slots])
        self.slot[people] = slots[order]
        for array in _in_order(self._in_slots.history):
            if len(array):  # optional arrays may be empty
                array[people] = array[people][order]
        self.gather_bodies(people)
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        _renumber(people.start, rank, contacts, rows)

    def _people(self, e: int) -> slice:
        env_start = self._in_slots.bodies.env_start
        return slice(int(env_start[e]), int(env_start[e + 1]))

    def gather_bodies(self, people: slice) -> None:
        """Copy the bodies of these people, of whole environments, from slot order."""
        for copy, array in zip(self.batch.bodies[:-1], self._in_slots.bodies[:-1], strict=True):
            copy[people] = array[self.slot[people]]

    def gather(self, asked: Command) -> None:
        """Copy all that callers may have changed, and write the command for the physics."""
        for people in self._small:
            self.gather_bodies(people)
        for copy, array in self._shown():
            _gather(self.slot, _flat(array), _flat(copy))
        set_command(self.batch.control, asked, lambda array, values: _gather(self.slot, _flat(values), _flat(array)))

    def scatter(self) -> None:
        """Copy the results of the physics back to slot order."""
        for copy, array in self._shown():
            _scatter(self.slot, _flat(copy), _flat(array))

    def _shown(self) -> list[tuple[Any, Any]]:
        """Return the arrays that callers read and write: pairs of a copy and its array in slot order."""
        copies, arrays = self.batch, self._in_slots
        return [
            *zip(copies.state[:-1], arrays.state[:-1], strict=True),
            (copies.history.followed, arrays.history.followed),
            *zip(copies.results[:-1], arrays.results[:-1], strict=True),
        ]


def _in_order(history: History) -> list[np.ndarray]:
    """Return the part of the history that only the physics reads, which is stored in spatial order."""
    own = [array for name, array in arrays_of_people(history).items() if name != "followed"]
    return own + [array for memory in history.memory for array in arrays_of_people(memory).values()]


def _stretches(chosen: Bools, env_start: Ints) -> list[slice]:
    """Return the slots of the chosen environments, one slice for each run of consecutive ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]])))
    return [slice(int(env_start[e]), int(env_start[stop])) for e, stop in edges.reshape(-1, 2)]


def _flat(array: Any) -> Any:
    """Return an array with one number a pedestrian: a vector (P, 2) as complex numbers."""
    return array if array.ndim == 1 else array.view(np.complex128)[:, 0]


# NumPy's take and put need three times as long.
@kernel
def _gather(slot: Ints, source: Any, copy: Any) -> None:
    """Copy the people of ``source`` in the order of ``slot``."""
    for i in range(len(slot)):
        copy[i] = source[index(slot[i])]


@kernel
def _scatter(slot: Ints, copy: Any, target: Any) -> None:
    """Copy people from the order of ``slot`` back to their slots."""
    for i in range(len(slot)):
        target[index(slot[i])] = copy[i]


def _order_of_space(position: Floats, active: Bools) -> Ints:
    """Return the order (N,) of people by rows of cells; people that have left come last."""
    if not active.any():
        return np.arange(len(active))
    low = position[active].min(axis=0)
    column, row = np.floor((np.where(active[:, None], position, low) - low) / _CELL).astype(np.int64).T
    return np.argsort(np.where(active, row * (column.max() + 1) + column, np.iinfo(np.int64).max), kind="stable")


def _renumber(begin: int, rank: Ints, contacts: Contacts, rows: slice) -> None:
    """Renumber the contacts ``rows`` of an environment by the new places ``rank`` of people, and sort them again."""
    i, j = contacts.i[rows] - begin, contacts.j[rows]
    others = contacts.normal[rows], contacts.disc_i[rows], contacts.disc_j[rows]
    *renumbered, order = between(begin + rank, i, np.where(j >= 0, j - begin, j), *others)
    for name, array in zip(("i", "j", "normal", "disc_i", "disc_j"), renumbered, strict=True):
        getattr(contacts, name)[rows] = array
    for array in (contacts.gap, contacts.impulse, contacts.history):
        array[rows] = array[rows][order]


def between(
    number: Ints, i: Ints, j: Ints, normal: Floats, disc_i: Ints, disc_j: Ints
) -> tuple[Ints, Ints, Floats, Ints, Ints, Ints]:
    """Return contacts after renumbering people by ``number``, i < j, sorted by (i, j, discs); and their former order."""
    i, j = number[i], np.where(j >= 0, number[np.maximum(j, 0)], j)
    swap = (j >= 0) & (j < i)
    i, j = np.where(swap, j, i), np.where(swap, i, j)
    if len(disc_i):
        disc_i, disc_j = np.where(swap, disc_j, disc_i), np.where(swap, disc_i, disc_j)
    order = order_of_contacts(i, j, disc_i, disc_j)
    of_discs = order[: len(disc_i)]  # none without an outline
    normal = np.where(swap[:, None], -normal, normal)
    return i[order], j[order], normal[order], disc_i[of_discs], disc_j[of_discs], order
