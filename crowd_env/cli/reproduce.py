"""The command ``crowd-env reproduce``."""

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.console import check_folder, counted, friendly_errors, interrupted, notes, progress_bar
from crowd_env.physics import SCHEMES
from crowd_env.reproduce import LIN, PECOL, REPRODUCTIONS, LinSettings, Reproduction, Result, Settings, find
from crowd_env.reproduce.lin2016.settings import check
from crowd_env.reproduce.lin2016.store import Store
from crowd_env.reproduce.pecol2011.settings import flag
from crowd_env.reproduce.pool import Interrupted, all_cores, complete, distinct
from crowd_env.reproduce.report import as_object, show, show_names
from crowd_env.reproduce.result import Halfway, write_table

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_ROOM = "Room of fig3 and table5"
_LIN = "Lin, Ma, Lo"


@app.command()
def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help=", ".join(REPRODUCTIONS) + "; those of one paper: pecol, lin; both: all; what they are: list.",
        ),
    ],
    runs: Annotated[
        int | None,
        typer.Option(
            help="Draws of fig3 and table5, default 50; of table7 and fig6, default 100; of each point of lin-*, default 10."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Draw k has the seed SEED + k; default 0.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the CSV files, the figure and, of lin-*, the runs.")] = Path(
        "reproduce"
    ),
    dt: Annotated[float | None, typer.Option(help="Time step, s; default 0.01, lin-* 0.001.")] = None,
    target: Annotated[
        str | None,
        typer.Option(
            help="What people walk to: path (shortest path of a disc, default of fig3 and table5), or straight to the "
            "center of the door (default of lin-*), its nearest point that keeps off the jambs (nearest), or the nearest "
            "point of its whole width."
        ),
    ] = None,
    scheme: Annotated[
        str | None,
        typer.Option(
            help="Scheme that fig3 draws: " + ", ".join(SCHEMES) + "; default nsm2-printed.", rich_help_panel=_ROOM
        ),
    ] = None,
    door_width: Annotated[float | None, typer.Option(help="m; default 0.82.", rich_help_panel=_ROOM)] = None,
    side: Annotated[float | None, typer.Option(help="Of the square room, m; default 5.", rich_help_panel=_ROOM)] = None,
    n: Annotated[int | None, typer.Option(help="Number of people; default 20.", rich_help_panel=_ROOM)] = None,
    exit_line: Annotated[
        float | None,
        typer.Option(
            help="How far beyond the door people are counted and removed, m; default 0.", rich_help_panel=_ROOM
        ),
    ] = None,
    stiffness: Annotated[
        float | None, typer.Option(help="k of dem, N/m; default 1.2e5.", rich_help_panel=_ROOM)
    ] = None,
    k_normal: Annotated[
        float | None, typer.Option(help="K_N of nsm2-printed, kg; default 1e5.", rich_help_panel=_ROOM)
    ] = None,
    k_tangent: Annotated[
        float | None, typer.Option(help="K_T of nsm2-printed, kg; default 0.", rich_help_panel=_ROOM)
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            help="calibrated (default): friction and social force of walls, which the paper leaves open, fitted to its "
            "Figure 7; literal: its text as printed.",
            rich_help_panel=_LIN,
        ),
    ] = None,
    wall_friction: Annotated[
        float | None,
        typer.Option(help="Friction of people on walls; calibrated 0.1, literal 0.5.", rich_help_panel=_LIN),
    ] = None,
    wall_social: Annotated[
        float | None,
        typer.Option(
            help="Social force of walls at zero distance, N; calibrated 300, literal 0.", rich_help_panel=_LIN
        ),
    ] = None,
    anisotropy: Annotated[
        float | None, typer.Option(help="phi of the social force; default 0.3.", rich_help_panel=_LIN)
    ] = None,
    no_rotation: Annotated[
        bool, typer.Option("--no-rotation", help="Nobody turns (lin-fig5 compares both).", rich_help_panel=_LIN)
    ] = False,
    damping: Annotated[
        str | None,
        typer.Option(
            help="Reading of gamma = 0.8: per-length (1/(m s), default), rate (1/s) or critical (share of the critical "
            "damping).",
            rich_help_panel=_LIN,
        ),
    ] = None,
    exit_depth: Annotated[
        float | None,
        typer.Option(help="How far behind the wall people count as out, m; default 0.", rich_help_panel=_LIN),
    ] = None,
    cutoff: Annotated[
        float | None,
        typer.Option(help="Distance beyond which there is no social force, m; default 0.4.", rich_help_panel=_LIN),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(help="Processes; default one a core. Results do not depend on it.", rich_help_panel=_LIN),
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Compute all runs again instead of taking those kept.", rich_help_panel=_LIN),
    ] = False,
) -> None:
    """Redo a table or figure of Pécol et al. 2011, or of Lin, Ma, Lo, and print the paper's numbers beside ours.

    Writes NAME.csv, the numbers behind it and NAME.png into the folder --out.

    Runs of lin-* are kept in the folder runs inside it: after an interruption, or for another figure, they are there.

    Examples: crowd-env reproduce table3

    crowd-env reproduce table5 --runs 50 --door-width 0.9

    crowd-env reproduce lin-fig7 --preset literal --runs 5
    """
    if name == "list":
        show_names(as_json)
        return
    asked = locals()
    given = {key: asked[key] for key in _OPTIONS if asked[key] is not None and asked[key] is not False}
    with friendly_errors():
        work = _plan(name, given, out)
    told: list[Result] = []
    stopped: str | None = None
    with friendly_errors():
        try:
            for result in work.results():
                paths = _write(result, out)
                told.append(result)
                if not as_json:
                    show(result)
                notes.print(f"files: {', '.join(str(path) for path in paths)}", markup=False, soft_wrap=True)
        except Interrupted as error:
            stopped = str(error)
        except KeyboardInterrupt as error:
            stopped = _kept(list(work.chosen)[len(told)], error, out)
    if as_json and (told or stopped is None):
        typer.echo(json.dumps(as_object(name, told), allow_nan=False))
    if stopped is not None:
        done = ", ".join(result.name for result in told)
        interrupted(stopped + (f"; whole: {done}" if done else ""))


