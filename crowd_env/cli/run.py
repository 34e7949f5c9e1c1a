"""The command ``crowd-env run``: many evacuations under a bar, on all cores, and what an interruption has left of them."""

import itertools
import json
import shlex
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from rich.text import Text

from crowd_env.analysis.by_hand import by_hand
from crowd_env.analysis.figures import FEWEST, cells, doubts, report, runs_enough
from crowd_env.analysis.plan_check import check_place, spot
from crowd_env.analysis.results.crowding import CrowdingRecorder
from crowd_env.analysis.sections import CrossingRecorder, flows_at, places_of
from crowd_env.analysis.storeys import storeys_of
from crowd_env.analysis.ways_out import remarks_on
from crowd_env.cli import options
from crowd_env.cli.console import show_table
from crowd_env.cli.place import CrowdOptions, Setting, setting_of
from crowd_env.cli.results_folder import again, config_of, keep_in, open_folder, write_results
from crowd_env.core.checks import Range, counted, whole
from crowd_env.core.console import friendly_errors, interrupted, literal_console, noted, progress_bar, say
from crowd_env.core.executors import Processes, all_cores
from crowd_env.core.files.own import names_own
from crowd_env.envs.rollout import Episode, Recorder, Recorders, RunsInterrupted, run_episodes
from crowd_env.envs.tasks.task import HELD_OUT_SEED, named_task
from crowd_env.scenarios.titles import run_title

app = options.new_app()

EXAMPLES = """Examples:

crowd-env run room-v0 --scheme nsm2 --runs 50 --json

crowd-env run my_room.wkt --exit 5,2,5,3 --people 40 --set speed=1.5

crowd-env run my_room.wkt --exit 5,2,5,3 --people 40 --time-limit 600 --out results
"""
_CONFIG = "Run what the config.json of an --out says; options beside it come first."
_OUT = (
    "Folder for tables of all runs and people, N(t) and what was run; the same command goes on there. film, replay, "
    "forces, report and clogging look at it."
)
_RECORD = "Record the first N runs, or all, into --out: who is where when; default 1."
_NO_CONTACTS = "Record no contacts and forces: smaller files."


