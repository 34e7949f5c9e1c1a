"""The command ``crowd-env run``."""

import json
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from crowd_env.cli.console import (
    AsJson,
    MannerName,
    OutlineOption,
    Runs,
    Seed,
    check_picture,
    counted,
    evacuate,
    friendly_errors,
    interrupted,
    notes,
    run_title,
    with_manner,
)
from crowd_env.cli.place import PLACES, Count, Exits, Radius, Speed, Starts, TimeLimit, Unit, read_place
from crowd_env.envs.rollout import report
from crowd_env.physics import SCHEMES, SOCIAL_FORCES, ContactScheme, make_scheme
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import MAX_SPEED

_LEAST_AROUND = 0.5  # m
_EXITS_SHOWN = 4


def run(
    scenario: Annotated[str, typer.Argument(help=PLACES)] = "room-v0",
    scheme: Annotated[str, typer.Option(help="Contact scheme: " + ", ".join(SCHEMES) + ".")] = "nsm2",
    runs: Runs = 50,
    exit: Exits = None,
    unit: Unit = None,
    n: Count = None,
    radius: Radius = None,
    speed: Speed = None,
    starts: Starts = None,
    time_limit: TimeLimit = None,
    social: Annotated[
        str | None,
        typer.Option(
            help=f"Social force: {', '.join(SOCIAL_FORCES)}; default the scheme's: hertz has one, others none."
        ),
    ] = None,
    dt: Annotated[
        float | None, typer.Option(help="Physics step in s; default the scheme's, 0.01 or (hertz) 0.001.")
    ] = None,
    strategy: Annotated[
        str,
        typer.Option(help="How people choose their way: shortest, nearest, fastest, comfortable, or a route or exit."),
    ] = "shortest",
    manner: MannerName = None,
    outline: OutlineOption = None,
    rules: Annotated[bool, typer.Option(" /--no-rules", help="Leave out the scenario's control rules.")] = True,
    seed: Seed = 0,
    film: Annotated[Path | None, typer.Option(help="Also film the first run: .gif or .mp4.")] = None,
    force_network: Annotated[
        Path | None,
        typer.Option(help="Also draw who presses on whom in the first run: .png, lines as wide as the force."),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(help="Moment of --force-network in s; default the end if the exits block, else the hardest push."),
    ] = None,
    around: Annotated[
        float | None,
        typer.Option(
            help="How far around the exit --force-network shows, in m; inf for all; default 3.5 in big places."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Evacuate a place many times, everyone walking as the strategy says, and report how it went.

    Examples: crowd-env run room-v0 --scheme nsm2 --runs 50 --json

    crowd-env run my_room.wkt --exit 5,2,5,3 --n 40 --film out.gif
    """
    with friendly_errors():
        if film is not None:
            from crowd_env.rendering.film import FORMATS

            check_picture("--film", film, tuple(FORMATS))
        _check_network(force_network, at, around)
        people: dict[str, Any] = {"count": n, "radius": radius, "speed": speed, "starts": starts}
        found = read_place(scenario, exits=exit, unit=unit, time_limit=time_limit, **people)
        place = with_manner(found, manner, outline)
        if at is not None and at > place.time_limit:
            raise ValueError(f"--at is {at:g} s; the evacuation ends after {place.time_limit:g} s at the latest")
        contact = make_scheme(scheme, social)
        options: dict[str, Any] = {"scheme": contact, "dt": dt, "strategy": strategy, "rules": rules}
        begin = time.monotonic()
        episodes, stopped = evacuate(run_title(place, scheme), place, runs, seed=seed, **options)
        figures = report(place, scheme, episodes)
        if stopped is not None:
            figures["interrupted_of"] = stopped.runs
    # Before any picture: what has been computed must not be lost with it.
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        Console().print(_table(place, figures, time.monotonic() - begin))
    with friendly_errors():
        if stopped is not None:
            interrupted(f"{stopped}; the figures are of these, and lean to short evacuations")
        if film is not None:
            from crowd_env.rendering import write_film
            from crowd_env.rendering.live import record

            write_film(film, record(place, title=run_title(place, contact.info.name), seed=seed, **options))
            notes.print(f"film: {film}", markup=False)
        if force_network is not None:
            _draw_network(force_network, place, contact, around, seed=seed, dt=dt, at=at)


def _check_network(path: Path | None, at: float | None, around: float | None) -> None:
    for option, value, least in (("--at", at, 0.0), ("--around", around, _LEAST_AROUND)):
        if value is not None and path is None:
            raise ValueError(f"{option} belongs to --force-network, which is not given")
        if value is not None and not (value > 0 and value >= least):
            raise ValueError(f"{option} is {value:g}; it must be {f'>= {least:g} m' if least else '> 0'}")
    if path is not None:
        check_picture("--force-network", path, (".png",))


def _draw_network(path: Path, place: Scenario, scheme: ContactScheme, around: float | None, **moment: Any) -> None:
    from crowd_env.rendering import write_force_network
    from crowd_env.rendering.forces.moment import forces_of_run

    forces = forces_of_run(place, scheme, **moment)
    write_force_network(path, forces, around=around, title=run_title(place, scheme.info.name))
    notes.print(f"forces: {path}, mean of 0.1 s until {forces.time:.1f} s", markup=False, soft_wrap=True)


def _table(place: Scenario, figures: dict[str, Any], seconds: float) -> Table:
    def number(value: float | None, digits: int = 2) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    def spread(figure: dict[str, Any]) -> str:
        return number(figure["mean"]) + ("" if figure["sd"] is None else f" ± {number(figure['sd'])}")

    evacuation, flow = figures["evacuation_time"], figures["flow"]
    people, runs = counted(figures["people"], "person", "people"), counted(figures["runs"], "run", "runs")
    title = run_title(place, figures["scheme"], people=people, runs=runs)
    table = Table(title=title, show_header=False, caption=f"{seconds:.1f} s of computing")
    x0, y0, x1, y1 = place.geometry.bounds
    table.add_row("plan", f"{place.geometry.area:.1f} m2 in {x1 - x0:.2f} m x {y1 - y0:.2f} m")
    table.add_row("exits", _widths(place))
    table.add_row("evacuation time", f"{spread(evacuation)} s")
    if evacuation["ci95"][0] is not None:
        table.add_row("  95 % interval of the mean", " to ".join(number(bound) for bound in evacuation["ci95"]) + " s")
    table.add_row("flow", f"{spread(flow)} 1/s")
    table.add_row("unfinished", _unfinished(figures))
    for blocked in figures["blocked"]:
        table.add_row(
            "  blocked", f"run {blocked['run']}: nobody out after {blocked['since']:.1f} s, {blocked['left']} left"
        )
    overlap = figures["overlap_mm"]
    table.add_row("overlap of bodies", f"mean {number(overlap['mean'])}, at most {number(overlap['max'])} mm")
    table.add_row("reach beyond a wall", f"at most {number(figures['outside_mm'])} mm")
    table.add_row("largest speed", _speed(figures["max_speed"]))
    out = counted(figures["escaped"], "person", "people")
    table.add_row(
        "outside of the plan", f"[bold red]{out}: these figures are void[/]" if figures["escaped"] else "nobody"
    )
    table.add_row("solver residual", f"at most {figures['residual']:.1e} m/s")
    return table


def _speed(most: float) -> str:
    """Return the largest speed, and whether it is the bound to which faster people are held."""
    return f"{most:.2f} m/s" + (" (the bound: some were pushed harder)" if most >= MAX_SPEED * (1 - 1e-12) else "")


def _widths(place: Scenario) -> str:
    """Return the exits with their widths."""
    widths: dict[str, float] = {}
    for name, (a, b) in zip(place.geometry.exit_names, place.geometry.exits, strict=True):
        widths[name] = widths.get(name, 0.0) + float(np.hypot(*(b - a)))
    shown = [f"{name} {width:.2f} m" for name, width in widths.items()]
    more = [f"and {len(shown) - _EXITS_SHOWN} more"] if len(shown) > _EXITS_SHOWN else []
    return ", ".join([*shown[:_EXITS_SHOWN], *more])


def _unfinished(figures: dict[str, Any]) -> str:
    people, runs = figures["unfinished"], figures["unfinished_runs"]
    low, high = (100.0 * bound for bound in figures["unfinished_share"]["ci95"])
    share = f", {100.0 * figures['unfinished_share']['mean']:.0f} % ({low:.0f} to {high:.0f} %)"
    return f"{counted(people, 'person', 'people')} in {counted(runs, 'run', 'runs')}" + (share if runs else "")
