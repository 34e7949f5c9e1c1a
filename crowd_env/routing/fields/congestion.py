"""The fastest way through a crowd: a coarse travel-time field, marched again at the speeds that the crowd allows.

Queues slow people: passing a front takes as long as its queue takes at the narrowest place ahead
(`crowd_env.routing.fields.fronts`), and walking around the queue saves nothing.  Queues alone slow people that keep no
distance, so these leave the shortest way only where another door or exit is faster.  Density slows people that keep a
distance too: they go where a queue is thinner, and spread over wide openings (`crowd_env.routing.fields.drain`).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints, segment_lengths
from crowd_env.geometry.aprons import APRON
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.crossings import Crossings, coarse, reach
from crowd_env.routing.fields.directions import cell_kinds, descend
from crowd_env.routing.fields.domain import SOURCE
from crowd_env.routing.fields.drain import spread
from crowd_env.routing.fields.extension import fill_from_nearest
from crowd_env.routing.fields.field import NavigationField
from crowd_env.routing.fields.fronts import NARROW, Fronts
from crowd_env.routing.fields.fundamental_diagram import FundamentalDiagram, weidmann

SPACING = 0.2  # m, or four fifths of the radius: the band along a thin wall must hold a node
_EVERY = 1.0  # s, how often a fastest way is found again, counted from the start of each environment
_NODES = 200_000  # that are marched again each second at most
_ALIKE = 0.5  # cosine between two directions that lead the same way
_ABREAST = 0.7  # the same cosine, for people that spread: a larger turn leads around a crowd
_AT_EXIT, _IN_DOOR = 1.0, APRON  # s, at 1 m/s
_TIP = 2.0  # nodes that a corner may reach beyond the discs that fit into it
_AHEAD = 0.6  # m, of the fine way, to tell whether the marched field leads the same way
_SAME = 1e-9  # m, between the ends of two lines that meet
_SMOOTHING = 0.5  # m, half width of the window that density is averaged over, twice


class CongestionField:
    """Makes travel-time fields to the same exits repeatedly, on every few nodes of a fine one.

    Parameters
    ----------
    fine : field on the full grid, to the exits (or the region) in question.
    walls : (W, 2, 2) m, the standing ones.
    speed : speed (...) at points (..., 2) [m], relative to plain floor.
    exits : (X, 2, 2) m, rows as in the field; None if it leads to a region.
    building : the place, as its ways end, if it has several sheets.

    Attributes
    ----------
    every : s, how often to march again.
    """

    def __init__(
        self,
        fine: NavigationField,
        walls: Floats,
        speed: Callable[[Floats], Floats],
        exits: Floats | None,
        building: Geometry | None = None,
    ) -> None:
        stride = max(1, int(min(SPACING, 0.8 * fine.radius) / fine.spacing + 1e-9))
        self._tight = fine.free is not None and _is_tight(fine.free & ~(fine.travel_time < _AT_EXIT), stride // 2)
        if self._tight:
            stride = max(1, stride // 2)
        self.spacing = stride * fine.spacing
        self.origin = fine.origin
        walkable = ~np.isnan(fine.travel_time)
        self._inside = walkable[::stride, ::stride]
        marched = self._inside if building is None else self._inside[self._inside]  # nothing is between sheets
        self.every = max(_EVERY, marched.size / _NODES)
        self._free = self._inside if fine.free is None else _any_near(fine.free, stride) & self._inside
        self._first = _least_near(np.where(walkable, fine.travel_time, np.inf), stride // 2, stride)
        shape = self._inside.shape
        self._speed = speed(grid.node_points(self.origin, self.spacing, shape))
        blocked = grid.blocked_lines(walls, shape, self.origin, self.spacing)
        windows = coarse(fine.windows, stride, fine.spacing)
        self._crossings = None
        if building is not None:
            for nodes, origin, shift in windows:
                size = blocked[nodes].shape
                blocked[nodes] = grid.blocked_lines(walls - shift, size, origin, self.spacing)
            self._crossings = Crossings(building, windows, fine, self._free, self._first, self._speed, self.spacing)
        self._direct, self._blocked = fine.direct[::stride, ::stride], blocked
        seen, width = np.full(shape, -1), np.empty(0)  # a region is no bottleneck
        if exits is not None:
            seen, width = self._direct, _room(exits, fine.radius)
        links = {} if self._crossings is None else {"links": self._crossings.links}
        self._fronts = Fronts(self._first, self._free, self._speed, blocked, self.spacing, seen, width, **links)
        # This near to a door, and between its jambs, the straight line to it is the way, with any crowd.
        near_door = fine.travel_time[::stride, ::stride] < np.where(self._fronts.narrow, _IN_DOOR, _AT_EXIT)
        direct = np.where(near_door, self._direct, -1)
        self._template = replace(
            fine,
            travel_time=np.where(self._inside, 0.0, np.nan),
            direction=np.zeros((*shape, 2)),
            direct=direct,
            cell=cell_kinds(np.where(self._inside, 0.0, np.nan), direct, blocked),
            spacing=self.spacing,
            through=None,
            free=None,
            windows=windows,
        )
        self._shortest, self._fine, self._walls = fine.direction[::stride, ::stride], fine, walls
        self._narrow = np.zeros_like(self._inside) if fine.free is None else _narrow(fine.free, stride) & self._inside
        self._ahead = _walk(fine, stride, round(_AHEAD / fine.spacing)) if self._tight else None
        level = self._first - SOURCE * self.spacing
        self._level = np.ma.MaskedArray(np.where(np.isfinite(level), level, 1e3), ~self._free)

    @cached_property
    def _spread(self) -> tuple[Floats, Ints, Bools]:
        """For people that keep a distance: the directions (rows, cols, 2) of the spread, how to look up, and where they
        replace the marched field.
        """
        stride = round(self.spacing / self._fine.spacing)
        direction = spread(self._fine, self._walls, NARROW).direction[::stride, ::stride]
        same = (direction == self._shortest).all(axis=-1)
        direct = np.where(same, self._template.direct, -1)
        sure = self._narrow | ~same | self._fronts.shared
        if self._crossings is not None:  # on stairs nobody gets around anybody
            sure |= self._fronts.narrow
        return direction, cell_kinds(self._template.travel_time, direct, self._blocked), sure

    def density(self, position: Floats) -> Floats:
        """Return the density [1/m2] of people at ``position`` (K, 2) on the nodes (rows, cols), over about a meter."""
        count = np.zeros(self._inside.shape)
        np.add.at(count, grid.nearest_nodes(position, self.origin, self.spacing, count.shape), 1.0)
        floor = self._inside.astype(np.float64)
        half = max(1, round(_SMOOTHING / self.spacing))
        for _ in range(2):
            count, floor = _box_mean(count, half), _box_mean(floor, half)
        return np.divide(count, floor * self.spacing**2, out=np.zeros_like(count), where=floor > 1e-6)

    @cached_property
    def _open(self) -> NavigationField:
        """The field of people that keep a distance while nobody waits."""
        return self._march(self._speed, np.zeros_like(self._inside), True)

    def _crowded(self, position: Floats, people: FundamentalDiagram, queue: Floats) -> tuple[Floats, Bools]:
        """Return the speed (rows, cols) relative to plain floor, and where people keep to the shortest way."""
        fronts, front = self._fronts, self._fronts.front
        waiting = self._mean_around(queue[front])
        if not people.keeps_distance:
            return self._speed / waiting, fronts.keeps_on(queue)[front]
        # The time of a queue is fixed, and within it people go where it is thinner: around corners abreast.
        pace = weidmann(self.density(position))
        slow = np.bincount(front.ravel(), 1.0 / pace.ravel()) / np.maximum(np.bincount(front.ravel()), 1)
        return self._speed * pace * np.minimum(self._mean_around(slow[front]) / waiting, 1.0), np.zeros_like(
            self._inside
        )

    def _mean_around(self, values: Floats) -> Floats:
        """Return the mean (rows, cols) of ``values`` over the floor around every node; 1 outside."""
        half, floor = max(1, round(_SMOOTHING / self.spacing)), self._inside.astype(np.float64)
        total, floor = _box_mean(values * floor, half), _box_mean(floor, half)
        return np.divide(total, floor, out=np.ones_like(total), where=floor > 1e-6)

    def _leads_on(self, time: Floats, speed: Floats, ahead: tuple[Ints, Ints, Floats]) -> Bools:
        """Return where the fine way leads on in the marched field of ``time`` and ``speed``, all (rows, cols)."""
        row, col, walked = ahead
        least = _least_near(np.where(np.isnan(time), np.inf, time), 1)
        least[np.isinf(least)] = np.nan  # unknown neighborhood: no comparison holds
        gained = 0.5 * (speed + speed[row, col]) * (least - least[row, col])
        return gained > _ALIKE * walked

    def march(self, position: Floats | None = None, people: FundamentalDiagram | None = None) -> NavigationField:
        """Return the field for ``people`` at ``position`` (K, 2) [m], or for an empty place."""
        if position is None or people is None or not len(position):
            return self._march(self._speed, np.zeros_like(self._inside), people is not None and people.keeps_distance)
        node = grid.nearest_nodes(position, self.origin, self.spacing, self._inside.shape)
        queue = self._fronts.queue(node, people)
        if people.keeps_distance and queue.max() <= 1.0:
            return self._open
        return self._march(*self._crowded(position, people, queue), people.keeps_distance)

    def _march(self, speed: Floats, keeps_on: Bools, spreads: bool) -> NavigationField:
        """Return the field at ``speed``, with the shortest way where ``keeps_on`` (rows, cols)."""
        via = None
        if self._crossings is None:
            time = reach(self._level, self._first, self._free, speed, self.spacing)
        else:
            time, via = self._crossings.march(speed)
        known = ~np.isnan(time)
        direction = descend(time, self.spacing)
        # In narrow places and where only small bodies get out, the fine field knows the way, if both lead the same way.
        shortest, cell, sure, least = self._shortest, self._template.cell, self._narrow, _ALIKE
        if spreads:
            (shortest, cell, sure), least = self._spread, _ABREAST
        alike = sure & ((direction * shortest).sum(axis=-1) > least)
        if self._ahead is not None:  # slopes between nodes mislead: the march cuts corners that bodies touch
            alike |= sure & self._leads_on(time, speed, self._ahead)
        keeps = (keeps_on & known) | alike | (self._inside & ~self._free)
        if spreads:
            keeps |= self._free & (
                self._first < SOURCE * self.spacing
            )  # beside an exit the marched times do not say which way it faces
        direction[keeps] = shortest[keeps]
        if self._crossings is not None and via is not None:
            for nodes, over in self._crossings.before(via):
                direction[nodes] = over
        fill_from_nearest(time, direction, self._inside, known, self.spacing)
        if not keeps_on.any():
            return replace(self._template, travel_time=time, direction=direction, cell=cell)
        direct = np.where(keeps_on, self._direct, self._template.direct)
        cell = cell_kinds(self._template.travel_time, direct, self._blocked)
        return replace(self._template, travel_time=time, direction=direction, direct=direct, cell=cell)


def _room(exits: Floats, radius: float) -> Floats:
    """Return the width (X,) [m] that the middle of a body has of each of ``exits`` (X, 2, 2).

    A jamb takes a radius.  Where two lines meet, as around an exit area, is none.
    """
    ends = exits.reshape(-1, 2)
    jambs = (np.hypot(*(ends[:, None] - ends).T) < _SAME).sum(axis=0) == 1
    length = segment_lengths(exits)
    return np.maximum(length - radius * jambs.reshape(-1, 2).sum(axis=1), 0.0)


def _narrow(free: Bools, stride: int) -> Bools:
    """Return for every stride-th node whether it lies in or near a passage that holds few nodes abreast."""
    half = stride  # where a square of 2 half + 1 fine nodes has no room is a passage, or a corner
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(free, half), (2 * half + 1, 2 * half + 1))
    core = windows.all(axis=(2, 3))
    opened = np.lib.stride_tricks.sliding_window_view(np.pad(core, half), (2 * half + 1, 2 * half + 1)).any(axis=(2, 3))
    return _any_near(free & ~opened, stride)


def _is_tight(free: Bools, half: int) -> bool:
    """Return whether there are passages that no disc of ``half`` nodes fits into; the tips of corners are none."""
    middle = free & ~grid.near(~free, half)
    return bool((free & ~grid.near(middle, half + _TIP)).any())


def _walk(fine: NavigationField, stride: int, steps: int) -> tuple[Ints, Ints, Floats]:
    """Return the coarse nodes where ``steps`` from node to fine node lead from every coarse one, and how far that is [m]."""
    rows, cols = fine.travel_time.shape
    row, col = np.indices(fine.travel_time[::stride, ::stride].shape) * float(stride)
    walked = np.zeros(row.shape)
    for _ in range(steps):
        towards = fine.direction[_whole(row, rows), _whole(col, cols)]
        row, col = row + towards[..., 1], col + towards[..., 0]
        walked += fine.spacing * (towards != 0.0).any(axis=-1)
    return _whole(row / stride, len(row)), _whole(col / stride, row.shape[1]), walked


def _whole(index: Floats, count: int) -> Ints:
    return np.rint(index).astype(np.int64).clip(0, count - 1)


def _any_near(fine: Bools, stride: int) -> Bools:
    """Return for every stride-th node whether any node around it is true."""
    return _least_near(np.where(fine, 0.0, 1.0), stride // 2, stride) == 0.0


def _least_near(values: Floats, half: int, stride: int = 1) -> Floats:
    """Return for every stride-th node the least value in a square window of 2 ``half`` + 1 nodes."""
    padded = np.pad(values, half, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * half + 1, 2 * half + 1))
    return windows[::stride, ::stride].min(axis=(2, 3))


def _box_mean(values: Floats, half: int) -> Floats:
    """Return the mean over a square window of 2 ``half`` + 1 nodes; values outside of the grid are 0."""
    width = 2 * half + 1
    for axis in (0, 1):
        pad = [(0, 0), (0, 0)]
        pad[axis] = (half + 1, half)
        total = np.cumsum(np.pad(values, pad), axis=axis)
        size = values.shape[axis]
        upper = np.take(total, np.arange(width, width + size), axis=axis)
        lower = np.take(total, np.arange(size), axis=axis)
        values = (upper - lower) / width
    return values
