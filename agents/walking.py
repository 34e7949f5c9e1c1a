"""Rules of walking that keep bodies apart: what a learned crowd has to beat beside the stampede.

Each is a policy of constants that acts through the same actions as a learned one, every decision step (0.1 s), and returns a
share of each desired speed along the shortest path, never more than all of it.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from crowd_env import ObservationLayout, ObservationTerm, Walking
from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.headway import Headway, Manner
from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, SHARE, Range, check_fields
from crowd_env.envs.observation.neighbors import DENSITY_RADIUS, DENSITY_SCALE
from crowd_env.envs.observation.view import SPEED_SCALE, TIME_SCALE

from .plain import Plain
from .surroundings import LEADER, PREDECESSOR, read_leader

WEIGHT = Range(-100.0, 100.0)  # of weights that a search may set
_WEIGHTS = ("own", "far", "density", "close", "match", "crowd", "always")  # of `Evolved`, in the order of `inputs`
_SLOWEST, _FASTEST = 0.05, 3.0  # 2 m/s, of a desired speed that is divided by; and times one's own


class WalkingRule(ABC):
    """A rule that acts along and to the left of the shortest path, from the terms of an observation."""

    name: ClassVar[str]
    terms: ClassVar[tuple[str | ObservationTerm, ...]]
    full_state: ClassVar[bool] = False  # it knows more than what is within 3 m
    steady: ClassVar[bool] = True  # see `Policy`

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv`: the terms that the rule sees, and the axes in which it acts."""
        return {"observation": ObservationLayout(terms=self.terms), "action": "continuous"}

    def reset(self, env_mask: np.ndarray) -> None:  # noqa: B027  a hook: most rules remember nothing
        """Nothing to forget."""

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

    Lin, Ma, Qin, Dong (2016) find that a crowd may clear sooner when it hurries less.  The share is given, or None: then
    whatever evaluates the policy looks for the best in that scenario under that scheme, see
    `crowd_env.agents.drivers.best_share`.

    Parameters
    ----------
    share : of the desired speed, 0 to 1.

    Raises
    ------
    ValueError
        If the share is out of range.
    """

    name = "rule-best-speed"
    terms = ("desired_speed",)
    share: float | None = None

    def __post_init__(self) -> None:
        if self.share is not None:
            check_fields(self.name, self, share=SHARE)

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the share, whatever is seen."""
        if self.share is None:
            raise ValueError(f"policy {self.name!r} has no share of speed; give one, or let agents.evaluate find it")
        return np.tile([self.share, 0.0], (len(observation), 1))


@dataclass(frozen=True)
class DensityCap(WalkingRule):
    """Walk the shortest path, slowly where it is dense: ``V = min(v_0, c)`` if the density exceeds ``rho``, else ``v_0``.

    Sees the terms ``density`` (people within 1 m of the own center, oneself included) and ``desired_speed`` (known up to
    2 m/s).  It is the simplest rule that slows down at the door alone; a step where Weidmann (1993) has a smooth curve.

    Parameters
    ----------
    density : 1/m2, ``rho``.
    speed : m/s, ``c``.

    Raises
    ------
    ValueError
        If a constant is not positive.
    """

    name = "density-cap"
    terms = ("density", "desired_speed")
    density: float = 2.0
    speed: float = 1.0

    def __post_init__(self) -> None:
        check_fields(self.name, self, density=POSITIVE, speed=POSITIVE)

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return full speed, or the cap where it is dense."""
        people = np.rint(observation[:, layout["density"]][:, 0] * (np.pi * DENSITY_RADIUS**2 * DENSITY_SCALE))
        dense = people > self.density * np.pi * DENSITY_RADIUS**2
        return along(np.where(dense, self.speed, np.inf), desired_speed(observation, layout))


@dataclass(frozen=True)
class HeadwayRule(WalkingRule):
    """Keep a distance and step aside, as `crowd_env.core.behaviors.headway` says: the manner of
    ``CrowdEnv(walking=...)`` as a policy.

    It wants the shortest path at full speed, in an environment that it asks to be made with its manner: how fast and on which
    side of that path people walk, the compiled rule decides.  It sees pedestrians in front within 2 m that no wall hides.

    Parameters
    ----------
    manner : a name in ``MANNERS``, a Headway, or a table of its parameters; it goes before that of the scenario or the run.

    Raises
    ------
    ValueError
        If the manner is unknown or a parameter is out of range.
    """

    name = "headway"
    steady = False
    terms = ("desired_speed",)  # nobody reads it
    manner: Manner = "hurried"

    def __post_init__(self) -> None:
        Headway.of(self.manner)

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv`, the manner among them: without it people would walk on at full speed."""
        return {**super().env_options, "walking": Walking(self.manner)}

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return full speed along the shortest path, whatever is seen: the rest is done by the environment."""
        return np.tile([1.0, 0.0], (len(observation), 1))


@dataclass(frozen=True)
class Follow(WalkingRule):
    """Keep a distance along the way to the pedestrian next nearer to the exit, of all in front within 3 m.

        V = clip(u + (s_i - s_j - d) / T, -b v_0, v_0)

    with the rest s of the way to the exit and the speed u of the leader j along the leader's way; full speed with none in
    front.  Linear car following with relative speed (Helly 1959, with the rest of the way for the position in the lane), which
    merges streams: pedestrians from different sides follow one another as in one lane.  Sees ``desired_speed`` (known up
    to 2 m/s) and the term `LEADER`.  The constants are found by a search in Lin's room, see docs/training.md.

    Parameters
    ----------
    spacing : m, ``d``, kept from center to center along the way.
    time : s, ``T``, in which a difference from that is made up for.
    back : ``b``, share of the desired speed at which one steps back at most.

    Raises
    ------
    ValueError
        If a constant is out of range.
    """

    name = "follow"
    leader: ClassVar[ObservationTerm] = LEADER
    terms: ClassVar[tuple[str | ObservationTerm, ...]] = ("desired_speed", LEADER)
    spacing: float = 0.53
    time: float = 0.3
    back: float = 0.33

    def __post_init__(self) -> None:
        check_fields(self.name, self, spacing=NOT_NEGATIVE, time=POSITIVE, back=SHARE)

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the speed that keeps the distance to the leader, full speed without a leader."""
        leader = read_leader(observation, layout, self.leader)
        velocity = leader.speed + (leader.lead - self.spacing) / self.time
        return along(np.where(leader.there, velocity, np.inf), desired_speed(observation, layout), self.back)


