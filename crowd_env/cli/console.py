"""Options that several commands have, and checks of what they name."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.completion import complete_from
from crowd_env.core.arrays.headway import MANNERS
from crowd_env.core.arrays.outline import OUTLINES
from crowd_env.core.console import check_place
from crowd_env.core.files.store import claimed

# Sections of the help.
OF_PLACE, OF_PEOPLE, OF_PHYSICS, OF_RUNS, OF_OUTPUT = "Place", "People", "Physics", "Runs", "Output"

# Options that several commands have.
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object instead of a table.", rich_help_panel=OF_OUTPUT)
]
Workers = Annotated[
    int | None,
    typer.Option(
        help="Processes at most; default one a core. Results do not depend on it.", min=1, rich_help_panel=OF_RUNS
    ),
]
Runs = Annotated[
    int, typer.Option(help="Number of evacuations, each with other people in other places.", rich_help_panel=OF_RUNS)
]
MannerName = Annotated[
    str | None,
    typer.Option(
        "--manner",
        metavar="NAME",
        autocompletion=complete_from(MANNERS),
        help=f"How people walk before they touch: {', '.join(MANNERS)}; default the scenario's.",
        rich_help_panel=OF_PEOPLE,
    ),
]
OutlineOption = Annotated[
    str | None,
    typer.Option(
        "--outline",
        metavar="NAME",
        autocompletion=complete_from(OUTLINES),
        help=f"What shape bodies have: {', '.join(OUTLINES)} (hertz alone); default the scenario's.",
        rich_help_panel=OF_PEOPLE,
    ),
]
Seed = Annotated[int, typer.Option(help="Run k draws its people from seed + k.", min=0, rich_help_panel=OF_RUNS)]


def claim(context: typer.Context, option: str, path: Path, lock: Path) -> None:
    """Keep other commands from writing to ``path`` until this one ends, by the lock file ``lock``.

    Raises
    ------
    ValueError
        If another command writes there now.
    """
    if not context.with_resource(claimed(lock)):
        raise ValueError(f"{option} {path}: another command is writing there; let it end, or name another place")


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
