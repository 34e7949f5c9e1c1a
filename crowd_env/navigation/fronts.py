"""The fronts in which a crowd comes to a way out, and how long it queues there.

A front is a connected piece of floor that is equally far from the way out, `DEPTH` deep.  All who stand in it come
through the narrowest front between there and the way out, so many a second; nobody gets past the others by walking around
them.  Where ways part, the fronts do, and a queue on one of them makes the other the faster one.
"""

from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray

from crowd_env.navigation.fundamental_diagram import FundamentalDiagram
from crowd_env.navigation.grid import RIGHT, UP, connected_parts
from crowd_env.state import Bools, Floats, Ints

DEPTH = 0.5  # m on plain floor


class Fronts:
    """The fronts of a place; front 0 is where nobody walks.

    Parameters
    ----------
    time : (rows, cols) travel time at 1 m/s to the way out [s], inf where nobody walks.
    free : (rows, cols) where the middle of a body has room.
    speed : (rows, cols) relative to plain floor.
    blocked : (rows, cols) lines between nodes that walls cross, see `crowd_env.navigation.grid.blocked_lines`.
    spacing : m, between nodes.
    width : (rows, cols) m, that the middle of a body has of the exit that is seen; inf where none is.

    Attributes
    ----------
    front : (rows, cols) number of the front that a node lies in.
    """

    def __init__(
        self, time: Floats, free: Bools, speed: Floats, blocked: NDArray[np.uint8], spacing: float, width: Floats
    ) -> None:
        self._depth = max(DEPTH, 2.5 * spacing)  # s at 1 m/s
        known = np.isfinite(time)
        level = np.where(known, np.where(known, time, 0.0) / self._depth, -1.0).astype(np.int64)
        right = (blocked[:, :-1] & RIGHT == 0) & known[:, :-1] & known[:, 1:]
        up = (blocked[:-1] & UP == 0) & known[:-1] & known[1:]
        self.front = front = _parts_of_levels(level, right, up)
        count = int(front.max(initial=0)) + 1
        level_of = np.full(count, -1)
        level_of[front] = level
        size = np.maximum(np.bincount(front.ravel(), minlength=count), 1)
        share = np.bincount(front.ravel(), speed.ravel(), count) / size
        self._length = self._depth * np.maximum(share, 1e-6)  # m; slow ground takes longer, and lets fewer pass
        self._narrowest = np.bincount(front.ravel(), free.ravel(), count) * spacing**2 / self._length * share
        seen = np.full(count, np.inf)
        np.minimum.at(seen, front.ravel(), width.ravel())
        self._first = np.flatnonzero(level_of == 0)
        self._narrowest[self._first] = np.minimum(self._narrowest, seen)[self._first]
        pairs = np.concatenate(
            [np.stack([front[:, :-1][right], front[:, 1:][right]]), np.stack([front[:-1][up], front[1:][up]])], axis=1
        )
        pairs = np.unique(pairs[:, pairs[0] != pairs[1]], axis=1)
        self._beside: list[set[int]] = [set() for _ in range(count)]
        for one, other in pairs.T.tolist():
            self._beside[one].add(other)
            self._beside[other].add(one)
        self._ahead = [[p for p in near if level_of[p] < level_of[n]] for n, near in enumerate(self._beside)]
        self._by_level = np.argsort(level_of, kind="stable").tolist()
        for n in self._by_level:
            if self._ahead[n]:
                self._narrowest[n] = min(self._narrowest[n], self._narrowest[self._ahead[n]].sum())

    def queue(self, node: tuple[Ints, Ints], people: FundamentalDiagram) -> Floats:
        """Return how many times as long as for somebody alone (K,) each front takes, with people at these nodes."""
        waiting = np.bincount(self.front[node], minlength=len(self._narrowest)) / people.flow(self._narrowest)  # s
        waiting[0] = 0.0
        return np.asarray(np.maximum(waiting * people.desired_speed / self._depth, 1.0))

    def keeps_on(self, queue: Floats) -> Bools:
        """Return in which fronts (K,) the shortest way is the fastest, and stays so all the way out."""
        time, then = np.full(len(queue), np.inf), np.full(len(queue), -1)
        heap = [(0.5 * queue[n], n, -1) for n in self._first.tolist()]
        heapify(heap)
        while heap:
            at, n, on = heappop(heap)
            if time[n] <= at:
                continue
            time[n], then[n] = at, on
            for other in self._beside[n]:
                later = at + 0.5 * (queue[n] + queue[other])
                if later < time[other]:
                    heappush(heap, (later, other, n))
        keeps = np.zeros(len(queue), dtype=np.bool_)
        for n in self._by_level:
            ahead = self._ahead[n]
            keeps[n] = (then[n] in ahead and all(keeps[p] for p in ahead)) if ahead else then[n] < 0
        return keeps


def _parts_of_levels(level: Ints, right: Bools, up: Bools) -> Ints:
    """Return a number per node (rows, cols) of the connected part of its ``level`` (-1 = none: part 0).

    ``right`` (rows, cols - 1) and ``up`` (rows - 1, cols) say between which neighbors one can walk.
    """
    rows, cols = level.shape
    linked = np.zeros((2 * rows - 1, 2 * cols - 1), dtype=np.bool_)
    linked[::2, ::2] = level >= 0
    linked[::2, 1::2] = right & (level[:, :-1] == level[:, 1:])
    linked[1::2, ::2] = up & (level[:-1] == level[1:])
    part = connected_parts(linked, np.zeros_like(linked))[::2, ::2]
    return np.asarray(np.where(part > 0, part - 1, 0))
