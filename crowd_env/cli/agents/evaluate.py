"""Compare ways to lead people out, on a task or under any contact schemes, on the same draws: ``crowd-env evaluate``."""

import json
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from crowd_env import SCHEMES, make_scheme
from crowd_env.agents import starts_from
from crowd_env.agents.evaluation import plans, report, robustness
from crowd_env.agents.evaluation.comparison import by_scheme
from crowd_env.agents.evaluation.entries import RULE, make_entries
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.evaluation.protocol import credible_lines
from crowd_env.agents.evaluation.same_draws import compare, summary
from crowd_env.agents.plain import Plain
from crowd_env.agents.tasks import TASKS
from crowd_env.agents.tasks.presets import ALL_PLACES
from crowd_env.agents.training_config import GENERATED, RUNS
from crowd_env.cli.agents.lists_of_names import ListsOfNames
from crowd_env.cli.agents.options import People, PlaceName, Policies, TaskName, changes, task_or_place
from crowd_env.cli.options import AsJson, Exits, Unit, WalkingName, new_app, of_output, of_people, of_physics, of_runs
from crowd_env.cli.place import CrowdOptions, read_place, walking_of
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import Range, number, whole
from crowd_env.core.console import friendly_errors, progress_bar, say
from crowd_env.core.executors import Executor, Processes, RayCluster, Serial
from crowd_env.core.files.json_file import write_json
from crowd_env.core.files.own import own_or_name
from crowd_env.core.files.store import Store
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics.settings import check_behaviors
from crowd_env.rendering.libraries import require_libraries
from crowd_env.scenarios.titles import run_title, with_manner

# Unless a task or an option says otherwise.
_SCENARIO, _NAMED, _SCHEME, _RUNS = "room-v0", ("shortest", "fastest"), "nsm2", 100
_SET = {"outline": str, "learned": float, "threads": int}
_CHANGES = (
    "outline=NAME, the shape of bodies; learned=SHARE, so many of the people follow the policy, the others the "
    "rule (--walking is then theirs alone); threads=N of the simulation, which results do not depend on."
)
_SCHEMES = f"Contact schemes: {', '.join(SCHEMES)}; or your own, my_law.py:MyLaw."
_USUAL = f"{_SCHEME}; of a task its own"
_RAY = "Spread the draws over a Ray cluster; results do not depend on it."
_ROBUSTNESS = (
    "Also judge on the held-out variations of the task (other people, doors and schemes, a turned place, noise, delay, some "
    "who follow the rule), by default on a fifth of its draws."
)
_OUT = "Folder for tables, curves and maps; an interrupted one goes on there."

app = new_app()


