"""Tables of what no argument may be: each row a call and the words that its one sentence must hold."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from cases import looped

NAN, INF = float("nan"), float("inf")

# What is wrong for every argument of a kind, and for some.
NO_NUMBER = (True, "1", 1j, [1.0], {}, float, b"1", np.array([1.0, 2.0]), np.bool_(True))
OUTSIDE: dict[str, tuple[Any, ...]] = {
    "finite": (NAN, INF, -INF, np.float64(NAN), 10**400),
    "positive": (NAN, INF, -INF, 0, -1.0, np.float64(-1.0)),
    "positive or infinite": (NAN, -INF, 0.0, -1.0),
    "not negative": (NAN, INF, -INF, -1e-9, -1),
    "share": (NAN, INF, -0.1, 1.1),
    "bounded": (NAN, INF, -INF, 0, -1.0, np.float64(-1.0)),
    "1 to 32": (NAN, INF, 0, -1, 2.5, np.int64(-3), np.float64(2.5), 33),
    "1 to 360": (NAN, INF, 0, -1, 2.5, np.int64(-3), np.float64(2.5), 361),
    "count": (NAN, INF, 0, -1, 2.5, np.int64(-3), np.float64(2.5)),
    "whole": (NAN, INF, -1, 2.5),
}
# What a message says of the numbers that are allowed.
ALLOWED = {"positive": "> 0", "positive or infinite": "> 0", "not negative": ">= 0", "share": "[0, 1]", "count": "1"}
ALLOWED |= {"1 to 32": "1 to 32", "1 to 360": "1 to 360"}
NO_FLAG = ("no", "True", 1, 0, None, 1.0, [], np.array([True]))
NO_TEXT = (3, b"x", ["x"], 2.0, True)
NO_NAMES = ("e", 3, [1], {"a": 1}, b"e", (None,))
NO_CHOICE = ("everywhere", 3, ["x"], b"path", True, np.array([1, 2]))
NO_OBJECT = ("POLYGON", 3, {}, object, [1], NAN)

Row = tuple[str, Callable[[], Any], tuple[str, ...]]


def show(value: Any) -> str:
    return getattr(value, "__name__", None) or " ".join(repr(value).split())[:30]


def rows(name: str, call: Callable[[Any], Any], values: Iterable[Any]) -> list[Row]:
    """Return a row for each bad value of the argument, whose name is the last word of ``name``; it has to be said."""
    argument = name.split(".")[-1].split(" ")[-1]
    return [(f"{name}={show(value)}", lambda value=value: call(value), (argument, told(value))) for value in values]


def told(value: Any) -> str:
    """Return what a message has to say of a value."""
    if isinstance(value, type):
        return value.__name__
    if isinstance(value, np.ndarray):
        return f"array of shape {value.shape}"
    if isinstance(value, list | tuple | dict):  # what is wrong about it may be one of its entries
        return ""
    value = value.item() if isinstance(value, np.generic) else value
    text = " ".join(repr(value).split())[:20]
    return f"{value:g}" if isinstance(value, float) and text.startswith(f"{value:g}") else text


def numeric(name: str, call: Callable[[Any], Any], kind: str, *, or_none: bool = False) -> list[Row]:
    found = rows(name, call, (*NO_NUMBER, *OUTSIDE[kind], *(() if or_none else (None,))))
    return [(row, bad, (*words, "it must be", ALLOWED.get(kind, ""))) for row, bad, words in found]


def table(*parts: list[Row]) -> Any:
    """Return what runs a test of ``call, words`` for every row, and reports each that fails by its name."""
    found = [row for part in parts for row in part]
    return looped("call,words", [(call, words) for _, call, words in found], ids=[name for name, _, _ in found])


def refuses(call: Callable[[], Any], words: Iterable[str]) -> None:
    """Check that a call is refused by a ValueError (no other: no AttributeError from somewhere inside) in one sentence."""
    with pytest.raises(ValueError) as caught:
        call()
    message = str(caught.value)
    assert caught.type is ValueError
    assert "\n" not in message and len(message) < 400
    assert not message.startswith(("could not", "setting an array", "operands", "The truth value", "cannot reshape"))
    for word in words:
        assert word in message, message