@app.command(epilog=EXAMPLES)
def run(
    context: typer.Context,
    scenario: options.PlaceName = "room-v0",
    exit: options.Exits = None,
    unit: options.Unit = None,
    section: options.Sections = None,
    people: options.PeopleCount = None,
    starts: options.Starts = None,
    walking: options.WalkingName = None,
    routing: options.RoutingName = None,
    policy: options.PolicyName = None,
    scheme: options.SchemeName = None,
    set: options.Changes = None,
    runs: options.Runs = 50,
    until: options.Until = None,
    seed: options.Seed = 0,
    time_limit: options.TimeLimit = None,
    workers: options.Workers = None,
    config: Annotated[Path | None, options.of_runs(_CONFIG, is_eager=True, callback=again)] = None,
    out: Annotated[Path | None, options.of_output(_OUT)] = None,
    record: Annotated[str | None, options.of_output(_RECORD, metavar="N|all")] = None,
    contacts: Annotated[bool, options.of_output(_NO_CONTACTS, names=(" /--no-contacts",), show_default=False)] = True,
    as_json: options.AsJson = False,
) -> None:
    """Evacuate a place many times and report how it went; keep the runs in a folder."""
    given = dict(locals())
    with friendly_errors():
        asked = CrowdOptions.among(given)
        for name in ("scheme", "policy"):  # a folder that somebody sent is data
            text, source = getattr(asked, name), context.get_parameter_source(name)
            if str(getattr(source, "name", "")) != "COMMANDLINE" and names_own(str(text)):
                raise ValueError(f"--config {config} names the code {text}; to run it, give --{name} FILE.py:NAME too")
        recorded, share = _recorded(record, runs, out), _share(until)
        if named_task(scenario) is not None:  # as its environment, which folds such seeds
            free = Range(0, HELD_OUT_SEED - runs).because("later draws are held out, see crowd-env evaluate and show")
            whole("--seed", seed, free)
        with noted() as notes:
            setting = setting_of(asked)
        place, physics, ways, led = setting
        walk, start = place.longest_walk()
        if walk > place.time_limit:
            takes = f"it takes up to {walk:.0f} s to walk out; the time limit is {place.time_limit:g} s"
            say(f"note: from {spot(place.geometry, start)} {takes}")
        for remark in remarks_on(place, ways.strategy):
            say(f"note: {remark}", "yellow")
        here = config_of(asked, setting, runs=runs, until=until, seed=seed, like=config) | {"notes": notes}
        folder, kept = (None, []) if out is None else open_folder(context, out, here, place)
        check = check_place(place)
        places = places_of(check)
        seen: dict[str, Recorder] = {"sections": CrossingRecorder(places)} if places else {}
        if out is not None:
            seen["crowding"] = CrowdingRecorder(place.geometry)
            if recorded:
                from crowd_env.recording import RunRecorder
                from crowd_env.recording.formats import RECORDINGS

                facts = {"rules": ways.signs, **({} if led is None else {"policy": led.name})}
                path = out / RECORDINGS / ("run-0.sqlite" if len(recorded) == 1 else "run.sqlite")
                seen["recording"] = RunRecorder(path, runs=recorded, contacts=contacts, seed=seed, facts=facts)
                there = {one.run for one in kept if (out / RECORDINGS / f"run-{one.run}.sqlite").exists()}
                recorded = recorded - there
        begin = time.monotonic()
        done = evacuate(
            setting,
            runs,
            until=share,
            seed=seed,
            workers=workers,
            recorder=Recorders(**seen) if seen else None,
            recorded=recorded,
            kept=kept,
            keep=None if folder is None else keep_in(folder),
        )
        figures = report(place, physics.law, done.episodes, dt=physics.dt, strategy=ways.strategy)
        figures["sections"] = flows_at(places, done.episodes)
        storeys = storeys_of(place.geometry, places, done.episodes, figures)
        if storeys:
            figures["storeys"] = {one.sheet.name: one.figures for one in storeys}
        if not place.goes_on:
            figures["by_hand"] = by_hand(place, check, ways.strategy)
        if led is not None:
            figures["policy"] = led.name
        if share is not None:
            figures |= {"until": share, "enough": done.enough is not None}
        if done.stopped is not None:
            figures["interrupted_of"] = done.stopped.runs
        figures["doubts"] = doubts(figures)
    # Before anything is written: what has been computed must not be lost with it.
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        who = counted(figures["people"], "person", "people"), counted(figures["runs"], "run", "runs")
        many = f"up to {who[0]}" if "came" in figures else who[0]
        title = run_title(place, physics.law.info.name, people=many, runs=who[1])
        title += "" if led is None else f", led by {led.name}"
        took = f"{time.monotonic() - begin:.1f} s of computing"
        settings = f"seed {seed}, step {figures['dt']:g} s, {figures['strategy']}; {took}"
        show_table(title, {"": cells(place, figures)}, caption=settings)
        if figures["doubts"]:
            literal_console().print(Text.assemble(("check:", "yellow"), f" {figures['doubts']}"), soft_wrap=True)
    with friendly_errors():
        recordings = {number: records["recording"] for number, records in sorted(done.records.items())}
        for number, record_of in recordings.items():
            if isinstance(record_of, OSError):
                say(f"note: run {number} is not recorded: {record_of}", "yellow")
        if folder is not None:
            if done.enough is not None:
                folder.end_at(done.enough)
            write_results(folder, run_title(place, physics.law.info.name), figures, done.episodes, places)
        for record_of in recordings.values():
            if not isinstance(record_of, OSError):
                say(f"recording: {record_of}")
        if done.stopped is not None:
            said = f"{done.stopped}; the figures are of these, and lean to short evacuations"
            interrupted(said if folder is None else f"{said}; to go on: {shlex.join(['crowd-env', *sys.argv[1:]])}")


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


def _share(until: str | None) -> float | None:
    """Return the share that ``--until`` asks for; None if it asks for nothing.

    Raises
    ------
    ValueError
        If it is no percentage.
    """
    if until is None:
        return None
    try:
        percent = float(until.removesuffix("%"))
    except ValueError:
        percent = -1.0
    if not until.endswith("%") or not 0.0 < percent < 100.0:
        raise ValueError(f"--until is {until!r}; it must be a percentage such as 2%")
    return percent / 100.0


