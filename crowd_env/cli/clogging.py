"""The command ``crowd-env clogging``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from crowd_env.analysis.clogging import Clogging, RunExits, clogging, exits_of_run, powerlaw_library
from crowd_env.analysis.exit_times import read_exits, write_exits, write_gaps
from crowd_env.analysis.figures import number, percent, share
from crowd_env.cli.console import AsJson, Runs, Seed, Workers, show_table
from crowd_env.cli.evacuations import evacuate
from crowd_env.cli.place import (
    PLACES,
    Changes,
    CrowdName,
    Exits,
    PeopleCount,
    PhysicsName,
    Unit,
    complete_scenario,
    place_of,
)
from crowd_env.core.arrays.headway import plain_manner
from crowd_env.core.arrays.outline import plain_outline
from crowd_env.core.checks import counted
from crowd_env.core.console import check_folder, friendly_errors, interrupted, notes
from crowd_env.envs.rollout import Episode, RunsInterrupted
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import ContactScheme
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.titles import run_title

EXAMPLES = """Examples:

crowd-env clogging --set speed=1.5 --runs 10

crowd-env clogging lin-room-v0 --set speed=1.5 --times experiment.csv --out clogging

crowd-env clogging --times results/exits.csv
"""


def clog(
    context: typer.Context,
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO",
            autocompletion=complete_scenario,
            help=f"{PLACES}  By default lin-room-v0, or with --times none.",
        ),
    ] = None,
    exit: Exits = None,
    unit: Unit = None,
    people: PeopleCount = None,
    crowd: CrowdName = None,
    physics: PhysicsName = "hertz",
    set: Changes = None,
    runs: Runs = 10,
    seed: Seed = 0,
    workers: Workers = None,
    times: Annotated[
        list[Path] | None,
        typer.Option(
            help="CSV file of recorded exits, columns run,time (out = 0: watched until then with people inside); may be "
            "repeated, and stand beside a scenario."
        ),
    ] = None,
    pause: Annotated[float, typer.Option(help="A gap of this many seconds ends a burst.")] = 2.0,
    per_exit: Annotated[bool, typer.Option("--per-exit", help="Gaps between people who took the same exit.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for exits.csv, gaps.csv and survival.png.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure how a crowd clogs: gaps between exits, bursts, and the exponent of the tail of the gaps.

    The last gap of a run that ends with people inside is open, longer than what was seen: it is counted beside the closed ones.
    """
    with friendly_errors():
        if out is not None:
            check_folder("--out", out)
        powerlaw_library()  # is missed now, not after the work
        sets = _recorded(times or [])
        blocked_after = 120.0
        episodes: list[Episode] = []
        stopped: RunsInterrupted | None = None
        if scenario is not None or not sets:
            place, scheme, options = place_of({**context.params, "scenario": scenario or "lin-room-v0"})
            name = _name(place, scheme)
            blocked_after = place.blocked_after if np.isfinite(place.blocked_after) else blocked_after
            episodes, stopped, _ = evacuate(name, place, runs, seed=seed, workers=workers, scheme=scheme, **options)
            sets = {name: [exits_of_episode(episode, place.geometry) for episode in episodes], **sets}
        found = {
            name: clogging(data, pause=pause, per_exit=per_exit, blocked_after=blocked_after)
            for name, data in sets.items()
        }
        paths = [] if out is None else _write(out, found, sets, [episode.seed for episode in episodes], per_exit)
    if as_json:
        rows = [{"name": name, "manner": None, "outline": None, **_figures(each)} for name, each in found.items()]
        if episodes:  # the simulated runs are the first set
            rows[0]["manner"] = plain_manner(place.manner_of_run())
            rows[0]["outline"] = plain_outline(place.outline_of_run())
        typer.echo(json.dumps({"sets": rows}))
    else:
        _show(found)
    if paths:
        notes.print(f"files: {', '.join(str(path) for path in paths)}", markup=False, soft_wrap=True)
    if stopped is not None:
        interrupted(f"{stopped}; the figures are of these")


