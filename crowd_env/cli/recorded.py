"""Recordings that commands are given: files, or folders that ``crowd-env run --out`` has written."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from crowd_env.recording import Recording, load
from crowd_env.recording.formats import RECORDINGS, recordings_in

Sources = Annotated[
    list[Path],
    typer.Argument(
        metavar="DIR...", help="Folder of crowd-env run --out, or recording (.sqlite, .h5); several compare."
    ),
]
Source = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of crowd-env run --out, or recording (.sqlite, .h5).")
]


class Recorded(NamedTuple):
    """Recordings, what they are called, and where pictures of them go if nothing is asked for."""

    recordings: list[Recording]
    names: list[str]
    folder: Path
    stem: str


def read_recorded(sources: Sequence[Path], most: int, what: str) -> Recorded:
    """Return the recordings of some sources, the first one of each folder.

    Raises
    ------
    ValueError
        If there are more than ``most``, one is missing or no recording, or a folder holds none.
    """
    if len(sources) > most:
        raise ValueError(f"{len(sources)} recordings were given; {what}")
    files = [_file_of(source) for source in sources]
    names = [source.stem or source.name for source in sources]
    if len(set(names)) < len(names):
        names = [str(source) for source in sources]
    alone = len(sources) == 1 and sources[0].is_dir()
    folder = sources[0] if alone else sources[0].parent
    return Recorded([load(file) for file in files], names, folder, "" if alone else " and ".join(names))


def _file_of(source: Path) -> Path:
    if not source.is_dir():
        return source
    found = recordings_in(source)
    if not found:
        raise ValueError(f"{source} holds no recording in {RECORDINGS}/; crowd-env run --out records the first run")
    return found[0]


def place_of(out: Path | None, recorded: Recorded, name: str) -> Path:
    """Return where to write: ``out``, or ``name`` in the folder of the runs, or beside the recording by its name."""
    if out is not None:
        return out
    return recorded.folder / (f"{Path(recorded.stem).name}{Path(name).suffix}" if recorded.stem else name)
