"""Figures as tables: a line for whoever is measured, a column for each quantity; ratios in a table of their own."""

import re
from typing import Any, NamedTuple

Result = dict[str, Any]
Line = dict[str, Any]


class Grid(NamedTuple):
    """A table of text; without a head, pairs of words and figures."""

    head: list[str]
    lines: list[list[str]]
    legend: list[str] = []


def grids(result: Result) -> list[Grid]:
    """Return the tables of a case: figures by quantity, ratios by peer, and what has no quantity."""
    alone = [row for row in result["rows"] if row["ratio"] is None]
    named = [row for row in alone if ": " in row["what"]]
    rest = [row for row in alone if ": " not in row["what"]]
    found = _figures(named)
    ratios = [row for row in result["rows"] if row["ratio"] is not None]
    found += _ratios(ratios)
    if rest:
        found.append(Grid(["", ""], [[row["what"], f"{number(row['value'])}{_of(row['unit'])}"] for row in rest]))
    return found


def _of(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _ratios(rows: list[Line]) -> list[Grid]:
    """Return a table for all who are compared with the same peers: a line for each of them, a column for each peer."""
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        cells.setdefault(row["what"], {})[row["peer"]] = number(row["ratio"])
    groups: dict[tuple[str, ...], list[str]] = {}
    for what, ratios in cells.items():
        groups.setdefault(tuple(ratios), []).append(what)
    found = []
    for peers, whats in groups.items():
        marks = [chr(ord("A") + k) for k in range(len(peers))]
        common = _common_end(whats)
        lines = [[what.removesuffix(common), *cells[what].values()] for what in whats]
        head = f"{common.strip(' :,')}, ratio to" if common else "ratio to"
        legend = [f"{mark} = {peer}" for mark, peer in zip(marks, peers, strict=True)]
        found.append(Grid([head, *marks], lines, legend))
    return found


def _common_end(whats: list[str]) -> str:
    """Return what several lines end with alike, from a comma or a colon on."""
    if len(whats) < 2:
        return ""
    common = ""
    for ends in zip(*(re.findall(r"(?:^|, |: )(?:(?!, |: ).)*", what)[:0:-1] for what in whats), strict=False):
        if len(set(ends)) > 1:
            break
        common = ends[0] + common
    return common


def _figures(rows: list[Line]) -> list[Grid]:
    """Put lines with the same columns into one table, wide ones by the number of people; remarks go into one of their own."""
    lines: dict[str, dict[str, str]] = {}
    for row in rows:
        who, _, quantity = row["what"].rpartition(": ")
        lines.setdefault(who, {})[f"{quantity}, {row['unit']}"] = number(row["value"])
    groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for who, cells in lines.items():
        columns = tuple(column for column in cells if not column.startswith(_REMARKS))
        size = who.rpartition(", ")[2] if len(columns) > _NARROW else ""
        alike = (known for known in groups if known[0] == size and set(columns) <= set(known[1]))
        groups.setdefault(next(alike, (size, columns)), []).append(who)
    found = [_grid(lines, whose, columns, size) for (size, columns), whose in groups.items() if columns]
    for remark in dict.fromkeys(column for cells in lines.values() for column in cells if column.startswith(_REMARKS)):
        found.append(_grid(lines, [who for who, cells in lines.items() if remark in cells], (remark,), ""))
    return found


_REMARKS = ("saw only", "settled for", "stopped at")
_NARROW = 2  # columns


def _grid(lines: dict[str, dict[str, str]], whose: list[str], columns: tuple[str, ...], size: str) -> Grid:
    """Return a table; what all lines have in common is said once, in its head."""
    names = [who.removesuffix(f", {size}") if size else who for who in whose]
    cells = [
        [name, *(lines[who].get(column, "") for column in columns)] for name, who in zip(names, whose, strict=True)
    ]
    return Grid([size, *columns], cells)


def number(value: float) -> str:
    """Return a figure for people: 3 or 4 digits, large ones with a suffix."""
    for limit, size, suffix in ((1e9, 1e9, "G"), (1e6, 1e6, "M"), (1e4, 1e3, "k")):
        if abs(value) >= limit:
            return f"{value / size:.3g} {suffix}"
    return f"{value:.4g}"
