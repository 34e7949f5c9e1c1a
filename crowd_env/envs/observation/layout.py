"""Which terms an observation holds, and in which columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Ints
from crowd_env.core.checks import Range, check_fields, from_data
from crowd_env.envs.observation.terms import TERMS, USUAL, ObservationTerm
from crowd_env.envs.observation.view import Columns, Plan, View
from crowd_env.envs.terms import Layout, observed_terms, own_terms

# Up to so many people in an environment all pairs are looked at, above it those of neighboring cells: faster, the same bits.
ALL_PAIRS = 96
MOST_NEIGHBORS = 32
MOST_RAYS = 360
MOST_ROUTES = 1000


@dataclass(frozen=True)
class ObservationLayout(Layout):
    """Which terms an observation holds, and where: ``layout["direction"]`` is a slice of columns.

    Parameters
    ----------
    terms : names in ``TERMS`` and `ObservationTerm` objects, in the order of the columns; by default the ``USUAL`` ones.
    neighbors : how many nearest people are seen.
    rays : how many directions walls are felt for in.
    routes : number of exits and routes that the terms of each tell of; 0 = as many as the place has, which an environment
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
    neighbors: int = 6
    rays: int = 8
    routes: int = 0

    def __post_init__(self) -> None:
        counts = {"neighbors": Range(1, MOST_NEIGHBORS), "rays": Range(1, MOST_RAYS), "routes": Range(0, MOST_ROUTES)}
        check_fields("observation", self, **counts)
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
            If a term is a function of the user's own.
        """
        for term in self.own_terms:
            raise ValueError(
                f"{term.kind} {term.name!r} is a function of your own, which cannot be written as plain data"
            )
        table = {"terms": list(self.names), "neighbors": self.neighbors, "rays": self.rays}
        return {**table, "routes": self.routes} if self.tells_of_routes else table

    def plan(self, largest: int, all_pairs: int = ALL_PAIRS) -> Plan:
        """Return where the compiled terms go, and scratch for one thread.

        Parameters
        ----------
        largest : how many people the largest environment holds.
        all_pairs : environments of up to so many people need no cells.
        """
        wanted = [term for term in self.terms if isinstance(term, str)]
        angle = 2.0 * np.pi * np.arange(self.rays) / self.rays
        return Plan(
            column=Columns(**{name: self[name].start if name in wanted else -1 for name in TERMS}),
            turn=np.column_stack([np.cos(angle), np.sin(angle)]),
            beam=np.zeros((3, self.rays)),
            nearest=np.zeros(self.neighbors),
            around=np.zeros((4, largest)),
            key=np.zeros(largest),
            all_pairs=all_pairs,
        )

    def add_own_terms(self, view: View, environments: Ints, out: np.ndarray) -> None:
        """Write the columns of terms that are not compiled, of everyone in some environments, into ``out`` (P, size)."""
        for term in self.own_terms:
            values = np.zeros((len(out), term.width))
            term.function(view, values)
            values[~view.seen] = 0.0
            for e in environments:
                rows = slice(view.bodies.env_start[e], view.bodies.env_start[e + 1])
                out[rows, self[term.name]] = np.clip(values[rows], -1.0, 1.0)


def make_layout(observation: ObservationLayout | Mapping[str, Any] | None) -> ObservationLayout:
    """Return a layout, the one of plain data such as ``{"terms": ["velocity", "walls"], "rays": 16}``, or the default.

    Raises
    ------
    ValueError
        If it is something else, or a key is unknown.
    """
    allowed = "an ObservationLayout, a table {'terms': [...]} or None"
    return from_data("observation", ObservationLayout, observation, allowed)
