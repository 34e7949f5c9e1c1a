"""Results in print: as a table of at most 100 columns, or as one JSON object."""

import json
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crowd_env.reproduce import FIGURES, PAPERS
from crowd_env.reproduce.result import Result

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
    for row in result.rows:
        quantity = row.quantity if row.unit in ("1", "share", result.unit) else f"{row.quantity} [{row.unit}]"
        cells = (quantity, row.paper or "-", row.shown(), row.difference(), str(row.n), row.explained())
        table.add_row(*map(escape, cells), end_section=row.closes)
    console.print(table)
    if result.options:
        changed = ", ".join(f"{key} {value}" for key, value in result.options.items())
        console.print(f"Settings that differ from the defaults: {changed}", markup=False)
    for remark in result.remarks:
        console.print(f"* {remark}", markup=False)
    console.print()


def as_object(name: str, results: Sequence[Result]) -> dict[str, Any]:
    """Return what ``--json`` prints: a result, or those of a group put together."""
    if name in FIGURES:
        return results[0].as_json()
    parts = [result.as_json() for result in results]
    rows = [{"of": part["name"], **row} for part in parts for row in part["rows"]]
    remarks = [f"{part['name']}: {remark}" for part in parts for remark in part["remarks"]]
    options = {key: value for part in parts for key, value in part["options"].items()}
    return {"name": name, "rows": rows, "remarks": remarks, "options": options}


def show_names(as_json: bool) -> None:
    """Print what can be redone."""
    if as_json:
        titles = {name: figure.title for name, figure in FIGURES.items()}
        groups = {**{name: list(paper.figures) for name, paper in PAPERS.items()}, "all": list(FIGURES)}
        times = {name: _duration(figure.cpu_time) for name, figure in FIGURES.items()}
        typer.echo(json.dumps({"names": titles, "groups": groups, "cpu_time": times}))
        return
    table = Table("name", "table or figure", "about", box=SIMPLE_HEAD, pad_edge=False)
    for paper in PAPERS.values():
        for name, figure in paper.figures.items():
            table.add_row(name, figure.title, _duration(figure.cpu_time), end_section=name == list(paper.figures)[-1])
    for name, paper in PAPERS.items():
        table.add_row(name, f"all of {paper.title}", _duration(paper.cpu_time))
    table.add_row("all", "all papers", _duration(sum(paper.cpu_time for paper in PAPERS.values())))
    console = _console()
    console.print(table)
    for paper in PAPERS.values():
        settings = Table(f"--set, {paper.title}", "default", "meaning", box=SIMPLE_HEAD, pad_edge=False)
        for one in fields(paper.settings):
            if one.name not in ("runs", "seed"):
                settings.add_row(
                    one.name, "" if one.default is None else str(one.default), escape(one.metadata["help"])
                )
        console.print(settings)
    console.print("about: time on one core with the default draws; evacuations spread over the cores and are kept.")


def _duration(seconds: float) -> str:
    return f"{seconds:g} s" if seconds < 60 else f"{seconds / 60:g} min"


def _console() -> Console:
    """Return the standard output, at most 100 columns wide so that tables look the same in a file and on a screen."""
    console = Console(highlight=False)
    console.width = min(_WIDTH, console.width) if console.is_terminal else _WIDTH
    return console
