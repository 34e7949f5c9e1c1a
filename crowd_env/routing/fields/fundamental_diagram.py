"""Speed of a crowd at a density, and flow through an opening: the time cost of a congested way.

People that keep a distance walk about at the speed that Weidmann (1993) found for a density,
    v / v_free = 1 - exp(-1.913 (1 / rho - 1 / 5.4)),  rho in 1/m2,
but never slower than `SLOWEST`: a jam moves on slowly.  (The speed of their rule in a crowd packed in triangles,
(d - 2 r) / T, sends them around queues that they could join: at the recorded gate 0.95 instead of 1.13 people a second.)
They pass an opening as recorded crowds do.  People that keep no distance walk at full speed up to touching; only the queue in
front of an opening takes time.
"""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats

SLOWEST = 0.08  # of the free speed: a crowd that fills the floor moves on slowly
# 1/(m s)  The door of 1 m of Seyfried et al. 2009 (Transp. Sci. 43:395) passes 1.9; 79 published flows through doors of 0.4 to
# 2.8 m lie from 1.6 to 2.8.
_RECORDED = 1.9
_JAM = 5.4  # 1/m2
_CLOSEST = np.sqrt(3.0) / 2.0  # m2 per person and square of the distance, packed in triangles


class FundamentalDiagram(NamedTuple):
    """How a crowd walks: the means of ``radius`` [m] and ``desired_speed`` [m/s], and whether people keep a distance."""

    radius: float
    desired_speed: float
    keeps_distance: bool = False

    def flow(self, width: Floats) -> Floats:
        """Return how many pass an opening per second [1/s].

        ``width`` [m] is the room in it for the middle of a body.  Of people that keep no distance at least one file passes;
        more where a wide front lets more pass.
        """
        if self.keeps_distance:
            return _RECORDED * (width + 2.0 * self.radius)
        file = self.desired_speed / (2.0 * self.radius)
        front = self.desired_speed / (_CLOSEST * (2.0 * self.radius) ** 2)
        return np.maximum(file, front * width)


def weidmann(density: Floats) -> Floats:
    """Return the speed at a density [1/m2] as a share of the free speed (Weidmann 1993), at least `SLOWEST`."""
    with np.errstate(divide="ignore", over="ignore"):
        share = 1.0 - np.exp(-1.913 * (1.0 / np.maximum(density, 1e-9) - 1.0 / _JAM))
    return np.clip(share, SLOWEST, 1.0)
