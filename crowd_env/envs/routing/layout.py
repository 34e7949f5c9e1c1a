"""Which terms the observation of a routing controller holds, and in which columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from crowd_env.core.checks import check_keys, known, table, texts
from crowd_env.envs.routing.terms import TERMS, RoutingTerm
from crowd_env.envs.terms import Layout, observed_terms


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


def make_terms(observation: Mapping[str, Any] | None) -> tuple[RoutingTerm, ...]:
    """Return the terms of plain data, ``{"terms": ["count", "queue"]}``, or all; `RoutingTerm` objects may stand among names.

    Raises
    ------
    ValueError
        If it is something else, a name is unknown, or two terms have the same name.
    """
    given = table("observation", {} if observation is None else observation, "terms such as {'terms': ['count']}")
    check_keys("observation", given, ["terms"])
    terms = observed_terms(RoutingTerm, given.get("terms", tuple(TERMS)), TERMS)
    return tuple(term if isinstance(term, RoutingTerm) else TERMS[term] for term in terms)


def check_names(kind: str, names: Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the names as a tuple.

    Raises
    ------
    ValueError
        If they are one string or no list of names, or if a name is unknown or given twice.
    """
    found = texts(f"{kind}s", names)
    for name in found:
        known(kind, name, allowed)
        if found.count(name) > 1:
            raise ValueError(f"{kind} {name!r} is named twice; once is enough")
    return found
