"""Bounds on parameters of schemes and forces: one sentence that names what is wrong, and the formula that says why."""

from collections.abc import Iterable


def require_positive(scheme: str, why: str = "", **values: float) -> None:
    """Raise ValueError, naming scheme, parameter and formula, unless every value is > 0 (infinity is allowed)."""
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{scheme}: {name} is {value!r}; it must be > 0{why and ': ' + why}")


def require_known(scheme: str, name: str, value: str, known: Iterable[str]) -> None:
    """Raise ValueError, naming scheme and parameter, unless the value is a known one."""
    if value not in known:
        raise ValueError(f"{scheme}: unknown {name} {value!r}; known: {', '.join(known)}")


def require_not_negative(scheme: str, why: str = "", **values: float) -> None:
    """Raise ValueError, naming scheme, parameter and formula, unless every value is >= 0 (infinity is allowed)."""
    for name, value in values.items():
        if not value >= 0:
            raise ValueError(f"{scheme}: {name} is {value!r}; it must be >= 0{why and ': ' + why}")
