"""The command ``python -m benchmarks``."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from benchmarks import batch, cold, particles, room20, train
from benchmarks.measuring import Effort, Row

# Name -> function that measures.
CASES: dict[str, Callable[[Effort], list[Row]]] = {
    "batch": batch.rows,
    "train": train.rows,
    "room20": room20.rows,
    "particles": particles.rows,
    "cold": cold.rows,
}
_notes = Console(stderr=True, highlight=False)


def report(case: str, effort: Effort) -> dict[str, Any]:
    """Return the figures of a case, ready for JSON."""
    load = _load()
    found = [*CASES[case](effort), *load]
    return {"case": case, "rows": [row._asdict() for row in found]}


def _load() -> list[Row]:
    """What else the machine is doing: the figures suffer from it."""
    try:
        return [Row("load average of the last minute, before", round(os.getloadavg()[0], 2), "1")]
    except (AttributeError, OSError):  # not on every system
        return []


def run(
    case: Annotated[list[str] | None, typer.Argument(help=f"Cases: {', '.join(CASES)}; default all.")] = None,
    seconds: Annotated[float, typer.Option(help="CPU seconds of a block.")] = 1.0,
    blocks: Annotated[int, typer.Option(help="Blocks per figure, of which the fastest counts.")] = 3,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object a case, each on a line.")] = False,
    out: Annotated[Path | None, typer.Option(help="Also write CASE.json into this folder.")] = None,
) -> None:
    """Measure how fast crowd_env is; a few minutes for all cases."""
    try:
        effort = Effort(seconds, blocks)
        chosen = case or list(CASES)
        for name in chosen:
            if name not in CASES:
                raise ValueError(f"unknown case {name!r}; known: {', '.join(CASES)}")
        for name in chosen:
            with _notes.status(f"{name} ..."):
                result = report(name, effort)
            if out is not None:
                out.mkdir(parents=True, exist_ok=True)
                (out / f"{name}.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
            if as_json:
                typer.echo(json.dumps(result))
            else:
                Console().print(_table(result))
    except ValueError as error:
        _notes.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None


def _table(result: dict[str, Any]) -> Table:
    table = Table(title=result["case"], show_header=False, title_justify="left")
    for row in result["rows"]:
        unit = "" if row["unit"] == "1" else row["unit"]
        table.add_row(row["what"], f"{row['value']:,g}" if row["value"] < 1e4 else f"{row['value']:,.0f}", unit)
    return table


def main() -> None:
    """Run the command line."""
    typer.run(run)
