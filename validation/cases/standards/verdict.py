"""What a test of a standard answers."""

from collections.abc import Callable
from typing import Any, NamedTuple

from validation.cases.case import Setting


class Verdict(NamedTuple):
    """Whether a test is passed, the figures as a sentence, and the numbers behind them."""

    passed: bool | None  # None = the standard asks for figures, not for a bound
    figure: str
    more: dict[str, Any]


class Check(NamedTuple):
    """A test of one or several standards that ask the same."""

    run: Callable[[Setting], Verdict]
    criterion: str
    source: str