def _kept(name: str, error: KeyboardInterrupt, out: Path) -> str:
    """Write what an interruption has left of a table or figure, and say it."""
    if not isinstance(error, Halfway) or not error.runs:
        return f"{name} is not finished"
    path = write_table(out / f"{name}-interrupted.csv", error.finished)
    return f"{counted(error.runs, 'run', 'runs')} of {name} were finished, their exits are in {path}"


_OPTIONS = tuple({option: None for each in REPRODUCTIONS.values() for option in sorted(each.options)})


@dataclass(frozen=True)
class _Work:
    """What is to be done, all of it checked."""

    chosen: Collection[str]
    settings: Mapping[str, Settings]
    lin_settings: LinSettings
    store: Store
    workers: int
    fresh: bool

    def results(self) -> Iterator[Result]:
        """Yield one result after the other."""
        for name in self.chosen:
            if name in PECOL:
                yield _run(name, PECOL[name], self.settings[name])
        figures = [LIN[name] for name in self.chosen if name in LIN]
        if not figures:
            return
        runs = distinct(run for figure in figures for run in figure.runs(self.lin_settings))
        with progress_bar("runs", len(runs)) as progress:
            records = complete(runs, self.store, workers=self.workers, fresh=self.fresh, progress=progress)
        for figure in figures:
            yield figure.tell(self.lin_settings, records)


def _plan(name: str, given: Mapping[str, Any], out: Path) -> _Work:
    """Return what is to be done.

    An option goes to all the chosen that take it.

    Raises
    ------
    ValueError
        In one sentence, if a name or an option is wrong or belongs to nothing that is chosen.
    """
    chosen = find(name)
    for option in given:
        if not any(option in each.options for each in chosen.values()):
            raise ValueError(f"{flag(option)} belongs to {_owners(option)}; {name} has no use for it")
    pecol, lin = [name for name in chosen if name in PECOL], [name for name in chosen if name in LIN]
    meant = _meant_for(pecol, given, Settings)
    settings = {key: Settings(**{"runs": PECOL[key].runs, **meant}) for key in pecol}
    schemes = [s for key in pecol if (of := PECOL[key].schemes) is not None for s in of(settings[key])]
    if schemes:
        Settings(**meant).check(dict.fromkeys(schemes))
    lin_settings = LinSettings(**_meant_for(lin, given, LinSettings))
    check(run for key in lin for run in LIN[key].runs(lin_settings))
    workers = given.get("workers", all_cores())
    if workers < 1:
        raise ValueError(f"--workers is {workers}; it must be at least 1")
    check_folder("--out", out)
    return _Work(list(chosen), settings, lin_settings, Store(out / "runs"), workers, given.get("fresh", False))


def _meant_for(
    names: Collection[str], given: Mapping[str, Any], kind: type[Settings] | type[LinSettings]
) -> dict[str, Any]:
    taken = {option for name in names for option in REPRODUCTIONS[name].options} & {f.name for f in fields(kind)}
    return {option: value for option, value in given.items() if option in taken}


def _owners(option: str) -> str:
    """Return in words who takes an option."""
    owners = [name for name in PECOL if option in PECOL[name].options]
    lin = [name for name in LIN if option in LIN[name].options]
    without = [name for name in LIN if name not in lin]
    if lin:
        owners.append("lin" + (f" (all but {', '.join(without)})" if without else ""))
    return " and ".join([", ".join(owners[:-1]), owners[-1]] if owners[:-1] else owners)


def _run(name: str, reproduction: Reproduction, settings: Settings) -> Result:
    with progress_bar(name, reproduction.steps(settings)) as progress:
        return reproduction.run(settings, progress)


def _write(result: Result, out: Path) -> list[Path]:
    """Write the CSV files and, if it can be drawn, the figure."""
    try:
        paths = result.save(out)
        try:
            paths.append(result.draw(out / f"{result.name}.png"))
        except ModuleNotFoundError as error:
            notes.print(f"no figure: {error}", style="yellow", markup=False, soft_wrap=True)
    except OSError as error:
        raise ValueError(f"cannot write the results: {error}") from None
    return paths
