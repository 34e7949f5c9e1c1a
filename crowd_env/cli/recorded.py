"""Commands that look at recorded runs, files or folders of ``crowd-env run --out``: film, replay and forces."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from crowd_env.cli.console import check_picture
from crowd_env.cli.options import new_app, of_output, plain
from crowd_env.core.checks import POSITIVE, counted, number
from crowd_env.core.console import check_place, friendly_errors, progress_bar, say
from crowd_env.core.files.atomic import check_suffix, legible
from crowd_env.recording import Recording, load
from crowd_env.recording.formats import FORMATS, RECORDINGS, recordings_in

app = new_app()

_SOURCE = "Folder of crowd-env run --out, or recording (.sqlite, .h5)"
Sources = Annotated[list[Path], typer.Argument(metavar="DIR...", help=f"{_SOURCE}; several compare.")]
Source = Annotated[Path, typer.Argument(metavar="DIR", help=f"{_SOURCE}.")]

FilmWidth = Annotated[
    int | None,
    of_output("Width of the film in px; default 480 for each evacuation, 960 of a building.", min=160, max=3840),
]
_FILM = "Film, .mp4 or .gif, or picture, .png; default film.mp4 there."
_AT = "Moment in s; default the end if the exits block, else the hardest push."
_AROUND = "How far around the exit, in m; inf for all; default 3.5 in big places."
_FPS = "Frames of the film a second; default 20, of long GIFs down to 10."
FilmFps = Annotated[float | None, of_output(_FPS, max=100)]
_SPEED = "Seconds that a second of the film shows; default 1, or as many as make a film of 30 s."
FilmSpeed = Annotated[float | None, of_output(_SPEED)]


class Recorded(NamedTuple):
    """Files of recordings, what they are called, and where pictures of them go if nothing is asked for."""

    files: list[Path]
    names: list[str]
    folder: Path
    stem: str

    def load(self) -> list[Recording]:
        """Return the recordings; ValueError if a file is missing or no recording."""
        return [load(file) for file in self.files]

    def place(self, out: Path | None, name: str) -> Path:
        """Return where to write: ``out``, or ``name`` in the folder of the runs, or beside the recording by its name."""
        return out or self.folder / (f"{Path(self.stem).name}{Path(name).suffix}" if self.stem else name)


def find_recorded(sources: Sequence[Path], most: int, what: str) -> Recorded:
    """Return the files of some sources, the first one of each folder.

    Raises
    ------
    ValueError
        If there are more than ``most``, one is not there, or a folder holds none.
    """
    if len(sources) > most:
        raise ValueError(f"{len(sources)} recordings were given; {what}")
    files = []
    for source in sources:
        if not source.exists() and source.suffix.lower() not in FORMATS:
            raise ValueError(f"{source}: there is no such folder or file; name what crowd-env run --out has written")
        found = recordings_in(source) if source.is_dir() else [source]
        if not found:
            raise ValueError(f"{source} holds no recording in {RECORDINGS}/; crowd-env run --out records the first run")
        files.append(found[0])
    names = [source.stem or source.name for source in sources]
    if len(set(names)) < len(names):
        names = [str(source) for source in sources]
    alone = len(sources) == 1 and sources[0].is_dir()
    folder = sources[0] if alone else sources[0].parent
    return Recorded(files, list(map(legible, names)), folder, "" if alone else " and ".join(names))


def film_file(option: str, path: Path, name: str = "film") -> Path:
    """Return the file of a film: MP4 if ``path`` has no suffix, called ``name`` if it is a folder.

    Raises
    ------
    ValueError
        If its suffix is another than those of films, or it cannot be written.
    ModuleNotFoundError
        If a drawing library is not installed; the message explains how to install it.
    """
    from crowd_env.rendering.film import FORMATS as FILMS
    from crowd_env.rendering.libraries import film_suffix

    if not path.suffix:
        path = path / name if path.is_dir() else path
        path = path.with_name(path.name + film_suffix())
        if path.suffix == ".gif":
            say(f"note: MP4 needs imageio-ffmpeg, which is not installed: {path}")
    check_picture(option, path, FILMS)
    return path


def size_of(path: Path) -> str:
    """Return where a file is, and how large."""
    count = path.stat().st_size
    return f"{path}, {f'{count / 1e6:.1f} MB' if count >= 1e6 else f'{count / 1e3:.0f} kB'}"


@app.command()
def film(
    sources: Sources,
    out: Annotated[Path | None, plain(_FILM, names=("--out", "-o"))] = None,
    width: FilmWidth = None,
    fps: FilmFps = None,
    speed: FilmSpeed = None,
) -> None:
    """Film recorded runs, side by side under one clock.

    Examples: crowd-env run room-v0 --out room

    crowd-env film room

    crowd-env film nearest fastest -o compared.gif --width 960 --fps 10 --speed 2
    """
    with friendly_errors():
        recorded = find_recorded(sources, 4, "a film shows 4 at most")
        path = film_file("--out", out or recorded.place(None, "film").with_suffix(""))
        from crowd_env.rendering import write_film

        recordings, titles = recorded.load(), recorded.names if len(sources) > 1 else ()
        with progress_bar("film, frames") as progress:
            write_film(path, recordings, titles=titles, width=width, fps=fps, speed=speed, progress=progress)
        say(f"film: {size_of(path)}")


@app.command()
def replay(
    sources: Sources,
    out: Annotated[Path | None, plain("Page, .html; default replay.html there.", names=("--out", "-o"))] = None,
) -> None:
    """Make one web page that replays a recorded run, or two side by side; it needs no network, only a browser.

    Examples: crowd-env run room-v0 --out room

    crowd-env replay room

    crowd-env replay nearest fastest -o compared.html
    """
    with friendly_errors():
        recorded = find_recorded(sources, 2, "a page shows one, or two side by side")
        page = recorded.place(out, "replay.html")
        check_suffix(page, (".html",))
        check_place("--out", page)
        from crowd_env.rendering.replay import write_page

        written = write_page(page, recorded.load(), names=recorded.names)
        for name, frames, left_out in zip(recorded.names, written.frames, written.left_out, strict=True):
            if left_out:
                text = f"note: {name}: {frames} of {frames + left_out} frames are shown, so that the page stays small"
                say(text, "yellow")
        shown = counted(sum(written.frames), "frame", "frames")
        say(f"page: {size_of(page)}, {shown}")


@app.command()
def forces(
    source: Source,
    out: Annotated[Path | None, plain("Picture, .png; default forces.png there.", names=("--out", "-o"))] = None,
    at: Annotated[float | None, plain(_AT)] = None,
    around: Annotated[float | None, plain(_AROUND)] = None,
) -> None:
    """Draw who presses on whom in a recorded run, by lines as wide as the force.

    Examples: crowd-env run room-v0 --out room

    crowd-env forces room --at 3
    """
    with friendly_errors():
        if at is not None:
            number("--at", at, POSITIVE, "s")
        if around is not None and not around >= 0.5:
            raise ValueError(f"--around is {around:g}; it must be >= 0.5 m")
        recorded = find_recorded([source], 1, "the forces are those of one")
        path = recorded.place(out, "forces.png")
        check_picture("--out", path, (".png",))
        from crowd_env.rendering import force_network, forces_of, save_figure

        (recording,) = recorded.load()
        found = forces_of(recording, at)
        facts = recording.facts
        title = f"{facts.get('scenario', '')} {facts.get('scheme', '')}"
        save_figure(force_network(found, around=around, title=title), path)
        mean = recording.frame_interval
        say(f"forces: {path}, mean of {mean:g} s until {found.time:.1f} s")
