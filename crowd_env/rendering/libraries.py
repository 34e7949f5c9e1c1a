"""Where the drawing libraries are loaded: on first use, with a sentence that says what to install."""

import importlib
import os
from types import ModuleType


def load(name: str) -> ModuleType:
    """Return the module ``name``, imported now.

    Raises
    ------
    ModuleNotFoundError
        If it is not installed; the message says how to install it.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = (error.name or name).partition(".")[0]
        raise ModuleNotFoundError(
            f"drawing needs {package}, which is not installed; pip install 'crowd-env[render]'", name=error.name
        ) from error
