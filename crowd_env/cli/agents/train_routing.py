"""Train a controller that sends people to exits, and evaluate it: ``crowd-env train-routing``."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.agents.controllers import Controller, FixedSplit, RandomController
from crowd_env.agents.evaluation.comparison import last_times, mean_times, paired, ratio
from crowd_env.agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation
from crowd_env.agents.evaluation.report import left_table, table_console, times_table
from crowd_env.agents.evaluation.routing import STRATEGIES, evaluate_controller
from crowd_env.agents.runs import new_folder, versions
from crowd_env.agents.trained import LearnedController
from crowd_env.agents.training_config import RUNS, SEEDS, check_budget, check_envs, check_libraries
from crowd_env.analysis.figures import named
from crowd_env.cli.console import MannerName, OutlineOption
from crowd_env.cli.place import PLACES, Exits, Unit, complete_scenario, plan_options
from crowd_env.core.arrays.headway import plain_manner
from crowd_env.core.arrays.outline import plain_outline
from crowd_env.core.checks import number, whole
from crowd_env.core.console import friendly_errors, notes, progress_bar
from crowd_env.core.files.json_file import write_json
from crowd_env.envs.routing.batch import RoutingBatch, routing_arguments
from crowd_env.scenarios import make_scenario

_MOST_CELLS = 10_000  # nobody decides about more, and their names alone fill memory


def rows(results: list[Evaluation]) -> list[dict[str, Any]]:
    """Return a row for each, and how much longer than it the first one, the learned controller, took."""
    found = []
    learned = results[0]
    for result in results:
        figures = result.row()
        row = {name: figures[name] for name in ("runs", "unfinished", "unfinished_runs", "unfinished_share")}
        row |= {"controller": result.policy, "last": named(last_times(result)), "mean": named(mean_times(result))}
        if result is not learned:
            row["learned_minus_this"] = {
                "last": paired(last_times(learned), last_times(result)),
                "mean": paired(mean_times(learned), mean_times(result)),
            }
            row["learned_over_this"] = ratio(learned, result)
        found.append(row)
    return found


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    scenario: Annotated[
        str, typer.Option(autocompletion=complete_scenario, help=f"Scenario to train in.  {PLACES}")
    ] = "two-exit-hall-v0",
    exit: Exits = None,
    unit: Unit = None,
    people: Annotated[
        int | None, typer.Option(help="How many people there are.", show_default="the scenario's, or 20", min=1)
    ] = None,
    scheme: Annotated[str, typer.Option(help="Contact scheme.")] = "nsm2",
    manner: MannerName = None,
    outline: OutlineOption = None,
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

    Examples: crowd-env train-routing --seconds 60

    crowd-env train-routing --scenario my_plan.wkt --exit 6,2,6,3 --exit 0,2,0,3 --people 60
    """
    options: dict[str, Any] = {
        "scenario": scenario,
        "scheme": scheme,
        "interval": interval,
        "grid": grid,
        "threads": threads,
    }
    config = {**options, "envs": envs, "seed": seed, "steps": steps, "seconds": seconds, "versions": versions()}
    folder: Path | None = None
    results: dict[str, Any] = {}
    judged: list[Evaluation] = []
    try:
        again = {"scenario": scenario, "exit": exit, "unit": unit, "people": people, "manner": manner}
        with friendly_errors(lambda: _left_behind(folder, {**again, "outline": outline, "schemes": scheme})):
            whole("--runs", runs, RUNS)
            check_libraries()
            of_place = {**plan_options(scenario, exit, unit), **({} if people is None else {"people": people})}
            place = make_scenario(scenario, **of_place)
            options |= {"manner": plain_manner(place.manner_of_run(manner)), **of_place}
            options["outline"] = plain_outline(place.outline_of_run(outline))
            config |= options
            _check(options, seed, split, seconds=seconds, steps=steps, envs=envs)
            from crowd_env.agents.learned.routing import train_controller

            folder = new_folder(out.parent, out.name)
            notes.print(f"writing to {folder}/")
            trained = train_controller(folder, options, envs=envs, steps=steps, seconds=seconds, seed=seed)
            if trained["interrupted"]:
                raise KeyboardInterrupt
            results = {"config": {**config, "ppo": trained["ppo"]}, **{k: trained[k] for k in ("best", "finalists")}}
            learned = LearnedController.load(folder / "best.safetensors")
            controllers: list[Controller | str] = [learned, RandomController(), *STRATEGIES, FixedSplit(split)]
            with progress_bar("evaluating on held-out draws", runs * len(controllers)) as progress:
                on_held_out_draws = {**options, "runs": runs, "first_seed": HELD_OUT_SEED, "progress": progress}
                for controller in controllers:
                    judged.append(evaluate_controller(controller, **on_held_out_draws))
                    found = rows(judged)
                    results["rows"] = [*found[1:], found[0]]
                    write_json(folder / "results.json", results)
    finally:
        if judged and not as_json:
            table_console().print(times_table(judged, f"{scenario}, {runs} held-out draws"), left_table(judged))
    if as_json:
        typer.echo(json.dumps(results, indent=2, allow_nan=False))


def _check(options: dict[str, Any], seed: int, split: float, **budget: float) -> None:
    """Raise ValueError for everything that would fail later, before anything is written."""
    check_budget(**budget)
    whole("seed", seed, SEEDS)
    number("--split", split)
    columns, rows = options["grid"]
    if columns * rows > _MOST_CELLS:
        raise ValueError(f"--grid is {columns} {rows}; it must have at most {_MOST_CELLS} cells")
    batch = RoutingBatch(**routing_arguments(**options))
    if len(batch.layout.routes) < 2:
        raise ValueError(f"scenario {batch.scenario.name!r} has one way out: there is nothing to choose")
    check_envs(int(budget["envs"]), batch.env.num_people)


def _left_behind(folder: Path | None, given: Mapping[str, Any]) -> str:
    """Return in words what an interrupted run has kept, and how to evaluate it with the options that were ``given``."""
    if folder is None or not (folder / "best.safetensors").exists():
        return ""
    if (folder / "results.json").exists():
        return f"what was evaluated by then is in {folder}/results.json"
    words = ["crowd-env", "evaluate"]
    for option, value in given.items():
        for one in value if isinstance(value, list) else [value]:
            words += [] if one is None else [f"--{option}", str(one)]
    again = shlex.join([*words, "--policies", "nearest", "fastest", f"{folder}/best.safetensors"])
    return f"the best controller so far is {folder}/best.safetensors; evaluate it with: {again}"


if __name__ == "__main__":
    app()
