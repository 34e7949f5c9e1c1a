"""Places with two exits that tests of controllers share."""

import numpy as np

from crowd_env import FULL_SPEED, Geometry, Population, Scenario, Uniform
from crowd_env.geometry.geometry import box


def hall(count=150, time_limit=120.0, *, exits=("west", "east"), doors=None, **people):
    """20 x 12 m with an exit of 1 m in the middle of each short wall; everyone starts in the left half."""
    lines = {"west": [(0, 5.5), (0, 6.5)], "east": [(20, 5.5), (20, 6.5)]}
    regions = {"start": box(0, 0, 10, 12)}
    geometry = Geometry.from_polygon(
        box(0, 0, 20, 12), exits={name: lines[name] for name in exits}, regions=regions, doors=doors
    )
    return Scenario("hall", geometry, Population(count, start_region="start", **people), time_limit, **FULL_SPEED)


def corridor(starts, *, exits=("west", "east"), regions=None, routes=(), doors=None, speed=1.5, time_limit=60.0):
    """8 x 4 m, 1 m wide exit in the west, 2 m in the east; people of radius 0.2 m at known places."""
    lines = {"west": [(0, 1.5), (0, 2.5)], "east": [(8, 1.5), (8, 3.5)]}
    geometry = Geometry.from_polygon(
        box(0, 0, 8, 4), exits={name: lines[name] for name in exits}, regions=regions, doors=doors
    )
    people = Population(
        len(starts),
        radius=Uniform(0.2, 0.2),
        desired_speed=Uniform(speed, speed),
        starts=np.array(starts, dtype=np.float64),
    )
    return Scenario("corridor", geometry, people, time_limit, routes=routes, **FULL_SPEED)
