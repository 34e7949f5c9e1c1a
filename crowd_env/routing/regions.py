"""Named regions on grids, as bits of a mask."""

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.directions import regions_on_the_way
from crowd_env.routing.fields.field import NavigationField


def region_masks(geometry: Geometry, points: Floats) -> Ints:
    """Return which regions ``points`` (..., 2) [m] lie in: bit k is region k of the geometry."""
    mask = np.zeros(points.shape[:-1], dtype=np.int64)
    for k, name in enumerate(geometry.regions):
        mask[geometry.contains(points, name)] |= 1 << k
    return mask


def regions_along(field: NavigationField, geometry: Geometry) -> Ints:
    """Return which regions the way from every node of a field (rows, cols) leads through, as bits."""
    own = region_masks(geometry, field.nodes())
    return np.asarray(regions_on_the_way(field.travel_time, field.direction, own))