def exits_of_episode(episode: Episode, geometry: Geometry) -> RunExits:
    """Return when the people of an evacuation got out, and by which exits."""
    names = np.array([*geometry.exit_names, ""])  # the last one, row -1, is for people who did not get out
    return exits_of_run(episode.exit_time, episode.end, names[episode.exit_index])


def _recorded(paths: Sequence[Path]) -> dict[str, list[RunExits]]:
    """Return the runs of files by their names, or by their whole paths where names are the same."""
    names = [path.name for path in paths]
    return {path.name if names.count(path.name) == 1 else str(path): read_exits(path) for path in paths}


def _name(place: Scenario, scheme: ContactScheme) -> str:
    speed = place.population.desired_speed
    range = f"{speed.low:g}" if speed.low == speed.high else f"{speed.low:g} to {speed.high:g}"
    return f"{run_title(place, scheme.info.name)}, {counted(place.population.people, 'person', 'people')}, {range} m/s"


def _write(
    out: Path, found: dict[str, Clogging], sets: dict[str, list[RunExits]], seeds: Sequence[int], per_exit: bool
) -> list[Path]:
    from crowd_env.rendering.survival import survival_curves

    try:
        paths = [write_gaps(out / "gaps.csv", sets, per_exit=per_exit)]
        if seeds:  # the simulated runs are the first set
            paths.append(write_exits(out / "exits.csv", next(iter(sets.values())), seeds))
        if any(each.gaps.closed.any() for each in found.values()):
            title = next(iter(found)) if len(found) == 1 else "Gaps between exits"
            labels = {"all runs" if len(found) == 1 else name: each for name, each in found.items()}
            paths.append(survival_curves(out / "survival.png", labels, title=title))
        else:
            notes.print("no figure: there is no gap to draw", style="yellow")
    except OSError as error:
        raise ValueError(f"cannot write the results: {error}") from None
    return paths


def _show(found: dict[str, Clogging]) -> None:
    show_table("", {name: _cells(each) for name, each in found.items()}, sections=(3, 9, 12))
    for name, each in found.items():
        typer.echo(f"* {name}: {each.statement()}." if len(found) > 1 else f"{each.statement()}.")


def _figures(found: Clogging) -> dict[str, Any]:
    """Return the figures ready for JSON, with Wilson's interval of the share of blocked runs."""
    return {**found.as_json(), "blocked_share": share(found.blocked, found.runs)}


def _cells(found: Clogging) -> dict[str, str]:
    """Return the rows of the table."""
    figures = _figures(found)
    gaps, bursts, tail = figures["gaps"], figures["bursts"], figures["tail"] or {}
    opened = f", longest above {gaps['longest_open']:.1f} s" if gaps["open"] else ""
    return {
        "runs": str(found.runs),
        "  unfinished, of these blocked": f"{found.unfinished}, {found.blocked}",
        "  share blocked, 95 %": f"{percent(figures['blocked_share'])} %",
        "people out": str(found.exits),
        "gaps": str(gaps["count"]),
        "  mean": number(gaps["mean"], "s"),
        "  standard deviation / mean": number(gaps["cv"]),
        "  90 % are below": number(gaps["q90"], "s"),
        "  longest": number(gaps["max"], "s"),
        "  open at the end": f"{gaps['open']}{opened}",
        f"bursts (gaps below {found.pause:g} s)": str(bursts["count"]),
        "  mean size": number(bursts["mean_size"], "people"),
        "  largest": number(bursts["max_size"], "people", 0),
        "exponent of the tail": number(tail.get("alpha")) + (f" ± {tail['error']:.2f}" if tail else ""),
        "  if open gaps count as longer": number(tail.get("alpha_open")),
        "  from (x_min)": number(tail.get("x_min"), "s"),
        "  gaps in the tail": number(tail.get("n"), digits=0),
        "  Kolmogorov-Smirnov distance": number(tail.get("distance"), digits=3),
        "  log-likelihood ratio to an exponential": number(tail.get("ratio"), digits=1),
        "    p": number(tail.get("p"), digits=3),
    }
