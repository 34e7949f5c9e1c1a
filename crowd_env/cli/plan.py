"""The command ``crowd-env plan``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.console import check_picture, friendly_errors, notes
from crowd_env.cli.place import PLACES, Count, Exits, Unit, read_place


def plan(
    scenario: Annotated[list[str], typer.Argument(help=f"{PLACES}  Several make a sheet.")],
    out: Annotated[Path, typer.Option(help="Image to write, .png.")] = Path("plan.png"),
    exit: Exits = None,
    unit: Unit = None,
    n: Count = None,
    seed: Annotated[int, typer.Option(help="Where people stand.", min=0)] = 0,
) -> None:
    """Draw plans: walls, exits, regions and where people start, colored by the group they belong to."""
    with friendly_errors():
        check_picture("--out", out, (".png",), makes_folder=True)
        from crowd_env.rendering.sheet import draw_sheet

        places = [read_place(name, exits=exit, unit=unit, count=n) for name in scenario]
        draw_sheet(out, places, seed=seed)
        notes.print(f"plan: {out}", markup=False)
