"""Compare ways to lead people out, under every contact scheme, on the same draws: ``python -m agents.evaluate``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from agents.evaluation.comparison import last_times, mean_times, minus_first, ranking
from agents.evaluation.entries import Entry, make_entries
from agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation, evaluate_driver
from agents.evaluation.folder import EvaluationFolder, settings_of
from agents.evaluation.report import crowding_table, exits_table, left_table, ranking_lines, table_console, times_table
from agents.runs import versions
from agents.training_config import RUNS
from crowd_env import SCHEMES, CrowdEnv, Scenario, make_scenario, make_scheme
from crowd_env.checks import Range, whole
from crowd_env.cli.console import (
    MannerName,
    OutlineOption,
    friendly_errors,
    notes,
    progress_bar,
    run_title,
    with_manner,
)
from crowd_env.files.json_file import write_json
from crowd_env.headway import Headway
from crowd_env.outline import Outline
from crowd_env.physics import check_outline
from crowd_env.rendering.libraries import require_libraries

_POLICIES, _POLICY, _SCHEMES = "--policies", "--policy", "--schemes"


class _ListsOfNames(TyperCommand):
    """A command whose options for policies and schemes take several names each: ``--policies shortest fastest``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, _one_by_one(args))


def _one_by_one(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with the name of its option before every name of a list."""
    found: list[str] = []
    option = None
    for argument in arguments:
        if argument.startswith("--"):
            option = argument if argument in (_POLICIES, _POLICY, _SCHEMES) else None
        elif option is not None and found[-1] != option:
            found.append(option)
        found.append(argument)
    return found


def compare(
    entries: Sequence[Entry],
    scenario: Scenario,
    schemes: Sequence[str],
    *,
    runs: int,
    seed: int = 0,
    threads: int = 1,
    folder: EvaluationFolder | None = None,
) -> list[Evaluation]:
    """Evaluate every entry under every scheme: run ``k`` of all of them starts from the same people in the same places.

    What ``folder`` has kept is taken from there.
    """
    results: list[Evaluation] = []
    total = len(schemes) * len(entries)
    for scheme in schemes:
        warm: set[bool] = set()  # whether people keep a distance: then more is compiled
        for entry in entries:
            result = folder.load(entry, scheme) if folder is not None else None
            if result is None:
                headway = scenario.manner_of_run(entry.manner)
                if (headway is None) not in warm:
                    _warm_up(scheme, headway, scenario.outline_of_run())
                    warm.add(headway is None)
                result = _evaluate(entry, scenario, scheme, runs, seed, threads, f"{len(results) + 1}/{total}")
                if folder is not None:
                    folder.save(entry, scheme, result)
            results.append(result)
    return results


def _evaluate(
    entry: Entry, scenario: Scenario, scheme: str, runs: int, seed: int, threads: int, number: str
) -> Evaluation:
    title = f"{number} {entry.name}, {scheme}"
    with progress_bar(title, runs) as progress:
        result = evaluate_driver(
            entry.driver(scenario, scheme, threads),
            scenario,
            entry.name,
            scheme,
            runs=runs,
            first_seed=HELD_OUT_SEED + seed,
            measure=True,
            progress=progress,
        )
    if not notes.is_terminal:  # no bar there: say the same in lines
        notes.print(f"{title}: mean exit time {mean_times(result).mean():.2f} s", markup=False)
    return result


def _warm_up(scheme: str, headway: Headway | None, outline: Outline | None) -> None:
    """Load the kernels, so that compiling them is not counted as computing."""
    env = CrowdEnv("room-v0", scheme=scheme, strategy="fastest", manner=headway, outline=outline)
    env.reset(seed=0)
    env.step(None)


def summary(results: Sequence[Evaluation], scenario: Scenario, settings: dict[str, Any]) -> dict[str, Any]:
    """Return everything about an evaluation but single runs, ready for JSON."""
    rows = []
    for result in results:
        first = next(one for one in results if one.scheme == result.scheme)
        all_counted = {"last": float(last_times(result).mean()), "mean": float(mean_times(result).mean())}
        rows.append(result.row() | {"unfinished_at_limit": all_counted, "minus_first": minus_first(result, first)})
    return {
        **settings,
        "people": scenario.population.count,
        "time_limit": scenario.time_limit,
        "rows": rows,
        "ranking": {"last": ranking(results), "mean": ranking(results, of=mean_times)},
        "versions": versions(),
    }


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=_ListsOfNames)
def main(
    scenario: Annotated[str, typer.Option(help="Name of a scenario, or a scenario file.")] = "room-v0",
    policies: Annotated[
        list[str],
        typer.Option(
            _POLICIES,
            _POLICY,
            metavar="POLICY ...",
            show_default="shortest fastest",
            help="shortest, nearest, fastest, comfortable; the name of a route or exit; rules: the shortest path with the "
            "scenario's control rules in force, which are off for all others; random, stand-still; rules of walking: "
            "rule-best-speed, density-cap, headway (the manner hurried), follow, zipper; or a learned network (.npz).  The "
            "others are compared with the first.",
        ),
    ] = ["shortest", "fastest"],  # noqa: B006  (typer copies it)
    schemes: Annotated[
        list[str],
        typer.Option(_SCHEMES, metavar="SCHEME ...", show_default="nsm2", help=", ".join(SCHEMES) + "."),
    ] = ["nsm2"],  # noqa: B006
    manner: MannerName = None,
    outline: OutlineOption = None,
    runs: Annotated[int, typer.Option(help="Evacuations of each policy and scheme.")] = 100,
    seed: Annotated[int, typer.Option(help="Other draws; all are held out from training.")] = 0,
    threads: Annotated[int, typer.Option(help="Of the simulation; results do not depend on it.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder for tables, curves and maps; an interrupted one goes on there.")
    ] = None,
    trust_pickle: Annotated[
        bool,
        typer.Option(
            "--trust-pickle",
            help="Open networks of stable-baselines3 (.zip) too: opening one runs whatever code its maker put in.",
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Compare ways to lead people out, under every contact scheme, on the same draws.

    Examples:

    python -m agents.evaluate --scenario two-exit-hall-v0 --policies shortest fastest --schemes dem nsm2 --runs 20

    python -m agents.evaluate --scenario my_hall.toml --policies rules north runs/x/best.npz --out comparison
    """
    with friendly_errors("" if out is None else "the same command goes on"):
        place = with_manner(make_scenario(scenario), manner, outline)
        whole("--runs", runs, RUNS)
        whole("--seed", seed, Range(0, HELD_OUT_SEED - runs - 1))
        whole("--threads", threads)
        schemes = list(dict.fromkeys(schemes))
        for scheme in schemes:
            check_outline(place.outline_of_run(), make_scheme(scheme))
        entries = make_entries(policies, place, trust_pickle=trust_pickle)
        if "rules" in policies and not place.rules:
            notes.print(f"note: {place.name} has no control rules; rules is shortest there", markup=False)
        settings = settings_of(place, runs, seed)
        folder = None
        if out is not None:
            require_libraries(".png")  # says now, not after the work, that the drawing library is missing
            folder = EvaluationFolder(out, settings)
        results = compare(entries, place, schemes, runs=runs, seed=seed, threads=threads, folder=folder)
        figures = summary(results, place, settings)
        if folder is not None:
            _write(folder, results, figures, place, HELD_OUT_SEED + seed)
    if as_json:
        typer.echo(json.dumps(figures, allow_nan=False))
    else:
        _show(results, run_title(place, people=f"{place.population.count} people", runs=f"{runs} runs each"))


def _write(
    folder: EvaluationFolder, results: list[Evaluation], figures: dict[str, Any], scenario: Scenario, first_seed: int
) -> None:
    write_json(folder.path / "rows.json", figures)
    folder.write_runs(results, first_seed)
    pictures = folder.draw(results, scenario)
    notes.print(f"rows.json, runs.csv and {len(pictures)} pictures: {folder.path}/", markup=False, soft_wrap=True)


def _show(results: list[Evaluation], title: str) -> None:
    console = table_console()
    for table in (times_table(results, title), left_table(results), exits_table(results), crowding_table(results)):
        if table is not None:
            console.print(table)
    for line in ranking_lines(results):
        console.print(line, markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    app()
