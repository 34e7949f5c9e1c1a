"""The command ``crowd-env plan``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.cli.console import check_picture, friendly_errors, notes
from crowd_env.scenarios import make_scenario


def plan(
    scenario: Annotated[list[str], typer.Argument(help="Names of scenarios or scenario files; several make a sheet.")],
    out: Annotated[Path, typer.Option(help="Image to write, .png.")] = Path("plan.png"),
    seed: Annotated[int, typer.Option(help="Where people stand.", min=0)] = 0,
) -> None:
    """Draw plans: walls, exits, regions and where people start, colored by the group they belong to."""
    with friendly_errors():
        check_picture("--out", out, (".png",), makes_folder=True)
        from crowd_env.rendering.sheet import draw_sheet

        draw_sheet(out, [make_scenario(name) for name in scenario], seed=seed)
        notes.print(f"plan: {out}", markup=False)
