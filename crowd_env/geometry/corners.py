"""Where walls end: corners, each with the ends of walls that lie there."""

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats, Ints, row_starts

_SAME = 1e-9  # m; ends of walls nearer than this are one corner


def ends_together(ends: Floats) -> tuple[Ints, Ints]:
    """Return, as compressed rows (V+1,) and (M,), which of the ``ends`` (M, 2) [m] of walls lie at each corner."""
    if not len(ends):
        return np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int64)
    points = shapely.points(ends)
    end, twin = shapely.STRtree(points).query(points, predicate="dwithin", distance=_SAME)
    first = np.arange(len(ends))
    np.minimum.at(first, end, twin)  # an end is called by the first end at its place
    distinct, corner_of_end = np.unique(first, return_inverse=True)
    order = np.argsort(corner_of_end, kind="stable")
    return row_starts(np.bincount(corner_of_end, minlength=len(distinct))), order.astype(np.int64)
