"""Entrances: where and when people come in during an episode."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.placement import keeps_clear

NEVER = np.inf  # time of people that do not come in this draw
_MOST_SPOTS = 2000.0  # of an area; a larger one has them further apart


class Entries(NamedTuple):
    """When and where N people come in.

    People with the same ``start`` come by one entrance, and wait for each other there.
    """

    due: Floats  # (N,)  s    nan = there at the start; `NEVER` = does not come
    start: Ints  # (N,)  first of one's `spots`
    stop: Ints  # (N,)  one past the last of them
    first: Ints  # (N,)  the one that is tried first
    spots: Floats  # (K, 2)  m
    sheet: Ints  # (K,)  that each spot is on

    def first_spots(self) -> Floats:
        """Return the spot (N, 2) [m] that each person tries first; without meaning for people that do not come in."""
        return self.spots[self.first]


def at_the_start(people: int) -> Entries:
    """Return the entries of people that are all there at the start."""
    none = np.zeros(people, dtype=np.int64)
    return Entries(
        np.full(people, np.nan), none, none.copy(), none.copy(), np.zeros((1, 2)), np.zeros(1, dtype=np.int64)
    )


def join_entries(parts: Sequence[Entries]) -> Entries:
    """Return the entries of all ``parts`` (at least one), one behind the other."""
    before = row_starts([len(part.spots) for part in parts])[:-1].tolist()
    moved = [
        part._replace(start=part.start + k, stop=part.stop + k, first=part.first + k)
        for part, k in zip(parts, before, strict=True)
    ]
    return Entries._make(np.concatenate(column) for column in zip(*moved, strict=True))


def spots_in(geometry: Geometry, radius: float, region: str | None) -> Floats:
    """Return where (K, 2) bodies of ``radius`` [m] may come in on a region, None = anywhere; row by row.

    Raises
    ------
    ValueError
        If they fit nowhere.
    """
    low_x, low_y, high_x, high_y = geometry.bounds if region is None else geometry.regions[region].bounds
    step = max(radius, float(np.sqrt((high_x - low_x) * (high_y - low_y) / _MOST_SPOTS)))
    columns, rows = (max(round((high - low) / step), 1) for low, high in ((low_x, high_x), (low_y, high_y)))
    x, y = np.meshgrid(
        low_x + (np.arange(columns) + 0.5) * (high_x - low_x) / columns,
        low_y + (np.arange(rows) + 0.5) * (high_y - low_y) / rows,
    )
    points = np.column_stack([x.ravel(), y.ravel()])
    return _those_with_room(geometry, points, radius, region, "anywhere" if region is None else f"in {region!r}")


def spots_along(geometry: Geometry, radius: float, line: Floats) -> Floats:
    """Return where (K, 2) bodies of ``radius`` [m] may come in along a line (C, 2): on it, or beside it if it is an edge.

    Raises
    ------
    ValueError
        If they fit nowhere.
    """
    runs, normals = [], []
    for a, b in itertools.pairwise(line):
        length = float(np.hypot(*(b - a)))
        count = max(int(2.0 * length / radius), 1)
        runs.append(a + ((np.arange(count) + 0.5) / count)[:, None] * (b - a))
        normals.append(np.tile(np.array([a[1] - b[1], b[0] - a[0]]) / max(length, 1e-12), (count, 1)))
    points, aside = np.concatenate(runs), np.concatenate(normals)
    on_line = points[keeps_clear(geometry, points, radius)]
    if len(on_line):
        return on_line
    beside = np.concatenate([points + side * (radius + 1e-6) * aside for side in (1.0, -1.0)])
    ends = " to ".join(f"({x:g}, {y:g})" for x, y in (line[0], line[-1]))
    return _those_with_room(geometry, beside, radius, None, f"along the line from {ends}")


def _those_with_room(geometry: Geometry, points: Floats, radius: float, region: str | None, where: str) -> Floats:
    found = points[keeps_clear(geometry, points, radius, region)]
    if not len(found):
        raise ValueError(f"no person can come in {where}: a body of radius {radius:.2f} m fits nowhere there")
    return found
