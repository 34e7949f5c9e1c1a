"""A library that is not installed: one sentence says what it is for, and how to install it."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def needed_for(what: str, install: str = "") -> Iterator[None]:
    """Wrap the import of a library that ``what`` needs; ``install`` is what pip is given, by default its name.

    Raises
    ------
    ModuleNotFoundError
        If the library is not installed; the message explains how to install it.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        told = f"{what} needs {error.name}, which is not installed: pip install {install or error.name}"
        raise ModuleNotFoundError(told, name=error.name) from error
