"""Degrees of longitude and latitude, projected to meters about the middle of a plan."""

import numpy as np

from crowd_env.core.arrays.state import Floats

# The ellipsoid of WGS 84 (EPSG:7030): half its longer axis, and its eccentricity squared.
_RADIUS = 6_378_137.0  # m
_ECCENTRICITY = 0.00669437999014
_SMALL = 0.05  # degrees; no plan is larger, and none in meters is so small
_STANDARD = 1.0  # degrees; nor is one in meters smaller than this, but for its outliers
_LARGEST = 3000.0  # m


def looks_like_degrees(points: Floats, standard: bool) -> bool:
    """Return whether coordinates (N, 2) can only be degrees.

    Those of a ``standard`` that has nothing else, OpenStreetMap's or IMDF, may lie further apart.
    """
    if not len(points) or not (np.abs(points) <= (180.0, 90.0)).all():
        return False
    return bool(np.ptp(points, axis=0).max() < (_STANDARD if standard else _SMALL))


class Projection:
    """Meters to the east and the north of the middle of a plan.

    Lengths along the meridian and the parallel of the middle are true on the ellipsoid: x = N cos(lat) dlon, y = M dlat
    (Snyder, Map Projections, USGS 1395, 1987, equations 4-19 to 4-21).  Within 3 km of it they are right to 0.1 %.

    Raises
    ------
    ValueError
        If the points (N, 2) [degrees] are none on Earth, or lie further apart than a plan.
    """

    def __init__(self, points: Floats) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        self.middle = 0.5 * (low + high)
        if np.abs((low, high)).max() > 180.0 or np.abs((low, high))[:, 1].max() > 90.0:
            raise ValueError("it is in degrees, but a coordinate is no longitude and latitude; is it in meters?")
        latitude = np.radians(self.middle[1])
        curved = 1.0 - _ECCENTRICITY * np.sin(latitude) ** 2
        across = _RADIUS / np.sqrt(curved)
        along = across * (1.0 - _ECCENTRICITY) / curved
        self._scale = np.radians([across * np.cos(latitude), along])  # m per degree
        size = self._scale * (high - low)
        if size.max() > _LARGEST:
            raise ValueError(
                f"it is in degrees, and {size[0]:.4g} m x {size[1]:.4g} m large; keep the features of one building, or say "
                "--unit m if it is in meters"
            )

    def __call__(self, points: Floats) -> Floats:
        """Return points (N, 2) [degrees] in meters."""
        return np.asarray((points - self.middle) * self._scale)

    @property
    def note(self) -> str:
        """What was done, with the middle."""
        (x, y), (east, north) = np.abs(self.middle), self.middle >= 0.0
        return f"in degrees: projected to meters about {y:.5f} {'N' if north else 'S'}, {x:.5f} {'E' if east else 'W'}"
