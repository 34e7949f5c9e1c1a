"""The terms of observations, built-in and custom, and their columns.

Vectors are given in the frame of the actions: along and to the left of the shortest path ("path"), or along x and y
("world").  Only `direction` is always along x and y: a compass, by which a policy in the frame of the path could tell the walls
of a room apart.  Such a policy observes it only on request.  Every value lies in [-1, 1].
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Ints, unit_vectors
from crowd_env.core.checks import Plain, Range, check_fields, from_data
from crowd_env.envs.observation.view import Columns, Plan, View
from crowd_env.envs.terms import Layout, Term, observed_terms, own_terms

# Up to this number of pedestrians in an environment all pairs are compared, above it neighboring cells: faster, same bits.
ALL_PAIRS = 96
MOST_NEIGHBORS = 32
MOST_RAYS = 360
MOST_ROUTES = 1000


@dataclass(frozen=True)
class ObservationTerm(Term):
    """A custom term, an entry of ``ObservationLayout(terms=...)`` beside the names in ``TERMS``.

    Parameters
    ----------
    name : the columns are ``layout[name]``.
    width : number of columns.
    function : ``(view, out)`` writes the columns ``out`` (P, width), zero before, scaled to [-1, 1], from a `View`.  Values
        beyond that are clipped, and the rows of pedestrians outside stay zero.  It must draw no random numbers, and an
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
    """A term with columns that a kernel writes, see `crowd_env.envs.observation.perception`."""

    width: int
    of_each: Literal["", "neighbors", "rays", "routes"] = ""  # field of the layout that multiplies the width
    usual: bool = True  # part of an observation without a list of terms


# Each has a field of the same name in `Columns`.
TERMS: Mapping[str, CompiledTerm] = {
    # own velocity / 2 m/s, in the frame
    "velocity": CompiledTerm(2),
    # own desired speed / 2 m/s
    "desired_speed": CompiledTerm(1),
    # direction of the shortest path to an exit, along x and y
    "direction": CompiledTerm(2, usual=False),
    # time t of the rest of the shortest path at the desired speed, as t / (t + 5 s)
    "travel_time": CompiledTerm(1),
    # the narrowest opening on the way ahead: 1 - own diameter / width, at least 0, and the time t to it as t / (t + 5 s)
    "opening": CompiledTerm(2, usual=False),
    # the floor on the way, here and 1 m ahead, two values each: rise over the length of the slope, and the speed there relative
    # to that on level floor, minus 1; all four are 0 on level floor
    "slope": CompiledTerm(4, usual=False),
    # time t since the pedestrian was last nearer to the end of the way than ever before, as t / (t + 5 s)
    "stood": CompiledTerm(1, usual=False),
    # sum of the contact impulses since the last decision / (own mass * 1 m/s), in the frame
    "push": CompiledTerm(2),
    # sum of the magnitudes of these impulses / (own mass * 1 m/s): large between two neighbors that push from both sides
    "crush": CompiledTerm(1),
    # pedestrians within 1 m of the body's center, itself included, / (pi m2 * 8 /m2)
    "density": CompiledTerm(1),
    # free distance from the surface of the body to the nearest wall along rays / 3 m; ray k at k / n of a turn to the left
    "walls": CompiledTerm(1, of_each="rays"),
    # the k nearest people within 3 m, five values each: offset / 3 m (2), relative velocity / 4 m/s (2), closeness, which
    # is 1 - gap / 3 m, 1 at contact; all five are 0 without a neighbor
    "neighbors": CompiledTerm(5, of_each="neighbors"),
    # how much further along its route each of these k pedestrians is, (own distance to go - theirs) / 3 m: above 0 for a
    # neighbor nearer the exit, 0 without a neighbor
    "lead": CompiledTerm(1, of_each="neighbors", usual=False),
    # of the pedestrians within 3 m that go the same way and are nearer its end: closeness of the next, which is 1 - lead / 3 m
    # (at least 0), its speed along the route / 2 m/s, and their number n as n / (n + 10); 0 if there is none
    "ahead": CompiledTerm(3, usual=False),
    # two values for each exit and route of the place, in the order of `Scenario.ways`, as known from the plan:
    # the time t of this way at the desired speed, as t / (t + 5 s), and 1 for the way that is followed
    "routes": CompiledTerm(2, of_each="routes", usual=False),
    # how many pedestrians within 3 m are ahead of this one on each way and heading for it, n as n / (n + 10)
    "queues_seen": CompiledTerm(1, of_each="routes", usual=False),
    # the same of all pedestrians inside, as signs with the length of each queue would show it: n / (n + 50)
    "queues_shown": CompiledTerm(1, of_each="routes", usual=False),
    # other members of the group: offset of their center / (3 m + its distance) (2), in the frame, and their number n as
    # n / (n + 3); 0 for pedestrians that walk alone
    "group": CompiledTerm(3, usual=False),
}

