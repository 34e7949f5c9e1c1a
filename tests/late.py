"""What takes seconds to load, loaded at its first use: who only collects the tests waits for none of it."""

import importlib
import importlib.util
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest


def late(module: str, *names: str) -> Any:
    """Return what stands for a module, or for one or several of its names.

    Without the library, the tests of the file that asks are skipped, as with ``pytest.importorskip``.
    """
    library = module.partition(".")[0]
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed", allow_module_level=True)
    if not names:
        return Late(lambda: importlib.import_module(module))
    found = [Late(lambda name=name: getattr(importlib.import_module(module), name)) for name in names]
    return found[0] if len(found) == 1 else found


class Late:
    """Something that is loaded when it is first called, derived from, asked for its instances, read or patched."""

    __slots__ = ("_thing",)
    _mock_name = "late"  # what a mock has: pytest then does not look for fixtures within

    def __init__(self, load: Callable[[], Any]):
        object.__setattr__(self, "_thing", cache(load))

    @property
    def __dict__(self) -> Any:
        return vars(self._thing())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # so does pytest ask whether this is a test
            raise AttributeError(name)
        return getattr(self._thing(), name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._thing(), name, value)

    def __delattr__(self, name: str) -> None:
        delattr(self._thing(), name)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._thing()(*arguments, **options)

    def __instancecheck__(self, instance: Any) -> bool:
        return isinstance(instance, self._thing())

    def __mro_entries__(self, bases: tuple[Any, ...]) -> tuple[Any, ...]:
        return (self._thing(),)
