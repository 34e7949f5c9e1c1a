"""Tables in CSV files as people have them: written by a program, or by a spreadsheet of any country.

A byte order mark, ``;`` or tabs between the cells, decimal commas beside these, capitals and blanks in the names of columns,
empty lines and lines that begin with ``#`` are all understood.  A text that a spreadsheet would compute, since it begins with
``=``, ``+``, ``-`` or ``@``, is written behind a ``'``, which spreadsheets understand, and read without it.
"""

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from crowd_env.core.checks import path as path_of
from crowd_env.core.files.atomic import written
from crowd_env.core.files.foreign import read_text, rows_in

_SEPARATORS = (";", "\t", ",")
_FORMULA = re.compile(r"'*[=+\-@].", re.DOTALL)


class Row(NamedTuple):
    """A row of a table: its number, from 1, and its cells by the names of the columns."""

    number: int
    cells: dict[str, str]


class Table(NamedTuple):
    """The rows of a CSV file."""

    path: Path
    columns: list[str]  # in small letters
    rows: list[Row]
    decimal_comma: bool  # 1,5 is a number: the cells are not separated by commas

    def number(self, row: Row, column: str, what: str) -> float:
        """Return a cell as a finite number; ``what`` names the row in errors.

        Raises
        ------
        ValueError
            If it is none.
        """
        text = row.cells.get(column) or ""
        plain = text.replace(",", ".") if self.decimal_comma and "." not in text else text
        try:
            value = float(plain.replace("_", " _"))
        except ValueError:
            raise ValueError(f"{self.path}: {what}: {column} is {text!r}, not a number") from None
        if not math.isfinite(value):
            raise ValueError(f"{self.path}: {what}: {column} is {text}, which is not finite")
        return value


def read_table(path: str | Path, what: str, needed: Sequence[str], unit: str, row_is: str) -> Table:
    """Return the table of a CSV file whose header line names the columns ``needed``.

    Parameters
    ----------
    what : of what it is a table, for errors: "the starting positions".
    unit : in which the numbers are: "meters".
    row_is : what a line stands for: "a person".

    Raises
    ------
    ValueError
        If the file cannot be read, holds nothing, lacks a column, or a line has more cells than the header.
    """
    path = path_of(f"the file of {what}", path)
    names = ",".join(needed)
    wanted = f"a header line '{names}' and one line {row_is}"
    text = read_text(path, what, f"{what} are read from a CSV file with {wanted}")
    lines = rows_in(text)
    if lines and lines[0].lower().startswith("sep="):
        lines = lines[1:]
    if not lines:
        raise ValueError(f"{path}: no {what.removeprefix('the ')}; the file needs {wanted}")
    separator = next((one for one in _SEPARATORS if one in lines[0]), ",")
    try:
        header, *rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise ValueError(f"cannot read {what} {path}: {error}") from None
    columns = [name.strip().lower() for name in header]
    found = ", ".join(repr(name) for name in header)
    for name in needed:
        if name not in columns:
            raise ValueError(
                f"{path}: column {name!r} is missing; the header line must name {' and '.join(needed)} ({unit}), "
                f"it has {found}"
            )
        if columns.count(name) > 1:
            raise ValueError(f"{path}: column {name!r} occurs twice; the header line has {found}")
    table = Table(path, columns, list(_rows(path, columns, rows, separator)), separator != ",")
    if not table.rows:
        raise ValueError(f"{path}: no {what.removeprefix('the ')}; the file needs {wanted}")
    return table


def _rows(path: Path, columns: list[str], rows: list[list[str]], separator: str) -> Iterator[Row]:
    for number, cells in enumerate((row for row in rows if any(cell.strip() for cell in row)), start=1):
        if any(cell.strip() for cell in cells[len(columns) :]):
            comma = "; is it a decimal comma? Then separate the cells by ;" if separator == "," else ""
            raise ValueError(f"{path}: row {number} has {len(cells)} cells for {len(columns)} columns{comma}")
        yield Row(number, {name: plain_cell(cell.strip()) for name, cell in zip(columns, cells, strict=False)})


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write a table as CSV, whole or not at all, and return the path."""
    with written(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(map(_written, row) for row in chain([header], rows))
    return path


def _written(cell: object) -> object:
    """Return a cell as spreadsheets are to take it: numbers, also as text, as they are."""
    if not isinstance(cell, str) or not _FORMULA.match(cell):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def plain_cell(cell: str) -> str:
    """Return the text that `write_csv` was given for a cell."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell
