"""The command ``crowd-env film``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.films import FilmFps, FilmSpeed, FilmWidth, check_film_options, film_file, said_of
from crowd_env.cli.recorded import Sources, place_of, read_recorded
from crowd_env.core.console import friendly_errors, notes, progress_bar

_MOST = 4


def film(
    sources: Sources,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Film, .mp4 or .gif, or picture, .png; default film.mp4 there.")
    ] = None,
    width: FilmWidth = None,
    fps: FilmFps = None,
    speed: FilmSpeed = None,
) -> None:
    """Film recorded runs, side by side under one clock.

    Examples: crowd-env run room-v0 --out room

    crowd-env film room

    crowd-env film nearest fastest -o compared.gif
    """
    with friendly_errors():
        check_film_options(width, fps, speed, prefix="--")
        recorded = read_recorded(sources, _MOST, f"a film shows {_MOST} at most")
        path = film_file("--out", out or place_of(None, recorded, "film").with_suffix(""))
        from crowd_env.rendering import write_film

        titles = recorded.names if len(sources) > 1 else ()
        with progress_bar("film, frames") as progress:
            write_film(path, recorded.recordings, titles=titles, width=width, fps=fps, speed=speed, progress=progress)
        notes.print(said_of(path), markup=False, soft_wrap=True)