_WORTH_A_PROCESS = 5.0  # s of work; a process takes seconds to start
_BATCHES = 8  # of a process: a batch is what an interruption loses, and by what the bar moves


class Evacuations(NamedTuple):
    """What came of a command's runs."""

    episodes: list[Episode]  # that were finished, in the order of their numbers
    stopped: RunsInterrupted | None  # the interruption, if they are not all
    records: dict[int, Any]  # what the recorder kept, by the numbers of the runs
    enough: int | None  # how many were enough, if that was asked for and found


def evacuate(
    setting: Setting,
    runs: int,
    *,
    seed: int = 0,
    until: float | None = None,
    workers: int | None = None,
    kept: Sequence[Episode] = (),
    keep: Callable[[Sequence[Episode]], object] | None = None,
    recorder: Recorder | None = None,
    recorded: Collection[int] = (),
) -> Evacuations:
    """Run evacuations under a bar; without a single one an interruption ends the command.

    One run comes first and alone, in this process: mistakes show at once, and what is not compiled is compiled once.

    Parameters
    ----------
    until : share of the mean evacuation time to which it has to be known; then no more runs are made, and only those that
        were needed count, however many were made at once.
    workers : most processes; default one a core.
    kept : runs that were finished before.
    keep : is given the runs that have just ended, with what was recorded of them.
    recorder : sees all runs, and keeps something of those that are ``recorded``, which are run again if they were kept.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, the crowd does not fit, or a process has died.
    """
    whole("runs", runs)
    place, physics, routing, led = setting
    driver = None if led is None else led.driver(place, physics=physics, routing=routing).settled()
    way: dict[str, Any] = {"physics": physics, "routing": routing, "seed": seed, "driver": driver}
    evacuated = partial(run_episodes, place, runs, recorder=recorder, **way)
    found = {episode.run: episode for episode in kept}
    records: dict[int, Any] = {}
    todo = [run for run in range(runs) if run not in found or run in recorded]
    stopped: RunsInterrupted | None = None
    with progress_bar(f"{run_title(place, physics.law.info.name)}, runs", len(todo)) as progress:

        def take(episodes: Sequence[Episode]) -> None:
            episodes = [one._replace(crossings=(one.record or {}).get("sections")) for one in episodes]
            records.update({episode.run: episode.record for episode in episodes if episode.run in recorded})
            found.update({episode.run: episode._replace(record=None) for episode in episodes})
            progress(len(episodes))
            if keep is not None:
                keep(episodes)

        try:
            begin = time.monotonic()
            if todo and _enough(found, until) is None:
                evacuated(only=todo[:1], keep=take)
            a_run = time.monotonic() - begin  # s
            rest = todo[1:]
            while rest and _enough(found, until) is None:
                now = rest if until is None else rest[: max(FEWEST, len(found) // 2)]
                rest = rest[len(now) :]
                work = a_run * len(now)
                processes = min(all_cores() if workers is None else workers, len(now))
                executor = Processes(processes) if processes > 1 and work > _WORTH_A_PROCESS else None
                at_once = -(-len(now) // (_BATCHES * processes))
                evacuated(only=now, keep=take, executor=executor, at_once=at_once)
        except KeyboardInterrupt:
            stopped = RunsInterrupted([found[run] for run in sorted(found)], runs)
    if stopped is not None and not found:
        interrupted(f"0 of {counted(runs, 'run', 'runs')} were finished")
    enough = None if stopped is not None else _enough(found, until)
    return Evacuations([found[run] for run in sorted(found)[:enough]], stopped, records, enough)


def _enough(found: Mapping[int, Episode], until: float | None) -> int | None:
    """Return how many of the first runs are enough; None if more are needed, or that is not asked for."""
    if until is None:
        return None
    first = itertools.takewhile(found.__contains__, itertools.count())
    return runs_enough(np.array([found[run].metrics.evacuation_time for run in first]), until)