USUAL = tuple(name for name, term in TERMS.items() if term.usual)


@dataclass(frozen=True)
class ObservationLayout(Layout):
    """Which terms an observation holds, and where: ``layout["direction"]`` is a slice of columns.

    Parameters
    ----------
    terms : names in ``TERMS`` and `ObservationTerm` objects, in the order of the columns; by default the ``USUAL`` ones.
    neighbors : number of nearest pedestrians observed.
    rays : number of directions in which walls are sensed.
    routes : number of exits and routes in terms with columns for each; 0 = as many as the place has, which an environment
        fills in.

    Raises
    ------
    ValueError
        If a term is unknown, two have the same name, or a number is out of range.

    Examples
    --------
    >>> layout = ObservationLayout(terms=("velocity", "walls"), rays=16)
    >>> layout["walls"], layout.size
    (slice(2, 18, None), 18)
    """

    terms: Sequence[str | ObservationTerm] = USUAL
    neighbors: Annotated[int, Range(1, MOST_NEIGHBORS)] = 6
    rays: Annotated[int, Range(1, MOST_RAYS)] = 8
    routes: Annotated[int, Range(0, MOST_ROUTES)] = 0

    def __post_init__(self) -> None:
        check_fields("observation", self)
        object.__setattr__(self, "terms", observed_terms(ObservationTerm, self.terms, TERMS))

    @property
    def own_terms(self) -> tuple[ObservationTerm, ...]:
        """The terms that are not compiled."""
        return own_terms(ObservationTerm, self.terms)

    @property
    def tells_of_routes(self) -> bool:
        """Whether a term has columns for each exit and route of the place."""
        return any(TERMS[term].of_each == "routes" for term in self.terms if isinstance(term, str))

    def width(self, name: str) -> int:
        """Return the number of columns of a term."""
        return self._widths()[name]

    def _widths(self) -> dict[str, int]:
        widths = {}
        for term in self.terms:
            if isinstance(term, ObservationTerm):
                widths[term.name] = term.width
            else:
                known = TERMS[term]
                widths[term] = known.width * (getattr(self, known.of_each) if known.of_each else 1)
        return widths

    def as_table(self) -> dict[str, Any]:
        """Return plain data that `make_layout` makes the same layout of.

        Raises
        ------
        ValueError
            If a term is a custom function.
        """
        for term in self.own_terms:
            raise ValueError(f"{term.kind} {term.name!r} is one of your own, which cannot be written as plain data")
        table = {"terms": list(self.names), "neighbors": self.neighbors, "rays": self.rays}
        return {**table, "routes": self.routes} if self.tells_of_routes else table

    def plan(self, largest: int, all_pairs: int = ALL_PAIRS) -> Plan:
        """Return where the compiled terms go, and scratch for one thread.

        Parameters
        ----------
        largest : number of pedestrians of the largest environment.
        all_pairs : environments of up to this number of pedestrians need no cells.
        """
        wanted = [term for term in self.terms if isinstance(term, str)]
        angle = 2.0 * np.pi * np.arange(self.rays) / self.rays
        return Plan(
            column=Columns(**{name: self[name].start if name in wanted else -1 for name in TERMS}),
            turn=unit_vectors(angle),
            beam=np.zeros((3, self.rays)),
            nearest=np.zeros(self.neighbors),
            around=np.zeros((4, largest)),
            key=np.zeros(largest),
            all_pairs=all_pairs,
        )

    def add_own_terms(self, view: View, environments: Ints, out: np.ndarray) -> None:
        """Write the columns of terms that are not compiled, for all rows of some environments, into ``out`` (P, size).

        Raises
        ------
        ValueError
            If a function writes past its columns, raises it, or writes what is not finite; the message names the term.
        """
        for term in self.own_terms:
            values = np.zeros((len(out), term.width))
            try:
                term.function(view, values)
            except (IndexError, ValueError) as error:
                raise ValueError(f"{term.kind} {term.name!r} cannot write its {term.width} columns: {error}") from error
            values[~view.seen] = 0.0
            term.finite(values)
            for e in environments:
                rows = slice(view.bodies.env_start[e], view.bodies.env_start[e + 1])
                out[rows, self[term.name]] = np.clip(values[rows], -1.0, 1.0)


def make_layout(observation: ObservationLayout | Plain | None, *, in_world: bool = False) -> ObservationLayout:
    """Return a layout, the one of plain data such as ``{"terms": ["velocity", "walls"], "rays": 16}``, or the default.

    Vectors that are ``in_world``, along x and y, come with the `direction` of the path by default.

    Raises
    ------
    ValueError
        If it is of a wrong type, or a key is unknown.
    """
    if observation is None and in_world:
        return ObservationLayout(tuple(name for name in TERMS if name in USUAL or name == "direction"))
    allowed = "an ObservationLayout, a table {'terms': [...]} or None"
    return from_data("observation", ObservationLayout, observation, allowed)
