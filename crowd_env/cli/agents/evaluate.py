"""Compare ways to lead people out, on a task or under any contact schemes, on the same draws: ``crowd-env evaluate``."""

import json
from collections.abc import Sequence
from contextlib import closing, nullcontext
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env import SCHEMES, Scenario, make_scheme
from crowd_env.agents import POLICIES, PRETRAINED
from crowd_env.agents.evaluation.entries import RULE, make_entries
from crowd_env.agents.evaluation.evaluation import HELD_OUT_SEED, Evaluation
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.evaluation.protocol import credible_lines, task_table
from crowd_env.agents.evaluation.report import (
    crowding_table,
    exits_table,
    left_table,
    ranking_lines,
    table_console,
    times_table,
)
from crowd_env.agents.evaluation.robustness import (
    few_runs,
    judge_trial,
    lines_of_trials,
    make_trials,
    robustness_table,
    summary_of_trials,
)
from crowd_env.agents.evaluation.same_draws import compare, summary
from crowd_env.agents.tasks import TASKS, Task, make_task
from crowd_env.agents.training_config import RUNS
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.console import MannerName, OutlineOption, complete_from
from crowd_env.cli.place import PLACES, Exits, Unit, complete_scenario, read_place
from crowd_env.core.checks import Range, number, whole
from crowd_env.core.console import friendly_errors, notes
from crowd_env.core.executors import Executor, Serial, make_executor
from crowd_env.core.files.json_file import write_json
from crowd_env.physics import check_outline
from crowd_env.rendering.libraries import require_libraries
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios.titles import run_title, with_manner

