"""The folder of ``crowd-env run --out``, and how a command is run again from the config in it."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import typer

from crowd_env.analysis.results.config import FREE, require_data, run_config
from crowd_env.analysis.results.folder import CROWDING, KEPT, ResultsFolder
from crowd_env.analysis.sections import Place
from crowd_env.cli.place import CrowdOptions, Setting, named_now
from crowd_env.core.checks import Plain, check_keys, counted
from crowd_env.core.console import check_folder, friendly_errors, say
from crowd_env.core.files.json_file import read_json
from crowd_env.core.files.store import difference
from crowd_env.envs.rollout import Episode
from crowd_env.rendering.libraries import require_libraries
from crowd_env.scenarios.scenario import Scenario

CURVES = "nt.png"


@dataclass(frozen=True)
class _Kept(CrowdOptions):
    """Options that decide the results: what a config keeps of a command line."""

    runs: int = 1
    until: str | None = None
    seed: int = 0


def again(context: typer.Context, path: Path | None) -> Path | None:
    """Take the options of a config for those that the command line leaves out: the callback of ``--config``."""
    if path is not None and not context.resilient_parsing:
        with friendly_errors():
            config = read_json(path)
            arguments = config.get("arguments") if isinstance(config, dict) else None
            if not isinstance(arguments, dict):
                raise ValueError(f"--config {path}: this is no config of crowd-env run, as it writes it into --out")
            arguments = named_now(arguments)
            check_keys(f"--config {path}: arguments", arguments, [one.name for one in fields(_Kept)])
            require_data(f"--config {path}: arguments", _Kept, arguments)
            context.default_map = {**(context.default_map or {}), **arguments}
    return path


def config_of(
    options: CrowdOptions, setting: Setting, *, runs: int, until: str | None, seed: int, like: Path | None = None
) -> dict[str, Any]:
    """Return all that decides the results of a command.

    Parameters
    ----------
    like : config that the command runs again; a note says in what this one differs.

    Raises
    ------
    ValueError
        If a file that the command names cannot be read.
    """
    place, physics, routing, led = setting
    given = {**vars(options), "runs": runs, "until": until, "seed": seed}
    arguments = {name: value for name, value in given.items() if value is not None}
    files = options.files()
    for name, file in files.items():  # wherever the config is taken up again
        arguments[name] = str(given[name]).replace(str(file), str(file.absolute()), 1)
    config = run_config(
        place,
        physics,
        routing,
        runs,
        seed=seed,
        command=["crowd-env", *sys.argv[1:]],
        arguments=arguments,
        files=[*files.values(), *filter(None, [options.drawing()])],
    )
    if "scheme" in files:
        config["law"] = config["files"][str(files["scheme"].absolute())]
    if led is not None:
        config["policy"] = {"name": led.name} | ({} if led.digest is None else {"sha256": led.digest})
    if like is not None:
        other = difference(read_json(like), config, FREE)
        if other:
            say(f"note: not what {like} says: {other}", "yellow")
    return config


def open_folder(
    context: typer.Context, out: Path, config: dict[str, Any], place: Scenario
) -> tuple[ResultsFolder, list[Episode]]:
    """Return the folder, which is this command's alone, and the runs in it, after saying how many there are.

    Raises
    ------
    ValueError
        If it cannot be written, holds something else or a link, or another command writes there.
    """
    check_folder("--out", out)
    for name in (KEPT, CROWDING, "recordings"):
        if (out / name).is_symlink():
            raise ValueError(f"--out {out}: {name} in it is a link, through which runs would be written elsewhere")
    folder = ResultsFolder(out, config, place)
    context.with_resource(folder.alone())
    finished = folder.finished()
    if finished:
        runs = counted(config["runs"], "run", "runs")
        say(f"{out}: {len(finished)} of {runs} are finished")
    try:
        require_libraries(".png")
    except ModuleNotFoundError as error:
        say(f"no {CURVES}: {error}", "yellow")
    return folder, finished


def keep_in(folder: ResultsFolder) -> Callable[[Sequence[Episode]], None]:
    """Return what keeps finished runs; a folder that cannot be written stops no run: the figures are still to be told."""
    writes = True

    def keep(episodes: Sequence[Episode]) -> None:
        nonlocal writes
        try:
            if writes:
                folder.keep_runs(episodes)
        except OSError as error:
            writes, why = False, error.strerror or error
            say(f"note: cannot write into {folder.folder}: {why}", "yellow")

    return keep


def write_results(
    folder: ResultsFolder, title: str, figures: Plain, episodes: Sequence[Episode], places: Sequence[Place]
) -> None:
    """Write everything there is of the runs, and say where it is.

    Raises
    ------
    OSError
        If something cannot be written.
    """
    paths = folder.finish(episodes, figures, places)
    try:
        from crowd_env.rendering import egress_curves, save_figure

        times = {"last out": [one.exit_time[one.came] for one in episodes]}
        entries = {"last out": [one.entries for one in episodes]}
        paths.append(save_figure(egress_curves(times, title=title, entries=entries), folder.folder / CURVES))
    except ModuleNotFoundError:
        pass  # said before the work
    say(f"files: {', '.join(str(path) for path in paths)}")
