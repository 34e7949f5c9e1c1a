"""Train a policy to lead a crowd out, and compare it with the rules: ``python train.py``, ``crowd-env train``."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.evaluation.report import table_console
from crowd_env.agents.evaluation.trained_run import draw, judge, tables
from crowd_env.agents.runs import check_name, new_folder
from crowd_env.agents.tasks import PRESETS
from crowd_env.agents.training_config import (
    RUNS,
    check_budget,
    check_config,
    check_libraries,
    default_config,
    extended,
    read_config,
    task_config,
    task_of,
)
from crowd_env.cli.console import MannerName, OutlineOption, complete_from
from crowd_env.cli.place import PLACES, Exits, Unit, complete_scenario, plan_options
from crowd_env.core.checks import known, whole
from crowd_env.core.console import friendly_errors, notes
from crowd_env.core.executors import check_cluster
from crowd_env.core.files.json_file import write_json
from crowd_env.physics import SCHEMES
from crowd_env.rendering.libraries import require_libraries
from crowd_env.scenarios import kind_of_place

_TASK = "competitive-door"
_OF_THE_MACHINE = ("runs", "root", "resume", "threads", "runners")  # options that do not belong to what is trained
_RUNS = 50  # held-out draws where there is no task


def train(folder: Path, config: dict[str, Any], threads: int = 1) -> bool:
    """Train, or go on training, in ``folder`` on so many threads; False if it was interrupted."""
    from crowd_env.agents.learned.native import train_here

    return train_here(folder, config, threads)


def train_with_rllib(folder: Path, config: dict[str, Any], threads: int = 1, runners: int | None = None) -> bool:
    """Train as `train` does, with RLlib on a Ray cluster, by so many runners."""
    from crowd_env.agents.learned.rllib.training import train_on_cluster

    return train_on_cluster(folder, config, runners, threads)


BACKENDS: dict[str, Callable[..., bool]] = {"native": train, "rllib": train_with_rllib}

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(
    context: typer.Context,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            show_default=_TASK,
            autocompletion=complete_from(PRESETS),
            help=f"What to train for, with its preset: {', '.join(PRESETS)}.  It is judged as it stands.",
        ),
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            autocompletion=complete_scenario, help=f"Instead of a task: the scenario to train and judge in.  {PLACES}"
        ),
    ] = None,
    exit: Exits = None,
    unit: Unit = None,
    people: Annotated[
        int | None,
        typer.Option(help="How many people to train a task, or on a floor plan, with.", show_default="preset's, or 20"),
    ] = None,
    scheme: Annotated[
        str | None,
        typer.Option(help="Contact scheme.", autocompletion=complete_from(SCHEMES), show_default="the task's, or nsm2"),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(help="Physics step of training in seconds.", show_default="the preset's, or the scheme's own"),
    ] = None,
    manner: MannerName = None,
    outline: OutlineOption = None,
    start: Annotated[
        str | None,
        typer.Option(
            show_default="the preset's, or rule",
            help="What learning starts from: rule, full speed along the way, or a policy of rules that is cloned: "
            "evolution, follow, density-cap, ...",
        ),
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(help="Training stops after this many minutes, if not by then done.", show_default="15"),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Training steps, summed over all pedestrian slots.", show_default="preset's")
    ] = None,
    envs: Annotated[int | None, typer.Option(help="Rooms simulated side by side.", show_default="preset's")] = None,
    seed: Annotated[int, typer.Option(help="Fixes draws and network; below 1000000.")] = 0,
    runs: Annotated[
        int | None,
        typer.Option(help="Held-out evacuations per policy in the table.", show_default=f"the task's, or {_RUNS}"),
    ] = None,
    threads: Annotated[
        int, typer.Option(help="Of the simulation; results do not depend on it.", show_default="2, or all cores")
    ] = min(2, os.cpu_count() or 1),
    backend: Annotated[
        str,
        typer.Option(help=f"What trains: {', '.join(BACKENDS)} (on the nodes of a Ray cluster, see docs/ray.md)."),
    ] = "native",
    runners: Annotated[
        int | None,
        typer.Option(help="Processes that simulate for rllib.", show_default="all cores of the cluster but one"),
    ] = None,
    name: Annotated[
        str, typer.Option(help="Folder below runs/; made from task or scenario, scheme and seed if not given.")
    ] = "",
    root: Annotated[Path, typer.Option(help="Where the folders of runs are.")] = Path("runs"),
    resume: Annotated[
        str, typer.Option(help="Name of a run to go on with; --minutes and --steps then are its budget in all.")
    ] = "",
) -> None:
    """Train a shared policy by PPO and compare it with the rules on the same held-out draws.

    Examples
    --------
    crowd-env train

    crowd-env train --task narrow-door --seed 1

    crowd-env train --scenario my_hall.toml --scheme dem --minutes 3

    crowd-env train --scenario my_office.dxf --people 40 --scheme dem --minutes 3
    """
    folder: Path | None = None

    def kept() -> str:
        elsewhere = "" if root == Path("runs") else f" --root {root}"
        program = "python train.py" if context.parent is None else context.command_path
        return "" if folder is None else f"go on with: {program} --resume {folder.name}{elsewhere}"

    with friendly_errors(kept):
        budget = {"minutes": minutes, "steps": steps, "envs": envs}
        check_budget(**{option: value for option, value in budget.items() if value is not None})
        whole("--threads", threads)
        if runs is not None:
            whole("--runs", runs, RUNS)
        known("backend", backend, BACKENDS)
        far = {} if runners is None else {"runners": whole("--runners", runners)}
        check_libraries()
        require_libraries(".png")
        given = _given(context)
        if "resume" in given:
            folder, config = _resumed(root, resume, given)
        else:
            config = _begun(given, seed) | {"backend": backend}
        if config["backend"] == "rllib":
            check_cluster()
        elif far:
            raise ValueError(f"--runners is {runners}: runners belong to --backend rllib; leave them out")
        if folder is None:
            check_config(config)
            who = "".join(f"-{one}" for one in (manner, outline) if one is not None)
            who += "" if backend == "native" else f"-{backend}"
            what = config["task"] or Path(config["scenario"]).stem
            folder = new_folder(root, name or f"{what}-{config['scheme']}{who}-seed{seed}")
        write_json(folder / "config.json", config)
        notes.print(f"writing to {folder}/")
        if not BACKENDS[config["backend"]](folder, config, threads, **far):
            raise KeyboardInterrupt
        if config["task"] is not None:
            _confirm(folder, config, threads)
        runs = runs or (_RUNS if config["task"] is None else task_of(config).runs)
        results = judge(folder, config, runs, threads)
        table_console().print(*tables(config, results))
        draw(folder, config, results)
    notes.print(f"model, config, results.json, figures and film: {folder}/")


def _confirm(folder: Path, config: dict[str, Any], threads: int) -> None:
    from crowd_env.agents.learned.confirmation import confirm

    confirm(folder, config, threads)


def _begun(given: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return the parameters of a new run from the options of the command line.

    Raises
    ------
    ValueError
        If task and scenario are both given, or something in them is unknown or out of range.
    """
    of_run = ("people", "scheme", "dt", "manner", "outline", "start", "minutes", "steps", "envs")
    options: dict[str, Any] = {option: given[option] for option in of_run if option in given}
    if "scenario" not in given:
        for name in ("exit", "unit"):
            if name in given:
                raise ValueError(f"--{name} is for floor plans in files; name one by --scenario")
        return task_config(given.get("task", _TASK), seed, **options)
    if "task" in given:
        raise ValueError(
            f"--scenario is {given['scenario']}, but --task {given['task']} says where people walk; leave one out"
        )
    place = {"options": plan_options(given["scenario"], given.get("exit"), given.get("unit"))}
    if "people" in given and kind_of_place(given["scenario"]) != "plan":
        raise ValueError(f"--people is {given['people']}: a scenario says how many there are; leave it out")
    usual: dict[str, Any] = {"scheme": "nsm2", "envs": 64, "steps": 16_000_000, "minutes": 7.5}
    start_with = options.pop("start", RULE)
    return default_config(given["scenario"], seed=seed, **(usual | options | place)) | {"start": start_with}


def _given(context: typer.Context) -> dict[str, Any]:
    """Return the options that were written on the command line."""
    return {
        name: value
        for name, value in context.params.items()
        if str(getattr(context.get_parameter_source(name), "name", "")) == "COMMANDLINE"
    }


def _resumed(root: Path, resume: str, given: dict[str, Any]) -> tuple[Path, dict[str, Any]]:
    """Return folder and parameters of a run that is gone on with."""
    from crowd_env.agents.learned.training import read_curve

    check_name(resume)
    if "name" in given:
        raise ValueError(f"--name {given['name']} beside --resume {resume}: a run keeps its name; leave --name out")
    folder = root / resume
    config = read_config(folder / "config.json")
    curve = read_curve(folder / "learning_curve.csv")
    if (folder / "checkpoint.zip").exists() or (folder / "best.npz").exists():
        raise ValueError(f"{folder} was written by an earlier version, which this one cannot go on with")
    of_run = {option: value for option, value in given.items() if option not in _OF_THE_MACHINE}
    return folder, extended(config, of_run, curve, resume)
