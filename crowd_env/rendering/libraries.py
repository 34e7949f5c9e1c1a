"""Where the drawing libraries are loaded: on first use, with a sentence that says what to install; and their types."""

import importlib
import os
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from crowd_env.core.libraries import needed_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from matplotlib.lines import Line2D as Line2D
    from matplotlib.patches import PathPatch as PathPatch
    from PIL.Image import Image as Image
    from PIL.ImageFont import FreeTypeFont as FreeTypeFont
else:  # an annotation loads no library
    Axes = Figure = FreeTypeFont = Image = Line2D = PathPatch = Any

# Suffix -> what draws such a picture.
_NEEDED = {".png": ("matplotlib", "PIL"), ".gif": ("PIL",), ".mp4": ("PIL", "imageio_ffmpeg")}


def drawing_library() -> AbstractContextManager[None]:
    """Return what wraps an import of a drawing library.

    Raises
    ------
    ModuleNotFoundError
        If the library is not installed; the message explains how to install it.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    return needed_for("drawing", "pygame-ce matplotlib pillow imageio-ffmpeg")


def require_libraries(suffix: str) -> None:
    """Load what draws pictures that end in ``suffix``.

    Raises
    ------
    ModuleNotFoundError
        If one of them is not installed; the message explains how to install them.
    """
    with drawing_library():
        for name in _NEEDED[suffix]:
            importlib.import_module(name)


def film_suffix() -> str:
    """Return what a film ends in if nothing is asked for: .mp4, which is smaller, or .gif where no encoder is installed."""
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ModuleNotFoundError, RuntimeError):  # not installed, or its program is missing
        return ".gif"
    return ".mp4"
