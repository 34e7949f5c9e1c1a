"""Train a controller that sends people to exits, and evaluate it: ``python -m agents.train_routing``."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress
from rich.table import Table

from agents.controllers import Controller, FixedSplit, RandomController
from agents.evaluation.comparison import last_times, mean_times, paired, ratio
from agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation, named
from agents.evaluation.report import difference, percent, table_console
from agents.evaluation.routing import STRATEGIES, evaluate_controller
from agents.runs import new_folder, versions
from agents.trained import LearnedController
from agents.training_config import check_budget, check_envs, check_libraries, check_runs, check_seed
from crowd_env.cli.console import friendly_errors, notes
from crowd_env.envs.rollout import share
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.files.json_file import write_json

_MOST_CELLS = 10_000  # nobody decides about more, and their names alone fill memory


def evaluate_all(
    controllers: list[Controller | str], options: dict[str, Any], runs: int, done: Callable[[list[Evaluation]], None]
) -> list[Evaluation]:
    """Evaluate controllers and strategies on the same held-out draws; after each ``done`` gets the results so far."""
    results: list[Evaluation] = []
    with Progress(console=notes, transient=True) as bar:
        task = bar.add_task("evaluating on held-out draws", total=runs * len(controllers))
        for controller in controllers:
            result = evaluate_controller(
                controller,
                runs=runs,
                first_seed=HELD_OUT_SEED,
                progress=lambda ended: bar.advance(task, ended),
                **options,
            )
            results.append(result)
            done(results)
    return results


def rows(results: list[Evaluation]) -> list[dict[str, Any]]:
    """Return a row for each, and how much longer than it the first one, the learned controller, took."""
    found = []
    learned = results[0]
    for result in results:
        left = int((result.column("unfinished") > 0).sum())
        row: dict[str, Any] = {
            "controller": result.policy,
            "runs": result.runs,
            "unfinished": int(result.column("unfinished").sum()),
            "unfinished_runs": left,
            "unfinished_share": share(left, result.runs),
            "last": named(last_times(result)),
            "mean": named(mean_times(result)),
        }
        if result is not learned:
            row["learned_minus_this"] = {
                "last": paired(last_times(learned), last_times(result)),
                "mean": paired(mean_times(learned), mean_times(result)),
            }
            row["learned_over_this"] = ratio(learned, result)
        found.append(row)
    return found


def table(found: list[dict[str, Any]], title: str) -> Table:
    """Return the rows as a table for people."""
    caption = (
        "Exit times in s, of all people; people left inside count until the end (then ≥). learned - this: paired differences "
        "on the same draws and their 95 % interval. runs left: % of runs in which someone was left, and its 95 % interval."
    )
    made = Table(title=title, caption=caption, caption_justify="left")
    made.add_column("controller", style="bold", no_wrap=True)
    for name in ("last s", "learned - this", "mean s", "learned - this", "in", "runs left %"):
        made.add_column(name, justify="right", no_wrap=True)
    for row in found:
        cells = []
        for term in ("last", "mean"):
            cells.append(f"{'≥' if row['unfinished'] else ''}{row[term]['mean']:.2f}")
            cells.append(difference(row["learned_minus_this"][term], 2) if "learned_minus_this" in row else "")
        made.add_row(row["controller"], *cells, str(row["unfinished"]), percent(row["unfinished_share"]))
    return made


def main(
    scenario: Annotated[str, typer.Option(help="Scenario to train in.")] = "two-exit-hall-v0",
    scheme: Annotated[str, typer.Option(help="Contact scheme.")] = "nsm2",
    seconds: Annotated[float, typer.Option(help="Training stops after so long, if not done by then.")] = 600.0,
    steps: Annotated[int, typer.Option(help="Decisions to train for, summed over all evacuations.")] = 120_000,
    envs: Annotated[int, typer.Option(help="Evacuations simulated side by side.")] = 32,
    threads: Annotated[int, typer.Option(help="Threads of the simulation.")] = 2,
    interval: Annotated[float, typer.Option(help="Seconds between decisions.")] = 2.0,
    grid: Annotated[tuple[int, int], typer.Option(help="Columns and rows of decision regions.")] = (4, 2),
    split: Annotated[float, typer.Option(help="Where the scripted controller splits the plan [m].")] = 5.0,
    seed: Annotated[int, typer.Option(help="Fixes draws and network; below 1000000.")] = 0,
    runs: Annotated[int, typer.Option(help="Held-out evacuations per controller in the final table.")] = 200,
    out: Annotated[Path, typer.Option(help="Folder for model, learning curve and results.")] = Path("runs/routing"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
) -> None:
    """Train a controller by PPO and compare it on held-out draws with people who choose their way themselves.

    Example: python -m agents.train_routing --seconds 60
    """
    options = {"scenario": scenario, "scheme": scheme, "interval": interval, "grid": grid, "threads": threads}
    config = {**options, "envs": envs, "seed": seed, "steps": steps, "seconds": seconds, "versions": versions()}
    folder: Path | None = None
    results: dict[str, Any] = {}
    try:
        with friendly_errors(lambda: _left_behind(folder, scenario, scheme)):
            check_runs(runs)
            check_libraries()
            _check(options, seed, split, seconds=seconds, steps=steps, envs=envs)
            from agents.learned.routing import train_controller

            folder = new_folder(out.parent, out.name)
            notes.print(f"writing to {folder}/")
            trained = train_controller(folder, options, envs=envs, steps=steps, seconds=seconds, seed=seed)
            if trained["interrupted"]:
                raise KeyboardInterrupt
            chosen = {name: trained[name] for name in ("best", "finalists")}

            def keep(evaluated: list[Evaluation]) -> None:
                found = rows(evaluated)
                results.update(config={**config, "ppo": trained["ppo"]}, **chosen, rows=[*found[1:], found[0]])
                write_json(folder / "results.json", results)

            learned = LearnedController.load(folder / "best.npz")
            evaluate_all([learned, RandomController(), *STRATEGIES, FixedSplit(split)], options, runs, keep)
    finally:
        if results and not as_json:
            table_console().print(table(results["rows"], f"{scenario}, {scheme}, {runs} held-out draws"))
    if as_json:
        typer.echo(json.dumps(results, indent=2, allow_nan=False))


def _check(options: dict[str, Any], seed: int, split: float, **budget: float) -> None:
    """Raise ValueError for everything that would fail later, before anything is written."""
    check_budget(**budget)
    check_seed(seed)
    if not math.isfinite(split):
        raise ValueError(f"--split is {split}; it must be finite")
    columns, rows = options["grid"]
    if columns * rows > _MOST_CELLS:
        raise ValueError(f"--grid is {columns} {rows}; it must have at most {_MOST_CELLS} cells")
    batch = RoutingBatch(**options)
    if len(batch.layout.routes) < 2:
        raise ValueError(f"scenario {batch.scenario.name!r} has one way out: there is nothing to choose")
    check_envs(int(budget["envs"]), batch.env.num_people)


def _left_behind(folder: Path | None, scenario: str, scheme: str) -> str:
    """Return in words what an interrupted run has kept, and how to evaluate it."""
    if folder is None or not (folder / "best.npz").exists():
        return ""
    if (folder / "results.json").exists():
        return f"what was evaluated by then is in {folder}/results.json"
    again = f"python -m agents.evaluate --scenario {scenario} --schemes {scheme} --policies nearest fastest"
    return f"the best controller so far is {folder}/best.npz; evaluate it with: {again} {folder}/best.npz"


if __name__ == "__main__":
    typer.run(main)
