"""Large crowds in the order of space: who stands together lies together in memory.

People keep their slots for whoever looks from outside.  The physics of an environment of many people works on copies, sorted by
cells of half a meter, row after row of them, anew every half second: in a crowd of 100,000 in the order of their slots nearly
every touch of a neighbor had to be fetched from beyond the processor's caches.  How people lie changes the order of sums and
with it their last digits; it depends on nothing but the environment's own clock and positions.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowd_env._kernels.jit import index, kernel
from crowd_env.physics.contacts import KEPT, Contacts, contact_keys, rows_of
from crowd_env.physics.neighbors.lists import NeighborList
from crowd_env.physics.workspace import Batch, Command, History, Results, set_command
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

MANY = 1000  # people from which on an environment is sorted: fewer lie in the caches anyhow
EVERY = 0.5  # s
_CELL = 0.5  # m

# The part of the history that only the physics reads: it lies in the order of space itself.
_IN_ORDER = ("direction", "is_uniform", "lookup_turn", "region_bits", "local_speed", "force", "torque")


class Order(NamedTuple):
    """In which order people are, and until when: what a checkpoint keeps of a `SortedCrowd`."""

    slot: Ints  # (P,)
    due: Floats  # (E,)  s


class SortedCrowd:
    """Working copies of a batch, in the order of space where an environment is large.

    Attributes
    ----------
    slot : (P,) slot of everyone in the order of the copies; those of one environment stay together.
    """

    def __init__(self, bodies: Bodies, state: CrowdState, results: Results, history: History) -> None:
        self._env_start = bodies.env_start
        self.slot: Ints = np.arange(len(bodies.radius))
        self._first_turn = history.lookup_turn.copy()  # in slots
        self._large = np.flatnonzero(np.diff(bodies.env_start) >= MANY).tolist()
        self._small = _stretches(np.diff(bodies.env_start) < MANY, bodies.env_start)  # who keep their order
        self._due = np.full(len(state.time), -math.inf)
        self._bodies = Bodies._make([*(array.copy() for array in bodies[:-1]), bodies.env_start])
        self._state = CrowdState._make([*(array.copy() for array in state[:-1]), state.time])
        self._followed = history.followed.copy()
        self._results = results._replace(
            impulse=results.impulse.copy(), impulse_magnitude=results.impulse_magnitude.copy()
        )

    @staticmethod
    def is_needed(bodies: Bodies) -> bool:
        """Whether any environment is large."""
        return bool((np.diff(bodies.env_start) >= MANY).any())

    def restart(self, e: int, history: History) -> None:
        """Environment ``e`` has other people: in their slots, as at first, and to be sorted before the next step."""
        people = slice(int(self._env_start[e]), int(self._env_start[e + 1]))
        self.slot[people] = np.arange(people.start, people.stop)
        history.lookup_turn[people] = self._first_turn[people]
        self._due[e] = -math.inf

    def order(self) -> Order:
        """Return a copy of the order."""
        return Order(self.slot.copy(), self._due.copy())

    def restore(self, order: Order, bodies: Bodies) -> None:
        """Take up an order; the history that lies in it is restored by itself."""
        self.slot[:], self._due[:] = order
        for own, array in zip(self._bodies[:-1], bodies[:-1], strict=True):
            own[:] = array[self.slot]

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next environment is due; None if there is none."""
        waits = [max(1, math.ceil((self._due[e] - time[e]) / dt - 1e-9)) for e in self._large if inside[e] > 0]
        return min(waits, default=None)

    def update(self, bodies: Bodies, state: CrowdState, history: History, neighbors: NeighborList) -> None:
        """Sort the environments that are due anew."""
        for e in self._large:
            if state.time[e] >= self._due[e] - 1e-9:
                self._sort(e, bodies, state, history, neighbors)
                self._due[e] = (math.floor(float(state.time[e]) / EVERY + 1e-6) + 1) * EVERY

    def _sort(self, e: int, bodies: Bodies, state: CrowdState, history: History, neighbors: NeighborList) -> None:
        people = slice(int(self._env_start[e]), int(self._env_start[e + 1]))
        slots = self.slot[people]
        order = _order_of_space(state.position[slots], state.active[slots])
        self.slot[people] = slots[order]
        for array in (getattr(history, name) for name in _IN_ORDER):
            if len(array):  # not every scheme uses all
                array[people] = array[people][order]
        for own, values in zip(self._bodies[:-1], bodies[:-1], strict=True):
            own[people] = values[self.slot[people]]
        neighbors.reach[e] = -1.0
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        _renumber(people.start, rank, history.contacts, rows_of(e, history.contacts, neighbors))

    def view(self, batch: Batch) -> Batch:
        """Return the batch as the physics sees it: with the copies."""
        history = batch.history._replace(followed=self._followed)
        return batch._replace(bodies=self._bodies, state=self._state, results=self._results, history=history)

    def gather(self, batch: Batch, asked: Command) -> None:
        """Read anew what others may have changed, and write what is asked for to ``control``."""
        for people in self._small:
            for own, values in zip(self._bodies[:-1], batch.bodies[:-1], strict=True):
                own[people] = values[people]
        for copy, array in self._shown(batch):
            _gather(self.slot, array, copy)
        set_command(batch.control, asked, lambda array, values: _gather(self.slot, values, array))

    def scatter(self, batch: Batch) -> None:
        """Write what the physics has done to where everyone looks for it."""
        for copy, array in self._shown(batch):
            _scatter(self.slot, copy, array)

    def _shown(self, batch: Batch) -> list[tuple[Any, Any]]:
        """Return what lies in slots for others to read and write: each copy, and the array that it is of."""
        return [
            *zip(self._state[:-1], batch.state[:-1], strict=True),
            (self._followed, batch.history.followed),
            *zip(self._results[:-1], batch.results[:-1], strict=True),
        ]

    def by_slot(self, i: Ints, j: Ints, normal: Floats) -> tuple[Ints, Ints, Floats, Ints]:
        """Return contacts between slots, i < j, sorted by (i, j), walls last; and the order they had."""
        i, j = self.slot[i], np.where(j >= 0, self.slot[np.maximum(j, 0)], j)
        swap = (j >= 0) & (j < i)
        i, j = np.where(swap, j, i), np.where(swap, i, j)
        order = np.argsort(contact_keys(i, j))
        return i[order], j[order], np.where(swap[:, None], -normal, normal)[order], order


