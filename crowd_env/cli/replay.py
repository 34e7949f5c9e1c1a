"""The command ``crowd-env replay``."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crowd_env.core.checks import counted
from crowd_env.core.console import check_place, friendly_errors, notes
from crowd_env.core.files.atomic import check_suffix

if TYPE_CHECKING:
    from crowd_env.recording import Recording


def check_page(option: str, path: Path) -> None:
    """Raise ValueError, before the work instead of after it, if the page ``path`` cannot be written."""
    check_suffix(path, (".html",))
    check_place(option, path)


def replay(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Recording of a run (.sqlite, .h5, .parquet), or of JuPedSim; two are shown side by side."),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Page to write, .html; default beside the recording.")
    ] = None,
) -> None:
    """Make one web page that replays a recording, or two side by side; it needs no network, only a browser.

    Examples: crowd-env run room-v0 --runs 1 --record room.sqlite

    crowd-env replay room.sqlite

    crowd-env replay nearest.sqlite fastest.sqlite -o compared.html
    """
    with friendly_errors():
        if len(recordings) > 2:
            raise ValueError(f"{len(recordings)} recordings were given; a page shows one, or two side by side")
        page = out or _beside(recordings)
        check_page("--out", page)
        from crowd_env.recording import load

        said = _write(page, [load(path) for path in recordings], _names(recordings))
        notes.print(said, markup=False, soft_wrap=True)


def _write(path: Path, recordings: Sequence["Recording"], names: Sequence[str]) -> str:
    """Write a page, note what it leaves out, and return a line that says where it is."""
    from crowd_env.rendering.replay import write_page

    written = write_page(path, recordings, names=names)
    for name, frames, left_out in zip(names, written.frames, written.left_out, strict=True):
        if left_out:
            text = f"note: {name}: {frames} of {frames + left_out} frames are shown, so that the page stays small"
            notes.print(text, style="yellow", markup=False, soft_wrap=True)
    shown = counted(sum(written.frames), "frame", "frames")
    return f"page: {written.path} ({_size(written.size)}, {shown})"


def _beside(recordings: list[Path]) -> Path:
    name = " and ".join(path.stem for path in recordings)
    return recordings[0].with_name(f"{name}.html")


def _names(recordings: list[Path]) -> list[str]:
    """Return the names of the files, with their folders where two are called alike."""
    names = [path.stem for path in recordings]
    return names if len(set(names)) == len(names) else [str(path) for path in recordings]


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 1):.0f} kB"
