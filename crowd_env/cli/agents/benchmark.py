"""Train algorithms with several seeds on a task and judge them: ``crowd-env benchmark``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.agents.benchmark import ALGORITHMS, Job, Plan, do, fixed_policy, read_result, summarize, table
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.plain import Plain
from crowd_env.agents.tasks import PRESETS, make_preset, make_task
from crowd_env.agents.training_config import RUNS, check_budget, check_libraries
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.options import new_app, plain
from crowd_env.core.checks import Range, known, whole
from crowd_env.core.console import friendly_errors, say
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import write_json

_BASELINES = (RULE, "density-cap", "follow", "zipper")
_FOLDER = Path("benchmarks/results/learning")
_ABOUT = "; ".join(f"{name}: {one.about}" for name, one in ALGORITHMS.items())
_BESIDE = "Policies to judge beside them."

app = new_app()


@app.command(cls=ListsOfNames)
def main(
    task: Annotated[str, plain(f"What is learned: {', '.join(PRESETS)}.", metavar="NAME")] = "competitive-door",
    algorithms: Annotated[list[str] | None, plain(_ABOUT, metavar="NAME ...")] = None,
    baselines: Annotated[list[str] | None, plain(_BESIDE, " ".join(_BASELINES), metavar="POLICY ...")] = None,
    seeds: Annotated[int, plain("Trainings of each algorithm, with the seeds 0, 1, ...")] = 10,
    minutes: Annotated[float, plain("Processor time of each training, evaluations apart.")] = 2.0,
    runs: Annotated[int, plain("Held-out draws of the final evaluation, in the task as it stands.")] = 40,
    out: Annotated[Path | None, plain("Folder of the results.", f"{_FOLDER}/TASK")] = None,
    report_only: Annotated[bool, plain("Train nothing: report what there is.", names=("--report-only",))] = False,
) -> None:
    """Train algorithms on a task with several seeds each, and compare them by interquartile means and intervals.

    An interrupted command goes on, and more seeds or algorithms can be added later.

    Examples: crowd-env benchmark --task competitive-door --algorithms ppo evolution --seeds 10

    crowd-env benchmark --task narrow-door --algorithms ppo --baselines rule follow --seeds 3
    """
    folder = _FOLDER / task if out is None else out
    with friendly_errors("the same command goes on"):
        make_preset(task)
        chosen = [known("algorithm", name, ALGORITHMS) for name in algorithms or ALGORITHMS]
        beside = list(_BASELINES if baselines is None else baselines)
        for name in beside:
            fixed_policy(name, make_task(task))
        whole("--seeds", seeds, Range(1, 1000))
        whole("--runs", runs, RUNS)
        check_budget(minutes=minutes)
        check_libraries()
        plan = Plan(task, minutes, runs=runs)
        # Seed by seed: whenever it is stopped, all algorithms have about as many.
        jobs = [Job(name, seed) for seed in range(seeds) for name in chosen] + [Job(name, None) for name in beside]
        for k, job in enumerate([] if report_only else jobs):
            said = _said(do(job, plan, folder))
            say(f"{k + 1}/{len(jobs)} {job.title}: {said}")
        results: dict[str, list[Plain]] = {}
        for job in jobs:
            if (result := read_result(folder, job, plan)) is not None:
                results.setdefault(job.name, []).append(result)
        if not results:
            raise ValueError(f"nothing is finished in {folder} yet")
        rows = summarize(results)
        write_json(folder / "summary.json", {"plan": plan._asdict(), "rows": rows})
        write_text(folder / "table.md", table(rows))
    typer.echo(table(rows), nl=False)


def _said(result: Plain | None) -> str:
    if result is None:
        return "another process is about it"
    row = result["final"]
    mean = row["clearing_time"]["mean"]
    return f"{'-' if mean is None else f'{mean:.1f} s'}, {row['unfinished']} of {row['runs']} runs unfinished"
