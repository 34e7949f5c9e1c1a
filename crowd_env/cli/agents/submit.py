"""Judge policies by the protocol of a task, a file for each: ``crowd-env submit --task NAME --policy POLICY ...``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.agents.evaluation.robustness import few_runs
from crowd_env.agents.evaluation.submission import submit
from crowd_env.agents.rules import RandomWalk
from crowd_env.agents.tasks import make_task
from crowd_env.agents.trained import SAMPLED
from crowd_env.agents.training_config import RUNS
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.agents.options import OneTask
from crowd_env.cli.options import new_app, plain
from crowd_env.core.checks import Range, whole
from crowd_env.core.console import check_folder, friendly_errors

_POLICY = "As for agents.evaluate: names, shipped policies (TASK/NAME), or networks (.safetensors)."
_FOLDER = "Keeps what has been evaluated, so that an interrupted submission goes on."
_RUNS = "Other draws are no submission, but a trial of one."
_FEW = "Draws of each variation of the task; 0: none."

app = new_app()


@app.command(cls=ListsOfNames)
def main(
    task: OneTask,
    policy: Annotated[list[str], plain(_POLICY, names=("--policy", "--policies"), metavar="POLICY ...")],
    out: Annotated[Path, plain("Folder for TASK/POLICY.json.")] = Path("submissions"),
    folder: Annotated[Path | None, plain(_FOLDER)] = None,
    runs: Annotated[int | None, plain(_RUNS, "those of the task")] = None,
    robustness_runs: Annotated[int | None, plain(_FEW, "a fifth of those of the task")] = None,
) -> None:
    """Judge policies on the held-out draws of a task and on its variations; write one submission for each.

    A submission holds the network, a line for each run, and the digests of task and network.  The rule at full and at its best
    speed on the same draws lie beside all policies of a task in TASK.json.  Each policy is also judged, beside the rule, on
    draws that follow from its network or, of a rule, from its name and constants.  Where TASK.json lies in --out, the rule is
    run on its first draws alone, to see that the code is still that one.

    Examples
    --------
    crowd-env submit --task competitive-door --policy follow --runs 20 --robustness-runs 0 --out trial

    crowd-env submit --task competitive-door --policy follow runs/NAME/best.safetensors --folder runs/submission
    """
    with friendly_errors("" if folder is None else "the same command goes on"):
        chosen = make_task(task)
        runs = whole("--runs", chosen.runs if runs is None else runs, RUNS)
        few = min(few_runs(chosen), runs) if robustness_runs is None else robustness_runs
        few = whole("--robustness-runs", few, Range(0, runs).because("the first of the draws of the task"))
        check_folder("--out", out)
        drawn = [name for name in policy if name.endswith(SAMPLED)]
        if drawn:
            raise ValueError(f"--policy {drawn[0]}: a submission is of the most likely actions; leave out {SAMPLED}")
        if RandomWalk.name in policy:
            raise ValueError(
                "--policy random: what a run draws depends on the runs beside it; submit what draws nothing"
            )
        for path in submit(chosen, policy, runs=runs, few=few, out=out, folder=folder):
            typer.echo(str(path))
