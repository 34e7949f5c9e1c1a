"""Recorded starts: read, and checked to be places where people can stand."""

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.kernels.jit import kernel
from crowd_env.geometry.geometry import Geometry


def check_starts(geometry: Geometry, starts: Floats, radius: Floats) -> None:
    """Raise ValueError unless recorded positions lie inside, clear of walls and of each other."""
    outside = np.flatnonzero(~geometry.contains(starts))
    if len(outside):
        k = outside[0]
        where = "in a part that no exit reaches" if geometry.is_left_out(starts[k]) else "outside the walkable area"
        raise ValueError(f"start {k} at ({starts[k, 0]:g}, {starts[k, 1]:g}) is {where}")
    clearance = geometry.clearance(starts)
    k = int(np.argmin(clearance - radius))
    if clearance[k] < radius[k] - 1e-9:
        raise ValueError(
            f"start {k} at ({starts[k, 0]:g}, {starts[k, 1]:g}) is {clearance[k]:.3f} m from a wall; "
            f"its body of radius {radius[k]:.3f} m does not fit"
        )
    i, j, gap = closest_pair(np.ascontiguousarray(starts, dtype=np.float64), radius)
    if gap < -1e-9:
        raise ValueError(
            f"starts {i} and {j} overlap by {-gap:.3f} m: their radii add up to {radius[i] + radius[j]:.3f} m; "
            "take smaller bodies"
        )


def closest_pair(position: Floats, radius: Floats) -> tuple[int, int, float]:
    """Return the two discs with the smallest gap, and that gap [m]; (0, 0, inf) for fewer than two."""
    order = np.argsort(position[:, 0], kind="stable")
    return _closest_pair(position, radius, order, 2.0 * float(np.max(radius, initial=0.0)))


@kernel
def _closest_pair(position: Floats, radius: Floats, order: Ints, widest: float) -> tuple[int, int, float]:
    """Look from each disc, from left to right, only as far as a smaller gap can be."""
    best_i, best_j, best = 0, 0, np.inf
    for m in range(len(order)):
        i = order[m]
        for n in range(m + 1, len(order)):
            j = order[n]
            if position[j, 0] - position[i, 0] - widest > best:
                break
            distance = np.hypot(position[i, 0] - position[j, 0], position[i, 1] - position[j, 1])
            gap = distance - radius[i] - radius[j]
            if gap < best:
                best_i, best_j, best = min(i, j), max(i, j), gap
    return best_i, best_j, best
