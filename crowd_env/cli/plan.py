"""The command ``crowd-env plan``: how a place was understood, as a picture and in figures."""

import json
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from crowd_env.analysis.plan_check import PlanCheck, check_plan, spot
from crowd_env.cli.console import AsJson, OutlineOption, check_picture
from crowd_env.cli.place import (
    PLACES,
    Count,
    Exits,
    Radius,
    Starts,
    Unit,
    changed_place,
    complete_scenario,
    people_options,
    plan_options,
)
from crowd_env.core.arrays.outline import make_outline, room_of
from crowd_env.core.checks import counted
from crowd_env.core.console import friendly_errors, notes, progress_bar
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios import kind_of_place
from crowd_env.scenarios.floor_plan import people_on, scenario_on
from crowd_env.scenarios.plans.reading import read_plan
from crowd_env.scenarios.titles import with_manner

_SHOWN = 12  # rows of a kind in the table


def plan(
    place: Annotated[
        list[str], typer.Argument(autocompletion=complete_scenario, help=f"{PLACES} Several make a sheet.")
    ],
    exit: Exits = None,
    unit: Unit = None,
    n: Count = None,
    radius: Radius = None,
    starts: Starts = None,
    outline: OutlineOption = None,
    out: Annotated[Path | None, typer.Option(help="Image to write, .png.", show_default="plan.png")] = None,
    seed: Annotated[int, typer.Option(help="Where people stand.", min=0)] = 0,
    as_json: AsJson = False,
) -> None:
    """Draw what is understood of a place, to check it before anything is run: exits, regions, people, narrow passages.

    A floor plan is drawn without exits too: read their coordinates off the axes, and give them with --exit.

    Examples: crowd-env plan floor-v0 --out floor.png

    crowd-env plan my_room.wkt --exit 5,2,5,3 --n 40
    """
    wanted = Path("plan.png") if out is None else out
    picture: Path | None = wanted
    with friendly_errors():
        try:
            check_picture("--out", wanted, (".png",), makes_folder=True)
        except ModuleNotFoundError as error:
            if out is not None:
                raise
            warnings.warn(f"figures alone, no picture: {error}", stacklevel=2)
            picture = None
        for option, given in (("--exit", exit), ("--starts", starts)):
            if given and len(place) > 1:
                raise ValueError(f"{option} is for one floor plan, but {len(place)} places are given")
        people = people_options(n, radius, None, starts, unit)
        checks, told = [], []
        with progress_bar("plans", 2 * len(place)) as progress:
            for name in place:
                check, said = _understood(name, exit or [], unit, people, outline, seed)
                checks.append(check)
                told.append(said)
                progress(1)
            if picture is not None:
                from crowd_env.rendering.sheet import draw_sheet

                draw_sheet(picture, checks)
            progress(len(place))
    if as_json:
        heads = [_figures(check, said) for check, said in zip(checks, told, strict=True)]
        typer.echo(json.dumps({"picture": picture and str(picture), "plans": heads}))
        return
    for check in checks:
        Console().print(_table(check))
    if picture is not None:
        notes.print(f"plan: {picture}", markup=False, soft_wrap=True)


def _understood(
    name: str, exits: list[str], unit: str | None, people: dict[str, Any], outline: str | None, seed: int
) -> tuple[PlanCheck, list[str]]:
    """Return a place as it was understood, and what was noted on the way."""
    said: list[str] = []
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", UserWarning)
            check = _check(name, exits, unit, people, outline, seed)
    finally:  # also those that lead up to a mistake
        said += dict.fromkeys(" ".join(str(warning.message).split()) for warning in told)
        for text in said:
            warnings.warn(text, stacklevel=2)
    return check, said


def _check(
    name: str, exits: list[str], unit: str | None, people: dict[str, Any], outline: str | None, seed: int
) -> PlanCheck:
    options = plan_options(name, exits, unit)
    if kind_of_place(name) == "plan":
        drawn = read_plan(name, **options)
        crowd = people_on(drawn, **people)
        if not drawn.exits:
            for note in drawn.notes:
                warnings.warn(note, stacklevel=2)
            try:
                geometry = Geometry.from_polygon(drawn.walkable, regions=drawn.regions)
            except ValueError as error:
                raise ValueError(f"{drawn.path}: {error}") from None
            title, room = f"floor plan {drawn.path.name}", room_of(make_outline(outline))
            return check_plan(drawn.path.stem, geometry, crowd, title=title, room=room, seed=seed)
        scenario = scenario_on(drawn, crowd)
    else:
        scenario = changed_place(name, people)
    scenario = with_manner(scenario, None, outline)
    return check_plan(
        scenario.name,
        scenario.geometry,
        scenario.population,
        title=scenario.title,
        room=room_of(scenario.outline_of_run()),
        seed=seed,
    )


