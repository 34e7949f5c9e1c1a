"""A rule of walking whose constants an evolution strategy has found: what a search over ten numbers is worth without a network.

It sees what learned policies see, people within 3 m, through compiled terms of the observation.
"""

from dataclasses import dataclass

import numpy as np

from agents.walking import WalkingRule, along, desired_speed
from crowd_env import ObservationLayout
from crowd_env.checks import POSITIVE, SHARE, Range, check_fields
from crowd_env.envs.observation.neighbors import AHEAD_SCALE
from crowd_env.envs.observation.view import SIGHT, SPEED_SCALE

_ANY = Range(-10.0, 10.0)


@dataclass(frozen=True)
class Evolved(WalkingRule):
    """`Follow` with more constants, all of them found by a search.

        V = clip(m u - h v + (s_i - s_j - d - c n / 10) / T - g k, -b v_0, v_0)

    with the rest s of the way to the exit, the speed u of the next nearer person j along that person's way, the own speed v,
    the number n of people within 3 m who are nearer to the exit, and the closeness k (1 at contact, 0 at 3 m) of the nearest
    of those in front, within 45 degrees.  Full speed with nobody nearer.  Beside the way it wants ``-a k_1^4`` of the own
    desired speed to the side on which the nearest person of all is, of closeness k_1: away from that person if a is above 0.

    Linear car following (Helly 1959) of the next in the order of distance to the exit, as `Follow`, but of all within 3 m and
    not of those in front alone, and with the own speed fed back: who wants to keep a distance exactly has to make up for the
    relaxation time.  The constants are fitted for ``competitive-door`` by CMA-ES, see docs/training.md.

    Parameters
    ----------
    spacing : m, ``d``, kept from center to center along the way.
    crowd : m, ``c``, by which that grows with every ten people who are nearer to the exit.
    time : s, ``T``, in which a difference from that is made up for.
    match : ``m``, of the speed of the next nearer person.
    damping : ``h``, of the own speed.
    closeness : m/s, ``g``.
    side : ``a``, share of the desired speed.
    back : ``b``, share of the desired speed at which one steps back at most.

    Raises
    ------
    ValueError
        If a constant is out of range.
    """

    name = "evolution"
    terms = ("velocity", "desired_speed", "neighbors", "ahead")
    spacing: float = 0.335
    crowd: float = 0.092
    time: float = 0.235
    match: float = 1.135
    damping: float = 0.638
    closeness: float = 0.393
    side: float = -0.172
    back: float = 0.808

    def __post_init__(self) -> None:
        free = dict.fromkeys(("spacing", "crowd", "match", "damping", "closeness"), _ANY)
        check_fields(self.name, self, time=POSITIVE, side=Range(-1.0, 1.0), back=SHARE, **free)

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the speed that keeps the distance to the next nearer person, and the step aside."""
        closeness, speed, share = observation[:, layout["ahead"]].astype(np.float64).T
        own = SPEED_SCALE * observation[:, layout["velocity"]][:, 0].astype(np.float64)
        nearest = observation[:, layout["neighbors"]].astype(np.float64).reshape(len(observation), -1, 5)
        in_front = nearest[:, :, 0] > np.abs(nearest[:, :, 1])
        close = np.where(in_front, nearest[:, :, 4], 0.0).max(axis=1)
        nearer = AHEAD_SCALE * share / np.maximum(1.0 - share, 1e-9)
        gap = SIGHT * (1.0 - closeness) - self.spacing - self.crowd * nearer / 10.0
        velocity = self.match * SPEED_SCALE * speed - self.damping * own + gap / self.time - self.closeness * close
        action = along(np.where(share > 0.0, velocity, np.inf), desired_speed(observation, layout), self.back)
        action[:, 1] = -self.side * np.sign(nearest[:, 0, 1]) * nearest[:, 0, 4] ** 4
        return action
