"""Who stands in the walkable area, by position alone: a compiled test over many crowds that knows nothing of contacts.

A point is inside if the ray from it to the right crosses the border of the area an odd number of times.  The edges are kept in
horizontal rows, so that a point looks only at those at its own height.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from crowd_env._jit import index, kernel
from crowd_env.geometry_input import Area
from crowd_env.state import Bools, Floats, Ints

_MOST_ROWS = 4096


class Border(NamedTuple):
    """The border of G walkable areas as edges in rows, those of one area behind those of another."""

    bottom: Floats  # (G,)    m   where the first row begins
    per_height: Floats  # (G,)    1/m rows a metre
    row_start: Ints  # (G+1,)  first row of each area
    edge_start: Ints  # (R+1,)  first edge of each row
    low: Floats  # (M,)    m   lower and upper end of an edge
    high: Floats  # (M,)    m
    x: Floats  # (M,)    m   at the lower end
    slope: Floats  # (M,)        dx / dy


def border_of(areas: Sequence[Area]) -> Border:
    """Return the border of ``areas``, as `mark_outside` reads it."""
    parts = [_rows_of(area) for area in areas]
    row_start = np.concatenate([[0], np.cumsum([len(part.edge_start) - 1 for part in parts])])
    offsets = np.concatenate([[0], np.cumsum([len(part.low) for part in parts])])
    starts = [part.edge_start[:-1] + offset for part, offset in zip(parts, offsets, strict=False)]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Border._fields}
    columns["row_start"] = row_start.astype(np.int64)
    columns["edge_start"] = np.concatenate([*starts, offsets[-1:]]).astype(np.int64)
    return Border(**columns)


def _rows_of(area: Area) -> Border:
    """Return the border of one area."""
    rings = shapely.get_rings(shapely.get_parts(area))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    a, b = points[:-1][ring[:-1] == ring[1:]], points[1:][ring[:-1] == ring[1:]]
    upright = a[:, 1] != b[:, 1]
    a, b = a[upright], b[upright]
    falling = a[:, 1] > b[:, 1]
    a[falling], b[falling] = b[falling], a[falling]
    bottom, top = points[:, 1].min(), points[:, 1].max()
    rows = min(len(a), _MOST_ROWS)
    per_height = np.array([rows / (top - bottom)])
    first, last = (_row(end[:, 1], bottom, per_height[0], rows) for end in (a, b))
    edge = np.repeat(np.arange(len(a)), last - first + 1)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(last - first + 1) - (last - first + 1), last - first + 1)
    row += first[edge]
    edge = edge[np.argsort(row, kind="stable")]
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=rows))]).astype(np.int64)
    slope = (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    none = np.zeros(0, dtype=np.int64)
    return Border(
        np.array([bottom]),
        per_height,
        none,
        start,
        a[edge, 1],
        b[edge, 1],
        np.ascontiguousarray(a[edge, 0]),
        slope[edge],
    )


def _row(y: Floats, bottom: float, per_height: float, rows: int) -> NDArray[np.int64]:
    """Return the rows of the heights ``y``: the same expression as in `mark_outside`."""
    return np.minimum(((y - bottom) * per_height).astype(np.int64), rows - 1)


@kernel
def mark_outside(
    border: Border, geometry_of_env: Ints, env_start: Ints, active: Bools, position: Floats, outside: Bools
) -> None:
    """Set ``outside`` (P,) of whoever is active and not in the walkable area; nobody's is cleared."""
    low, high, x_low, slope, edge_start = border.low, border.high, border.x, border.slope, border.edge_start
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
