"""The command ``python -m benchmarks``."""

import json
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks import (
    batch,
    big,
    cold,
    dictionaries,
    hall,
    headway,
    jam,
    memory,
    plots,
    roofline,
    room20,
    scaling,
    train,
)
from benchmarks.measuring import Effort, Row
from benchmarks.tables import Grid, grids
from crowd_env.core.console import check_folder, friendly_errors, notes
from crowd_env.core.files.json_file import write_json

# Name -> function that measures.
CASES: dict[str, Callable[[Effort], list[Row]]] = {
    "room20": room20.rows,
    "big": big.rows,
    "hall": hall.rows,
    "jam": jam.rows,
    "headway": headway.rows,
    "batch": batch.rows,
    "dict": dictionaries.rows,
    "train": train.rows,
    "roofline": roofline.rows,
    "scaling": scaling.rows,
    "memory": memory.rows,
    "cold": cold.rows,
}


def report(case: str, effort: Effort) -> dict[str, Any]:
    """Return the figures of a case, ready for JSON."""
    before = _load("before")
    found = [*CASES[case](effort), *before, *_load("after"), machine()]
    return {"case": case, "rows": [row._asdict() for row in found]}


def _load(when: str) -> list[Row]:
    """What else the machine is doing: the figures suffer from it."""
    try:
        return [Row(f"load average of the last minute, {when}", round(os.getloadavg()[0], 2), "1")]
    except (AttributeError, OSError):  # not on every system
        return []


def machine() -> Row:
    """Return the type of the processor and how many cores it has."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):  # not Linux
        pass
    return Row(f"processor {name}", float(os.cpu_count() or 1), "cores")


def run(
    case: Annotated[list[str] | None, typer.Argument(help=f"Cases: {', '.join(CASES)}; default all.")] = None,
    peers: Annotated[bool, typer.Option("--peers", help="Also measure other programs, in turn with ours.")] = False,
    seconds: Annotated[float, typer.Option(help="CPU seconds of a block.")] = 0.5,
    blocks: Annotated[int, typer.Option(help="Blocks per figure, in turn; the fastest counts.")] = 3,
    peer_seconds: Annotated[float, typer.Option(help="Seconds after which a peer's block is cut short.")] = 10.0,
    max_people: Annotated[int, typer.Option(help="Leave out larger crowds.")] = 100_000,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object a case, each on a line.")] = False,
    out: Annotated[Path | None, typer.Option(help="Also write CASE.json, and plots, into this folder.")] = None,
) -> None:
    """Measure how fast crowd_env is, against itself, the machine and other programs; a few minutes for all cases.

    Figures are of CPU time; compare those of one run.  `python -m benchmarks.report DIR` puts what --out has written into
    docs/performance.md.
    """
    with friendly_errors():
        chosen = case or list(CASES)
        for name in chosen:
            if name not in CASES:
                raise ValueError(f"unknown case {name!r}; known: {', '.join(CASES)}")
        if out is not None:
            check_folder("--out", out)
        for name in chosen:
            with notes.status(f"{name} ...") as status:
                effort = Effort(seconds, blocks, peers, peer_seconds, max_people, _teller(name, status.update))
                result = report(name, effort)
            if out is not None:
                write_json(out / f"{name}.json", result)
                plots.draw(result, out)
            if as_json:
                typer.echo(json.dumps(result))
            else:
                show(result)


def _teller(case: str, update: Callable[[str], None]) -> Callable[[str], None]:
    """Return what tells of progress: on a terminal in place, else a line for each thing."""

    def tell(what: str) -> None:
        if notes.is_terminal:
            update(f"{case}: {what}")
        elif "block" not in what:
            notes.print(f"{case}: {what}", markup=False, soft_wrap=True)

    return tell


def show(result: dict[str, Any]) -> None:
    """Print the tables of a case."""
    console = Console()
    for k, grid in enumerate(grids(result)):
        console.print(_table(grid, result["case"] if k == 0 else None))
        for line in grid.legend:
            console.print(line, markup=False, highlight=False)


def _table(grid: Grid, title: str | None) -> Table:
    table = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        show_header=any(grid.head),
    )
    for k, head in enumerate(grid.head):
        words = max((len(word) for word in head.replace(", ", " ").split()), default=0)
        table.add_column(head.replace(", ", "\n"), justify="right" if k else "left", min_width=min(words, 16))
    for line in grid.lines:
        table.add_row(*line)
    return table


def main() -> None:
    """Run the command line."""
    typer.run(run)
