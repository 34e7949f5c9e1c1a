"""The command ``crowd-env plan``: how a place was understood, as a picture and in figures."""

import json
import os
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
from crowd_env.core.console import check_place as check_place_of
from crowd_env.core.console import friendly_errors, noted, notes, progress_bar, say
from crowd_env.core.files.atomic import check_suffix, keep_aside, write_text
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios import kind_of_place
from crowd_env.scenarios.file import read_content
from crowd_env.scenarios.floor_plan import PEOPLE, people_on
from crowd_env.scenarios.plans.reading import read_plan, split_level
from crowd_env.scenarios.project import Project, project_in, project_of
from crowd_env.scenarios.storeys import building_in, has_storeys

app = options.new_app()

_PLACES = f"{options.PLACES} Several make a sheet."
_LAYERS = (
    "Layers of a DXF drawing, by role, in place of their own names: walkable, obstacles, exits, starts or regions, such "
    'as "obstacles=A-WALL*,A-COLS"; may be repeated.'
)
_EDIT = (
    "Edit a floor plan or a scenario file on a page in the browser: exits, doors, areas, people, runs; --save names the file "
    "that is written, default that of the scenario, or .toml beside the drawing. Ctrl+C ends it."
)
_SAVE = "File, .toml, for what was understood of a floor plan: edit it, then run it. What was there is kept as FILE~."


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
    edit: Annotated[bool, options.plain(_EDIT, names=("--edit",))] = False,
    seed: Annotated[int, options.plain("Where people stand.", min=0)] = 0,
    as_json: options.AsJson = False,
) -> None:
    """Draw what is understood of a place, to check it before anything is run: exits, regions, people, narrow passages.

    A floor plan is drawn without exits too: read their coordinates off the axes, and give them with --exit.  --save writes a
    project, to which people, doors, zones and all else can be added.

    Examples: crowd-env plan floor-v0 --out floor.png

    crowd-env plan my_room.wkt --exit 5,2,5,3 --people 40

    crowd-env plan office.dxf --layers obstacles=A-WALL --layers exits=A-EXIT --save office.toml

    crowd-env plan office.dxf --edit
    """
    given, wanted = dict(locals()), Path("plan.png") if out is None else out
    picture: Path | None = wanted
    with friendly_errors():
        if edit:
            if len(place) > 1:
                raise ValueError(f"--edit is for one place, but {len(place)} are given")
            if out is not None and out.suffix != ".html":
                raise ValueError(f"--out {out}: with --edit it must be a page, .html, that stands alone")
            _edit(CrowdOptions.among(given, scenario=place[0]), save, out)
            return
        try:
            check_picture("--out", wanted, (".png",), makes_folder=True)
        except ModuleNotFoundError as error:
            if out is not None:
                raise
            warnings.warn(f"figures alone, no picture: {error}", stacklevel=2)
            picture = None
        if save is not None:
            check_suffix(save, (".toml",))
        for option in ("exit", "starts", "layers", "save"):
            if given[option] and len(place) > 1:
                raise ValueError(f"--{option} is for one floor plan, but {len(place)} places are given")
        checks, told = [], []
        with progress_bar("plans", 2 * len(place)) as progress:
            for name in place:
                with noted() as said:
                    asked = CrowdOptions.among(given, scenario=name)
                    checks.append(_check(asked, seed))
                    if save is not None:
                        text = _project(asked, save).text
                        if save.is_file() and save.read_text(encoding="utf-8", errors="replace") != text:
                            say(f"note: {save} was there; it is kept as {keep_aside(save)}")
                        write_text(save, text)
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


