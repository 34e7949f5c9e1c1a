"""Named terms, of observations and of rewards: names of a table, or custom objects beside them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np

from crowd_env.core.checks import FINITE, check_fields, known, number, refuse, require_all, table


class Term:
    """Base of all custom terms; checked at construction."""

    kind: ClassVar[str]  # name in messages
    arguments: ClassVar[str]  # of the function
    name: str
    function: Callable[..., Any]

    def __post_init__(self) -> None:
        check_fields(self.kind, self)
        if not self.name:
            raise ValueError(f"{self.kind} needs a name")
        if not callable(self.function):
            refuse(f"{self.kind} {self.name!r}: function", self.function, f"a function ({self.arguments})")

    def finite(self, values: np.ndarray) -> np.ndarray:
        """Return the values of the function; raise ValueError if a number is nan or infinite."""
        quick = bool(np.isfinite(values).all())  # at every step
        return values if quick else require_all(f"{self.kind} {self.name!r}", values, FINITE)


@dataclass(frozen=True)
class RewardTerm(Term):
    """A custom term, a key among the weights of a reward beside the built-in names.

    Parameters
    ----------
    name : it is reported as ``reward/<name>``.
    function : of a `crowd_env.envs.reward.Transition`; returns the term (P,) of each pedestrian.  Pedestrians outside at the
        start of the step get 0 in any case.  In ``crowd_env/routing-v0`` it is a function of a
        `crowd_env.envs.routing.terms.RoutingView`, and returns the term (E,) of each environment.  A function of a module can
        be pickled with its weights.

    Raises
    ------
    ValueError
        If the name is empty or the function cannot be called.
    """

    kind = "reward term"
    arguments = "transition, or view in crowd_env/routing-v0"
    name: str
    function: Callable[[Any], Any]


OwnTerm = TypeVar("OwnTerm", bound=Term)


def names_of(own: type[Term], terms: Iterable[Any], named: Mapping[str, Any]) -> list[str]:
    """Return the names of some terms.

    Parameters
    ----------
    own : class of the custom terms.
    terms : names in ``named`` and objects of the class ``own``.

    Raises
    ------
    ValueError
        If a name is unknown (the message lists the known ones), two terms have one name, or a custom term has a name in the
        table.
    """
    names: list[str] = []
    for term in terms:
        if not isinstance(term, str | own):
            refuse(f"one of the {own.kind}s", term, f"a name or {own.__name__}(...); known names: {', '.join(named)}")
        if isinstance(term, own) and term.name in named:
            raise ValueError(f"{own.kind} {term.name!r} comes with crowd_env; give your own another name")
        name = term.name if isinstance(term, own) else known(own.kind, term, named)
        if name in names:
            raise ValueError(f"{own.kind} {name!r} is named twice; name each only once")
        names.append(name)
    return names


def own_terms(own: type[OwnTerm], terms: Iterable[Any]) -> tuple[OwnTerm, ...]:
    """Return the custom terms among some terms."""
    return tuple(term for term in terms if isinstance(term, own))


def observed_terms(own: type[Term], terms: Any, named: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the terms of an observation as a tuple.

    Raises
    ------
    ValueError
        If it is of a wrong type or empty, or where `names_of` raises it.
    """
    if isinstance(terms, str):
        refuse("observation: terms", terms, f"a tuple of names: ({terms!r},)")
    if not isinstance(terms, Iterable) or isinstance(terms, Mapping | bytes):
        refuse("observation: terms", terms, f"a tuple of names and {own.__name__} objects")
    terms = tuple(terms)
    names_of(own, terms, named)
    if not terms:
        raise ValueError("an observation needs at least one term; observation: terms is empty")
    return terms


def weighed_terms(where: str, weights: Any, named: Mapping[str, Any]) -> dict[Any, float]:
    """Return the terms of a reward, names in ``named`` and `RewardTerm` objects, with their weights.

    Raises
    ------
    ValueError
        If it is no table, a weight is not finite, or where `names_of` raises it.
    """
    weights = table(where, weights, f"weights such as {{{next(iter(named))!r}: 1.0}}")
    return {
        term: number(f"weight of {RewardTerm.kind} {name!r}", weight)
        for name, (term, weight) in zip(names_of(RewardTerm, weights, named), weights.items(), strict=True)
    }


class Layout:
    """Terms laid side by side: ``layout["walls"]`` is a slice of columns."""

    def _widths(self) -> dict[str, int]:
        """Return the number of columns of each term, in their order."""
        raise NotImplementedError

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms, in the order of the columns."""
        return tuple(self._widths())

    @property
    def size(self) -> int:
        """Number of columns in all."""
        return sum(self._widths().values())

    def __getitem__(self, name: str) -> slice:
        """Return the columns of a term."""
        return columns_of("this observation has no term", name, self._widths())


def columns_of(what: str, name: str, widths: Mapping[str, int]) -> slice:
    """Return where the columns called ``name`` are among others, laid side by side in the order of ``widths``.

    Raises
    ------
    KeyError
        If there are none; the message states that ``what`` has none, and lists the existing ones.
    """
    if name not in widths:
        raise KeyError(f"{what} {name!r}; it has: {', '.join(widths)}")
    names = list(widths)
    begin = sum(widths[before] for before in names[: names.index(name)])
    return slice(begin, begin + widths[name])
