"""Named terms, of observations and of rewards: names of a table, or objects of the user's own beside them."""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from crowd_env.checks import known, refuse


class Term(Protocol):
    """What has a name."""

    @property
    def name(self) -> str:
        """Its name, unique among the terms of an environment."""
        ...


def names_of(what: str, terms: Iterable[Any], own: type[Term], table: Mapping[str, Any]) -> list[str]:
    """Return the names of some terms.

    Parameters
    ----------
    what : kind of term, as messages call it.
    terms : names in ``table`` and objects of the class ``own``.

    Raises
    ------
    ValueError
        If a name is unknown (the message lists the known ones), two terms have one name, or a term of the user's own has a
        name in the table.
    """
    names: list[str] = []
    for term in terms:
        if not isinstance(term, str | own):
            refuse(f"one of the {what}s", term, f"a name or {own.__name__}(...); known names: {', '.join(table)}")
        if isinstance(term, own) and term.name in table:
            raise ValueError(f"{what} {term.name!r} comes with crowd_env; give your own another name")
        name = term.name if isinstance(term, own) else known(what, term, table)
        if name in names:
            raise ValueError(f"{what} {name!r} is named twice; name each only once")
        names.append(name)
    return names


def require_plain(what: str, terms: Iterable[Any], own: type[Term]) -> None:
    """Raise ValueError if a term is an object: plain data hold names, and no functions."""
    for term in terms:
        if isinstance(term, own):
            raise ValueError(f"{what} {term.name!r} is a function of your own, which cannot be written as plain data")


def require_function(what: str, name: str, function: Any, arguments: str) -> None:
    """Raise ValueError unless a term has a name and a function."""
    if not name:
        raise ValueError(f"{what} needs a name")
    if not callable(function):
        refuse(f"{what} {name!r}: function", function, f"a function ({arguments})")
