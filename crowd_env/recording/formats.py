"""The formats of recordings, by the suffix of the file: writer, reader, and required library."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from crowd_env.core.checks import path as path_of
from crowd_env.core.files.atomic import check_suffix
from crowd_env.core.libraries import needed_for
from crowd_env.recording.content import Frames
from crowd_env.recording.foreign import read_text_trajectory
from crowd_env.recording.hdf5 import Hdf5Writer, read_hdf5
from crowd_env.recording.sqlite import SqliteWriter, read_sqlite
from crowd_env.recording.writer import Writer


class Format(NamedTuple):
    """A format to read recordings from, and perhaps to write."""

    read: Callable[[Path], dict[str, Any]]  # the fields of the recording
    write: Callable[[Path, Frames], Writer] | None
    library: str  # that has to be installed


FORMATS: dict[str, Format] = {
    ".sqlite": Format(read_sqlite, SqliteWriter, "sqlite3"),
    ".h5": Format(read_hdf5, Hdf5Writer, "h5py"),
    ".txt": Format(read_text_trajectory, None, "numpy"),
}


RECORDINGS = "recordings"  # the folder of a folder of runs in which their recordings lie


def recordings_in(folder: Path) -> list[Path]:
    """Return the finished recordings in a folder of runs, in the order of their names."""
    found = (folder / RECORDINGS).glob("*")
    return sorted(path for path in found if path.suffix in FORMATS and not path.stem.endswith(".part"))


def check_writable(what: str, path: str | Path) -> Path:
    """Return the path of a recording that is about to be written; ``what`` names it in errors.

    Raises
    ------
    ValueError
        If its suffix is that of no format that is written, or it is a folder.
    ModuleNotFoundError
        If the library that writes the format is not installed.
    """
    written = [suffix for suffix, one in FORMATS.items() if one.write is not None]
    path = check_suffix(path_of(what, path), written)
    if path.is_dir():
        raise ValueError(f"{what} is {path}, which is a folder; it must be a file")
    require_library(path, "writing")
    return path


def open_writer(path: Path, first: Frames) -> Writer:
    """Return the writer of a path that `check_writable` has let pass, for a recording that begins with ``first``."""
    write = FORMATS[path.suffix.lower()].write
    assert write is not None
    path.parent.mkdir(parents=True, exist_ok=True)
    return write(path, first)


def require_library(path: Path, doing: str) -> None:
    """Raise ModuleNotFoundError unless the library of a format is installed; the message explains how to install it."""
    with needed_for(f"{doing} {path.name}"):
        importlib.import_module(FORMATS[path.suffix.lower()].library)
