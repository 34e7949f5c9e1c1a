"""Speed maps of the floor: walking speeds by place, and the cost of a comfortable way."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from crowd_env.core.arrays.state import MAX_SPEED, Floats
from crowd_env.core.checks import Checked, NotNegative, Positive, Range, check_fields, shown
from crowd_env.geometry.geometry import Boundary, Geometry

_NOT_GIVEN = float("nan")


@dataclass(frozen=True)
class SpeedZone:
    """A region where people walk at another speed, such as stairs; give ``speed``, ``factor`` or both."""

    region: str
    """name of the region."""
    speed: Annotated[float, Range(0.0, MAX_SPEED, above=True)] | None = None
    """m/s, the desired speed of everyone in the region; by default as elsewhere."""
    factor: Annotated[float, Range(0.0, 10.0, above=True)] = _NOT_GIVEN
    """number by which the desired speed in the region is multiplied; 1 by default."""

    def __post_init__(self) -> None:
        if self.factor is _NOT_GIVEN:  # a factor of 1 that is given may be one of several that are tried
            if self.speed is None:
                raise ValueError(f"speed zone {shown(self.region)} changes nothing; give it a speed or a factor")
            object.__setattr__(self, "factor", 1.0)
        check_fields(f"speed zone {shown(self.region)}", self)


@dataclass(frozen=True)
class Comfort(Checked):
    """What the most comfortable way costs, in meters of plain floor."""

    stairs: NotNegative = 3.0
    """number of meters that a meter in a slow zone costs in addition, be it stairs or other slow ground."""
    turn: NotNegative = 1.0
    """number of meters that passing a corner costs, if it juts into the way."""
    reach: Positive = 0.6
    """m, the distance from a corner over which its cost is spread, which also keeps the way off the corner."""


@dataclass(frozen=True, eq=False)
class SpeedMap:
    """The floor of a place with the speed or cost of every meter.

    Parameters
    ----------
    geometry, zones : the place, and where people walk at another speed.
    walking_speed : m/s, on plain floor, to compare fixed speeds of zones with.
    comfort : costs of a comfortable way.
    """

    geometry: Geometry
    zones: Sequence[SpeedZone]
    walking_speed: float
    comfort: Comfort

    def walking(self, points: Floats) -> Floats:
        """Return the speed (...) at ``points`` (..., 2) [m], relative to plain floor."""
        speed = np.ones(points.shape[:-1])
        names = list(self.geometry.regions)
        for zone in sorted(self.zones, key=lambda zone: names.index(zone.region)):  # as the compiled step does
            inside = self.geometry.contains(points, zone.region)
            if zone.speed is not None:
                speed[inside] = zone.speed / self.walking_speed
            speed[inside] *= zone.factor
        return speed

    def comfortable(self, points: Floats) -> Floats:
        """Return 1 / (cost of a meter) on a grid of ``points`` (rows, cols, 2) [m]."""
        x, y = points[..., 0], points[..., 1]
        slow = self.walking(points) < 1.0
        if self.geometry.building is not None:
            slow |= self.geometry.building.slows(points)
        cost = np.where(slow, 1.0 + self.comfort.stairs, 1.0)
        reach = self.comfort.reach
        corners = jutting_corners(self.geometry.of_layout.boundary)
        left, right = (np.searchsorted(x[0], corners[:, 0] + away) for away in (-reach, reach))
        low, high = (np.searchsorted(y[:, 0], corners[:, 1] + away) for away in (-reach, reach))
        for k, (cx, cy) in enumerate(corners):  # each affects only the nodes around it
            around = slice(low[k], high[k] + 1), slice(left[k], right[k] + 1)
            near = np.hypot(x[around] - cx, y[around] - cy) < reach
            cost[around][near] += self.comfort.turn / (2.0 * reach)
        return 1.0 / cost


def jutting_corners(boundary: Boundary) -> Floats:
    """Return the corners (V, 2) of a geometry that jut into the walkable area, of round ones the centers: where ways turn."""
    # Elsewhere walls turn left (walkable side) or hardly at all.
    return boundary.corner[(boundary.corner_door < 0) & (boundary.corner_turn <= -0.3)]
