"""Options that several commands have, tables, and what commands check before they work."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from crowd_env.core.console import check_place

# Sections of the help.
OF_PLACE, OF_PEOPLE, OF_PHYSICS, OF_RUNS, OF_OUTPUT = "Place", "People", "Physics", "Runs", "Output"
of_place, of_people, of_physics, of_runs, of_output = (
    partial(typer.Option, rich_help_panel=section) for section in (OF_PLACE, OF_PEOPLE, OF_PHYSICS, OF_RUNS, OF_OUTPUT)
)

_WIDTH = 100  # letters of a table that no terminal shows


def complete_from(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return what proposes names to a shell: those of ``names`` that begin as the user has begun."""
    known = tuple(names)
    return lambda incomplete: [name for name in known if name.startswith(incomplete)]


# Options that several commands have.
AsJson = Annotated[bool, of_output("--json", help="Print one JSON object instead of a table.")]
Workers = Annotated[
    int | None, of_runs(help="Processes at most; default one a core. Results do not depend on it.", min=1)
]
Runs = Annotated[int, of_runs(help="Number of evacuations, each with other people in other places.")]
Seed = Annotated[int, of_runs(help="Run k draws its people from seed + k.", min=0)]


def show_table(
    title: str,
    columns: Mapping[str, Mapping[str, str]],
    *,
    caption: str = "",
    sections: Sequence[int] = (),
) -> None:
    """Print a table: a row for each label of the first column, a column for each of ``columns``.

    Parameters
    ----------
    columns : heading -> label -> cell; the heading "" of a single column is not shown.
    sections : numbers of rows that a line follows.
    """
    console = Console(highlight=False)
    console.width = min(_WIDTH, console.width) if console.is_terminal else _WIDTH
    alone = list(columns) == [""]
    table = Table(
        title=title or None,
        caption=caption or None,
        show_header=not alone,
        box=SIMPLE_HEAD,
        pad_edge=False,
        title_justify="left",
        caption_justify="left",
    )
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
