"""Ship what a training run has learned: ``crowd-env ship runs/NAME --as TASK/POLICY``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.agents.shipping import ship
from crowd_env.cli.options import new_app
from crowd_env.core.console import friendly_errors, say

app = new_app()


@app.command()
def main(
    run: Annotated[Path, typer.Argument(help="Folder of a run of train.py.", metavar="RUN")],
    name: Annotated[
        str, typer.Option("--as", metavar="TASK/POLICY", help="What it is shipped as; generalist: for all places.")
    ],
    replace: Annotated[bool, typer.Option("--replace", help="Replace the shipped policy of that name.")] = False,
) -> None:
    """Ship the network of a training run, with a card that says how it was trained.

    Example: crowd-env ship runs/competitive-door-hertz-seed0 --as competitive-door/ppo --replace
    """
    with friendly_errors():
        path = ship(run, name, replace=replace)
        say(f"{path} and {path.with_suffix('.json').name}")