@app.command(cls=ListsOfNames)
def main(
    context: typer.Context,
    task_name: TaskName = None,
    scenario: PlaceName = None,
    exit: Exits = None,
    unit: Unit = None,
    people: People = None,
    walking: WalkingName = None,
    set: Annotated[list[str] | None, of_people(_CHANGES, metavar="NAME=VALUE")] = None,
    scheme: Annotated[
        list[str] | None, of_physics(_SCHEMES, _USUAL, names=("--scheme",), among=SCHEMES, metavar="NAME ...")
    ] = None,
    policies: Policies = None,
    runs: Annotated[int | None, of_runs("Evacuations of each policy and scheme.", f"{_RUNS}; those of a task")] = None,
    seed: Annotated[int, of_runs("Other draws; all are held out from training.")] = 0,
    ray: Annotated[bool, of_runs(_RAY, names=("--ray",))] = False,
    vary: Annotated[bool, of_runs(_ROBUSTNESS, names=("--robustness",))] = False,
    out: Annotated[Path | None, of_output(_OUT)] = None,
    as_json: AsJson = False,
) -> None:
    """Compare ways to lead people out, on a task or under any contact schemes, on the same draws.

    The others are compared with the first policy.

    Examples
    --------
    crowd-env evaluate --task competitive-door --policies rule density-cap follow --runs 40

    crowd-env evaluate --task competitive-door --policies rule follow competitive-door/ppo --robustness

    crowd-env evaluate --scenario two-exit-hall-v0 --policies shortest fastest --scheme dem nsm2 --runs 20

    crowd-env evaluate --task generated --policies rule follow generalist --runs 200 --out runs/plans

    crowd-env evaluate --scenario my_plan.wkt --exit 6,2,6,3 --people 40 --policies shortest --runs 20
    """
    with friendly_errors("" if out is None else "the same command goes on"):
        place = task_or_place(task_name, scenario)
        task = TASKS.get(place or "")
        changed = changes(set, _SET)
        threads = whole("--set threads", changed.pop("threads", 1))
        if out is not None:
            context.with_resource(Store(out).alone())
        given = {"--scheme": scheme, "--people": people, "--walking": walking, "--exit": exit, "--unit": unit}
        given |= {f"--set {name}": value for name, value in changed.items()}
        if place == GENERATED:
            given |= {"--robustness": vary or None, "--seed": seed or None}
            if beside := _first_given(given):
                raise ValueError(f"--task {GENERATED} draws places, people and laws itself, {beside} too; leave it out")
            count = whole("--runs", plans.PLANS if runs is None else runs, RUNS)
            judged = policies or plans.RULES
            where_to = Processes(threads) if threads > 1 and not ray else _executor(ray, 1)
            bar = progress_bar("judging in generated places", count * len(judged))
            with closing(where_to) as executor, bar as progress:
                outcomes = plans.judge_plans(judged, count, folder=out, executor=executor, progress=progress)
            rows = plans.figures(outcomes)
            table = plans.table(rows, f"{count} generated places that training never draws")
            figures: Plain = {"task": dict(ALL_PLACES), "plans": count, "rows": rows}
            _tell(figures, None if out is None else out / "rows.json", as_json, [table])
            return
        if vary:
            if task is None:
                raise ValueError("--robustness varies a task; name one by --task")
            if beside := _first_given(given):
                raise ValueError(f"--robustness says itself what it varies, {beside} among it; leave one out")
            runs = whole("--runs", robustness.few_runs(task) if runs is None else runs, RUNS)
            whole("--seed", seed, Range(0, HELD_OUT_SEED - runs - 1))
            trials, found = robustness.make_trials(task, policies or [RULE]), list[robustness.Judged]()
            with closing(_executor(ray, threads)) as executor:
                for one in trials:
                    kept = None if out is None else out / one.variation.name
                    results = robustness.judge_trial(one, runs, seed, threads=threads, folder=kept, executor=executor)
                    found.append((one, results))
            title = f"{task.name}, version {task.version}, and its variations: {runs} runs each"
            table, lines = robustness.robustness_table(found, title), robustness.lines_of_trials(found)
            figures = robustness.summary_of_trials(task, found, runs, seed)
            _tell(figures, None if out is None else out / "robustness.json", as_json, [table], lines)
            return
        if task is None:
            where = read_place(
                CrowdOptions(scenario=_SCENARIO if place is None else place, exit=exit, unit=unit, people=people)
            )
        elif beside := _first_given({"--exit": exit, "--unit": unit}):
            raise ValueError(f"{beside} is for floor plans in files, but --task {task.name} says where people walk")
        else:
            where = task.place(people)
        where = with_manner(where, walking_of(walking), changed.get("outline"))
        policies = policies or list(_NAMED if task is None else (RULE,))
        named = dict.fromkeys(scheme or [_SCHEME if task is None else task.scheme])
        schemes = [make_scheme(own_or_name("--scheme", one)) for one in named]
        count = _RUNS if task is None else task.runs
        runs = whole("--runs", count if runs is None else runs, RUNS)
        whole("--seed", seed, Range(0, HELD_OUT_SEED - runs - 1))
        learned = changed.get("learned")
        if learned is not None:
            learned = number("--set learned", learned, Range(0.0, 1.0, above=True))
        for law in schemes:
            check_behaviors({"outline": where.behavior(Outline)}, law)
        entries = make_entries(policies, where, task, learned_share=learned)
        if "rules" in policies and not where.rules:
            say(f"note: {where.name} has no control rules; rules is shortest there")
        settings = settings_of(where, runs, seed, task, learned)
        folder = None
        if out is not None:
            require_libraries(".png")  # before the work, not after it
            folder = EvaluationFolder(out, settings)
        with closing(_executor(ray, threads)) as executor:
            results = compare(
                entries, where, schemes, runs=runs, seed=seed, threads=threads, folder=folder, executor=executor
            )
        figures = summary(results, where, settings, task)
        if folder is not None:
            write_json(folder.folder / "rows.json", figures)
            folder.write_runs(results, HELD_OUT_SEED + seed)
            pictures = folder.draw(results, where)
            say(f"rows.json, runs.csv and {len(pictures)} pictures: {folder.folder}/")
    title = run_title(where, people=f"{where.population.people} people", runs=f"{runs} runs each")
    title += "" if learned is None else f", {100 * learned:g} % learned"
    lines = report.ranking_lines(results)
    if task is None:
        tables = [report.times_table(results, title), report.left_table(results)]
    else:
        starts = {one.name: starts_from(str(one.source or one.name)) for one in entries}
        heading = f"{task.name}, version {task.version}: {title}"
        tables = [report.task_table(by_scheme(results), heading, starts=starts)]
        lines += credible_lines(figures["rows"])
    _tell(figures, None, as_json, [*tables, report.exits_table(results), report.crowding_table(results)], lines)


def _first_given(given: Plain) -> str | None:
    """Return the first option that the command line gives, if any."""
    return next((name for name, value in given.items() if value is not None), None)


def _executor(ray: bool, threads: int) -> Executor:
    """Return what simulates: a cluster of whose cores a batch takes as many as it has threads, or this process."""
    return RayCluster(threads) if ray else Serial()


def _tell(
    figures: Plain, file: Path | None, as_json: bool, tables: Sequence[Table | None], lines: Sequence[str] = ()
) -> None:
    """Write figures into a file, if there is one; print them as one JSON object, or as tables with lines below them."""
    if file is not None:
        write_json(file, figures)
    if as_json:
        typer.echo(json.dumps(figures, allow_nan=False))
        return
    console = report.table_console()
    console.print(*(table for table in tables if table is not None))
    for line in lines:
        console.print(line, soft_wrap=True)
