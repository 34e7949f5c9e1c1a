"""Options that several commands have, tables, and what commands check before they work."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from crowd_env.core.console import check_place

# Sections of the help.
OF_PLACE, OF_PEOPLE, OF_PHYSICS, OF_RUNS, OF_OUTPUT = "Place", "People", "Physics", "Runs", "Output"
_WIDTH = 100  # letters of a table that no terminal shows


def complete_from(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return what proposes names to a shell: those of ``names`` that begin as the user has begun."""
    known = tuple(names)
    return lambda incomplete: [name for name in known if name.startswith(incomplete)]


def section(panel: str | None = None) -> Callable[..., Any]:
    """Return what makes an option of a section of the help, from its text and what that says is the default.

    ``names`` are others than that of the argument, ``among`` the names that a shell completes; the rest is that of
    `typer.Option`.
    """

    def option(
        help: str, default: str | None = None, *, names: Iterable[str] = (), among: Iterable[str] = (), **more: Any
    ) -> Any:
        more |= {"show_default": default} if default else {}
        if among:
            more = {"metavar": "NAME", "autocompletion": complete_from(among), **more}
        return typer.Option(*names, help=help, rich_help_panel=panel, **more)

    return option


of_place, of_people, of_physics = map(section, (OF_PLACE, OF_PEOPLE, OF_PHYSICS))
of_runs, of_output, plain = map(section, (OF_RUNS, OF_OUTPUT, None))

# Options that several commands have.
AsJson = Annotated[bool, of_output("Print one JSON object instead of a table.", names=("--json",))]
Workers = Annotated[int | None, of_runs("Processes at most; default one a core. Results do not depend on it.", min=1)]
Runs = Annotated[int, of_runs("Number of evacuations, each with other people in other places.")]
Seed = Annotated[int, of_runs("Run k draws its people from seed + k.", min=0)]


def wide_console() -> Console:
    """Return the standard output, at most 100 columns wide so that tables look the same in a file and on a screen."""
    console = Console(highlight=False)
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
        If a drawing library is not installed; the message says how to install it.
    """
    from crowd_env.core.files.atomic import check_suffix
    from crowd_env.rendering.libraries import require_libraries

    check_suffix(path, suffixes)
    check_place(option, path, makes_folder=makes_folder)
    require_libraries(path.suffix.lower())
