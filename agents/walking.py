"""Rules of walking that keep bodies apart: baselines of learned policies beside full speed.

Each rule is a policy of constants.  Like a learned policy it acts every decision step (0.1 s).  Its action is a share of each
desired speed along the shortest path, at most 1.

The standard term ``neighbors`` does not hold which pedestrians are nearer to the exit.  Two terms add the next one on the same
route, with three columns: 1 if there is one, the difference of the distances to the exit / 3 m, and its speed along its way
/ 4 m/s.  `LEADER` is local: pedestrians in front within 3 m, like the standard terms.  `PREDECESSOR` is full state: it compares
all pedestrians in the room.  Both look through walls.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np

from crowd_env import ObservationLayout, ObservationTerm, Walking
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.behaviors.headway import Headway, Manner
from crowd_env.core.checks import NotNegative, Positive, Range, Share, check_fields
from crowd_env.envs.observation.neighbors import DENSITY_RADIUS, DENSITY_SCALE
from crowd_env.envs.observation.view import SIGHT, SPEED_SCALE, TIME_SCALE, View

from .plain import Plain
from .policy import WithoutMemory

WEIGHT = Range(-100.0, 100.0)
Weight = Annotated[float, WEIGHT]
_SLOWEST = 0.05  # 2 m/s  lower bound of a desired speed in a denominator
_FASTEST = 3.0  # upper bound of a relative speed
_LEADER_SCALE = 4.0  # m/s


def write_leader(view: View, out: np.ndarray) -> None:
    """Write `LEADER`: of the pedestrians in front on the same route within 3 m, the next nearer to the exit."""
    way, inside, start = view.distance_to_go, view.seen & view.state.active, view.bodies.env_start
    for begin, end in pairwise(start.tolist()):
        rows = begin + np.flatnonzero(inside[begin:end])
        if not len(rows):
            continue
        (dx, dy), route = (axis - axis[:, None] for axis in view.state.position[rows].T), view.followed[rows]
        ahead = dx * view.direction[rows, :1] + dy * view.direction[rows, 1:] > 0.0
        lead = way[rows][:, None] - way[rows]
        candidate = ahead & (lead > 0.0) & (np.hypot(dx, dy) < SIGHT) & (route[:, None] == route)
        nearest, some = np.where(candidate, lead, np.inf).argmin(axis=1), candidate.any(axis=1)
        _write_leader(view, rows[some], rows[nearest[some]], out)


def write_predecessor(view: View, out: np.ndarray) -> None:
    """Write `PREDECESSOR`: of all pedestrians on the same route, the next nearer to the exit; of equals, the lower slot."""
    way, inside = view.distance_to_go, np.flatnonzero(view.seen & view.state.active)
    env = np.searchsorted(view.bodies.env_start, inside, side="right")
    order = np.lexsort((way[inside], view.followed[inside], env))
    rows, env, route = inside[order], env[order], view.followed[inside][order]
    same = (env[1:] == env[:-1]) & (route[1:] == route[:-1])
    _write_leader(view, rows[1:][same], rows[:-1][same], out)


def _write_leader(view: View, rows: Ints, leader: Ints, out: np.ndarray) -> None:
    """Write the columns of pedestrians ``rows`` (K,) that follow ``leader`` (K,)."""
    lead = view.distance_to_go[rows] - view.distance_to_go[leader]
    speed = (view.state.velocity[leader] * view.direction[leader]).sum(axis=1)
    out[rows] = np.column_stack([np.ones(len(rows)), lead / SIGHT, speed / _LEADER_SCALE])


LEADER = ObservationTerm("leader", 3, write_leader)
PREDECESSOR = ObservationTerm("predecessor", 3, write_predecessor)


class WalkingRule(WithoutMemory, ABC):
    """A rule that acts along and to the left of the shortest path, from the terms of an observation.

    Subclasses are frozen dataclasses, whose fields are the constants of the rule.

    Raises
    ------
    ValueError
        If a constant is out of range.
    """

    name: ClassVar[str]
    terms: ClassVar[tuple[str | ObservationTerm, ...]]
    full_state: ClassVar[bool] = False  # it observes pedestrians beyond 3 m
    steady: ClassVar[bool] = True  # see `Policy`

    def __post_init__(self) -> None:
        check_fields(self.name, self)

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv`: the terms that the rule observes, and its kind of action."""
        return {"observation": ObservationLayout(terms=self.terms), "action": "continuous"}

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return the actions (P, 2) along and left of the shortest path.

        Raises
        ------
        ValueError
            If the observation lacks a term that the rule needs.
        """
        needed = [term if isinstance(term, str) else term.name for term in self.terms]
        missing = [name for name in needed if name not in layout.names]
        if missing:
            what = "the full state, which only its own" if self.full_state else "its own"
            raise ValueError(
                f"policy {self.name!r} needs {what} observation holds: {', '.join(missing)} is not among the terms "
                f"{', '.join(layout.names)}; make the environment with the env_options of the policy"
            )
        return self.decide(observation, layout)

    @abstractmethod
    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the actions (P, 2) from an observation that holds all terms."""