@dataclass(frozen=True)
class Zipper(Follow):
    """Follow, in the order of distance to the exit, the pedestrian next nearer, wherever in the room that is.

    `Follow` with one order of everyone on the same route instead of the people within 3 m: one after the other through the
    door, as zips close.  That order is full state, which no pedestrian sees: the term `PREDECESSOR`.  A bound to aim at, and
    no rule that people could walk by.  Where a route leads to several exits, people of all of them stand in one order.
    """

    name = "zipper"
    leader = PREDECESSOR
    terms = ("desired_speed", PREDECESSOR)
    full_state = True
    spacing: float = 0.43
    time: float = 0.3
    back: float = 0.5


@dataclass(frozen=True)
class Evolved(WalkingRule):
    """A weighted sum of what is seen: no gap to keep and no leader to follow is written down.

        V = v_0 clip(1 + w . x, -1, 1)

    along the way, with the desired speed v_0.  x is what learned policies see too, people within 3 m of those on the same way,
    through compiled terms of the observation, as they are scaled there.  With all weights 0 it is full speed, where a search
    begins (`crowd_env.agents.learned.evolution`).  The weights were found for ``competitive-door``, from nothing: they come
    close to the linear car following of Helly (1959), which `Follow` was given.

    Parameters
    ----------
    own : weight of the own speed along the way, as a share of v_0.
    far : of the term ``travel_time``.
    density : of the term ``density``.
    close : of the closeness of the next person nearer to the exit, 0 if there is none.
    match : of the speed of that person along the way, as a share of v_0, at most 3.
    crowd : of the number of pedestrians nearer to the exit, as the term ``ahead`` has it.
    always : added in any case.

    Raises
    ------
    ValueError
        If a weight is out of range.
    """

    name = "evolution"
    terms: ClassVar[tuple[str, ...]] = ("velocity", "desired_speed", "travel_time", "density", "ahead")
    own: float = -3.0
    far: float = 2.64
    density: float = 2.29
    close: float = -8.9
    match: float = 3.99
    crowd: float = -3.89
    always: float = 6.21

    def __post_init__(self) -> None:
        check_fields(self.name, self, **dict.fromkeys(_WEIGHTS, WEIGHT))

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return the speed along the way."""
        weights = np.array([getattr(self, name) for name in _WEIGHTS])
        share = 1.0 + inputs(observation, layout) @ weights
        return np.column_stack([np.clip(share, -1.0, 1.0), np.zeros(len(share))])


@dataclass(frozen=True)
class YieldWhenStuck(Evolved):
    """Full speed for pedestrians that get on, `Evolved` for all that have not got on for ``patience``.

    Streams that press against each other, or pedestrians that arch in front of a door, stand for good at full speed: all that
    are stuck go on pushing.  `Evolved` steps back from the next one ahead, which loosens them.  It sees the term ``stood`` too.

    Parameters
    ----------
    patience : s, within which one has to get nearer to the end of the way than ever before; set by hand.

    Raises
    ------
    ValueError
        If a constant is out of range.
    """

    name = "yield-when-stuck"
    steady = False
    terms: ClassVar[tuple[str, ...]] = (*Evolved.terms, "stood")
    patience: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self.name, self, patience=NOT_NEGATIVE)

    def decide(self, observation: np.ndarray, layout: ObservationLayout) -> np.ndarray:
        """Return full speed, or what loosens a crowd that is stuck."""
        stuck = observation[:, layout["stood"]] > self.patience / (self.patience + TIME_SCALE)
        return np.where(stuck, super().decide(observation, layout), [1.0, 0.0])


def inputs(observation: np.ndarray, layout: ObservationLayout) -> Floats:
    """Return what `Evolved` weighs (P, 7), from an observation that holds its terms."""
    seen = {name: observation[:, layout[name]].astype(np.float64) for name in Evolved.terms}
    desired, ahead = np.maximum(seen["desired_speed"][:, 0], _SLOWEST), seen["ahead"]
    match = np.minimum(ahead[:, 1] / desired, _FASTEST)
    own, always = seen["velocity"][:, 0] / desired, np.ones(len(observation))
    columns = own, seen["travel_time"][:, 0], seen["density"][:, 0], ahead[:, 0], match, ahead[:, 2], always
    return np.column_stack(columns)


def desired_speed(observation: np.ndarray, layout: ObservationLayout) -> Floats:
    """Return the desired speed (P,) [m/s] as observed, up to 2 m/s; a tiny number for pedestrians that are out."""
    return np.maximum(SPEED_SCALE * observation[:, layout["desired_speed"]][:, 0].astype(np.float64), 1e-9)


def along(velocity: Floats, desired: Floats, back: float = 0.0) -> np.ndarray:
    """Return the actions (P, 2) of velocities (P,) [m/s] along the way, within ``-back`` and 1 of the desired speed."""
    return np.column_stack([np.clip(velocity / desired, -back, 1.0), np.zeros(len(velocity))])
