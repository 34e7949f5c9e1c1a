"""The command ``crowd-env sweep``: evacuations at several values of an input, or of the usual inputs one at a time."""

import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from crowd_env.analysis.results.config import FREE
from crowd_env.analysis.results.folder import decode, encode
from crowd_env.analysis.sweep import HEADS, TIMES, Variant, by_effect, cells, figures_of, write_sweep
from crowd_env.cli import options
from crowd_env.cli.console import show_table
from crowd_env.cli.place import CrowdOptions, Setting, setting_of
from crowd_env.cli.results_folder import config_of
from crowd_env.cli.run import evacuate
from crowd_env.core.checks import POSITIVE, Plain, number, whole
from crowd_env.core.console import check_folder, friendly_errors, interrupted, noted, say
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.files.store import Store
from crowd_env.envs.rollout import Episode
from crowd_env.rendering.libraries import require_libraries
from crowd_env.scenarios.titles import run_title
from crowd_env.scenarios.variants import with_exit_widths, with_times

app = options.new_app()

_POINTS = 5  # of a range
_OPTIONS = ("people", "walking", "routing", "policy", "scheme", "time_limit")  # that a value may be of, beside --set
_DRAWN = {"speed": "desired_speed"}
_BASE = "as it is"
# What is varied, one at a time, where nothing is named; a delay has no factor where there is none.
USUAL = {
    "people": ("x0.8", "x1.2"),
    "speed": ("x0.8", "x1.2"),
    "radius": ("x0.9", "x1.1"),
    "response_time": ("x0.5", "x1.5"),
    "exit_width": ("x0.8", "x1.2"),
    "walking": ("calm", "eager"),
}
_DELAYS = ("0,30", "0,60")  # s, uniform

EXAMPLES = """Examples:

crowd-env sweep room-v0 door_width=0.8..2.4 --people 60 --out doors

crowd-env sweep office.toml cohorts.visitors.people=20,40,80

crowd-env sweep office.dxf, which of the usual inputs moves T95 most
"""
_INPUTS = (
    "Input and its values, a range of 5 or so many values, 50..200 or 50..200/4, or a list, 50,100: people, exit_width "
    "(m), walking, scheme, any number of --set, or a key of a scenario file. x0.8 is a factor. Default the usual inputs."
)
_OUT = "Folder for sweep.csv, sweep.png and all runs; the same command goes on there."


@app.command(epilog=EXAMPLES)
def sweep(
    context: typer.Context,
    scenario: options.PlaceName,
    inputs: Annotated[list[str] | None, typer.Argument(metavar="NAME=VALUES...", help=_INPUTS)] = None,
    exit: options.Exits = None,
    unit: options.Unit = None,
    people: options.PeopleCount = None,
    starts: options.Starts = None,
    walking: options.WalkingName = None,
    routing: options.RoutingName = None,
    policy: options.PolicyName = None,
    scheme: options.SchemeName = None,
    set: options.Changes = None,
    runs: options.Runs = 20,
    seed: options.Seed = 0,
    time_limit: options.TimeLimit = None,
    workers: options.Workers = None,
    out: Annotated[Path | None, options.of_output(_OUT)] = None,
    as_json: options.AsJson = False,
) -> None:
    """Vary an input over values, or several one at a time, with the same draws: how times follow, and what moves T95 most.

    Without an input the usual ones are varied, about the place as it is: a sensitivity analysis.
    """
    options_of = dict(locals())
    with friendly_errors():
        asked = CrowdOptions.among(options_of)
        whole("runs", runs)
        given = _inputs(inputs or ())
        with noted():
            base = setting_of(asked)
            points = list(_points(asked, base, given))
        store = None
        if out is not None:
            check_folder("--out", out)
            config = config_of(asked, base, runs=runs, until=None, seed=seed)
            store = Store(out, {name: one for name, one in config.items() if name not in FREE}, about="sweep.json")
            context.with_resource(store.alone())
        found = []
        for name, value, setting in points:
            episodes = _episodes(setting, f"{name}={value}", store, runs=runs, seed=seed, workers=workers)
            found.append(Variant(name, value, episodes))
    alone = len(given) == 1
    rows = [figures_of(one, found[0].episodes) for one in found]
    rows = rows if alone else [rows[0], *by_effect(rows[1:])]
    title = run_title(base.place, base.physics.law.info.name)
    if as_json:
        typer.echo(json.dumps({"scenario": base.place.name, "seed": seed, "base": found[0].value, "rows": rows}))
    else:
        found_cells = {f"{row['name']} {row['value']}".strip(): cells(row) for row in rows}
        heads = {head: {label: one[head] for label, one in found_cells.items()} for head in cells(rows[0])}
        show_table(
            title,
            heads,
            caption=f"means with their 95 % intervals; ΔT95 to {found[0].value}, paired run by run; seed {seed}",
        )
    if out is not None:
        with friendly_errors():
            paths = [write_sweep(out / "sweep.csv", rows)]
            try:
                require_libraries(".png")
                paths += _picture(out / "sweep.png", rows, title, alone)
            except ModuleNotFoundError as error:
                say(f"no sweep.png: {error}", "yellow")
            say(f"files: {', '.join(map(str, paths))}")


