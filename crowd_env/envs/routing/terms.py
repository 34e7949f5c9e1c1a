"""Observation and reward of a controller of ``crowd_env/routing-v0``: two tables of named terms, and custom ones."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import Plain, check_keys, table
from crowd_env.envs.terms import Layout, RewardTerm, Term, observed_terms, own_terms, weighed_terms

DENSITY_SCALE = 5.0  # 1/m2
SPEED_SCALE = 2.0  # m/s
FLOW_SCALE = 5.0  # 1/(s m)  people out per second and meter of exit
QUEUE_REACH = 2.5  # m  people with no further to walk to an exit stand in its queue


class RoutingView(NamedTuple):
    """Input of a term: E evacuations of N people, R regions, X exits, K routes and D doors, when a decision is due."""

    interval: float  # s  between decisions
    inside: Bools  # (E, N)  inside, or cut off by the end of the episode since the last decision
    left: Bools  # (E, N)  got out since the last decision
    time_inside: Floats  # (E, N)  s spent inside since the last decision
    position: Floats  # (E, N, 2)  m
    velocity: Floats  # (E, N, 2)  m/s
    region: Ints  # (E, N)  region of people inside; -1 = none of the regions, or not inside
    region_area: Floats  # (R,)  m2, walkable
    exit_taken: Ints  # (E, N)  exit of people that left since the last decision; -1 = have not
    exit_width: Floats  # (X,)  m
    exit_distance: Floats  # (X, E, N)  m to walk to each exit
    on_route: Bools  # (K, E, N)  inside and sent along the route
    door_open: Bools  # (E, D)
    time: Floats  # (E,)  s since the start
    time_limit: Floats  # (E,)  s

    def total(self, group: Ints, groups: int, weights: Floats | None = None) -> Floats:
        """Return the number (E, ``groups``) of people in each ``group`` (E, N), or the sum of ``weights``; -1 is no group."""
        environments = len(group)
        known = group >= 0
        cell = (group + groups * np.arange(environments)[:, None])[known]
        total = np.bincount(cell, weights=None if weights is None else weights[known], minlength=environments * groups)
        return np.asarray(total, dtype=np.float64).reshape(environments, groups)


@dataclass(frozen=True)
class RoutingTerm(Term):
    """A term of the observation, ``RoutingEnv(observation={"terms": [...]})``.

    Parameters
    ----------
    name : the columns are ``layout[name]``.
    of_each : the term has a column for each "region", "exit", "route" or controlled "door", or a single one ("").
    function : of a `RoutingView`; returns the columns (E, n), scaled to [0, 1].  Values beyond that are clipped.  It must draw
        no random numbers, and an environment's row must not depend on other environments.

    Raises
    ------
    ValueError
        If the name is empty, ``of_each`` is unknown, or the function cannot be called.
    """

    kind = "observation term"
    arguments = "view"
    name: str
    of_each: Literal["region", "exit", "route", "door", ""]
    function: Callable[[RoutingView], Any]


def _count(view: RoutingView) -> Floats:
    return view.total(view.region, len(view.region_area)) / view.inside.shape[1]


def _density(view: RoutingView) -> Floats:
    return view.total(view.region, len(view.region_area)) / view.region_area / DENSITY_SCALE


def _speed(view: RoutingView) -> Floats:
    speed = np.hypot(view.velocity[..., 0], view.velocity[..., 1])
    total, people = (view.total(view.region, len(view.region_area), weights) for weights in (speed, None))
    return total / np.maximum(people, 1.0) / SPEED_SCALE


def _flow(view: RoutingView) -> Floats:
    return view.total(view.exit_taken, len(view.exit_width)) / view.interval / (view.exit_width * FLOW_SCALE)


def _queue(view: RoutingView) -> Floats:
    return _share(view.inside & (view.exit_distance <= QUEUE_REACH))


def _assigned(view: RoutingView) -> Floats:
    return _share(view.on_route)


def _door(view: RoutingView) -> Bools:
    return view.door_open


def _inside(view: RoutingView) -> Floats:
    return _share(view.inside[None])


def _time(view: RoutingView) -> Floats:
    return (view.time / view.time_limit)[:, None]


def _share(people: Bools) -> Floats:
    """Return the share (E, n) of all N people for each of n choices (n, E, N) of them."""
    return (people.sum(axis=2) / people.shape[2]).T


_TERMS = (
    # people in it / all N people of the scenario
    RoutingTerm("count", "region", _count),
    # people per walkable m2 / (5 /m2)
    RoutingTerm("density", "region", _density),
    # mean speed of the people in it / (2 m/s); 0 if there are none
    RoutingTerm("speed", "region", _speed),
    # people that left by it since the last decision / (interval * width * 5 /(s m))
    RoutingTerm("flow", "exit", _flow),
    # people with at most 2.5 m to walk to it / N
    RoutingTerm("queue", "exit", _queue),
    # people inside sent along it / N
    RoutingTerm("assigned", "route", _assigned),
    # 1 = open
    RoutingTerm("door", "door", _door),
    # people inside / N
    RoutingTerm("inside", "", _inside),
    # time / time limit
    RoutingTerm("time", "", _time),
)
TERMS: Mapping[str, RoutingTerm] = {term.name: term for term in _TERMS}


@dataclass(frozen=True)
class RoutingLayout(Layout):
    """Where the terms of an observation are: ``layout["queue"]`` is a slice of columns; all values lie in [0, 1].

    Parameters
    ----------
    regions, exits, routes, doors : names, in the order of the columns of terms that have one for each.
    terms : in the order of the columns.
    """

    regions: tuple[str, ...]
    exits: tuple[str, ...]
    routes: tuple[str, ...]
    doors: tuple[str, ...] = ()
    terms: tuple[RoutingTerm, ...] = tuple(TERMS.values())

    def _widths(self) -> dict[str, int]:
        each = {"region": self.regions, "exit": self.exits, "route": self.routes, "door": self.doors, "": ("all",)}
        return {term.name: len(each[term.of_each]) for term in self.terms}


def make_terms(observation: Plain | None) -> tuple[RoutingTerm, ...]:
    """Return the terms of plain data, ``{"terms": ["count", "queue"]}``, or all; `RoutingTerm` objects may stand among names.

    Raises
    ------
    ValueError
        If it is of a wrong type, a name is unknown, or two terms have the same name.
    """
    given = table("observation", {} if observation is None else observation, "terms such as {'terms': ['count']}")
    check_keys("observation", given, ["terms"])
    terms = observed_terms(RoutingTerm, given.get("terms", tuple(TERMS)), TERMS)
    return tuple(term if isinstance(term, RoutingTerm) else TERMS[term] for term in terms)


def _mean(view: RoutingView) -> Floats:
    return -view.time_inside.mean(axis=1)


def _last(view: RoutingView) -> Floats:
    return -view.time_inside.max(axis=1)


_REWARDS = (
    # minus the time that everyone spent inside [s], averaged over all N people: sums to minus the mean exit time
    RewardTerm("mean", _mean),
    # minus the time during which anyone was inside [s]: sums to minus the exit time of the last person
    RewardTerm("last", _last),
)
REWARDS: Mapping[str, RewardTerm] = {term.name: term for term in _REWARDS}


def make_weights(reward: Mapping[str | RewardTerm, float] | None) -> dict[RewardTerm, float]:
    """Return the weights of all terms of the reward: 0.1 each by default, 0 for terms that a table of weights leaves out.

    Raises
    ------
    ValueError
        If it is no table, a term is unknown, two terms have the same name, or a weight is not finite.
    """
    given = weighed_terms("reward", dict.fromkeys(REWARDS, 0.1) if reward is None else reward, REWARDS)
    own = own_terms(RewardTerm, given)
    return {term: given.get(term.name, 0.0) for term in REWARDS.values()} | {term: given[term] for term in own}
