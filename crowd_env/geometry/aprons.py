"""Aprons: the ground just outside of the exits, which belongs to no walkable area but is stepped on by whoever leaves."""

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.parsing import Area

_INWARDS = 1e-3  # m  an apron begins this far inside, so that no gap of rounding parts it from the area


def add_aprons(walkable: Area, exits: Floats, depth: float) -> Area:
    """Return the area with a rectangle as wide as the exit and ``depth`` [m] deep outside of each of ``exits`` (X, 2, 2)."""
    along = exits[:, 1] - exits[:, 0]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]  # the area lies to the left
    near, far = exits - _INWARDS * outward[:, None], exits + depth * outward[:, None]
    aprons = shapely.polygons(np.concatenate([near, far[:, ::-1]], axis=1))
    area = shapely.union_all([walkable, *aprons])
    assert isinstance(area, Polygon | MultiPolygon)  # each apron touches the area along its exit
    return area
