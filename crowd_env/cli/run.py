"""The command ``crowd-env run``."""

import json
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from crowd_env.analysis.figures import cells, doubts, report
from crowd_env.cli.console import OF_OUTPUT, OF_RUNS, AsJson, Runs, Seed, Workers, show_table
from crowd_env.cli.evacuations import evacuate
from crowd_env.cli.place import (
    Changes,
    CrowdName,
    Exits,
    PeopleCount,
    PhysicsName,
    PlaceName,
    RoutingName,
    Starts,
    TimeLimit,
    Unit,
    place_of,
)
from crowd_env.cli.results_folder import again, config_of, how_to_go_on, keep_in, open_folder, write_results
from crowd_env.core.checks import counted
from crowd_env.core.console import friendly_errors, interrupted, notes
from crowd_env.scenarios.titles import run_title

EXAMPLES = """Examples:

crowd-env run room-v0 --physics nsm2 --runs 50 --json

crowd-env run my_room.wkt --exit 5,2,5,3 --people 40 --set speed=1.5

crowd-env run my_room.wkt --exit 5,2,5,3 --people 40 --out results
"""


def run(
    context: typer.Context,
    scenario: PlaceName = "room-v0",
    exit: Exits = None,
    unit: Unit = None,
    people: PeopleCount = None,
    starts: Starts = None,
    crowd: CrowdName = None,
    routing: RoutingName = "shortest",
    physics: PhysicsName = "nsm2",
    set: Changes = None,
    runs: Runs = 50,
    seed: Seed = 0,
    time_limit: TimeLimit = None,
    workers: Workers = None,
    config: Annotated[
        Path | None,
        typer.Option(
            help="Run what the config.json of an --out says; options beside it come first.",
            is_eager=True,
            callback=again,
            rich_help_panel=OF_RUNS,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for tables of all runs and people, N(t) and what was run; the same command goes on there. "
            "film, replay, forces and report look at it.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    record: Annotated[
        str | None,
        typer.Option(
            metavar="N|all",
            help="Record the first N runs, or all, into --out: who is where when; default 1.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    contacts: Annotated[
        bool,
        typer.Option(
            " /--no-contacts", help="Record no contacts and forces: smaller files.", rich_help_panel=OF_OUTPUT
        ),
    ] = True,
    as_json: AsJson = False,
) -> None:
    """Evacuate a place many times and report how it went; keep the runs in a folder."""
    with friendly_errors():
        recorded = _recorded(record, runs, out)
        place, scheme, options = place_of(context.params)
        here = config_of(context.params, place, scheme, options)
        folder, kept = (None, []) if out is None else open_folder(context, out, here)
        recorder = None
        if out is not None and recorded:
            from crowd_env.recording import RunRecorder
            from crowd_env.recording.formats import RECORDINGS

            facts = {"rules": options["rules"]}
            path = out / RECORDINGS / ("run-0.sqlite" if len(recorded) == 1 else "run.sqlite")
            recorder = RunRecorder(path, runs=recorded, contacts=contacts, seed=seed, facts=facts)
            there = {one.run for one in kept if (out / RECORDINGS / f"run-{one.run}.sqlite").exists()}
            recorded = recorded - there
        begin = time.monotonic()
        done = evacuate(
            run_title(place, scheme.info.name),
            place,
            runs,
            seed=seed,
            workers=workers,
            recorder=recorder,
            recorded=recorded,
            kept=kept,
            keep=None if folder is None else keep_in(folder),
            scheme=scheme,
            **options,
        )
        figures = report(place, scheme, done.episodes, dt=options["dt"], strategy=options["strategy"])
        if done.stopped is not None:
            figures["interrupted_of"] = done.stopped.runs
        figures["doubts"] = doubts(figures)
    # Before anything is written: what has been computed must not be lost with it.
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        who = counted(figures["people"], "person", "people"), counted(figures["runs"], "run", "runs")
        title = run_title(place, scheme.info.name, people=who[0], runs=who[1])
        settings = f"seed {seed}, step {figures['dt']:g} s, {routing}; {time.monotonic() - begin:.1f} s of computing"
        show_table(title, {"": cells(place, figures)}, caption=settings)
        if figures["doubts"]:
            Console(highlight=False).print(f"[yellow]check:[/] {escape(figures['doubts'])}", soft_wrap=True)
    with friendly_errors():
        if folder is not None:
            write_results(folder, place, run_title(place, scheme.info.name), figures, done.episodes)
        for number in sorted(done.records):
            notes.print(f"recording: {done.records[number]}", markup=False, soft_wrap=True)
        if done.stopped is not None:
            said = f"{done.stopped}; the figures are of these, and lean to short evacuations"
            interrupted(said if folder is None else f"{said}; to go on: {how_to_go_on()}")


def _recorded(record: str | None, runs: int, out: Path | None) -> frozenset[int]:
    """Return which of so many runs are recorded.

    Raises
    ------
    ValueError
        If the option is not understood, or there is no folder for the recordings.
    """
    if out is None:
        if record is None:
            return frozenset()
        raise ValueError("--record needs a folder: give --out too")
    if record not in (None, "all") and not (record.isdecimal() and int(record) <= runs):
        raise ValueError(f"--record is {record!r}; it must be all, or how many of the {runs} runs")
    return frozenset(range(runs if record == "all" else int(record or 1)))