def _figures(check: PlanCheck, said: list[str]) -> dict[str, Any]:
    """Return what is known of a place as plain data, lengths in meters and areas in square meters."""
    geometry = check.geometry
    passages = {
        name: None
        if passage is None
        else {
            "width": passage.gap.width,
            "line": passage.gap.line.tolist(),
            "is_exit": passage.is_exit,
            "share_of_people": passage.behind,
        }
        for name, passage in check.passages.items()
    }
    return {
        "name": check.name,
        "bounds": list(geometry.bounds),
        "area": geometry.area,
        "exits": [
            {
                "name": name,
                "width": width,
                "lines": [
                    line.tolist()
                    for line, other in zip(geometry.exits, geometry.exit_names, strict=True)
                    if other == name
                ],
                "narrowest_passage": passages[name],
            }
            for name, width in check.widths.items()
        ],
        "regions": {name: geometry.area_of(name) for name in geometry.regions},
        "doors": list(geometry.doors),
        "not_reached": [{"area": area, "at": _inside(part)} for part, area in check.unreached],
        "people": check.people.people,
        "body_diameter": list(check.body),
        "free_area": check.free_area,
        "capacity": check.capacity,
        "remarks": list(check.remarks),
        "notes": said,
    }


def _inside(part: Any) -> list[float]:
    at = part.representative_point()
    return [at.x, at.y]


def _table(check: PlanCheck) -> Table:
    geometry = check.geometry
    table = Table(title=check.name, show_header=False, title_justify="left")
    x0, y0, x1, y1 = geometry.bounds
    table.add_row("plan", f"{geometry.area:.1f} m2 in {x1 - x0:.2f} m x {y1 - y0:.2f} m")
    table.add_row("  x, y", f"{x0:.2f} to {x1:.2f} m, {y0:.2f} to {y1:.2f} m")
    exits = [f"{name} {width:.2f} m" for name, width in check.widths.items()]
    table.add_row("exits", _rows(exits) if exits else "[bold]none yet[/]: give --exit x1,y1,x2,y2, points on the edge")
    narrow = [_passage(check, name) for name in check.passages]
    if narrow:
        table.add_row("narrowest passage", _rows(narrow))
    if geometry.regions:
        table.add_row("regions", _rows([f"{name} {geometry.area_of(name):.1f} m2" for name in geometry.regions]))
    if geometry.doors:
        table.add_row("doors", _rows(list(geometry.doors)))
    for part, area in check.unreached[:_SHOWN]:
        x, y = _inside(part)
        table.add_row("no exit reaches", f"{area:.3g} m2 around ({x:.2f}, {y:.2f})")
    least, most = check.body
    body = f"{least:.2f} m" if most - least < 1e-9 else f"{least:.2f} to {most:.2f} m"
    table.add_row("people", f"{counted(check.people.people, 'person', 'people')}, bodies {body} wide")
    table.add_row("room for", f"at most {check.capacity} people on the {check.start_area:.1f} m2 where they start")
    table.add_row("  centers of bodies", f"{check.free_area:.1f} m2")
    for remark in check.remarks:
        table.add_row("[yellow]check[/]", remark)
    return table


def _passage(check: PlanCheck, name: str) -> str:
    passage = check.passages[name]
    if passage is None:
        return f"to {name}: no way"
    share = 100.0 * passage.behind
    where = "the exit itself" if passage.is_exit else f"at {spot(passage.gap)}, for {share:.0f} % of the people"
    return f"to {name}: {passage.gap.width:.2f} m, {passage.gap.width / check.body[1]:.1f} bodies, {where}"


def _rows(items: list[str]) -> str:
    more = [f"and {len(items) - _SHOWN} more"] if len(items) > _SHOWN else []
    return "\n".join([*items[:_SHOWN], *more])
