"""The colors of frames, films and figures, and the ramp from no contact to a pressure that injures."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.core.arrays.state import Floats

Color = tuple[int, int, int]

BACKGROUND: Color = (246, 243, 237)
FLOOR: Color = (255, 255, 255)
WALL: Color = (55, 65, 77)
OBSTACLE: Color = (172, 180, 188)
EXIT: Color = (38, 148, 98)
EXIT_MAT: Color = (205, 233, 217)
SEAM: Color = (214, 158, 46)  # where one comes to another sheet of a building
INK: Color = (43, 51, 60)
QUIET: Color = (116, 123, 131)
FAINT: Color = (221, 217, 209)

# One color a curve: they differ in print and to color-blind eyes, and none looks like a pressure.
SERIES: tuple[Color, ...] = ((15, 118, 128), (137, 71, 145), (158, 122, 22), (74, 92, 160), (112, 112, 112))


ANCHORS: tuple[Color, ...] = ((168, 188, 205), (238, 186, 92), (222, 96, 46), (160, 16, 30))


def to_oklab(colors: ArrayLike) -> Floats:
    """Return sRGB ``colors`` (..., 3) in 0..255 as OKLab, where equal steps look equal (Ottosson 2020)."""
    srgb = np.asarray(colors, dtype=np.float64) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.cbrt(linear @ _LMS_FROM_RGB.T) @ _LAB_FROM_LMS.T


def from_oklab(lab: ArrayLike) -> NDArray[np.uint8]:
    """Return OKLab colors (..., 3) as sRGB in 0..255."""
    linear = (np.asarray(lab, dtype=np.float64) @ np.linalg.inv(_LAB_FROM_LMS).T) ** 3 @ np.linalg.inv(_LMS_FROM_RGB).T
    linear = np.clip(linear, 0.0, 1.0)
    srgb = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(srgb * 255.0).astype(np.uint8)


def pressure_color(value: ArrayLike) -> NDArray[np.uint8]:
    """Return (..., 3) the color of pressures in 0..1: blue-grey, amber, red; values beyond are clipped, nan is 0."""
    level = np.clip(np.nan_to_num(np.asarray(value, dtype=np.float64)), 0.0, 1.0)
    return RAMP[np.rint(level * (len(RAMP) - 1)).astype(np.int64)]


def cohort_color(cohort: ArrayLike) -> NDArray[np.uint8]:
    """Return (..., 3) the colors of cohorts of people, by their numbers."""
    return np.asarray(SERIES, dtype=np.uint8)[np.asarray(cohort, dtype=np.int64) % len(SERIES)]


def darker(colors: ArrayLike, by: float = 0.22) -> NDArray[np.uint8]:
    """Return ``colors`` (..., 3) with their perceived lightness lowered."""
    lab = to_oklab(colors)
    lab[..., 0] = np.maximum(lab[..., 0] - by, 0.0)
    return from_oklab(lab)


def blend(anchors: Sequence[Color], level: ArrayLike) -> NDArray[np.uint8]:
    """Return (..., 3) the colors at ``level`` (...) in 0..1 between anchors, which are equally far apart."""
    return from_oklab(_between(to_oklab(anchors), np.linspace(0.0, 1.0, len(anchors)), np.asarray(level)))


def _between(corners: Floats, at: Floats, level: Floats) -> Floats:
    return np.stack([np.interp(level, at, corners[:, k]) for k in range(3)], axis=-1)


def _ramp(size: int = 256) -> NDArray[np.uint8]:
    """Return ``size`` colors along the anchors, at equal perceived distances."""
    corners = to_oklab(ANCHORS)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    return from_oklab(_between(corners, length, np.linspace(0.0, length[-1], size)))


_LMS_FROM_RGB = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_LAB_FROM_LMS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
RAMP = _ramp()
