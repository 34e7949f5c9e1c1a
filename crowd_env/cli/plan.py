"""The command ``crowd-env plan``: how a place was understood, as a picture and in figures."""

import json
import warnings
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.analysis.plan_check import PlanCheck, cells, check_place, check_plan, plain_check
from crowd_env.analysis.results.plain import plain
from crowd_env.cli import options
from crowd_env.cli.console import check_picture, show_table
from crowd_env.cli.place import (
    CrowdOptions,
    people_options,
    plan_options,
    sections_of,
    setting_of,
    split_changes,
    value_of,
)
from crowd_env.core.behaviors import BEHAVIORS
from crowd_env.core.behaviors.outline import Outline, room_of
from crowd_env.core.checks import Plain, at
from crowd_env.core.console import friendly_errors, noted, progress_bar, say
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios import kind_of_place
from crowd_env.scenarios.floor_plan import people_on
from crowd_env.scenarios.plans.reading import read_plan
from crowd_env.scenarios.project import project_text

app = options.new_app()

_PLACES = f"{options.PLACES} Several make a sheet."
_LAYERS = (
    "Layers of a DXF drawing, by role, in place of their own names: walkable, obstacles, exits, starts or regions, such "
    'as "obstacles=A-WALL*,A-COLS"; may be repeated.'
)
_SAVE = "File, .toml, for what was understood of a floor plan: edit it, then run it."


@app.command()
def plan(
    place: Annotated[list[str], typer.Argument(autocompletion=options.complete_scenario, help=_PLACES)],
    exit: options.Exits = None,
    unit: options.Unit = None,
    section: options.Sections = None,
    layers: Annotated[list[str] | None, options.of_place(_LAYERS)] = None,
    people: options.PeopleCount = None,
    starts: options.Starts = None,
    set: options.Changes = None,
    out: Annotated[Path | None, options.plain("Image to write, .png.", "plan.png")] = None,
    save: Annotated[Path | None, options.plain(_SAVE)] = None,
    seed: Annotated[int, options.plain("Where people stand.", min=0)] = 0,
    as_json: options.AsJson = False,
) -> None:
    """Draw what is understood of a place, to check it before anything is run: exits, regions, people, narrow passages.

    A floor plan is drawn without exits too: read their coordinates off the axes, and give them with --exit.  --save writes a
    project, to which people, doors, zones and all else can be added.

    Examples: crowd-env plan floor-v0 --out floor.png

    crowd-env plan my_room.wkt --exit 5,2,5,3 --people 40

    crowd-env plan office.dxf --layers obstacles=A-WALL --layers exits=A-EXIT --save office.toml
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
        if save is not None:
            check_suffix(save, (".toml",))
        for option, given in (("--exit", exit), ("--starts", starts), ("--layers", layers), ("--save", save)):
            if given and len(place) > 1:
                raise ValueError(f"{option} is for one floor plan, but {len(place)} places are given")
        checks, told = [], []
        with progress_bar("plans", 2 * len(place)) as progress:
            for name in place:
                with noted() as said:
                    asked = CrowdOptions(
                        scenario=name,
                        exit=exit,
                        unit=unit,
                        section=section,
                        layers=layers,
                        people=people,
                        starts=starts,
                        set=set,
                    )
                    checks.append(_check(asked, seed))
                    if save is not None:
                        write_text(save, _project(asked, save))
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
    if save is not None:
        say(f"project: {save}; crowd-env run {save} runs it")


def _check(asked: CrowdOptions, seed: int) -> PlanCheck:
    """Return a place as it was understood; a floor plan may lack exits."""
    if kind_of_place(asked.scenario) == "plan":
        drawn = read_plan(asked.scenario, **plan_options(asked))
        if not drawn.exits:
            for note in drawn.notes:
                warnings.warn(note, stacklevel=2)
            changes = split_changes(asked.set)
            room = room_of(Outline.of(changes.pop("outline", None)))
            crowd = people_on(drawn, **people_options(asked, changes))
            with at(str(drawn.path)):
                geometry = Geometry.from_polygon(drawn.walkable, regions=drawn.regions)
            sections = sections_of(asked)
            return check_plan(drawn.name, geometry, crowd, title=drawn.title, room=room, seed=seed, sections=sections)
    return check_place(setting_of(asked).place, seed)


def _project(asked: CrowdOptions, path: Path) -> str:
    """Return a scenario file of a floor plan, with all that the command was given."""
    if kind_of_place(asked.scenario) != "plan":
        raise ValueError(f"{asked.scenario} is no floor plan in a file; --save writes a project of one")
    if asked.starts is not None:
        raise ValueError("--starts is not for --save: write starts = FILE under [population] of the project")
    with warnings.catch_warnings():  # they have been given
        warnings.simplefilter("ignore")
        drawing = plan_options(asked)
        plan = read_plan(asked.scenario, **drawing)
        own_exits, changes = bool(drawing.pop("exits", None)), split_changes(asked.set)
        others: Plain = {name: value_of(changes.pop(name)) for name in BEHAVIORS if name in changes}
        if sections := sections_of(asked):
            others = {**others, "sections": [plain(one) for one in sections]}
        fields = dict(people_options(asked, changes))
        crowd = people_on(plan, fields.pop("people", None))
        of_all = {name: plain(law) for name, law in fields.items()}
        return project_text(path, plan, crowd, own_exits=own_exits, drawing=drawing, of_all=of_all, others=others)
