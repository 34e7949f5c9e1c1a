"""Which places lie near each other, for work done now and then; at every step the lists of neighbors are quicker."""

import shapely

from crowd_env.core.arrays.state import Floats, Ints


def pairs_within(points: Floats, distance: float) -> tuple[Ints, Ints]:
    """Return the pairs (M,), (M,) of ``points`` (K, 2) [m] no further apart than ``distance`` [m], each with itself too."""
    places = shapely.points(points)
    i, j = shapely.STRtree(places).query(places, predicate="dwithin", distance=distance)
    return i, j
