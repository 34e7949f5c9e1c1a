"""The command ``crowd-env replay``."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crowd_env.cli.recorded import Sources, place_of, read_recorded
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
    sources: Sources,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Page, .html; default replay.html there.")] = None,
) -> None:
    """Make one web page that replays a recorded run, or two side by side; it needs no network, only a browser.

    Examples: crowd-env run room-v0 --out room

    crowd-env replay room

    crowd-env replay nearest fastest -o compared.html
    """
    with friendly_errors():
        if out is not None:
            check_page("--out", out)
        recorded = read_recorded(sources, 2, "a page shows one, or two side by side")
        page = place_of(out, recorded, "replay.html")
        check_page("--out", page)
        notes.print(_write(page, recorded.recordings, recorded.names), markup=False, soft_wrap=True)


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


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 1):.0f} kB"
