"""Figures as tables: a line for whoever is measured, a column for each quantity; ratios in a table of their own."""

from typing import Any, NamedTuple

Result = dict[str, Any]


class Grid(NamedTuple):
    """A table of text."""

    head: list[str]
    lines: list[list[str]]


def grids(result: Result) -> list[Grid]:
    """Return the tables of a case: figures by quantity (those of the same quantities together), then ratios by peer."""
    plain = [row for row in result["rows"] if row["ratio"] is None and ": " in row["what"]]
    ratios = [row for row in result["rows"] if row["ratio"] is not None]
    rest = [row for row in result["rows"] if row["ratio"] is None and ": " not in row["what"]]
    found = _figures(plain)
    if ratios:
        peers = list(dict.fromkeys(row["peer"] for row in ratios))
        cells = {(row["what"], row["peer"]): number(row["ratio"]) for row in ratios}
        whats = list(dict.fromkeys(row["what"] for row in ratios))
        marks = [chr(ord("A") + k) for k in range(len(peers))]
        lines = [[what, *(cells.get((what, peer), "") for peer in peers)] for what in whats]
        legend = [[f"{mark} = {peer}", *[""] * len(peers)] for mark, peer in zip(marks, peers, strict=True)]
        found.append(Grid(["ratio to", *marks], lines + legend))
    if rest:
        found.append(Grid(["", ""], [[row["what"], f"{number(row['value'])}{_of(row['unit'])}"] for row in rest]))
    return found


def _of(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _figures(rows: list[dict[str, Any]]) -> list[Grid]:
    """Put lines with the same columns into one table."""
    lines: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for row in rows:
        who, _, quantity = row["what"].rpartition(": ")
        column = f"{quantity}, {row['unit']}"
        lines.setdefault(who, {})[column] = number(row["value"])
        units[column] = row["unit"]
    groups: dict[tuple[str, ...], list[str]] = {}
    for who, cells in lines.items():
        fitting = next((columns for columns in groups if set(cells) <= set(columns)), None)
        groups.setdefault(fitting or tuple(cells), []).append(who)
    return [
        Grid(["", *columns], [[who, *(lines[who].get(column, "") for column in columns)] for who in whose])
        for columns, whose in groups.items()
    ]


def number(value: float) -> str:
    """Return a figure for people: 3 or 4 digits, large ones with a suffix."""
    for limit, suffix in ((1e9, "G"), (1e6, "M"), (1e4, "k")):
        if abs(value) >= limit:
            return f"{value / {'G': 1e9, 'M': 1e6, 'k': 1e3}[suffix]:.3g} {suffix}"
    return f"{value:.4g}"
