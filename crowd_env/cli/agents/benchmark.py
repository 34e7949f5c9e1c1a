"""Train algorithms with several seeds on tasks and judge them: ``crowd-env benchmark``."""

from pathlib import Path
from typing import Annotated

import typer

from crowd_env.agents.benchmark.jobs import ALGORITHMS, TASKS, Job, Plan, do, fixed_policy, read_result
from crowd_env.agents.benchmark.report import draw, summarize, table
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.plain import Plain
from crowd_env.agents.tasks import make_preset, make_task
from crowd_env.agents.training_config import RUNS, check_budget, check_libraries
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.options import new_app, plain
from crowd_env.core.checks import Range, known, whole
from crowd_env.core.console import friendly_errors, say
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import write_json
from crowd_env.rendering.libraries import require_libraries

_BASELINES = (RULE, "follow", "generalist")
_FOLDER = Path("benchmarks/results/learning")
_ABOUT = "; ".join(f"{name}: {one.about}" for name, one in ALGORITHMS.items())
_BESIDE = "Policies to judge beside them."

app = new_app()


@app.command(cls=ListsOfNames)
def main(
    tasks: Annotated[list[str] | None, plain("What is learned.", " ".join(TASKS), metavar="TASK ...")] = None,
    algorithms: Annotated[list[str] | None, plain(_ABOUT, metavar="NAME ...")] = None,
    baselines: Annotated[list[str] | None, plain(_BESIDE, " ".join(_BASELINES), metavar="POLICY ...")] = None,
    seeds: Annotated[int, plain("Trainings of each algorithm on each task, with the seeds 0, 1, ...")] = 10,
    minutes: Annotated[float, plain("Processor time of each training, evaluations apart.")] = 2.0,
    runs: Annotated[int, plain("Held-out draws of the final evaluation, in the task as it stands.")] = 40,
    out: Annotated[Path | None, plain("Folder of the results.", str(_FOLDER))] = None,
    report_only: Annotated[bool, plain("Train nothing: report what there is.", names=("--report-only",))] = False,
) -> None:
    """Train algorithms on tasks with several seeds each, and compare them by interquartile means and intervals.

    An interrupted command goes on, several may share a folder, and seeds, tasks or algorithms can be added later.

    Examples: crowd-env benchmark

    crowd-env benchmark --tasks narrow-door --algorithms ppo --baselines rule follow --seeds 3
    """
    folder = _FOLDER if out is None else out
    with friendly_errors("the same command goes on"):
        chosen = [known("algorithm", name, ALGORITHMS) for name in algorithms or ALGORITHMS]
        beside = list(_BASELINES if baselines is None else baselines)
        for task in tasks or TASKS:
            make_preset(task)
            for name in beside:
                fixed_policy(name, make_task(task))
        whole("--seeds", seeds, Range(1, 1000))
        whole("--runs", runs, RUNS)
        check_budget(minutes=minutes)
        check_libraries()
        require_libraries(".png")
        plan = Plan(minutes, runs=runs)
        # Seed by seed: whenever it is stopped, all have about as many.
        every = [Job(task, name, seed) for seed in range(seeds) for task in tasks or TASKS for name in chosen]
        every += [Job(task, name, None) for task in tasks or TASKS for name in beside]
        for k, job in enumerate([] if report_only else every):
            say(f"{k + 1}/{len(every)} {job.task}, {job.title}: {_said(do(job, plan, folder))}")
        results: dict[str, dict[str, list[Plain]]] = {}
        for job in every:
            if (result := read_result(folder, job, plan)) is not None:
                results.setdefault(job.name, {}).setdefault(job.task, []).append(result)
        if not results:
            raise ValueError(f"nothing is finished in {folder} yet")
        rows = summarize(results)
        write_json(folder / "summary.json", {"plan": plan._asdict(), "rows": rows})
        write_text(folder / "table.md", table(rows))
        draw(results, folder)
    typer.echo(table(rows), nl=False)


def _said(result: Plain | None) -> str:
    if result is None:
        return "another process is about it"
    times = [time for time in result["held_out"]["clearing_times"] if time is not None]
    left = len(result["held_out"]["clearing_times"]) - len(times)
    return f"{f'{sum(times) / len(times):.1f} s' if times else '-'}, somebody left in {left}"
