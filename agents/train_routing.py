"""Train a controller that sends people to exits, and judge it: ``python -m agents.train_routing``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from agents.evaluation import HELD_OUT_SEED
from agents.routing import STRATEGIES, Controller, FixedSplit, Judged, RandomController, difference, judge
from agents.runs import new_folder, versions, write_json
from crowd_env.metrics import Summary, summarise

console = Console(stderr=True)


def compare(controllers: list[Controller | str], options: dict[str, Any], runs: int) -> list[Judged]:
    """Judge all controllers and strategies on the same held-out draws."""
    results = []
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("judging on held-out draws", total=runs * len(controllers))
        for controller in controllers:
            judged = judge(
                controller,
                runs=runs,
                first_seed=HELD_OUT_SEED,
                progress=lambda ended: bar.advance(task, ended),
                **options,
            )
            results.append(judged)
    return results


def rows(results: list[Judged]) -> list[dict[str, Any]]:
    """Return a row for each, and how much longer than it the last one, the learned controller, took."""
    found = []
    for result in results:
        row: dict[str, Any] = {"controller": result.name, "runs": len(result.episodes), "unfinished": result.unfinished}
        row |= {"last": _named(summarise(result.last)), "mean": _named(summarise(result.mean))}
        if result is not results[-1]:
            paired = difference(results[-1], result)
            row["learned_minus_this"] = {name: _named(summary) for name, summary in paired.items()}
            row["ratio"] = {
                "last": float(results[-1].last.mean() / result.last.mean()),
                "mean": float(results[-1].mean.mean() / result.mean.mean()),
            }
        found.append(row)
    return found


def _named(summary: Summary) -> dict[str, Any]:
    return {"mean": summary.mean, "ci95": list(summary.ci95)}


def table(found: list[dict[str, Any]], title: str) -> Table:
    """Return the rows as a table for people."""
    caption = "exit times in s; learned - this: paired differences on the same draws, 95 % bootstrap"
    made = Table(title=title, caption=caption)
    made.add_column("controller", style="bold", no_wrap=True)
    for name in ("last s", "learned - this", "mean s", "learned - this", "in"):
        made.add_column(name, justify="right", no_wrap=True)
    for row in found:
        cells = []
        for term in ("last", "mean"):
            cells.append(f"{row[term]['mean']:.2f}")
            paired = row.get("learned_minus_this")
            if paired is None:
                cells.append("")
            else:
                low, high = paired[term]["ci95"]
                cells.append(f"{paired[term]['mean']:+.2f} ({low:+.2f}..{high:+.2f})")
        made.add_row(row["controller"], *cells, str(row["unfinished"]))
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
    """Train a controller by PPO and judge it on held-out draws against people who choose their way themselves.

    Example: python -m agents.train_routing --seconds 60
    """
    from agents.learned.routing import LearnedController, train_controller

    options = {
        "scenario": scenario,
        "scheme": scheme,
        "interval": interval,
        "grid": grid,
        "threads": threads,
    }
    try:
        for option, value in (("seconds", seconds), ("steps", steps), ("envs", envs), ("runs", runs)):
            if not 0 < value < float("inf"):
                raise ValueError(f"--{option} is {value}; it must be > 0 and finite")
        if not 0 <= seed < HELD_OUT_SEED:
            raise ValueError(f"seed is {seed}; it must be 0 to {HELD_OUT_SEED - 1} (larger ones are kept for judging)")
        folder = new_folder(out.parent, out.name)
        console.print(f"writing to {folder}/", highlight=False)
        trained = train_controller(folder, options, envs=envs, steps=steps, seconds=seconds, seed=seed)
        controllers: list[Controller | str]
        controllers = [RandomController(), *STRATEGIES, FixedSplit(split), LearnedController.load(folder / "best.zip")]
        found = rows(compare(controllers, options, runs))
    except ValueError as error:
        console.print(f"error: {error}", style="red", highlight=False)
        raise typer.Exit(2) from None
    config = {**options, "envs": envs, "seed": seed, "steps": steps, "seconds": seconds, "versions": versions()}
    results = {"config": {**config, "ppo": trained["ppo"]}, "best": trained["best"], "rows": found}
    write_json(folder / "results.json", results)
    if as_json:
        print(json.dumps(results, indent=2))
    else:
        Console().print(table(found, f"{scenario}, {scheme}, {runs} held-out draws"))


if __name__ == "__main__":
    typer.run(main)
