"""Named regions on grids, as bits of a mask."""

import numpy as np

from crowd_env.geometry.geometry import Geometry
from crowd_env.navigation.field import NavigationField
from crowd_env.state import Floats, Ints


def region_masks(geometry: Geometry, x: Floats, y: Floats) -> Ints:
    """Return which regions the points x, y (any shape) [m] lie in: bit k is region k of the geometry."""
    mask = np.zeros(x.shape, dtype=np.int64)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    for k, name in enumerate(geometry.regions):
        mask[geometry.contains(points, name).reshape(x.shape)] |= 1 << k
    return mask


def region_masks_of(field: NavigationField, geometry: Geometry) -> Ints:
    """Return which regions the nodes of a field (rows, cols) lie in, as bits."""
    return region_masks(geometry, *field.nodes())
