"""How results are told: as a table of at most 100 columns, or as one JSON object."""

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from crowd_env.reproduce import GROUPS, REPRODUCTIONS, Result, Row
from crowd_env.reproduce.pecol2011.settings import flag

_WIDTH = 100


def show(result: Result) -> None:
    """Print a result as a table, followed by its remarks."""
    console = _console()
    table = Table(title=result.title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("quantity", max_width=34)
    for head in ("paper", "here", "difference"):
        table.add_column(head, justify="right")
    table.add_column("n", justify="right")
    table.add_column("estimator and reading used", ratio=1)
    for row, last in _with_sections(result.rows):
        quantity = row.quantity if row.unit in ("1", "share", result.unit) else f"{row.quantity} [{row.unit}]"
        cells = (quantity, row.paper or "-", row.shown(), row.difference(), str(row.n), row.explained())
        table.add_row(*(_plain(cell) for cell in cells), end_section=last)
    console.print(table)
    if result.options:
        changed = ", ".join(flag(key) + ("" if value is True else f" {value}") for key, value in result.options.items())
        console.print(f"Options that differ from the defaults: {changed}", markup=False)
    for remark in result.remarks:
        console.print(f"* {remark}", markup=False)
    console.print()


def as_object(name: str, told: Sequence[Result]) -> dict[str, Any]:
    """Return what ``--json`` prints: a result, or those of a group put together."""
    if name not in GROUPS:
        return told[0].as_json()
    parts = [result.as_json() for result in told]
    rows = [{"of": part["name"], **row} for part in parts for row in part["rows"]]
    remarks = [f"{part['name']}: {remark}" for part in parts for remark in part["remarks"]]
    options = {key: value for part in parts for key, value in part["options"].items()}
    return {"name": name, "rows": rows, "remarks": remarks, "options": options}


def show_names(as_json: bool) -> None:
    """Print what can be redone."""
    if as_json:
        titles = {name: each.title for name, each in REPRODUCTIONS.items()}
        about = {name: each.about for name, each in REPRODUCTIONS.items()}
        typer.echo(json.dumps({"names": titles, "groups": {k: list(v) for k, v in GROUPS.items()}, "cpu_time": about}))
        return
    table = Table("name", "table or figure", "about", box=SIMPLE_HEAD, pad_edge=False)
    sections = [list(GROUPS["pecol"]), list(GROUPS["lin"])]
    for names in sections:
        for name in names:
            table.add_row(name, REPRODUCTIONS[name].title, REPRODUCTIONS[name].about, end_section=name == names[-1])
    table.add_row("pecol", "all of Pécol et al. 2011", "1 min")
    table.add_row("lin", "all of Lin, Ma, Lo; they share runs", "12 min")
    table.add_row("all", "both", "13 min")
    console = _console()
    console.print(table)
    console.print(
        "about: time on one core with the default draws; lin-* spread over the cores, and keep finished runs."
    )


def _console() -> Console:
    """Return the standard output, at most 100 columns wide so that tables look the same in a file and on a screen."""
    console = Console(highlight=False)
    console.width = min(_WIDTH, console.width) if console.is_terminal else _WIDTH
    return console


def _plain(text: str) -> str:
    """Return text that rich does not take for its markup."""
    return text.replace("[", r"\[")


def _with_sections(rows: Sequence[Row]) -> Iterator[tuple[Row, bool]]:
    """Yield each row and whether a line follows it."""
    for row, _ in pairwise([*rows, None]):
        assert row is not None
        yield row, row.closes and row is not rows[-1]
