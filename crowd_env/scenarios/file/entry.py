"""A value of a scenario file that knows where it stands there, so that every mistake is named by its place."""

import difflib
import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from numbers import Real
from typing import Any

from crowd_env.scenarios.file.numbers import LARGEST, fill_in

_KINDS = {dict: "a table", list: "a list", str: "a text", bool: "true or false", int: "a number", float: "a number"}


@dataclass(frozen=True)
class Entry:
    """A value, the file it is from, and its place there, such as ``groups[1].radius``; "" = the whole file."""

    value: Any
    source: str
    path: str = ""

    def error(self, problem: str) -> ValueError:
        """Return the error that names this place."""
        return ValueError(": ".join(part for part in (self.source, self.path, problem) if part))

    @contextmanager
    def named(self) -> Iterator[None]:
        """Say this place before any ValueError of the block."""
        try:
            yield
        except ValueError as error:
            raise self.error(str(error)) from None

    def table(self, known: Collection[str] | None = None, needed: Collection[str] = ()) -> dict[str, "Entry"]:
        """Return its entries by key; None = any key will do.

        Raises
        ------
        ValueError
            If it is no table, a key is not ``known``, or one that is ``needed`` is missing.
        """
        if not isinstance(self.value, Mapping):
            raise self._must_be("a table")
        at = f"{self.path}." if self.path else ""
        for key in self.value:
            if known is not None and key not in known:
                raise ValueError(f"{self.source}: unknown key {key!r}{self._here(' in ')}; {nearest(key, known)}")
        for key in needed:
            if key not in self.value:
                raise ValueError(f"{self.source}: key {key!r} is missing{self._here(' in ')}")
        return {key: Entry(value, self.source, f"{at}{key}") for key, value in self.value.items()}

    def _here(self, before: str) -> str:
        return f"{before}{self.path}" if self.path else ""

    def entries(self, size: int | None = None) -> list["Entry"]:
        """Return the entries of a list, of ``size`` if that is given."""
        if not isinstance(self.value, list):
            raise self._must_be("a list" if size is None else f"a list of {size} values")
        if size is not None and len(self.value) != size:
            raise self.error(f"has {len(self.value)} values; it must have {size}")
        return [Entry(value, self.source, f"{self.path}[{k}]") for k, value in enumerate(self.value)]

    def number(self, *, infinite: bool = False) -> float:
        """Return it as a number, finite unless ``infinite`` is allowed."""
        if isinstance(self.value, bool) or not isinstance(self.value, Real):
            raise self._must_be("a number")
        number: Any = self.value
        finite = isinstance(number, int) or math.isfinite(number)
        if not finite and (math.isnan(number) or not infinite):
            raise self.error(f"is {number}; it must be finite")
        if finite and abs(number) > LARGEST:
            raise self.error(f"is beyond {LARGEST:g}, the largest number that is read")
        return number

    def whole(self) -> int:
        """Return it as a whole number."""
        number = self.number()
        if number != int(number):
            raise self.error(f"is {number:g}; it must be a whole number")
        return int(number)

    def text(self) -> str:
        """Return it as a text."""
        if not isinstance(self.value, str):
            raise self._must_be("a text")
        return self.value

    def flag(self) -> bool:
        """Return it as true or false."""
        if not isinstance(self.value, bool):
            raise self._must_be("true or false")
        return self.value

    def one_of(self, allowed: Collection[str]) -> str:
        """Return it as one of these words."""
        if self.text() not in allowed:
            raise self.error(f"is {self.value!r}; allowed: {', '.join(allowed)}")
        return self.text()

    def texts(self) -> tuple[str, ...]:
        """Return a list of texts."""
        return tuple(entry.text() for entry in self.entries())

    def point(self) -> tuple[float, float]:
        """Return a list of two numbers."""
        x, y = self.entries(2)
        return x.number(), y.number()

    def filled(self, options: Mapping[str, float]) -> "Entry":
        """Return it with the numbers of ``options`` where texts have braces."""
        if isinstance(self.value, str):
            with self.named():
                value: Any = fill_in(self.value, options)
        elif isinstance(self.value, Mapping):
            value = {key: entry.filled(options).value for key, entry in self.table().items()}
        elif isinstance(self.value, list):
            value = [entry.filled(options).value for entry in self.entries()]
        else:
            value = self.value
        return Entry(value, self.source, self.path)

    def _must_be(self, kind: str) -> ValueError:
        found = _KINDS.get(type(self.value), f"a {type(self.value).__name__}")
        shown = f" ({self.value!r})" if isinstance(self.value, str | bool | int | float) else ""
        return self.error(f"is {found}{shown}; it must be {kind}")


def nearest(name: str, known: Collection[str]) -> str:
    """Return the advice about an unknown name: the one that was probably meant, or all there are."""
    close = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"
