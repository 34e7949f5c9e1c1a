"""How fast a crowd walks at a density, and how many pass an opening: what a congested way costs in time.

People of radius r who keep a time gap T leave V T in front at speed V, so that at a density rho, packed in triangles,

    V = clip((d - 2 r) / T, p v_0, v_0),  d = sqrt(2 / (sqrt(3) rho))

(collision-free speed model: Tordeux, Chraibi, Seyfried 2016).  Who keeps no distance walks at full speed up to touching.
"""

from typing import NamedTuple

import numpy as np

from crowd_env.state import Floats

SLOWEST = 0.08  # of the free speed: a crowd that fills the floor moves on, it only takes its time
_CLOSEST = np.sqrt(3.0) / 2.0  # m2 per person and square of the distance, packed in triangles


class FundamentalDiagram(NamedTuple):
    """The means of a crowd: ``radius`` [m], ``desired_speed`` [m/s], ``time_gap`` [s] and ``push`` (share of that speed)."""

    radius: float
    desired_speed: float
    time_gap: float = 0.0
    push: float = 1.0

    def speed(self, density: Floats) -> Floats:
        """Return the speed at a density [1/m2] as a share of the desired speed, at least `SLOWEST`."""
        least = max(self.push, SLOWEST)
        if least >= 1.0 or self.time_gap * self.desired_speed <= 0.0:
            return np.ones_like(density)
        distance = 1.0 / np.sqrt(_CLOSEST * np.maximum(density, 1e-9))
        share = (distance - 2.0 * self.radius) / (self.time_gap * self.desired_speed)
        return np.clip(share, least, 1.0)

    def flow(self, width: Floats) -> Floats:
        """Return how many pass an opening per second; ``width`` [m] is what the middle of a body has of it.

        At least one file of people who walk freely at their distance; more where the greatest flow of a wide front is more.
        """
        room = self.time_gap * (1.0 - self.push)  # those who push keep less
        speed = self.desired_speed
        file = speed / (speed * room + 2.0 * self.radius)
        best = speed if room <= 0.0 else min(speed, 2.0 * self.radius / room)
        front = best / (_CLOSEST * (best * room + 2.0 * self.radius) ** 2)
        return np.maximum(file, front * width)
