"""The fronts in which a crowd comes to a way out, and how long it queues there.

The floor is divided into bands, each `DEPTH` deep, by the distance to the way out.  A front is a connected piece of a band.
The people of one band with the same opening ahead wait for each other there, whichever branch they come by.  Walking around a
queue gains nothing.  Where ways part for good, a queue on one of them makes the other the faster one.
"""

from heapq import heapify, heappop, heappush
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.routing.fields.fundamental_diagram import FundamentalDiagram
from crowd_env.routing.fields.grid import RIGHT, UP, connected_parts

DEPTH = 0.5  # m on plain floor
NARROW = 1.6  # m, for the middle of a body, of openings over which density alone does not spread people; fitted
_NO_LINKS = np.empty((2, 0), dtype=np.int64)
_BESIDE = 3  # nodes between a wall and where the middle of a body has room


class Fronts:
    """The fronts of a place; front 0 is all floor without ways.

    Parameters
    ----------
    time : (rows, cols) travel time at 1 m/s to the way out [s], inf where there is none.
    free : (rows, cols) where the middle of a body has room.
    speed : (rows, cols) relative to plain floor.
    blocked : (rows, cols) lines between nodes that walls cross, see `crowd_env.routing.fields.grid.blocked_lines`.
    spacing : m, between nodes.
    seen : (rows, cols) row of the exit that is seen; -1 where none is.
    width : (exits,) m, that the middle of a body has of each exit.
    links : (2, N) rows of nodes that are neighbors too: on either side of a seam.

    Attributes
    ----------
    front : (rows, cols) number of the front that a node lies in, or is next to.
    narrow : (rows, cols) where a front is at most `NARROW` wide.
    shared : (rows, cols) where all ways out lead through one opening: the only front beside the way out, or a narrow one.
    """

    def __init__(
        self,
        time: Floats,
        free: Bools,
        speed: Floats,
        blocked: NDArray[np.uint8],
        spacing: float,
        seen: Ints,
        width: Floats,
        links: Ints = _NO_LINKS,
    ) -> None:
        self._depth = max(DEPTH, 2.5 * spacing)  # s at 1 m/s
        known = np.isfinite(time) & free  # others may lie on walls, with floor on both sides
        band = np.where(known, np.where(known, time, 0.0) / self._depth, -1.0).astype(np.int64)
        open_right, open_up = blocked[:, :-1] & RIGHT == 0, blocked[:-1] & UP == 0
        right, up = open_right & known[:, :-1] & known[:, 1:], open_up & known[:-1] & known[1:]
        front = parts_of_bands(band, right, up)
        if links.size:
            links = links[:, known.ravel()[links].all(axis=0)]
            front = _joined(front, links[:, np.equal(*band.ravel()[links])])
        count = int(front.max(initial=0)) + 1
        band_of = np.full(count, -1)
        band_of[front] = band
        size = np.maximum(np.bincount(front.ravel(), minlength=count), 1)
        share = np.bincount(front.ravel(), speed.ravel(), count) / size
        self._length = self._depth * np.maximum(share, 1e-6)  # m; slow ground takes longer, and lets fewer pass
        self._width = size * spacing**2 / self._length * share
        # A front may lie along several lines, as around an exit that is an area: people leave by all of them.
        by, row = np.unique(np.stack([front[seen >= 0], seen[seen >= 0]]), axis=1)
        through = np.bincount(by, width[row], count)
        self._first = np.flatnonzero(band_of == 0)
        leads_out = self._first[np.isin(self._first, by)]
        self._width[leads_out] = np.minimum(self._width, through)[leads_out]
        self._width = np.maximum(self._width, 1e-6)
        beside = (front[:, :-1][right], front[:, 1:][right]), (front[:-1][up], front[1:][up])
        pairs = np.concatenate([*map(np.stack, beside), front.ravel()[links]], axis=1)
        pairs = np.unique(pairs[:, pairs[0] != pairs[1]], axis=1)
        self._beside: list[set[int]] = [set() for _ in range(count)]
        for one, other in pairs.T.tolist():
            self._beside[one].add(other)
            self._beside[other].add(one)
        self._ahead = [[p for p in near if band_of[p] < band_of[n]] for n, near in enumerate(self._beside)]
        self._by_band, self._band = np.argsort(band_of, kind="stable").tolist(), band_of
        self._steps = [self._step(list(fronts)) for _, fronts in groupby(self._by_band, band_of.__getitem__)]
        self._steps = [step for step in self._steps if len(step[0])]
        self.front = _spread(front, open_right, open_up)
        narrow = size * spacing**2 / self._length <= NARROW
        self.narrow = narrow[self.front]
        self.shared = self._behind(narrow)[self.front] | (len(self._first) == 1)

    def _behind(self, narrow: Bools) -> Bools:
        """Return which fronts (K,) a single ``narrow`` one parts from the way out (cut vertices; Tarjan 1972)."""
        count, root = len(self._band), len(self._band)
        beside = [*map(list, self._beside), self._first.tolist()]  # the way out is a front more, beside the first ones
        for n in self._first.tolist():
            beside[n].append(root)
        number, low, parent = np.full(count + 1, -1), np.zeros(count + 1, dtype=np.int64), np.full(count + 1, -1)
        order, stack = list[int](), [root]
        while stack:  # in depth
            n = stack[-1]
            if number[n] < 0:
                number[n] = low[n] = len(order)
                order.append(n)
            if not beside[n]:
                stack.pop()
                if n != root:
                    low[parent[n]] = min(low[parent[n]], low[n])
                continue
            other = beside[n].pop()
            if number[other] < 0:
                parent[other] = n
                stack.append(other)
            elif other != parent[n]:
                low[n] = min(low[n], number[other])
        behind = np.zeros(count + 1, dtype=bool)
        for n in order[1:]:
            on = parent[n]
            behind[n] = behind[on] or (on != root and narrow[on] and low[n] >= number[on])
        return behind[:count]

    def _step(self, fronts: list[int]) -> tuple[Ints, Ints, Floats, Ints]:
        """Return the pairs of these fronts and the fronts ahead of them: behind, ahead, share, first.

        Of the people in ``behind`` (N,) the ``share`` (N, 1) comes through ``ahead`` (N,), by its share of the width;
        ``first`` are the first pairs of each front.
        """
        fronts = [n for n in fronts if self._ahead[n]]
        behind = np.array([n for n in fronts for _ in self._ahead[n]], dtype=np.int64)
        ahead = np.array([p for n in fronts for p in self._ahead[n]], dtype=np.int64)
        total = np.bincount(behind, self._width[ahead], len(self._ahead))
        first = np.flatnonzero(np.diff(behind, prepend=-1))
        return behind, ahead, (self._width[ahead] / total[behind])[:, None], first

    def queue(self, node: tuple[Ints, Ints], people: FundamentalDiagram) -> Floats:
        """Return the factor (K,) by which each front takes longer than for one pedestrian alone, with people at these nodes."""
        inside = np.bincount(self.front[node], minlength=len(self._band))
        inside[0] = 0
        passing = np.zeros((len(inside), int(self._band.max()) + 1))  # people of each band that come through each front
        passing[np.arange(len(inside)), self._band] = inside
        for behind, ahead, share, _ in reversed(self._steps):
            np.add.at(passing, ahead, passing[behind] * share)
        waiting = passing / people.flow(self._width)[:, None]  # s
        for behind, ahead, _, first in self._steps:
            waiting[behind[first]] = np.maximum(waiting[behind[first]], np.minimum.reduceat(waiting[ahead], first))
        longest = waiting[np.arange(len(inside)), self._band]
        longest[0] = 0.0
        return np.maximum(longest * people.desired_speed / self._depth, 1.0)

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
        keeps = np.zeros(len(queue), dtype=bool)
        for n in self._by_band:
            ahead = self._ahead[n]
            keeps[n] = (then[n] in ahead and all(keeps[p] for p in ahead)) if ahead else then[n] < 0
        return keeps


