"""Commands that make what the repository keeps of tasks: the tables of the benchmark, the rules and the probes."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.agents.evaluation.shipped import ship_rules
from crowd_env.agents.evaluation.tiers import FOLDER, judge_tiers
from crowd_env.agents.tasks import TASKS
from crowd_env.agents.tasks.probe import freeze as freeze_tasks
from crowd_env.agents.tasks.tiers import TIERS
from crowd_env.cli.options import new_app, plain
from crowd_env.core.console import friendly_errors, say

app = new_app()

_TIERS = f"Tiers: {', '.join(TIERS)}; default all."
_POLICIES = "Policy to try, may be repeated; default rules, the search and what ships."
_TASKS = "Tasks; default those with a shipped policy."


@app.command()
def tiers(
    tier: Annotated[list[str] | None, typer.Argument(help=_TIERS)] = None,
    policy: Annotated[list[str] | None, plain(_POLICIES)] = None,
    out: Annotated[Path, plain("Folder of the results, a file for each setting.")] = FOLDER,
) -> None:
    """Try policies in the settings of the benchmark, and keep every one that is finished.

    Then `python -m validation pages tiers` makes the table.

    Example: crowd-env tiers open --policy evolution --policy runs/NAME/best.safetensors
    """
    with friendly_errors("the same command goes on"):
        judge_tiers(tier or list(TIERS), policy, out)


@app.command()
def dilemma(out: Annotated[Path, typer.Argument(help="Folder for results.json and dilemma.png.")]) -> None:
    """Measure what crowds that push lose, what a deviator gains, and what learning makes of it: 45 CPU minutes.

    Example: crowd-env dilemma runs/dilemma
    """
    with friendly_errors("the same command goes on"):
        from crowd_env.agents.learned.dilemma import measure

        measure(out)
    say(f"results.json and dilemma.png: {out}/")


@app.command()
def rules(task: Annotated[list[str] | None, typer.Argument(help=_TASKS)] = None) -> None:
    """Compute what ships of the rules in tasks; some minutes a task.

    Example: crowd-env rules competitive-door
    """
    with friendly_errors("the same command goes on"):
        ship_rules(task)


@app.command()
def freeze() -> None:
    """Write digest and probe of every task, as it is now, into the file of the tasks."""
    with friendly_errors():
        say(f"probing {len(TASKS)} tasks ...")
        freeze_tasks()