@dataclass(frozen=True)
class RuleAtShare(WalkingRule):
    """Walk the shortest path at a fixed share of the desired speed.

    Lin, Ma, Qin, Dong (2016) find that a crowd may clear sooner when it hurries less.

    Parameters
    ----------
    share : of the desired speed, 0 to 1.  None = an evaluation searches the best share in its scenario under its scheme, see
        `crowd_env.agents.drivers.best_share`.
    """

    name = "rule-best-speed"
    terms = ("desired_speed",)
    share: Share | None = None

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the share for every pedestrian."""
        if self.share is None:
            raise ValueError(f"policy {self.name!r} has no share of speed; give one, or let agents.evaluate find it")
        return np.tile([self.share, 0.0], (len(observation), 1))


@dataclass(frozen=True)
class DensityCap(WalkingRule):
    """Walk the shortest path, slowly where it is dense: ``V = min(v_0, c)`` if the density exceeds ``rho``, else ``v_0``.

    It observes the terms ``density`` (pedestrians within 1 m of the body's center, itself included) and ``desired_speed``
    (up to 2 m/s).  It is the simplest rule that slows down only at the door, with a step in place of the smooth curve of
    Weidmann (1993).

    Parameters
    ----------
    density : 1/m2, ``rho``.
    speed : m/s, ``c``.
    """

    name = "density-cap"
    terms = ("density", "desired_speed")
    density: Positive = 2.0
    speed: Positive = 1.0

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return full speed, and the cap where the density is high."""
        people = np.rint(observation[:, layout["density"]][:, 0] * (np.pi * DENSITY_RADIUS**2 * DENSITY_SCALE))
        dense = people > self.density * np.pi * DENSITY_RADIUS**2
        return along(np.where(dense, self.speed, np.inf), desired_speed(observation, layout))


@dataclass(frozen=True)
class HeadwayRule(WalkingRule):
    """Keep a distance and step aside: the manner of ``CrowdEnv(walking=...)`` as a policy.

    The policy acts at full speed along the shortest path, in an environment with its manner.  The compiled rule of
    `crowd_env.core.behaviors.headway` then sets speed and side of each pedestrian.  It observes pedestrians in front within 2 m
    that no wall hides.

    Parameters
    ----------
    manner : a name in ``MANNERS``, a Headway, or a table of its parameters; it overrides the manner of scenario and run.

    Raises
    ------
    ValueError
        If the manner is unknown or a parameter is out of range.
    """

    name = "headway"
    steady = False
    terms = ("desired_speed",)  # unused: an observation needs a term
    manner: Manner = "hurried"

    def __post_init__(self) -> None:
        Headway.of(self.manner)

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv` with the manner, without which pedestrians would keep full speed."""
        return {**super().env_options, "walking": Walking(self.manner)}

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return full speed along the shortest path; the environment applies the manner."""
        return np.tile([1.0, 0.0], (len(observation), 1))


@dataclass(frozen=True)
class Follow(WalkingRule):
    """Keep a distance along the way to the pedestrian next nearer to the exit, of all in front within 3 m.

        V = clip(u + (s_i - s_j - d) / T, -b v_0, v_0)

    Here s is the distance to the exit along the way, and u is the speed of the leader j along its way.  Without a leader V is
    full speed.  This is linear car following with relative speed (Helly 1959), with s as the position in the lane.  It merges
    streams: pedestrians from different sides follow one another as in one lane.  It observes ``desired_speed`` (up to 2 m/s)
    and the term `LEADER`.  A search in Lin's room found the constants, see docs/training.md.

    Parameters
    ----------
    spacing : m, ``d``, between centers along the way.
    time : s, ``T``, relaxation time of the distance.
    back : ``b``, largest backward speed as a share of the desired speed.
    """

    name = "follow"
    leader = LEADER
    terms = ("desired_speed", LEADER)
    spacing: NotNegative = 0.53
    time: Positive = 0.3
    back: Share = 0.33

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the speed that keeps the distance to the leader, full speed without a leader."""
        there, lead, speed = observation[:, layout[self.leader.name]].astype(np.float64).T
        velocity = _LEADER_SCALE * speed + (SIGHT * lead - self.spacing) / self.time
        return along(np.where(there > 0.5, velocity, np.inf), desired_speed(observation, layout), self.back)


@dataclass(frozen=True)
class Zipper(Follow):
    """Follow the pedestrian next nearer to the exit, anywhere in the room.

    This is `Follow` with one order of all pedestrians on the same route, instead of the pedestrians within 3 m: one after the
    other through the door, like the teeth of a zipper.  That order is full state (the term `PREDECESSOR`), which no pedestrian
    can observe.  The rule is a bound for comparison, not a model of walking.  Where a route leads to several exits, the
    pedestrians of all of them stand in one order.
    """

    name = "zipper"
    leader = PREDECESSOR
    terms = ("desired_speed", PREDECESSOR)
    full_state = True
    spacing: NotNegative = 0.43
    back: Share = 0.5


@dataclass(frozen=True)
class Evolved(WalkingRule):
    """A weighted sum of observed terms, without a built-in distance or leader.

        V = v_0 clip(1 + w . x, -1, 1)

    along the way, with the desired speed v_0.  The inputs x are terms that learned policies observe as well, in their scaling,
    about pedestrians within 3 m on the same way.  Zero weights are full speed, where a search begins
    (`crowd_env.agents.learned.evolution`).  A search from zero in ``competitive-door`` found these weights.  They are close to
    the linear car following of Helly (1959), which is built into `Follow`.

    Parameters
    ----------
    own : weight of the own speed along the way, as a share of v_0.
    far : of the term ``travel_time``.
    density : of the term ``density``.
    close : of the closeness of the pedestrian next nearer to the exit, 0 if there is none.
    match : of the speed of that pedestrian along the way, as a share of v_0, at most 3.
    crowd : of the number of pedestrians nearer to the exit, as in the term ``ahead``.
    always : constant.
    """

    name = "evolution"
    terms: ClassVar[tuple[str, ...]] = ("velocity", "desired_speed", "travel_time", "density", "ahead")
    own: Weight = -3.0
    far: Weight = 2.64
    density: Weight = 2.29
    close: Weight = -8.9
    match: Weight = 3.99
    crowd: Weight = -3.89
    always: Weight = 6.21

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the speed along the way."""
        weights = np.array([getattr(self, one.name) for one in fields(Evolved)])
        share = 1.0 + inputs(observation, layout) @ weights
        return np.column_stack([np.clip(share, -1.0, 1.0), np.zeros(len(share))])


@dataclass(frozen=True)
class YieldWhenStuck(Evolved):
    """Full speed for pedestrians that make progress, and `Evolved` for pedestrians without progress for ``patience``.

    At full speed, opposing streams block each other for good, and so do arches in front of a door.  `Evolved` steps back from
    the pedestrian ahead, which dissolves them.  The rule also observes the term ``stood``.

    Parameters
    ----------
    patience : s, time without coming nearer to the end of the way than ever before; set by hand.
    """

    name = "yield-when-stuck"
    steady = False
    terms = (*Evolved.terms, "stood")
    patience: NotNegative = 2.0

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return full speed, and the actions of `Evolved` for pedestrians without progress."""
        stuck = observation[:, layout["stood"]] > self.patience / (self.patience + TIME_SCALE)
        return np.where(stuck, super().decide(observation, layout), [1.0, 0.0])


@dataclass(frozen=True)
class Overtaking(WalkingRule):
    """A weighted sum of observed terms along the way, and another to its left.

        V = v_0 (clip(1 + w . x, -1, 1), clip(u . x, -1, 1))

    The inputs x are those of `Evolved`, the speed to the left, and the sums over the neighbors of their closeness, alone and
    times their distance ahead and to the left.  Zero weights are full speed.

    Parameters
    ----------
    weights : (22,) w and u.
    """

    name = "overtaking"
    terms = (*Evolved.terms, "neighbors")
    weights: tuple[float, ...] = (0.0,) * 22

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the velocity as a share of the desired speed."""
        return overtake(observation, layout, np.tile(self.weights, (len(observation), 1)))


def inputs(observation: np.ndarray, layout: ObservationLayout) -> Floats:
    """Return the inputs (P, 7) of `Evolved` from an observation that holds its terms."""
    seen = {name: observation[:, layout[name]].astype(np.float64) for name in Evolved.terms}
    desired, ahead = np.maximum(seen["desired_speed"][:, 0], _SLOWEST), seen["ahead"]
    match = np.minimum(ahead[:, 1] / desired, _FASTEST)
    own, far, density = seen["velocity"][:, 0] / desired, seen["travel_time"], seen["density"]
    return np.column_stack([own, far, density, ahead[:, 0], match, ahead[:, 2], np.ones(len(own))])


def overtake(observation: np.ndarray, layout: ObservationLayout, weights: Floats) -> Floats:
    """Return the actions (P, 2) of `Overtaking` for rows of weights (P, 22)."""
    near = observation[:, layout["neighbors"]].astype(np.float64).reshape(len(observation), -1, 5)
    sides = np.einsum("pkx,pk->px", near[:, :, [0, 1]], near[:, :, 4])
    left = observation[:, layout["velocity"]][:, 1]
    seen = np.column_stack([inputs(observation, layout), left, sides, near[:, :, 4].sum(axis=1)])
    change = np.einsum("px,pax->pa", seen, weights.reshape(len(seen), 2, -1))
    return np.clip(change + np.array([1.0, 0.0]), -1.0, 1.0)


def desired_speed(observation: np.ndarray, layout: ObservationLayout) -> Floats:
    """Return the observed desired speed (P,) [m/s], up to 2 m/s; a tiny number for pedestrians outside."""
    return np.maximum(SPEED_SCALE * observation[:, layout["desired_speed"]][:, 0].astype(np.float64), 1e-9)


def along(velocity: Floats, desired: Floats, back: float = 0.0) -> np.ndarray:
    """Return the actions (P, 2) of velocities (P,) [m/s] along the way, within ``-back`` and 1 of the desired speed."""
    return np.column_stack([np.clip(velocity / desired, -back, 1.0), np.zeros(len(velocity))])
