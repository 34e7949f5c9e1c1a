"""Train a policy to lead a crowd out, and compare it with the rules: ``python train.py``, ``crowd-env train``."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.agents import training_config
from crowd_env.agents.evaluation.report import table_console
from crowd_env.agents.evaluation.trained_run import draw, judge, judge_in_plans, tables
from crowd_env.agents.runs import new_folder
from crowd_env.agents.tasks import TASKS
from crowd_env.agents.training_config import TrainingConfig
from crowd_env.cli.agents.options import People, PlaceName, TaskName, Threads, changes, of_learning, task_or_place
from crowd_env.cli.options import ONE_SCHEME, Exits, Unit, WalkingName, of_output, of_people, of_physics, of_runs
from crowd_env.cli.place import CrowdOptions, plan_options, walking_of
from crowd_env.core.checks import Plain, known, number, whole
from crowd_env.core.console import friendly_errors, say
from crowd_env.core.executors import check_cluster
from crowd_env.core.files.json_file import write_json
from crowd_env.core.files.store import Store
from crowd_env.physics import SCHEMES
from crowd_env.rendering.libraries import require_libraries
from crowd_env.scenarios import kind_of_place

_TASK = "narrow-door"
_THREADS = min(2, os.cpu_count() or 1)
_DECIDES = ("walking", "routing")
_RUNS = 50  # held-out draws where there is no task
_PLANS = 200  # after a training in generated places
_ROUTING = {"interval": 2.0, "grid": [4, 2]}


def _grid(text: str) -> list[int]:
    columns, rows = (int(part) for part in text.split(","))
    return [columns, rows]


_SET: Mapping[str, Callable[[str], object]] = {
    "dt": float,
    "outline": str,
    "interval": float,
    "grid": _grid,
    "runners": int,
}


def train(folder: Path, config: TrainingConfig, threads: int = 1) -> bool:
    """Train, or resume training, in ``folder`` on ``threads`` threads; False if it was interrupted."""
    from crowd_env.agents.learned.training import train_here

    return train_here(folder, config, threads)


def train_with_rllib(folder: Path, config: TrainingConfig, threads: int = 1, runners: int | None = None) -> bool:
    """Train as `train` does, with RLlib on a Ray cluster, by ``runners`` processes."""
    from crowd_env.agents.learned.rllib.training import train_on_cluster

    return train_on_cluster(folder, config, runners, threads)


BACKENDS: dict[str, Callable[..., bool]] = {"native": train, "rllib": train_with_rllib}

_CHANGES = (
    "Change the step of the physics (dt), the shape of bodies (outline), where a controller decides (grid=4,2), "
    "how often (interval), or how many processes simulate for rllib (runners); may be repeated."
)
_WHO_DECIDES = "walking: a policy of everyone's steps; routing: a controller that sends people to exits."
_START = (
    "What learning starts from: rule, full speed along the way; nothing, what a search from there finds; "
    "or a policy of rules that is cloned: evolution, follow, density-cap, ..."
)
_STEPS = "Training steps, summed over all pedestrian slots, or over all controllers."
_RUNS_SAID = f"the task's, or {_RUNS}"
_BACKEND = f"What trains: {', '.join(BACKENDS)} (on the nodes of a Ray cluster)."
_FRESH = "Compute what the rules do, too, which ships with a task."
_RESUME = "Folder of a run to go on with; --minutes and --steps then are its budget in all."

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    context: typer.Context,
    task: TaskName = None,
    scenario: PlaceName = None,
    exit: Exits = None,
    unit: Unit = None,
    people: People = None,
    walking: WalkingName = None,
    set: Annotated[list[str] | None, of_people(_CHANGES, metavar="NAME=VALUE")] = None,
    scheme: Annotated[str | None, of_physics(ONE_SCHEME, "the task's, or nsm2", among=SCHEMES)] = None,
    decides: Annotated[str, of_learning(_WHO_DECIDES, among=_DECIDES)] = _DECIDES[0],
    start: Annotated[str | None, of_learning(_START, "the preset's, or rule")] = None,
    minutes: Annotated[float | None, of_learning("Training stops after so long.", "the preset's")] = None,
    steps: Annotated[int | None, of_learning(_STEPS, "the preset's")] = None,
    envs: Annotated[int | None, of_learning("Evacuations simulated side by side.", "the preset's")] = None,
    seed: Annotated[int, of_learning("Fixes draws and network; below 1000000.")] = 0,
    runs: Annotated[int | None, of_runs("Held-out evacuations per policy in the table.", _RUNS_SAID)] = None,
    fresh: Annotated[bool, of_runs(_FRESH, names=("--fresh",))] = False,
    threads: Threads = _THREADS,
    backend: Annotated[str, of_runs(_BACKEND)] = "native",
    out: Annotated[Path | None, of_output("Folder of the run.", "runs/, named after what is trained")] = None,
    resume: Annotated[Path | None, of_output(_RESUME)] = None,
) -> None:
    """Train a policy or a controller by PPO and compare it with the rules on the same held-out draws.

    Examples
    --------
    crowd-env train

    crowd-env train --task competitive-door --seed 1 --threads 4

    crowd-env train --task two-exit-hall --decides routing

    crowd-env train --scenario my_office.dxf --people 40 --scheme dem --minutes 3
    """
    folder: Path | None = None

    def kept() -> str:
        program = "python train.py" if context.parent is None else context.command_path
        return "" if folder is None else f"go on with: {program} --resume {folder}"

    with friendly_errors(kept):
        budget = {"minutes": minutes, "steps": steps, "envs": envs}
        training_config.check_budget(**{option: value for option, value in budget.items() if value is not None})
        whole("--threads", threads)
        if runs is not None:
            whole("--runs", runs, training_config.RUNS)
        known("backend", backend, BACKENDS)
        known("--decides", decides, _DECIDES)
        training_config.check_libraries()
        require_libraries(".png")
        given = _given(context) | changes(set, _SET)
        if (place := task_or_place(task, scenario)) is not None:
            given["place"] = place
        for name in ("set", "task", "scenario"):
            given.pop(name, None)
        if "dt" in given:
            number("--set dt", given["dt"], training_config.LEAST_DT, "s")
        far = {"runners": whole("--set runners", given.pop("runners"))} if "runners" in given else {}
        if resume is not None:
            folder, config = _resumed(context, resume, given)
        else:
            config = replace(_begun(given, seed), backend=backend)
        if config.backend == "rllib":
            check_cluster()
            if config.routing is not None:
                raise ValueError("--backend rllib trains policies of people's own steps; leave out --decides routing")
        elif far:
            raise ValueError(f"--set runners={far['runners']}: runners belong to --backend rllib; leave them out")
        if folder is None:
            training_config.check_config(config)
            folder = _new_folder(config, out)
            context.with_resource(Store(folder).alone())
        write_json(folder / "config.json", config.as_table())
        say(
            f"writing to {folder}/: training, at most {config.minutes:g} min; then fresh draws, the table, figures, a film"
        )
        if not BACKENDS[config.backend](folder, config, threads, **far):
            raise KeyboardInterrupt
        if config.places is not None:
            table_console().print(judge_in_plans(folder, config, runs or _PLANS, threads))
            return
        if config.task is not None:
            from crowd_env.agents.learned.significance_test import compare_with_start

            compare_with_start(folder, config, threads)
        runs = runs or (_RUNS if config.task is None else training_config.task_of(config).runs)
        results = judge(folder, config, runs, threads, fresh=fresh)
        table_console().print(*tables(config, results))
        say("drawing figures and a film, some seconds ...")
        draw(folder, config, results)
    say(f"model, config, results.json, figures and film: {folder}/")


def _begun(given: Plain, seed: int) -> TrainingConfig:
    """Return the parameters of a new run from the options of the command line.

    Raises
    ------
    ValueError
        If something in them is unknown or out of range.
    """
    asked = _asked(given)
    routing = given.get("decides") == "routing"
    own = {name: asked.pop(name) for name in _ROUTING if name in asked}
    if routing:
        asked["routing"] = _ROUTING | own
    elif own:
        raise ValueError(f"--set {next(iter(own))}: this belongs to --decides routing")
    place = given.get("place", _TASK)
    if place == training_config.GENERATED:
        ours = ("people", "envs", "steps", "minutes")
        if beside := [name for name in (*asked, *_ROUTING, "exit", "unit") if name in given and name not in ours]:
            raise ValueError(f"--{beside[0]}: --task generated draws its places itself; leave it out")
        return training_config.generalist_config(seed, **asked)
    if place in TASKS:
        for name in ("exit", "unit"):
            if name in given:
                raise ValueError(f"--{name} is for floor plans in files; name one by --scenario")
        return training_config.task_config(place, seed, **asked)
    if "people" in asked and kind_of_place(place) != "plan":
        raise ValueError(f"--people is {asked['people']}: a scenario says how many there are; leave it out")
    options = plan_options(CrowdOptions(scenario=place, exit=given.get("exit"), unit=given.get("unit")))
    usual: dict[str, Any] = {"scheme": "nsm2", "envs": 64, "steps": 16_000_000, "minutes": 7.5}
    usual |= training_config.ROUTING_BUDGET if routing else {}
    return training_config.default_config(place, seed=seed, options=options, **(usual | asked))


def _asked(given: Plain) -> dict[str, Any]:
    """Return the parameters of a run that options stand for."""
    names = {"walking": "manner"}
    of_run = ("people", "walking", "outline", "scheme", "dt", "start", "minutes", "steps", "envs", *_ROUTING)
    asked = {names.get(option, option): given[option] for option in of_run if option in given}
    return asked | ({"manner": walking_of(asked["manner"])} if "manner" in asked else {})


def _given(context: typer.Context) -> dict[str, Any]:
    """Return the options that were written on the command line."""
    return {
        name: value
        for name, value in context.params.items()
        if str(getattr(context.get_parameter_source(name), "name", "")) == "COMMANDLINE"
    }


def _new_folder(config: TrainingConfig, out: Path | None) -> Path:
    """Make and return the folder of a run."""
    if out is not None:
        return new_folder(out.parent, out.name)
    parts = [config.task or Path(config.scenario).stem, config.scheme]
    parts = parts if config.places is None else [training_config.GENERATED]
    parts += [] if config.routing is None else ["routing"]
    parts += [] if config.backend == "native" else [config.backend]
    return new_folder(Path("runs"), f"{'-'.join(parts)}-seed{config.seed}")


def _resumed(context: typer.Context, folder: Path, given: Plain) -> tuple[Path, TrainingConfig]:
    """Return folder and parameters of a run that is resumed, by this command alone."""
    from crowd_env.agents.learned.curve import CURVE, read_curve

    if "out" in given:
        raise ValueError(f"--out {given['out']} beside --resume {folder}: a run keeps its folder; leave --out out")
    folder = folder if (folder / "config.json").exists() else Path("runs") / folder
    context.with_resource(Store(folder).alone())
    config = training_config.read_config(folder / "config.json")
    own = {name: given[name] for name in ("place", "exit", "unit", "seed", "backend", "decides") if name in given}
    curve = read_curve(folder / CURVE)
    return folder, training_config.resumed(config, own | _asked(given), curve, folder.name)
