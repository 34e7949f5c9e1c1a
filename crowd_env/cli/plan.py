"""The command ``crowd-env plan``: how a place was understood, as a picture and in figures."""

import json
import warnings
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.analysis.plan_check import PlanCheck, cells, check_place, check_plan, plain_check
from crowd_env.cli import options
from crowd_env.cli.console import check_picture, show_table
from crowd_env.cli.place import CrowdOptions, people_options, plan_options, setting_of, split_changes
from crowd_env.core.behaviors.outline import Outline, room_of
from crowd_env.core.checks import at
from crowd_env.core.console import friendly_errors, noted, progress_bar, say
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios import kind_of_place
from crowd_env.scenarios.floor_plan import people_on
from crowd_env.scenarios.plans.reading import read_plan

app = options.new_app()

_PLACES = f"{options.PLACES} Several make a sheet."


@app.command()
def plan(
    place: Annotated[list[str], typer.Argument(autocompletion=options.complete_scenario, help=_PLACES)],
    exit: options.Exits = None,
    unit: options.Unit = None,
    people: options.PeopleCount = None,
    starts: options.Starts = None,
    set: options.Changes = None,
    out: Annotated[Path | None, options.plain("Image to write, .png.", "plan.png")] = None,
    seed: Annotated[int, options.plain("Where people stand.", min=0)] = 0,
    as_json: options.AsJson = False,
) -> None:
    """Draw what is understood of a place, to check it before anything is run: exits, regions, people, narrow passages.

    A floor plan is drawn without exits too: read their coordinates off the axes, and give them with --exit.

    Examples: crowd-env plan floor-v0 --out floor.png

    crowd-env plan my_room.wkt --exit 5,2,5,3 --people 40
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
        checks, told = [], []
        with progress_bar("plans", 2 * len(place)) as progress:
            for name in place:
                with noted() as said:
                    checks.append(
                        _check(
                            CrowdOptions(scenario=name, exit=exit, unit=unit, people=people, starts=starts, set=set),
                            seed,
                        )
                    )
                told.append(said)
                progress(1)
            if picture is not None:
                from crowd_env.rendering import save_figure
                from crowd_env.rendering.sheet import draw_sheet

                save_figure(draw_sheet(checks), picture)
            progress(len(place))
    if as_json:
        heads = [{**plain_check(check), "notes": said} for check, said in zip(checks, told, strict=True)]
        typer.echo(json.dumps({"picture": picture and str(picture), "plans": heads}))
        return
    for check in checks:
        show_table(check.name, {"": cells(check)})
    if picture is not None:
        say(f"plan: {picture}")


def _check(asked: CrowdOptions, seed: int) -> PlanCheck:
    """Return a place as it was understood; a floor plan may lack exits."""
    if kind_of_place(asked.scenario) == "plan":
        drawn = read_plan(asked.scenario, **plan_options(asked.scenario, asked.exit, asked.unit))
        if not drawn.exits:
            for note in drawn.notes:
                warnings.warn(note, stacklevel=2)
            changes = split_changes(asked.set)
            room = room_of(Outline.of(changes.pop("outline", None)))
            crowd = people_on(drawn, **people_options(asked, changes))
            with at(str(drawn.path)):
                geometry = Geometry.from_polygon(drawn.walkable, regions=drawn.regions)
            return check_plan(drawn.name, geometry, crowd, title=drawn.title, room=room, seed=seed)
    return check_place(setting_of(asked).place, seed)
