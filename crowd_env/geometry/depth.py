"""How thick is what is solid behind each wall."""

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.parsing import SLIVER, Area, border_edges


def solid_depth(walls: Floats, area: Area, most: float = 0.25) -> Floats:
    """Return (W,) half the thickness [m] of what is solid behind (to the right of) each wall, ``most`` at the most.

    A center that was pressed into a wall belongs to the nearer face of it.
    """
    depth = np.full(len(walls), most)
    if not len(walls):
        return depth
    along = walls[:, 1] - walls[:, 0]
    along = along / np.hypot(*along.T)[:, None]
    behind = 2 * most * np.column_stack([along[:, 1], -along[:, 0]])
    a, b = walls[:, 0] + SLIVER * along, walls[:, 1] - SLIVER * along
    strips = shapely.polygons(np.stack([a, b, b + behind, a + behind], axis=1))
    # What is walkable in a strip and nearest to its wall lies on the border of the area: its edges near the strip tell all.
    room = shapely.buffer(area, -SLIVER)
    border = shapely.linestrings(border_edges(room))
    row, edge = shapely.STRtree(border).query(strips, predicate="intersects")
    faces = shapely.linestrings(np.stack([a, b], axis=1))
    away = shapely.distance(faces[row], shapely.intersection(strips[row], border[edge]))
    np.minimum.at(depth, row, 0.5 * away)
    shapely.prepare(room)
    depth[shapely.intersects_xy(room, *a.T)] = 0.0  # a thin wall: there is nothing solid behind it
    return depth
