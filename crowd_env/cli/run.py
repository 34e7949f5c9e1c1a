"""The command ``crowd-env run``."""

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from crowd_env.analysis.results.report import doubts, report
from crowd_env.cli.completion import complete_from
from crowd_env.cli.console import (
    OF_OUTPUT,
    OF_PEOPLE,
    OF_PHYSICS,
    OF_RUNS,
    AsJson,
    MannerName,
    OutlineOption,
    Runs,
    Seed,
    Workers,
)
from crowd_env.cli.evacuations import evacuate
from crowd_env.cli.figures_table import figures_table
from crowd_env.cli.films import FilmFps, FilmSpeed, FilmWidth
from crowd_env.cli.first_run import Film, FirstRun, ForceNetwork, Output
from crowd_env.cli.place import (
    PLACES,
    Count,
    Exits,
    Radius,
    Speed,
    Starts,
    TimeLimit,
    Unit,
    complete_scenario,
    read_place,
)
from crowd_env.cli.recording_file import RecordingFile
from crowd_env.cli.replay import Html
from crowd_env.cli.results_folder import again, config_of, how_to_go_on, keep_in, open_folder, write_results
from crowd_env.core.console import friendly_errors, interrupted, notes
from crowd_env.physics import SCHEMES, SOCIAL_FORCES, make_scheme
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios.titles import with_manner

EXAMPLES = """Examples:

crowd-env run room-v0 --scheme nsm2 --runs 50 --json

crowd-env run my_room.wkt --exit 5,2,5,3 --n 40 --film out.gif

crowd-env run my_room.wkt --exit 5,2,5,3 --n 40 --out results
"""


def run(
    context: typer.Context,
    scenario: Annotated[str, typer.Argument(help=PLACES, autocompletion=complete_scenario)] = "room-v0",
    exit: Exits = None,
    unit: Unit = None,
    n: Count = None,
    radius: Radius = None,
    speed: Speed = None,
    starts: Starts = None,
    manner: MannerName = None,
    outline: OutlineOption = None,
    strategy: Annotated[
        str,
        typer.Option(
            help="How people choose their way: shortest, nearest, fastest, comfortable, or a route or exit.",
            autocompletion=complete_from(STRATEGIES),
            rich_help_panel=OF_PEOPLE,
        ),
    ] = "shortest",
    rules: Annotated[
        bool, typer.Option(" /--no-rules", help="Leave out the scenario's control rules.", rich_help_panel=OF_PEOPLE)
    ] = True,
    scheme: Annotated[
        str,
        typer.Option(
            help="Contact scheme: " + ", ".join(SCHEMES) + ".",
            autocompletion=complete_from(SCHEMES),
            rich_help_panel=OF_PHYSICS,
        ),
    ] = "nsm2",
    social: Annotated[
        str | None,
        typer.Option(
            autocompletion=complete_from(SOCIAL_FORCES),
            help=f"Social force: {', '.join(SOCIAL_FORCES)}; default the scheme's: hertz has one, others none.",
            rich_help_panel=OF_PHYSICS,
        ),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(
            help="Physics step in s; default the scheme's, 0.01 or (hertz) 0.001.", rich_help_panel=OF_PHYSICS
        ),
    ] = None,
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
            help="Folder for tables of all runs and people, N(t) and what was run; the same command goes on there.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    film: Annotated[
        Path | None,
        typer.Option(
            help="Also film the first run: .mp4 or .gif; of a name without suffix, or a folder, the smaller one that can be "
            "written.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    film_width: FilmWidth = None,
    film_fps: FilmFps = None,
    film_speed: FilmSpeed = None,
    html: Annotated[
        Path | None,
        typer.Option(help="Also make a web page that replays the first run: .html.", rich_help_panel=OF_OUTPUT),
    ] = None,
    force_network: Annotated[
        Path | None,
        typer.Option(
            help="Also draw who presses on whom in the first run: .png, lines as wide as the force.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(
            help="Moment of --force-network in s; default the end if the exits block, else the hardest push.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    around: Annotated[
        float | None,
        typer.Option(
            help="How far around the exit --force-network shows, in m; inf for all; default 3.5 in big places.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            help="Also record the first run, who is where when: .sqlite (JuPedSim) or .h5 (PedPy).",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    record_runs: Annotated[
        str | None,
        typer.Option(
            help="Record these runs in place of the first: 3, 0,3,7, 0-9 or all; several get a file each, NAME-3.sqlite.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    record_contacts: Annotated[
        bool,
        typer.Option(
            "--record-contacts", help="Record who touches whom, and with what forces, too.", rich_help_panel=OF_OUTPUT
        ),
    ] = False,
    every: Annotated[
        float | None,
        typer.Option(
            help="Time from one frame of --record to the next in s, a multiple of 0.1; default 0.1.",
            rich_help_panel=OF_OUTPUT,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Evacuate a place many times, everyone walking as the strategy says, and report how it went."""
    # Everything that can be made of the first run.
    possible: list[Output] = [
        Film(film, film_width, film_fps, film_speed),
        Html(html),
        ForceNetwork(force_network, at, around),
    ]
    recording = RecordingFile(record, record_runs, record_contacts, every)
    with friendly_errors():
        recording.check(runs)
        for output in possible:
            output.check()
        outputs = [output for output in possible if output.path is not None]
        people: dict[str, Any] = {"people": n, "radius": radius, "speed": speed, "starts": starts}
        found = read_place(scenario, exits=exit, unit=unit, time_limit=time_limit, **people)
        place = with_manner(found, manner, outline)
        contact = make_scheme(scheme, social)
        options: dict[str, Any] = {"dt": dt, "strategy": strategy, "rules": rules}
        first = FirstRun(place, contact, options, seed)
        recorders = [output.recorder(first) for output in outputs]
        here = config_of(context.params, place, contact, options)
        writer = recording.recorder(context, runs, seed, {"rules": rules})
        folder, kept = (None, []) if out is None else open_folder(context, out, here)
        begin = time.monotonic()
        done = evacuate(
            first.title,
            place,
            runs,
            seed=seed,
            workers=workers,
            first=recorders,
            recorder=writer,
            recorded=recording.numbers(runs),
            kept=kept,
            keep=None if folder is None else keep_in(folder),
            scheme=contact,
            **options,
        )
        figures = report(place, contact, done.episodes, dt=dt, strategy=strategy)
        if done.stopped is not None:
            figures["interrupted_of"] = done.stopped.runs
        figures["doubts"] = doubts(figures)
    # Before any picture: what has been computed must not be lost with it.
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        Console().print(figures_table(place, figures, time.monotonic() - begin))
        if figures["doubts"]:
            Console(highlight=False).print(f"[yellow]check:[/] {escape(figures['doubts'])}", soft_wrap=True)
    with friendly_errors():
        if folder is not None:
            write_results(folder, place, first.title, figures, done.episodes)
        for run in sorted(done.records):
            notes.print(f"recording: {done.records[run]}", markup=False, soft_wrap=True)
        if done.stopped is not None:
            said = f"{done.stopped}; the figures are of these, and lean to short evacuations"
            interrupted(said if folder is None else f"{said}; to go on: {how_to_go_on()}")
        for k, output in enumerate(outputs):
            assert done.first is not None  # every run is finished
            written = output.write(first, done.first._replace(record=done.first.record[k]))
            notes.print(written, markup=False, soft_wrap=True)
