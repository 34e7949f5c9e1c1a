"""``python -m benchmarks.report DIR``: put what ``python -m benchmarks --out DIR`` has written into docs/performance.md.

Between ``<!-- case: NAME -->`` and ``<!-- end -->`` stand the tables of a case, and nothing that is written by hand; plots go
to docs/images.  Cases without a file in DIR stay as they are.
"""

import json
import shutil
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from benchmarks.cli import CASES
from benchmarks.tables import Grid, grids
from crowd_env.files.atomic import write_text

PAGE = Path(__file__).resolve().parent.parent / "docs" / "performance.md"
_notes = Console(stderr=True, highlight=False)


def run(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that --out named.")],
    page: Annotated[Path, typer.Option(help="Page to write the tables into.")] = PAGE,
) -> None:
    """Write the tables of docs/performance.md, and its plots, from measured figures."""
    try:
        done = fill(folder, page)
    except (ValueError, OSError) as error:
        _notes.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None
    _notes.print(f"{page.name}: {', '.join(done)}", markup=False, soft_wrap=True)


def fill(folder: Path, page: Path) -> list[str]:
    """Write the cases of a folder into a page; return their names.

    Raises
    ------
    ValueError
        If there is nothing to write, a file is not what --out writes, or the page has no place for a case.
    """
    found = {name: folder / f"{name}.json" for name in CASES if (folder / f"{name}.json").exists()}
    if not found:
        raise ValueError(f"{folder} holds no figures; write some with: python -m benchmarks --out {folder}")
    tables = {name: markdown(read(path)) for name, path in found.items()}
    text = page.read_text(encoding="utf-8")
    for name, lines in tables.items():
        before, mark, rest = text.partition(f"<!-- case: {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise ValueError(
                f"{page.name} has no place for {name}; mark one with <!-- case: {name} --> and <!-- end -->"
            )
        text = f"{before}{mark}\n{lines}\n{end}{after}"
    for name in found:
        if (folder / f"{name}.png").exists():
            images = page.parent / "images"
            images.mkdir(exist_ok=True)
            shutil.copyfile(folder / f"{name}.png", images / f"performance-{name}.png")
    write_text(page, text)
    return list(found)


def read(path: Path) -> dict[str, Any]:
    """Return the figures of a file.

    Raises
    ------
    ValueError
        If it does not hold what --out writes.
    """
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        for row in result["rows"]:
            if set(row) != {"what", "value", "unit", "peer", "ratio"}:
                raise ValueError(f"row {row}")
        return dict(result)
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} does not hold the figures of a case ({error})") from None


def markdown(result: dict[str, Any]) -> str:
    """Return the tables of a case, and under them the machine and its load."""
    return "\n".join(_table(grid) if any(grid.head) else _list(grid) for grid in grids(result))


def _table(grid: Grid) -> str:
    head = [cell.replace(", ", "<br>") for cell in grid.head]
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *grid.lines]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "".join(f"\n{line}\n" for line in grid.legend)


def _list(grid: Grid) -> str:
    return "; ".join(" ".join(line) for line in grid.lines) + ".\n"


if __name__ == "__main__":
    typer.run(run)