def _stretches(chosen: Bools, env_start: Ints) -> list[slice]:
    """Return whose people the chosen environments are, those that follow one another together."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]])))
    return [slice(int(env_start[e]), int(env_start[stop])) for e, stop in edges.reshape(-1, 2)]


def _gather(slot: Ints, source: Any, copy: Any) -> None:
    """Copy the people of ``source`` in the order of ``slot``."""
    (_gather_one if source.ndim == 1 else _gather_two)(slot, source, copy)


def _scatter(slot: Ints, copy: Any, target: Any) -> None:
    """Copy them back."""
    (_scatter_one if target.ndim == 1 else _scatter_two)(slot, copy, target)


# NumPy's own take and put need three times as long.
@kernel
def _gather_one(slot: Ints, source: Any, copy: Any) -> None:
    for i in range(len(slot)):
        copy[i] = source[index(slot[i])]


@kernel
def _gather_two(slot: Ints, source: Any, copy: Any) -> None:
    for i in range(len(slot)):
        k = index(slot[i])
        copy[i, 0], copy[i, 1] = source[k, 0], source[k, 1]


@kernel
def _scatter_one(slot: Ints, copy: Any, target: Any) -> None:
    for i in range(len(slot)):
        target[index(slot[i])] = copy[i]


@kernel
def _scatter_two(slot: Ints, copy: Any, target: Any) -> None:
    for i in range(len(slot)):
        k = index(slot[i])
        target[k, 0], target[k, 1] = copy[i, 0], copy[i, 1]


def _order_of_space(position: Floats, active: Bools) -> Ints:
    """Return the people (N,) row by row of cells; those who are out last."""
    if not active.any():
        return np.arange(len(active))
    low = position[active].min(axis=0)
    column, row = np.floor((np.where(active[:, None], position, low) - low) / _CELL).astype(np.int64).T
    return np.argsort(np.where(active, row * (column.max() + 1) + column, np.iinfo(np.int64).max), kind="stable")


def _renumber(begin: int, rank: Ints, contacts: Contacts, rows: slice) -> None:
    """Let the contacts ``rows`` of an environment follow people to their new places ``rank``, sorted as they must be."""
    i, j, normal = contacts.i[rows], contacts.j[rows], contacts.normal[rows]
    i = begin + rank[i - begin]
    j = np.where(j >= 0, begin + rank[np.maximum(j, begin) - begin], j)
    swap = (j >= 0) & (j < i)
    contacts.i[rows], contacts.j[rows] = np.where(swap, j, i), np.where(swap, i, j)
    normal[swap] *= -1.0
    order = np.argsort(contact_keys(contacts.i[rows], contacts.j[rows]))
    for name in KEPT:
        array = getattr(contacts, name)
        array[rows] = array[rows][order]