def _edit(asked: CrowdOptions, save: Path | None, out: Path | None) -> None:
    """Serve the page of a project until the command is ended, or write it."""
    from crowd_env.cli.editing import Editor, Server, page_alone

    project, path = _opened(asked, save)
    if out is not None:
        write_text(out, page_alone(project.content, path))
        say(f"page: {out}; it hands back a project to be put beside the drawing")
        return
    check_place_of(f"--save {path}" if save else str(path), path)
    server = Server(Editor(project, path))
    typer.echo(f"editing {path}: {server.url}")
    say("Ctrl+C ends it")
    if notes.is_terminal:
        typer.launch(server.url)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        say(f"{path} is as it was saved last" if path.exists() else "nothing was saved")
    finally:
        server.editor.stop()
        server.server_close()


def _opened(asked: CrowdOptions, save: Path | None) -> tuple[Project, Path]:
    """Return the project of a place as it is edited first, and where it is saved."""
    kind = kind_of_place(asked.scenario)
    if kind == "file":
        path = Path(asked.scenario)
        content = read_content(path)
        if save is not None and save.absolute().parent != path.absolute().parent:
            raise ValueError(f"--save {save}: a project names files beside it; save it in {path.parent}")
        return _with_comments(content, path), save or path
    if kind != "plan":
        raise ValueError(f"{asked.scenario} ships with crowd_env; --edit is for floor plans and scenario files")
    drawing, level = split_level(asked.scenario)
    path = save or drawing.with_name(f"{drawing.stem}{'' if level is None else f'-{level}'}.toml")
    if path.is_file():
        content = read_content(path)
        file = content.get("geometry", {}).get("file")
        if file is None or (path.parent / file).absolute() != drawing.absolute():
            raise ValueError(f"{path} is another project than that of {drawing}; name another file by --save")
        say(f"going on with {path}")
        return _with_comments(content, path), path
    try:
        return _project(asked, path), path
    except ValueError as error:
        if not drawing.is_file():
            raise
        say(f"note: {error}", "yellow")  # the page shows the layers of the drawing
    of_drawing = {key: value for key, value in plan_options(asked).items() if key != "exits"}
    file = Path(os.path.relpath(drawing.absolute(), path.absolute().parent)).as_posix()
    geometry = {"file": file, **({} if level is None else {"level": level}), **of_drawing}
    return Project({"geometry": geometry, "population": {"people": asked.people or PEOPLE}}), path


def _with_comments(content: Plain, path: Path) -> Project:
    return Project(content) if path.suffix.lower() == ".json" else project_in(path.read_text(encoding="utf-8-sig"))


def _check(asked: CrowdOptions, seed: int) -> PlanCheck:
    """Return a place as it was understood; a floor plan may lack exits."""
    if kind_of_place(asked.scenario) == "plan" and not has_storeys(asked.scenario):
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


def _project(asked: CrowdOptions, path: Path) -> Project:
    """Return a project of a floor plan, with all that the command was given."""
    if kind_of_place(asked.scenario) != "plan":
        raise ValueError(f"{asked.scenario} is no floor plan in a file; --save writes a project of one")
    if asked.starts is not None:
        raise ValueError("--starts is not for --save: write starts = FILE under [population] of the project")
    with warnings.catch_warnings():  # they have been given
        warnings.simplefilter("ignore")
        drawing = plan_options(asked)
        if has_storeys(asked.scenario):
            if asked.people is not None or asked.set or asked.section:
                raise ValueError(
                    "--people, --set and --section are not for --save of a building: write them in the project"
                )
            return building_in(asked.scenario, beside=path, **drawing)
        plan = read_plan(asked.scenario, **drawing)
        own_exits, changes = bool(drawing.pop("exits", None)), split_changes(asked.set)
        others: Plain = {name: value_of(changes.pop(name)) for name in BEHAVIORS if name in changes}
        if sections := sections_of(asked):
            others = {**others, "sections": [plain(one) for one in sections]}
        fields = dict(people_options(asked, changes))
        crowd = people_on(plan, fields.pop("people", None))
        of_all = {name: plain(law) for name, law in fields.items()}
        return project_of(path, plan, crowd, own_exits=own_exits, drawing=drawing, of_all=of_all, others=others)
