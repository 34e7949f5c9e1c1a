"""Corners of plain shapes."""

import numpy as np

from crowd_env.core.arrays.state import Floats


def rectangle(left: float, low: float, right: float, high: float) -> Floats:
    """Return the corners (4, 2) [m] of a rectangle along the axes, from the lower left one."""
    return np.array([(left, low), (right, low), (right, high), (left, high)])


def circle(x: float, y: float, radius: float, corners: int = 32) -> Floats:
    """Return the corners (``corners``, 2) [m] of a circle."""
    angle = 2.0 * np.pi * np.arange(corners) / corners
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