def _spread(front: Ints, right: Bools, up: Bools) -> Ints:
    """Return the fronts (rows, cols) with the nodes beside them, up to `_BESIDE`, where people may be pressed against walls."""
    front = front.copy()
    for _ in range(_BESIDE):
        before = front.copy()
        for here, there, between in (
            (np.s_[:, :-1], np.s_[:, 1:], right),
            (np.s_[:, 1:], np.s_[:, :-1], right),
            (np.s_[:-1], np.s_[1:], up),
            (np.s_[1:], np.s_[:-1], up),
        ):
            front[here] = np.where((front[here] == 0) & between, before[there], front[here])
    return front


def _joined(front: Ints, same: Ints) -> Ints:
    """Return the fronts (rows, cols), renumbered, where the nodes of each pair (2, N) are of one front."""
    number = np.arange(front.max() + 1)
    for one, other in np.unique(front.ravel()[same], axis=1).T.tolist():
        number[number == number[other]] = number[one]
    return np.unique(number, return_inverse=True)[1][front]


def parts_of_bands(band: Ints, right: Bools, up: Bools) -> Ints:
    """Return a number per node (rows, cols) of the connected part of its ``band`` (-1 = none: part 0).

    ``right`` (rows, cols - 1) and ``up`` (rows - 1, cols) say between which neighbors one can walk.
    """
    rows, cols = band.shape
    linked = np.zeros((2 * rows - 1, 2 * cols - 1), dtype=bool)
    linked[::2, ::2] = band >= 0
    linked[::2, 1::2] = right & (band[:, :-1] == band[:, 1:])
    linked[1::2, ::2] = up & (band[:-1] == band[1:])
    part = connected_parts(linked, np.zeros_like(linked))[::2, ::2]
    return np.where(part > 0, part - 1, 0)
