"""Judge policies by the protocol of a task, a file for each: ``crowd-env submit --task NAME --policy POLICY ...``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.agents.evaluation.entries import RULE, Entry, make_entries
from crowd_env.agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.evaluation.robustness import Found, Trial, few_runs, judge_trial, make_trials
from crowd_env.agents.evaluation.same_draws import compare
from crowd_env.agents.evaluation.submission import (
    OWN_DRAWS,
    REFERENCES,
    own_runs,
    own_seed,
    references_known,
    write_submissions,
)
from crowd_env.agents.networks import network_digest
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
_CHECKED = 10  # draws of the rule that are held against those that lie there
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
        place, known = chosen.place(), runs == chosen.runs and not set(policy) & set(REFERENCES)
        known = known and references_known(out / f"{chosen.name}.json", chosen, few)
        beside = (RULE,) if known else REFERENCES
        named = list(dict.fromkeys((*beside, *policy)))
        entries = make_entries(named, place, chosen)
        trials = make_trials(chosen, list(dict.fromkeys(policy if known else (RULE, *policy)))) if few else []

        def judged(who: list[Entry], draws: int, name: str) -> list[Evaluation]:
            kept = None if folder is None else EvaluationFolder(folder / name, settings_of(place, draws, 0, chosen))
            return compare(who, place, [chosen.scheme], runs=draws, folder=kept)

        results = judged(entries[:1], min(_CHECKED, runs), "checked") if known else []
        results += judged(entries[1:] if known else entries, runs, "all")
        found: Found = [(one, judge_trial(chosen, one, compare, runs=few, out=folder)) for one in trials]
        sources: dict[str, Path | None] = {}
        own: dict[str, list[Evaluation]] = {}
        for given, entry, result in zip(named, entries, results, strict=True):
            if given in policy:
                sources[entry.name] = entry.source
                trial = Trial(OWN_DRAWS, place, chosen.scheme, list(dict.fromkeys((entries[0], entry))), [])
                digest = None if entry.source is None else network_digest(entry.source)
                seed = own_seed(entry.name, digest, result.constants) - HELD_OUT_SEED
                kept_in = None if folder is None else folder / f"own-{entry.name.replace('/', '-')}"
                how: dict[str, Any] = {
                    "runs": min(runs, own_runs(chosen)),
                    "seed": seed,
                    "out": kept_in,
                }
                own[entry.name] = judge_trial(chosen, trial, compare, **how)
        for path in write_submissions(out, chosen, sources, results, own, found):
            typer.echo(str(path))
