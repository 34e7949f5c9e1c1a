"""Which terms the observation of a routing controller holds, and in which columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from crowd_env.checks import check_keys, known, refuse, shown
from crowd_env.envs.routing.terms import TERMS, RoutingTerm
from crowd_env.envs.terms import names_of


@dataclass(frozen=True)
class RoutingLayout:
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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms, in the order of the columns."""
        return tuple(term.name for term in self.terms)

    @property
    def size(self) -> int:
        """Number of columns in all."""
        return sum(self._width(term) for term in self.terms)

    def _width(self, term: RoutingTerm) -> int:
        each = {"region": self.regions, "exit": self.exits, "route": self.routes, "door": self.doors}
        return len(each[term.of_each]) if term.of_each else 1

    def __getitem__(self, name: str) -> slice:
        """Return the columns of a term."""
        begin = 0
        for term in self.terms:
            if term.name == name:
                return slice(begin, begin + self._width(term))
            begin += self._width(term)
        raise KeyError(f"this observation has no term {name!r}; it has: {', '.join(self.names)}")


def make_terms(observation: Mapping[str, Any] | None) -> tuple[RoutingTerm, ...]:
    """Return the terms of plain data, ``{"terms": ["count", "queue"]}``, or all; `RoutingTerm` objects may stand among names.

    Raises
    ------
    ValueError
        If it is something else, a name is unknown, or two terms have the same name.
    """
    if observation is None:
        return tuple(TERMS.values())
    form = f"a table of terms such as {{'terms': [{', '.join(map(repr, list(TERMS)[:2]))}]}}"
    if not isinstance(observation, Mapping) or "terms" not in observation:
        refuse("observation", observation, form)
    check_keys("observation", observation, ["terms"])
    terms = observation["terms"]
    if not isinstance(terms, list | tuple) or not terms:
        refuse("observation: terms", terms, "a list of at least one name or RoutingTerm")
    names_of("observation term", terms, RoutingTerm, TERMS)
    return tuple(term if isinstance(term, RoutingTerm) else TERMS[term] for term in terms)


def check_names(kind: str, names: Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the names as a tuple.

    Raises
    ------
    ValueError
        If they are one string or no sequence, or if a name is unknown or given twice.
    """
    if not isinstance(names, list | tuple):
        raise ValueError(f"{kind}s is {shown(names)}; it must be a list or tuple of names")
    for name in names:
        known(kind, name, allowed)
        if names.count(name) > 1:
            raise ValueError(f"{kind} {name!r} is named twice; once is enough")
    return tuple(names)
