"""The measured tables of docs/: each is a file in docs/tables/, and stands in the pages wherever a mark names it.

Between ``<!-- table: NAME -->`` and ``<!-- end -->`` stands docs/tables/NAME.csv, with the command that made it from
docs/tables/made_by.csv below; nothing there is typed by hand.  ``<!-- table: NAME COLUMN=VALUE -->`` takes the rows that have
this value and leaves out columns that are empty then, and the command; a single row stands upright.

A figure in a sentence stands between ``<!--NAME-->`` and ``<!--/-->``, and is the value of NAME in docs/tables/facts.csv.
"""

import csv
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from crowd_env.analysis.figures import cell
from crowd_env.core.checks import Plain, known
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.csv_table import plain_cell, write_csv

ROOT = Path(__file__).resolve().parent.parent
TABLES = ROOT / "docs" / "tables"
MADE_BY = "made_by"  # table, or picture of docs/images/, command, note
_FACT = re.compile(r"<!--([\w-]+)-->.*?<!--/-->", re.DOTALL)
_MARK = re.compile(r"(<!-- table: ([\w-]+)((?: [\w-]+=[\w.-]+)*) -->\n).*?(?=<!-- end -->)", re.DOTALL)

Grid = list[list[str]]  # rows of cells, the head first
Rows = Iterable[Plain]


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file of this package."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


_LAYOUTS = read_toml(Path(__file__).with_name("tables.toml"))


def grid(rows: Rows, **columns: str) -> Grid:
    """Return a table with a row for each of ``rows``; ``columns`` are format strings by the heads of the columns."""
    return [list(columns), *([cell(text, row) for text in columns.values()] for row in rows)]


def pivoted(rows: Rows, index: Mapping[str, str], across: str, text: str) -> Grid:
    """Return a table with a row for each index and a column for each value of ``across``."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        found.setdefault(tuple(cell(one, row) for one in index.values()), {})[cell(across, row)] = cell(text, row)
    heads = list(dict.fromkeys(head for cells in found.values() for head in cells))
    return [[*index, *heads], *([*names, *(cells.get(head, "") for head in heads)] for names, cells in found.items())]


def laid_out(name: str, rows: Rows) -> Grid:
    """Return a table of rows as tables.toml lays it out."""
    layout = _LAYOUTS[name]
    if "across" in layout:
        return pivoted(rows, layout["columns"], layout["across"], layout["cells"])
    return grid(rows, **layout["columns"])


def read_table(name: str, folder: Path = TABLES) -> Grid:
    """Return a table; ValueError if there is none."""
    path = folder / f"{name}.csv"
    if not path.exists():
        raise ValueError(f"no table {name!r}; known: {', '.join(sorted(one.stem for one in folder.glob('*.csv')))}")
    with path.open(newline="", encoding="utf-8") as file:
        return [list(map(plain_cell, row)) for row in csv.reader(file)]


def write_table(name: str, grid: Grid, command: str, note: str = "", folder: Path = TABLES) -> None:
    """Store a table and the command that made it; each file is whole or as it was."""
    commands = {row[0]: row for row in read_table(MADE_BY, folder)[1:]} | {name: [name, command, note]}
    write_csv(folder / f"{name}.csv", grid[0], grid[1:])
    write_csv(folder / f"{MADE_BY}.csv", ["table", "command", "note"], [commands[key] for key in sorted(commands)])


def pages_of(root: Path = ROOT) -> list[Path]:
    """Return README, the pages and the notebooks."""
    return [
        root / "README.md",
        *sorted((root / "docs").rglob("*.md")),
        *sorted((root / "docs/notebooks").glob("*.ipynb")),
    ]


def facts_in(page: str) -> list[str]:
    """Return the names of the facts that a page states."""
    return [mark[1] for mark in _FACT.finditer(page)]


def filled(page: str, folder: Path = TABLES) -> str:
    """Return the text of a page with the tables and facts as they lie in a folder; ValueError if one is not there."""
    page = _MARK.sub(lambda mark: mark[1] + _markdown(mark[2], mark[3], folder), page)
    facts = dict(read_table("facts", folder)) if facts_in(page) else {}
    return _FACT.sub(lambda mark: f"<!--{mark[1]}-->{facts[known('fact', mark[1], facts)]}<!--/-->", page)


def fill_pages(root: Path = ROOT) -> list[Path]:
    """Write all tables and facts into the pages below ``root``; return the pages that have changed."""
    changed = []
    for page in pages_of(root):
        before = page.read_text(encoding="utf-8")
        after = filled(before, root / "docs" / "tables")
        if after != before:
            write_text(page, after)
            changed.append(page)
    return changed


def _markdown(name: str, chosen: str, folder: Path) -> str:
    head, *rows = read_table(name, folder)
    if chosen:
        wanted = {head.index(column): value for column, value in (word.split("=") for word in chosen.split())}
        rows = [row for row in rows if all(row[k].strip("`") == value for k, value in wanted.items())]
        if not rows:
            return "None yet.\n"
        kept = [k for k in range(len(head)) if k not in wanted and any(row[k] for row in rows)]
        head, *rows = ([row[k] for k in kept] for row in (head, *rows))
        if len(rows) == 1:
            head, rows = ["", ""], [list(pair) for pair in zip(head, rows[0], strict=True)]
    lines = [head, ["---"] * len(head), *rows]
    text = "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
    if chosen:
        return text
    command, note = next(row[1:] for row in read_table(MADE_BY, folder) if row[0] == name)
    return f"{text}\nMade by `{command}`{note and f'; {note}'}.\n"
