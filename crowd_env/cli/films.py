"""The options of films, and where a film goes whose format is not said."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.console import OF_OUTPUT, check_picture
from crowd_env.core.checks import POSITIVE, Range, number, whole
from crowd_env.core.console import notes

_WIDTHS = Range(160, 3840)  # px
_RATES = Range(0.0, 100.0, above=True)  # 1/s; a GIF counts in hundredths of a second

FilmWidth = Annotated[
    int | None,
    typer.Option(help="Width of the film in px; default 480 an evacuation.", rich_help_panel=OF_OUTPUT),
]
FilmFps = Annotated[
    float | None,
    typer.Option(help="Frames of the film a second; default 20, of long GIFs down to 10.", rich_help_panel=OF_OUTPUT),
]
FilmSpeed = Annotated[
    float | None,
    typer.Option(
        help="Seconds that a second of the film shows; default 1, or as many as make a film of 30 s.",
        rich_help_panel=OF_OUTPUT,
    ),
]


def check_film_options(width: int | None, fps: float | None, speed: float | None, prefix: str = "--film-") -> None:
    """Raise ValueError if an option of a film is out of range; None = not given."""
    if width is not None:
        whole(f"{prefix}width", width, _WIDTHS)
    if fps is not None:
        number(f"{prefix}fps", fps, _RATES, "1/s")
    if speed is not None:
        number(f"{prefix}speed", speed, POSITIVE)


def film_file(option: str, path: Path, name: str = "film") -> Path:
    """Return the file of a film: MP4 if ``path`` has no suffix, called ``name`` if it is a folder.

    Raises
    ------
    ValueError
        If its suffix is another than those of films, or it cannot be written.
    ModuleNotFoundError
        If a drawing library is not installed; the message says how to install it.
    """
    from crowd_env.rendering.film import FORMATS
    from crowd_env.rendering.libraries import film_suffix

    if not path.suffix:
        path = path / name if path.is_dir() else path
        path = path.with_name(path.name + film_suffix())
        if path.suffix == ".gif":
            notes.print(f"note: MP4 needs imageio-ffmpeg, which is not installed: {path}", markup=False, soft_wrap=True)
    check_picture(option, path, tuple(FORMATS))
    return path


def said_of(path: Path) -> str:
    """Return the line that says where a film is, and how large."""
    return f"film: {path}, {path.stat().st_size / 1e3:.0f} kB"
