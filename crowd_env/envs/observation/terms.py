"""The terms that observations are made of: a literal table of those that are compiled, and the class of a user's own.

Vectors are given in the frame of the actions: along and to the left of the shortest path ("path"), or along x and y
("world"); `direction` is always along x and y.  Every value lies in [-1, 1].
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from crowd_env.envs.observation.view import View
from crowd_env.envs.terms import Term


@dataclass(frozen=True)
class ObservationTerm(Term):
    """A term of one's own, an entry of ``ObservationLayout(terms=...)`` beside the names in ``TERMS``.

    Parameters
    ----------
    name : the columns are ``layout[name]``.
    width : number of columns.
    function : ``(view, out)`` writes the columns ``out`` (P, width), zero before, scaled to [-1, 1], from a `View`.  Values
        beyond that are clipped, and the rows of those who are out stay zero.  It must draw no random numbers, and an
        environment's rows must not depend on other environments.  A function of a module can be pickled with its layout.

    Raises
    ------
    ValueError
        If the name is empty, the width no whole number of at least 1, or the function cannot be called.
    """

    kind = "observation term"
    arguments = "view, out"
    name: str
    width: int
    function: Callable[[View, np.ndarray], Any]


class CompiledTerm(NamedTuple):
    """A term whose columns a kernel writes, see `crowd_env.envs.observation.perception`."""

    width: int
    of_each: Literal["", "neighbors", "rays", "routes"] = ""  # field of the layout: so many times the width
    usual: bool = True  # part of an observation whose terms are not named


# Each has a field of the same name in `Columns`.
TERMS: Mapping[str, CompiledTerm] = MappingProxyType(
    {
        # own velocity / 2 m/s, in the frame
        "velocity": CompiledTerm(2),
        # own desired speed / 2 m/s
        "desired_speed": CompiledTerm(1),
        # direction of the shortest path to an exit, along x and y
        "direction": CompiledTerm(2),
        # time t the rest of the shortest path takes at the own desired speed, as t / (t + 5 s)
        "travel_time": CompiledTerm(1),
        # sum of the contact impulses since the last decision / (own mass * 1 m/s), in the frame
        "push": CompiledTerm(2),
        # sum of the magnitudes of these impulses / (own mass * 1 m/s): large between two who push from both sides
        "crush": CompiledTerm(1),
        # people within 1 m of the own center, oneself included, / (pi m2 * 8 /m2)
        "density": CompiledTerm(1),
        # free distance from the own surface to the nearest wall along rays / 3 m; ray k at k / n of a turn to the left
        "walls": CompiledTerm(1, of_each="rays"),
        # the k nearest people within 3 m, five values each: offset / 3 m (2), relative velocity / 4 m/s (2), closeness, which
        # is 1 - gap / 3 m, 1 at contact; all five are 0 where there is nobody
        "neighbors": CompiledTerm(5, of_each="neighbors"),
        # how much further along the own route each of these k people is, (own distance to go - theirs) / 3 m: above 0 for those
        # who are nearer the exit, 0 where there is nobody
        "lead": CompiledTerm(1, of_each="neighbors", usual=False),
        # of the people within 3 m who are nearer the exit along the own route: closeness of the next, which is 1 - lead / 3 m
        # (at least 0), the speed of that person along the route / 2 m/s, and their number n as n / (n + 10); 0 if there is none
        "ahead": CompiledTerm(3, usual=False),
        # two values for each exit and route of the place, in the order of `Scenario.ways`, as who knows the plan knows them:
        # the time t that this way takes at the own desired speed, as t / (t + 5 s), and 1 for the one that is followed
        "routes": CompiledTerm(2, of_each="routes", usual=False),
        # how many of the people within 3 m are nearer the end of each way than oneself and heading for it, n as n / (n + 10)
        "queues_seen": CompiledTerm(1, of_each="routes", usual=False),
        # the same of all people inside, as signs would show it that count those who wait: n / (n + 50)
        "queues_shown": CompiledTerm(1, of_each="routes", usual=False),
    }
)

USUAL = tuple(name for name, term in TERMS.items() if term.usual)
