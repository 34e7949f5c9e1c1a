"""Speed maps of the floor: how fast it is walked, and how far a comfortable meter goes."""

from collections.abc import Sequence

import numpy as np

from crowd_env.geometry.geometry import Boundary, Geometry
from crowd_env.routing.spec import Comfort, SpeedZone
from crowd_env.state import Floats


class SpeedMap:
    """Speed maps: that of the zones, and that of comfort."""

    def __init__(self, geometry: Geometry, zones: Sequence[SpeedZone], walking_speed: float, comfort: Comfort) -> None:
        self.geometry, self.zones, self.walking_speed, self.comfort = geometry, zones, walking_speed, comfort

    def __call__(self, x: Floats, y: Floats) -> Floats:
        """Return the speed at places x, y relative to plain floor."""
        pace = np.ones(x.shape)
        places = np.stack([x.ravel(), y.ravel()], axis=1)
        names = list(self.geometry.regions)
        for zone in sorted(self.zones, key=lambda zone: names.index(zone.region)):  # as the compiled step does
            inside = self.geometry.contains(places, zone.region).reshape(x.shape)
            if zone.speed is not None:
                pace[inside] = zone.speed / self.walking_speed
            pace[inside] *= zone.factor
        return pace

    def comfortable(self, x: Floats, y: Floats) -> Floats:
        """Return 1 / (cost of a meter) on a grid: ``x`` (rows, cols) grows along columns only, ``y`` along rows."""
        slow = self(x, y) < 1.0
        cost = np.where(slow, 1.0 + self.comfort.stairs, 1.0)
        reach = self.comfort.reach
        corners = jutting_corners(self.geometry.boundary)
        left, right = (np.searchsorted(x[0], corners[:, 0] + away) for away in (-reach, reach))
        low, high = (np.searchsorted(y[:, 0], corners[:, 1] + away) for away in (-reach, reach))
        for k, (cx, cy) in enumerate(corners):  # each looks only at the nodes around it
            around = slice(low[k], high[k] + 1), slice(left[k], right[k] + 1)
            near = np.hypot(x[around] - cx, y[around] - cy) < reach
            cost[around][near] += self.comfort.turn / (2.0 * reach)
        return 1.0 / cost


def jutting_corners(boundary: Boundary) -> Floats:
    """Return the corners (V, 2) of a geometry that jut into the walkable area: where ways turn."""
    found = []
    for v in np.flatnonzero(boundary.corner_door < 0):
        rows = boundary.corner_wall[boundary.corner_wall_start[v] : boundary.corner_wall_start[v + 1]]
        if len(rows) == 2 and not boundary.two_sided[rows].any():
            into = boundary.wall[rows[np.hypot(*(boundary.wall[rows, 1] - boundary.corner[v]).T) < 1e-9]]
            out = boundary.wall[rows[np.hypot(*(boundary.wall[rows, 0] - boundary.corner[v]).T) < 1e-9]]
            if len(into) and len(out):
                a, b = into[0, 1] - into[0, 0], out[0, 1] - out[0, 0]
                turn = (a[0] * b[1] - a[1] * b[0]) / (np.hypot(*a) * np.hypot(*b))
                if turn > -0.3:  # walls turn left (walkable side) or hardly at all: concave
                    continue
        found.append(boundary.corner[v])
    return np.array(found).reshape(-1, 2)