def _inputs(texts: Sequence[str]) -> dict[str, list[str]]:
    """Return the values of each input, as they are written; none named is the usual ones.

    Raises
    ------
    ValueError
        If one is not understood, or named twice.
    """
    found: dict[str, list[str]] = {}
    for text in texts:
        name, sign, values = (part.strip() for part in text.partition("="))
        first, dots, last = values.partition("..")
        if not (name and sign and values) or name in found:
            raise ValueError(f"{text}: this must be NAME=VALUES such as people=50..200, each name once")
        if dots:
            last, _, count = last.partition("/")
            low, high = (_number(text, one) for one in (first, last))
            many = whole(f"{text}: the number of values", int(count) if count.isdecimal() else count or _POINTS)
            steps = np.linspace(low, high, many)
            if all("." not in one for one in (first, last)) and name == "people":
                steps = np.unique(np.rint(steps))
            found[name] = [f"{one:.6g}" for one in steps]
        else:
            found[name] = [one.strip() for one in values.split(",")]
    return found


def _number(text: str, written: str) -> float:
    try:
        return number(text, float(written))
    except ValueError:
        raise ValueError(f"{text}: {written!r} is no number; a range is FROM..TO or FROM..TO/COUNT") from None


def _points(asked: CrowdOptions, base: Setting, given: dict[str, list[str]]) -> Iterator[tuple[str, str, Setting]]:
    """Yield input, value and setting of all that is run, first what others are compared with."""
    if len(given) != 1:
        yield "", _BASE, base
    for name, values in (given or USUAL).items():
        if not given and name == "response_time" and not any(p.response_time.high for p in base.place.population.parts):
            values = _DELAYS
        for value in values:
            try:
                yield name, value, _with(asked, base, name, value)
            except ValueError as error:
                if given:
                    raise
                say(f"note: {name}={value} is left out: {error}", "yellow")


def _with(asked: CrowdOptions, base: Setting, name: str, value: str) -> Setting:
    """Return the setting in which an input has another value."""
    factor = _number(f"{name}={value}", value[1:]) if value[:1] == "x" else None
    if name == "exit_width":
        width = number(name, _number(f"{name}={value}", value) if factor is None else factor, POSITIVE)
        return base._replace(place=with_exit_widths(base.place, lambda own: width if factor is None else own * width))
    if factor is not None:
        number(f"{name}={value}", factor, POSITIVE)
        return base._replace(place=with_times(base.place, _DRAWN.get(name, name), factor))
    if name in _OPTIONS:
        numbers: dict[str, Any] = {"people": round, "time_limit": float}
        given: dict[str, Any] = {name: numbers[name](_number(f"{name}={value}", value)) if name in numbers else value}
        return setting_of(replace(asked, **given))
    return setting_of(
        replace(asked, set=[*(one for one in asked.set or () if one.split("=")[0] != name), f"{name}={value}"])
    )


def _episodes(
    setting: Setting, label: str, store: Store | None, *, runs: int, seed: int, workers: int | None
) -> list[Episode]:
    """Return the runs of a setting, some from the folder."""
    made_by = {"of": fingerprint(setting.place, setting.physics, setting.routing)}
    names = [f"runs/{label}/{seed + run}".replace(" ", "_") for run in range(runs)]
    kept: list[Episode] = []
    if store is not None:
        read = (decode(run, store.load(name, made_by, redo=True)) for run, name in enumerate(names))
        kept = [one for one in read if one is not None]

    def keep(episodes: Sequence[Episode]) -> None:
        if store is not None:
            for one in episodes:
                store.keep(names[one.run], encode(one), made_by)

    done = evacuate(setting, runs, seed=seed, workers=workers, kept=kept, keep=keep)
    if done.stopped is not None:
        again = "" if store is None else f"; to go on: {shlex.join(['crowd-env', *sys.argv[1:]])}"
        interrupted(f"{label}: {done.stopped}{again}")
    return done.episodes


def _picture(path: Path, rows: Sequence[Plain], title: str, alone: bool) -> list[Path]:
    """Draw the curve of one input with numbers for values, or the effects of several inputs."""
    from crowd_env.rendering import effect_figure, learning_curve, save_figure

    if not alone:
        return [save_figure(effect_figure(rows[1:], title=title), path)]
    try:
        at = [float(row["value"].removeprefix("x")) for row in rows]
    except ValueError:
        say("no sweep.png: the values are names", "yellow")
        return []
    order = np.argsort(at, kind="stable")

    figures = {head: [rows[k][name] for k in order] for name, head in zip(TIMES, HEADS, strict=True)}
    middle, high = (
        {head: np.array([of(one) for one in ones], dtype=np.float64) for head, ones in figures.items()}
        for of in (lambda one: one["mean"], lambda one: one["ci95"][1])
    )
    errors = {head: high[head] - middle[head] for head in figures}
    name = str(rows[0]["name"])
    drawn = learning_curve(np.sort(at), middle, errors=errors, title=title, xlabel=name, ylabel="time [s]")
    return [save_figure(drawn, path)]
