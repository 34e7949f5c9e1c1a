"""A rule of walking whose constants an evolution strategy has found: what a search over eight numbers is worth.

It sees what learned policies see, people within 3 m, through compiled terms of the observation.
"""

from dataclasses import dataclass

import numpy as np

from crowd_env import ObservationLayout
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import POSITIVE, SHARE, Range, check_fields
from crowd_env.envs.observation.neighbors import AHEAD_SCALE
from crowd_env.envs.observation.view import SIGHT, SPEED_SCALE, TIME_SCALE

from .walking import WalkingRule, along, desired_speed

_ANY = Range(-10.0, 10.0)
_FAR = 5.0  # m


@dataclass(frozen=True)
class Evolved(WalkingRule):
    """`Follow` with more constants, all of them found by a search.

        V = clip(m u - h v + (s_i - s_j - d - c n / 10 - f min(s_i / 5 m, 1)) / T, -b v_0, v_0)

    with the rest s of the way to the exit, the speed u of the next nearer person j along that person's way, the own speed v,
    and the number n of people within 3 m who are nearer to the exit.  Full speed with nobody nearer.  To the side it wants
    ``a k^4`` of the own desired speed, away from the nearest person of all, of closeness k (1 at contact, 0 at 3 m).

    Linear car following (Helly 1959) of the next in the order of distance to the exit, as `Follow`, but of all within 3 m and
    not of those in front alone, and with the own speed fed back: who wants to keep a distance exactly has to make up for the
    relaxation time.  The constants are fitted for ``competitive-door`` by CMA-ES, see docs/training.md.

    Parameters
    ----------
    spacing : m, ``d``, kept from center to center along the way.
    crowd : m, ``c``, by which that grows with every ten people who are nearer to the exit.
    far : m, ``f``, by which that grows up to 5 m before the exit.
    time : s, ``T``, in which a difference from that is made up for.
    match : ``m``, of the speed of the next nearer person.
    damping : ``h``, of the own speed.
    side : ``a``, share of the desired speed; below 0 it is towards the nearest person.
    back : ``b``, share of the desired speed at which one steps back at most.

    Raises
    ------
    ValueError
        If a constant is out of range.
    """

    name = "evolution"
    terms = ("velocity", "desired_speed", "travel_time", "neighbors", "ahead")
    spacing: float = 0.376
    crowd: float = 0.408
    far: float = -0.26
    time: float = 0.201
    match: float = 1.247
    damping: float = 0.999
    side: float = -0.046
    back: float = 0.743

    def __post_init__(self) -> None:
        free = dict.fromkeys(("spacing", "crowd", "far", "match", "damping"), _ANY)
        check_fields(self.name, self, time=POSITIVE, side=Range(-1.0, 1.0), back=SHARE, **free)

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the speed that keeps the distance to the next nearer person, and the step aside."""
        seen = {name: observation[:, layout[name]].astype(np.float64) for name in layout.names}
        desired = desired_speed(observation, layout)
        rest = desired * _unsquashed(seen["travel_time"][:, 0], TIME_SCALE)
        closeness, speed, share = seen["ahead"].T
        gap = SIGHT * (1.0 - closeness) - self.spacing - self.crowd * _unsquashed(share, AHEAD_SCALE) / 10.0
        gap -= self.far * np.minimum(rest / _FAR, 1.0)
        velocity = SPEED_SCALE * (self.match * speed - self.damping * seen["velocity"][:, 0]) + gap / self.time
        action = along(np.where(share > 0.0, velocity, np.inf), desired, self.back)
        nearest = seen["neighbors"]  # the first five columns are of the nearest
        action[:, 1] = -self.side * np.sign(nearest[:, 1]) * nearest[:, 4] ** 4
        return action / np.maximum(np.hypot(*action.T), 1.0)[:, None]


def _unsquashed(value: Floats, scale: float) -> Floats:
    """Return x from x / (x + scale)."""
    return scale * value / np.maximum(1.0 - value, 1e-9)
