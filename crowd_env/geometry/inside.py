"""Test of positions for the walkable area: compiled, over many crowds, without contacts.

A point is inside if the ray from it to the right crosses the border of the area an odd number of times.  The edges are kept in
horizontal rows, so that a point compares only the edges at its own height.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints, joined_starts, row_starts
from crowd_env.core.kernels.jit import index, kernel
from crowd_env.geometry.parsing import Area, border_edges

_FEWEST_ROWS, _MOST_ROWS = 8, 1024


class Border(NamedTuple):
    """The border of G walkable areas as edges in rows, area by area."""

    bottom: Floats  # (G,)    m   where the first row begins
    per_height: Floats  # (G,)    1/m rows a meter
    row_start: Ints  # (G+1,)  first row of each area
    edge_start: Ints  # (R+1,)  first edge of each row
    low: Floats  # (M,)    m   lower and upper end of an edge
    high: Floats  # (M,)    m
    x: Floats  # (M,)    m   at the lower end
    slope: Floats  # (M,)        dx / dy


def border_of(areas: Sequence[Area]) -> Border:
    """Return the border of ``areas``, as `mark_outside` reads it."""
    parts = [_rows_of(area) for area in areas]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Border._fields}
    columns["row_start"] = row_starts([len(part.edge_start) - 1 for part in parts])
    columns["edge_start"] = joined_starts([part.edge_start for part in parts])
    return Border(**columns)


def _rows_of(area: Area) -> Border:
    """Return the border of one area."""
    edges = border_edges(area)
    edges = edges[edges[:, 0, 1] != edges[:, 1, 1]]  # a ray to the right crosses no other
    falling = edges[:, 0, 1] > edges[:, 1, 1]
    edges[falling] = edges[falling, ::-1]
    bottom, top = float(edges[:, 0, 1].min()), float(edges[:, 1, 1].max())
    rows = min(max(len(edges), _FEWEST_ROWS), _MOST_ROWS)
    per_height = rows / (top - bottom)
    start, edge = _by_row(edges, bottom, per_height, rows)
    low, high = edges[edge, 0], edges[edge, 1]
    return Border(
        bottom=np.array([bottom]),
        per_height=np.array([per_height]),
        row_start=np.zeros(0, dtype=np.int64),
        edge_start=start,
        low=low[:, 1].copy(),
        high=high[:, 1].copy(),
        x=low[:, 0].copy(),
        slope=(high[:, 0] - low[:, 0]) / (high[:, 1] - low[:, 1]),
    )


def _by_row(edges: Floats, bottom: float, per_height: float, rows: int) -> tuple[Ints, Ints]:
    """Return, as compressed rows (R+1,) and (M,), the edges that come into each row."""
    first, last = (_row(edges[:, k, 1], bottom, per_height, rows) for k in (0, 1))
    count = last - first + 1
    edge = np.repeat(np.arange(len(edges)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    return row_starts(np.bincount(row, minlength=rows)), edge[np.argsort(row, kind="stable")]


def _row(y: Floats, bottom: float, per_height: float, rows: int) -> Ints:
    """Return the rows of the heights ``y``: the same expression as in `mark_outside`."""
    return np.minimum(((y - bottom) * per_height).astype(np.int64), rows - 1)


@kernel
def mark_outside(
    border: Border, geometry_of_env: Ints, env_start: Ints, active: Bools, position: Floats, outside: Bools
) -> None:
    """Set ``outside`` (P,) of all active pedestrians out of the walkable area; clear none."""
    low, high, x_low, slope = border.low, border.high, border.x, border.slope
    edge_start = border.edge_start
    for e in range(len(geometry_of_env)):
        g = geometry_of_env[e]
        bottom, per_height = border.bottom[g], border.per_height[g]
        first_row, rows = border.row_start[g], border.row_start[g + 1] - border.row_start[g]
        for i in range(index(env_start[e]), index(env_start[e + 1])):
            if not active[i]:
                continue
            x, y, crossings = position[i, 0], position[i, 1], 0
            part = (y - bottom) * per_height
            if part >= 0.0 and part <= rows:  # false for nan
                row = first_row + min(int(part), rows - 1)
                for m in range(index(edge_start[row]), index(edge_start[row + 1])):
                    crossings += (low[m] <= y) & (y < high[m]) & (x < x_low[m] + (y - low[m]) * slope[m])
            if crossings & 1 == 0:
                outside[i] = True
