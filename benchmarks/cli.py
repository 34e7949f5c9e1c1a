"""The command ``python -m benchmarks``."""

import json
import os
import platform
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks import batch, cold, crowds, memory, scaling, train
from benchmarks.measuring import Effort, Row, grid
from benchmarks.pictures import draw_pictures
from crowd_env.core.checks import known
from crowd_env.core.console import friendly_errors, notes
from validation.pages import TABLES, fill_pages, write_table

# Name -> function that measures.
CASES: dict[str, Callable[[Effort], list[Row]]] = {
    **{name: partial(crowds.rows, name) for name in crowds.CASES},
    "batch": batch.rows,
    "dict": batch.dictionaries,
    "train": train.rows,
    "scaling": scaling.rows,
    "memory": memory.rows,
    "cold": cold.rows,
}


def load() -> str:
    """Return the load average of the last minute: what else the machine is doing, from which figures suffer."""
    return f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "unknown"


def machine() -> str:
    """Return the type of the processor and how many cores it has."""
    name, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8").splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {os.cpu_count() or 1} cores"


def run(
    case: Annotated[list[str] | None, typer.Argument(help=f"Cases: {', '.join(CASES)}; default all.")] = None,
    peers: Annotated[bool, typer.Option("--peers", help="Also measure other programs, in turn with ours.")] = False,
    seconds: Annotated[float, typer.Option(help="CPU seconds of a block.")] = 0.5,
    blocks: Annotated[int, typer.Option(help="Blocks per figure, in turn; the fastest counts.")] = 3,
    peer_seconds: Annotated[float, typer.Option(help="Seconds after which a peer's block is cut short.")] = 10.0,
    max_people: Annotated[int, typer.Option(help="Leave out larger crowds.")] = 100_000,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object a case, each on a line.")] = False,
    as_csv: Annotated[
        bool, typer.Option("--csv", help="Also write docs/tables/benchmark-CASE.csv, pages and pictures of docs/.")
    ] = False,
) -> None:
    """Measure how fast crowd_env is, against itself and other programs; a few minutes for all cases.

    Figures are of CPU time; compare those of one run.
    """
    with friendly_errors():
        chosen = case or list(CASES)
        for name in chosen:
            known("case", name, CASES)
        for name in chosen:
            with notes.status(f"{name} ...") as status:
                tell = lambda what, name=name, status=status: status.update(f"{name}: {what}")  # noqa: E731
                effort, before = Effort(seconds, blocks, peers, peer_seconds, max_people, tell), load()
                rows = CASES[name](effort)
            made_on = f"load {before} before, {load()} after; {machine()}"
            if as_csv:
                command = f"python -m benchmarks {name}{' --peers' if peers else ''} --csv"
                write_table(f"benchmark-{name}", grid(rows), command, made_on, TABLES)
                fill_pages()
                draw_pictures()
            if as_json:
                typer.echo(json.dumps({"case": name, "machine": made_on, "rows": [row._asdict() for row in rows]}))
            else:
                show(name, grid(rows), made_on)


def show(case: str, figures: list[list[str]], made_on: str) -> None:
    """Print the table of a case, as wide as it needs to be where there is no terminal."""
    table = Table(title=case, title_justify="left", caption=made_on, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for k, head in enumerate(figures[0]):
        table.add_column(head, justify="right" if k else "left")
    for line in figures[1:]:
        table.add_row(*line)
    Console(width=None if notes.is_terminal else 160).print(table)


def main() -> None:
    """Run the command line."""
    typer.run(run)