_POLICIES, _POLICY, _SCHEMES = "--policies", "--policy", "--schemes"
_SCENARIO, _NAMED, _SCHEME, _RUNS = (
    "room-v0",
    ("shortest", "fastest"),
    "nsm2",
    100,
)  # unless a task or an option says otherwise


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=ListsOfNames)
def main(
    task: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            autocompletion=complete_from(TASKS),
            help=f"What the policies are judged on: {', '.join(TASKS)}.  It says scenario, people, scheme, steps and draws.",
        ),
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            show_default=_SCENARIO, autocompletion=complete_scenario, help=f"{PLACES}  Where there is no task."
        ),
    ] = None,
    exit: Exits = None,
    unit: Unit = None,
    policies: Annotated[
        list[str] | None,
        typer.Option(
            _POLICIES,
            _POLICY,
            metavar="POLICY ...",
            show_default="shortest fastest; of a task rule",
            autocompletion=complete_from((RULE, *STRATEGIES, *POLICIES, *PRETRAINED)),
            help="rule: the strategy of a task; shortest, nearest, fastest, comfortable; the name of a route or exit; rules: "
            "the shortest path with the scenario's control rules in force, which are off for all others; random, stand-still; "
            "rules of walking: rule-best-speed, density-cap, headway (the manner hurried), follow, evolution, zipper; a "
            "shipped policy (TASK/NAME), or a learned network (.safetensors).  The others are compared with the first.",
        ),
    ] = None,
    schemes: Annotated[
        list[str] | None,
        typer.Option(
            _SCHEMES,
            metavar="SCHEME ...",
            autocompletion=complete_from(SCHEMES),
            show_default=f"{_SCHEME}; of a task its own",
            help=", ".join(SCHEMES) + ".",
        ),
    ] = None,
    people: Annotated[
        int | None,
        typer.Option(help="Another number of people of the same kinds; on a task they have as much time each."),
    ] = None,
    manner: MannerName = None,
    learned_share: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Mixed crowds: only this share of the people, drawn anew in every run but the same for every policy, follows "
            "the policy; the others follow the rule, and --manner is theirs alone.",
        ),
    ] = None,
    outline: OutlineOption = None,
    runs: Annotated[
        int | None,
        typer.Option(help="Evacuations of each policy and scheme.", show_default=f"{_RUNS}; those of a task"),
    ] = None,
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
    ray: Annotated[
        bool,
        typer.Option(
            "--ray",
            help="Spread the draws over a Ray cluster, see docs/ray.md; results do not depend on it.",
        ),
    ] = False,
    robustness: Annotated[
        bool,
        typer.Option(
            "--robustness",
            help="Also judge on the held-out variations of the task (twice the people, other doors, other schemes, other "
            "people, half of them learned), by default on a fifth of its draws; rows carry the variation.",
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Compare ways to lead people out, on a task or under any contact schemes, on the same draws.

    Examples
    --------
    crowd-env evaluate --task competitive-door --policies rule density-cap follow --runs 40

    crowd-env evaluate --task competitive-door --policies rule follow competitive-door/ppo --people 200

    crowd-env evaluate --task competitive-door --policies rule follow competitive-door/ppo --robustness

    crowd-env evaluate --scenario two-exit-hall-v0 --policies shortest fastest --schemes dem nsm2 --runs 20

    crowd-env evaluate --scenario my_plan.wkt --exit 6,2,6,3 --people 40 --policies shortest --runs 20

    crowd-env evaluate --scenario my_hall.toml --policies rules north runs/x/best.safetensors --out comparison
    """
    with friendly_errors("" if out is None else "the same command goes on"):
        chosen = None if task is None else make_task(task)
        if robustness:
            given: dict[str, Any] = {
                "--scenario": scenario,
                "--schemes": schemes,
                "--people": people,
                "--manner": manner,
            }
            given |= {"--learned-share": learned_share, "--outline": outline, "--exit": exit, "--unit": unit}
            _refuse_beside_robustness(chosen, given)
            assert chosen is not None
            with closing(_executor(ray, threads)) as executor:
                _vary(chosen, policies or [RULE], runs, seed, threads, out, trust_pickle, as_json, executor)
            return
        place = with_manner(_place(chosen, scenario, people, exit, unit), manner, outline)
        policies = policies or list(_NAMED if chosen is None else (RULE,))
        schemes = list(dict.fromkeys(schemes or [_SCHEME if chosen is None else chosen.scheme]))
        count = _RUNS if chosen is None else chosen.runs
        runs = whole("--runs", count if runs is None else runs, RUNS)
        whole("--seed", seed, Range(0, HELD_OUT_SEED - runs - 1))
        whole("--threads", threads)
        if learned_share is not None:
            learned_share = number("--learned-share", learned_share, Range(0.0, 1.0, above=True))
        for scheme in schemes:
            check_outline(place.outline_of_run(), make_scheme(scheme))
        entries = make_entries(policies, place, chosen, trust_pickle=trust_pickle, learned_share=learned_share)
        if "rules" in policies and not place.rules:
            notes.print(f"note: {place.name} has no control rules; rules is shortest there", markup=False)
        settings = settings_of(place, runs, seed, chosen, learned_share)
        folder = None
        if out is not None:
            require_libraries(".png")  # says now, not after the work, that the drawing library is missing
            folder = EvaluationFolder(out, settings)
        with closing(_executor(ray, threads)) as executor, nullcontext() if folder is None else folder.alone():
            options: dict[str, Any] = {"seed": seed, "threads": threads, "folder": folder, "executor": executor}
            results = compare(entries, place, schemes, runs=runs, **options)
        figures = summary(results, place, settings, chosen)
        if folder is not None:
            _write(folder, results, figures, place, HELD_OUT_SEED + seed)
    if as_json:
        typer.echo(json.dumps(figures, allow_nan=False))
    else:
        title = run_title(place, people=f"{place.population.people} people", runs=f"{runs} runs each")
        if learned_share is not None:
            title += f", {100 * learned_share:g} % learned"
        _show(results, title, place, chosen)


def _executor(ray: bool, threads: int) -> Executor:
    """Return what simulates: a cluster of whose cores a batch takes as many as it has threads, or this process."""
    return make_executor("ray", cores=threads) if ray else Serial()


def _refuse_beside_robustness(task: Task | None, given: dict[str, Any]) -> None:
    """Raise ValueError if something is asked for that --robustness says itself, or there is no task."""
    if task is None:
        raise ValueError("--robustness varies a task; name one by --task")
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"--robustness says itself what it varies, {name} among it; leave one out")


def _vary(
    task: Task,
    policies: Sequence[str],
    runs: int | None,
    seed: int,
    threads: int,
    out: Path | None,
    trust_pickle: bool,
    as_json: bool,
    executor: Executor,
) -> None:
    """Judge policies on a task and its variations, and say what came out."""
    runs = whole("--runs", few_runs(task) if runs is None else runs, RUNS)
    whole("--seed", seed, Range(0, HELD_OUT_SEED - runs - 1))
    whole("--threads", threads)
    trials = make_trials(task, policies, trust_pickle=trust_pickle)
    how: dict[str, Any] = {"runs": runs, "seed": seed, "threads": threads, "out": out}
    found = [(one, judge_trial(task, one, partial(compare, executor=executor), **how)) for one in trials]
    figures = summary_of_trials(task, found, runs, seed)
    if out is not None:
        write_json(out / "robustness.json", figures)
    if as_json:
        typer.echo(json.dumps(figures, allow_nan=False))
        return
    title = f"{task.name}, version {task.version}, and its variations: {runs} runs each"
    console = table_console()
    console.print(robustness_table(found, title))
    for line in lines_of_trials(found):
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _place(
    task: Task | None, scenario: str | None, people: int | None, exits: list[str] | None, unit: str | None
) -> Scenario:
    """Return the scenario of a task, or the one that is named, with so many people if a number is given."""
    count = None if people is None else whole("--people", people)
    if task is None:
        return read_place(_SCENARIO if scenario is None else scenario, exits=exits, unit=unit, people=count)
    for name, value in (("--scenario", scenario), ("--exit", exits), ("--unit", unit)):
        if value:
            said = value if isinstance(value, str) else " ".join(value)
            raise ValueError(f"{name} is {said}, but --task {task.name} says where people walk; leave one out")
    return task.place(count)


def _write(
    folder: EvaluationFolder, results: list[Evaluation], figures: dict[str, Any], scenario: Scenario, first_seed: int
) -> None:
    write_json(folder.folder / "rows.json", figures)
    folder.write_runs(results, first_seed)
    pictures = folder.draw(results, scenario)
    notes.print(f"rows.json, runs.csv and {len(pictures)} pictures: {folder.folder}/", markup=False, soft_wrap=True)


def _show(results: list[Evaluation], title: str, place: Scenario, task: Task | None) -> None:
    console = table_console()
    if task is None:
        judged = [times_table(results, title), left_table(results)]
    else:
        judged = [task_table(results, f"{task.name}, version {task.version}: {title}")]
    for table in (*judged, exits_table(results), crowding_table(results)):
        if table is not None:
            console.print(table)
    for line in [*ranking_lines(results), *([] if task is None else credible_lines(results, place))]:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    app()
