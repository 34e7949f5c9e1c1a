"""Where the drawing libraries are loaded: on first use, with a sentence that says what to install."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def drawing_library() -> Iterator[None]:
    """Wrap an import of a drawing library.

    Raises
    ------
    ModuleNotFoundError
        If the library is not installed; the message says how to install it.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        yield
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"drawing needs {error.name}, which is not installed: pip install 'crowd-env[render]'", name=error.name
        ) from error
