"""Single file: people walk one behind the other around a ring; how fast, at which line density?"""

from typing import Any

import numpy as np
import shapely

from crowd_env import Geometry
from crowd_env.core.arrays.state import unit_vectors
from validation.cases.case import RECORDED, Row, Setting, adults, row
from validation.cases.crowds import Floats, Moment, crowds_at, generator

ENOUGH = 9

# Line density [1/m] -> 10 %, 50 % and 90 % of the recorded speeds [m/s].
BANDS = {float(density): tuple(speeds) for density, speeds in RECORDED["ring"].items()}

_LENGTH, _WIDTH = 27.0, 0.6  # m, of the lane: bodies cannot overtake
_RADIUS = _LENGTH / (2.0 * np.pi)
_FROM, _UNTIL = 20.0, 60.0  # s, when speeds are measured: the start from rest is over


def ring() -> Geometry:
    """Return the lane, with no way out."""
    return annulus(_RADIUS, _WIDTH)


def annulus(radius: float, width: float) -> Geometry:
    """Return the floor around a circle of ``radius`` [m], ``width`` [m] wide."""
    outer, inner = (shapely.Point(0.0, 0.0).buffer(radius + side * 0.5 * width, quad_segs=24) for side in (1.0, -1.0))
    return Geometry.from_polygon(outer.difference(inner))


def onward(moment: Moment) -> Floats:
    """Return the commands (P, 2) that lead everyone around, and gently back to the middle of the lane."""
    x, y = moment.position.T
    off = np.hypot(x, y)
    radial = np.clip(2.0 * (_RADIUS - off), -0.3, 0.3)  # 0.1 m off the middle: 0.2 towards it
    command = np.column_stack([-y + radial * x, x + radial * y]) / np.maximum(off, 1e-9)[:, None]
    return command / np.maximum(np.hypot(*command.T), 1e-9)[:, None]


def along(moment: Moment) -> Floats:
    """Return the unit vectors (P, 2) that lead around a circle."""
    x, y = moment.position.T
    return np.column_stack([-y, x]) / np.maximum(np.hypot(x, y), 1e-9)[:, None]


def around(before: Moment, now: Moment) -> Floats:
    """Return how far (P,) [m] people got around a circle."""
    return np.einsum("ij,ij->i", now.position - before.position, along(before))


def speeds(setting: Setting, densities: tuple[float, ...] = tuple(BANDS)) -> dict[float, float]:
    """Return the mean speed [m/s] along the lane at each line density [1/m]."""
    numbers = [round(density * _LENGTH) for density in densities]
    drawn = []
    for n in numbers:
        angle = 2.0 * np.pi / n * np.arange(n)
        position = _RADIUS * unit_vectors(angle)
        drawn += [(adults(n).draw_bodies(generator(setting, d)), position) for d in range(setting.draws)]
    crowds = crowds_at(ring(), drawn, setting, setting.draws)
    found = crowds.speeds(onward, lambda before, now: _RADIUS * turned(before.position, now.position), _FROM, _UNTIL)
    return dict(zip(densities, crowds.means(found), strict=True))


def turned(before: Floats, now: Floats) -> Floats:
    """Return the angle [rad] between two positions (P, 2), counted around the center."""
    cross = before[:, 0] * now[:, 1] - before[:, 1] * now[:, 0]
    return np.arctan2(cross, np.einsum("ij,ij->i", before, now))


def run(setting: Setting) -> list[Row]:
    """Return the row.  There are no routes: everyone is led along the lane."""
    found = speeds(setting)
    inside = [density for density, speed in found.items() if BANDS[density][0] <= speed <= BANDS[density][2]]
    outside = ", ".join(
        f"{speed:.2f} m/s at {density:g} /m" for density, speed in found.items() if density not in inside
    )
    figure = f"{len(inside)} of {len(found)} inside" + (f"; outside: {outside}" if outside else "")
    more: dict[str, Any] = {"speed": found, "band": {density: BANDS[density] for density in found}}
    return [row("ring", setting, len(inside) >= ENOUGH, figure, **more)]
