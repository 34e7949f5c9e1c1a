"""The widths of the narrow places of a plan, without a grid."""

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry

_TOUCH = 1e-7  # m


def passages(geometry: Geometry, walls: Floats, least: float, most: float) -> Floats:
    """Return the widths [m] between ``least`` and ``most`` of the passages between ``walls`` (W, 2, 2) [m].

    The connectivity of the floor changes with the dilation of the walls only where a circle of that size fits between two
    walls.  It touches them on opposite sides, one of them at an end: its middle is a critical point of the wall distance.
    """
    tree, ends = shapely.STRtree(shapely.linestrings(walls)), np.unique(walls.reshape(-1, 2), axis=0)
    end, wall = tree.query(shapely.points(ends), predicate="dwithin", distance=most)
    start, along = walls[wall, 0], walls[wall, 1] - walls[wall, 0]
    share = ((ends[end] - start) * along).sum(axis=1) / (along**2).sum(axis=1)
    across = start + np.clip(share, 0.0, 1.0)[:, None] * along - ends[end]
    width = np.hypot(*across.T)
    passed = width > least
    middle, width = (ends[end] + across / 2)[passed], width[passed]
    (row, _), clear = tree.query_nearest(shapely.points(middle), return_distance=True, all_matches=False)
    free = row[clear > width[row] / 2 - _TOUCH]
    return width[free[geometry.contains(middle[free])]]
