"""Tables of commands, and what commands check before they work."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from crowd_env.core.console import check_place, literal_console

_WIDTH = 100  # letters of a table that no terminal shows


def wide_console() -> Console:
    """Return the standard output, at most 100 columns wide so that tables look the same in a file and on a screen."""
    console = literal_console()
    console.width = min(_WIDTH, console.width) if console.is_terminal else _WIDTH
    return console


def show_table(
    title: str, columns: Mapping[str, Mapping[str, str]], *, caption: str = "", sections: Sequence[int] = ()
) -> None:
    """Print a table: a row for each label of the first column, a column for each of ``columns``.

    Parameters
    ----------
    columns : heading -> label -> cell; the heading "" of a single column is not shown.
    sections : numbers of rows that a line follows.
    """
    console = wide_console()
    alone = list(columns) == [""]
    look: dict[str, Any] = {"box": SIMPLE_HEAD, "pad_edge": False, "title_justify": "left", "caption_justify": "left"}
    table = Table(title=title or None, caption=caption or None, show_header=not alone, **look)
    table.add_column("", no_wrap=True)
    for heading in columns:
        table.add_column(heading, justify="left" if alone else "right")
    for row, label in enumerate(next(iter(columns.values()))):
        table.add_row(label, *(cells[label] for cells in columns.values()), end_section=row in sections)
    console.print(table)


def check_picture(option: str, path: Path, suffixes: Sequence[str], *, makes_folder: bool = False) -> None:
    """Raise, before the work instead of after it, if the picture ``path`` cannot be drawn or written.

    Raises
    ------
    ValueError
        If its suffix is another, it is a folder, or its folder is missing (unless that is made) or cannot be written.
    ModuleNotFoundError
        If a drawing library is not installed; the message explains how to install it.
    """
    from crowd_env.core.files.atomic import check_suffix
    from crowd_env.rendering.libraries import require_libraries

    check_suffix(path, suffixes)
    check_place(option, path, makes_folder=makes_folder)
    require_libraries(path.suffix.lower())
