"""The command ``crowd-env reproduce``."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from crowd_env.console import notes, progress_bar, said_plainly
from crowd_env.physics import SCHEMES
from crowd_env.reproduce import REPRODUCTIONS, Reproduction, Result, Settings, find
from crowd_env.reproduce.settings import flag

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_WIDTH = 100
_ROOM = "Room of fig3 and table5"


@app.command()
def reproduce(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help=", ".join(REPRODUCTIONS) + "; all of them: all; what they are: list.")
    ],
    runs: Annotated[int, typer.Option(help="Draws of fig3 and table5; the others have no chance in them.")] = 50,
    seed: Annotated[int, typer.Option(help="Draw k has the seed SEED + k.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the CSV files and the figure.")] = Path("reproduce"),
    scheme: Annotated[
        str | None, typer.Option(help="Scheme that fig3 draws: " + ", ".join(SCHEMES) + "; default nsm2.")
    ] = None,
    door_width: Annotated[float | None, typer.Option(help="m; default 0.82.", rich_help_panel=_ROOM)] = None,
    side: Annotated[float | None, typer.Option(help="Of the square room, m; default 5.", rich_help_panel=_ROOM)] = None,
    n: Annotated[int | None, typer.Option(help="Number of people; default 20.", rich_help_panel=_ROOM)] = None,
    target: Annotated[
        str | None,
        typer.Option(
            help="What people walk to: path (shortest path of a disc, default), or straight to the nearest point of the "
            "door that keeps off the jambs (nearest), its centre, or the nearest point of its whole width.",
            rich_help_panel=_ROOM,
        ),
    ] = None,
    exit_line: Annotated[
        float | None,
        typer.Option(
            help="How far beyond the door people are counted and removed, m; default 0.", rich_help_panel=_ROOM
        ),
    ] = None,
    dt: Annotated[float | None, typer.Option(help="Time step h, s; default 0.01.", rich_help_panel=_ROOM)] = None,
    stiffness: Annotated[
        float | None, typer.Option(help="k of dem, N/m; default 1.2e5.", rich_help_panel=_ROOM)
    ] = None,
    k_normal: Annotated[float | None, typer.Option(help="K_N of nsm2, kg; default 1e5.", rich_help_panel=_ROOM)] = None,
    k_tangent: Annotated[float | None, typer.Option(help="K_T of nsm2, kg; default 0.", rich_help_panel=_ROOM)] = None,
) -> None:
    """Redo a table or figure of Pécol et al. 2011 and print the paper's numbers beside ours.

    Writes NAME.csv, the numbers behind it and NAME.png into the folder --out.

    Examples: crowd-env reproduce table3

    crowd-env reproduce table5 --runs 50 --door-width 0.9
    """
    if name == "list":
        _list(as_json)
        return
    of_room = {
        "door_width": door_width,
        "side": side,
        "n": n,
        "target": target,
        "exit_line": exit_line,
        "dt": dt,
        "stiffness": stiffness,
        "k_normal": k_normal,
        "k_tangent": k_tangent,
    }
    given = {key: value for key, value in {"scheme": scheme, **of_room}.items() if value is not None}
    with said_plainly():
        chosen = dict(REPRODUCTIONS) if name == "all" else {name: find(name)}
        settings = _settings(chosen, runs, seed, given)
        _check_folder(out)
    told: list[Result] = []
    with said_plainly():
        for each, reproduction in chosen.items():
            result = _run(each, reproduction, settings)
            paths = _write(result, out)
            told.append(result)
            if not as_json:
                _show(result)
            notes.print(f"files: {', '.join(str(path) for path in paths)}", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(json.dumps(_json(name, told), allow_nan=False))


def _settings(chosen: dict[str, Reproduction], runs: int, seed: int, given: dict[str, Any]) -> Settings:
    """Return the settings, checked with all that is to run."""
    rooms = [key for key, reproduction in REPRODUCTIONS.items() if reproduction.schemes is not None]
    if given and not set(chosen) & set(rooms):
        raise ValueError(
            f"{flag(next(iter(given)))} belongs to {' and '.join(rooms)}; {next(iter(chosen))} has no room"
        )
    if "scheme" in given and "fig3" not in chosen:
        raise ValueError(f"--scheme belongs to fig3; {next(iter(chosen))} has its own schemes")
    settings = Settings(runs=runs, seed=seed, **given)
    schemes = [name for each in chosen.values() if each.schemes is not None for name in each.schemes(settings)]
    if schemes:
        settings.check(dict.fromkeys(schemes))
    return settings


def _check_folder(out: Path) -> None:
    """Say now, not after the work, that the folder cannot be written."""
    there = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists())
    if not there.is_dir():
        raise ValueError(f"--out {out}: {there} is not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ValueError(f"--out {out}: {there} cannot be written")


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


def _json(name: str, told: list[Result]) -> dict[str, Any]:
    if name != "all":
        return told[0].as_json()
    parts = [result.as_json() for result in told]
    rows = [{"of": part["name"], **row} for part in parts for row in part["rows"]]
    remarks = [f"{part['name']}: {remark}" for part in parts for remark in part["remarks"]]
    options = {key: value for part in parts for key, value in part["options"].items()}
    return {"name": name, "rows": rows, "remarks": remarks, "options": options}


def _list(as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps({"names": {name: each.title for name, each in REPRODUCTIONS.items()}}))
        return
    table = Table(show_header=False)
    for name, each in REPRODUCTIONS.items():
        table.add_row(name, each.title)
    _console().print(table)


def _console() -> Console:
    """Return the standard output, at most 100 columns wide so that tables look the same in a file and on a screen."""
    console = Console(highlight=False)
    console.width = min(_WIDTH, console.width) if console.is_terminal else _WIDTH
    return console


def _show(result: Result) -> None:
    console = _console()
    table = Table(title=result.title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("quantity", max_width=34)
    for head in ("paper", "here", "difference"):
        table.add_column(head, justify="right")
    table.add_column("n", justify="right")
    table.add_column("estimator and reading used", ratio=1)
    for row, last in _with_sections(result):
        quantity = row.quantity if row.unit in ("1", "share", result.unit) else f"{row.quantity} [{row.unit}]"
        cells = (quantity, row.paper or "-", row.shown(), row.difference(), str(row.n), row.explained())
        table.add_row(*(_plain(cell) for cell in cells), end_section=last)
    console.print(table)
    if result.options:
        changed = ", ".join(f"{flag(key)} {value}" for key, value in result.options.items())
        console.print(f"Options that differ from the defaults: {changed}", markup=False)
    for remark in result.remarks:
        console.print(f"* {remark}", markup=False)
    console.print()


def _plain(text: str) -> str:
    """Return text that rich does not take for its markup."""
    return text.replace("[", r"\[")


def _with_sections(result: Result) -> Iterator[tuple[Any, bool]]:
    """Yield each row and whether a line follows it: after what is left of one scheme or panel."""
    rows = list(result.rows)
    for row, following in zip(rows, [*rows[1:], None], strict=True):
        ends = row.quantity.startswith("unfinished")
        yield row, following is not None and (ends or following.quantity.startswith("flow, experiment"))
