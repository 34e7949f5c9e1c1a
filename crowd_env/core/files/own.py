"""Objects of the user's own that a command line names by file and name: ``my_law.py:MyLaw``."""

import importlib
import sys
from pathlib import Path
from typing import Any


def names_own(text: str) -> bool:
    """Return whether a text names an object of the user's own rather than one of the package."""
    return ".py:" in text or text.endswith(".py")


def own_or_name(option: str, text: str) -> Any:
    """Return the object of the user's own that a text names, or the text, if it is a name of the package."""
    return load_own(option, text) if names_own(text) else text


def load_own(option: str, text: str) -> Any:
    """Return the object that a text such as ``my_law.py:MyLaw`` names; of a class, the one that it makes without arguments.

    Parameters
    ----------
    option : of the command line, for messages.

    Raises
    ------
    ValueError
        If the text names a file alone, there is no such file, it cannot be imported, nothing in it has the name, or a class
        needs arguments.
    """
    file, _, name = text.rpartition(":")
    if name.endswith(".py"):
        raise ValueError(f"{option} {text}: say what in the file is meant: {text}:NAME")
    path = Path(file).resolve()
    if not path.is_file():
        raise ValueError(f"{option} {text}: there is no file {file}")
    sys.path.insert(0, str(path.parent))  # also of the processes that compute runs
    try:
        module = importlib.import_module(path.stem)
    except Exception as error:  # whatever the user's file does at its top
        raise ValueError(f"{option} {text}: {file} cannot be imported: {type(error).__name__}: {error}") from error
    if Path(module.__file__ or "").resolve() != path:
        raise ValueError(f"{option} {text}: another module is called {path.stem}; rename the file")
    if not hasattr(module, name):
        raise ValueError(f"{option} {text}: {file} has no {name}")
    found = getattr(module, name)
    if not isinstance(found, type):
        return found
    try:
        return found()
    except TypeError as error:
        raise ValueError(f"{option} {text}: {name} cannot be made without arguments: {error}") from error
