"""Shoulders against discs as tables of docs/physics.md: the gate and the doors of the map, run with both."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from validation.cases.case import DISC, number, share
from validation.cases.doors import WIDTHS
from validation.cases.gate import FLOW, RADIUS

if TYPE_CHECKING:
    from validation.pages import Sources

Cells = list[list[str]]

_OUTLINES = {DISC: "discs", "torso": "torsos"}
_RUN = "python -m validation {} --schemes hertz --manner hurried --manner competitive --draws {} --out DIR"
_ONCE_MORE = ", and once more with --outline torso"
GATE_MADE_BY = _RUN.format("gate", 100) + _ONCE_MORE
DOORS_MADE_BY = _RUN.format("doors", 10) + _ONCE_MORE

GATE_HEAD = ("bodies", "manner", "flow, 1/s", "variation of the gaps", "no passage for 20 s")
DOORS_HEAD = ("bodies", "manner", *(f"{width:g} m" for width in WIDTHS))


def gate(source: "Sources") -> Cells:
    """One row a shape and manner: the flow of the runs that were not stuck, and how many were."""
    cells = []
    for row in _rows(source, "gate"):
        found, runs = row["more"], len(row["more"]["passages"])
        flow = _number(found["flow"])
        if found["flow_error"] is not None:
            flow += f" ± {number(found['flow_error'])}"
        names = [f"{_OUTLINES[row['outline']]} of {RADIUS:g} m", row["manner"]]
        cells.append([*names, flow, _number(found["variation"]), share(found["stuck"], runs)])
    return cells


def gate_note(source: "Sources") -> str:
    """Say how often each was run, and what was recorded."""
    starts = {row["more"]["starts"] for row in _rows(source, "gate")}
    where = {"random": "at random", "recorded": "where recorded"}
    return (
        f"`hertz`, {_draws(source, 'gate')} of 75 people who start {' or '.join(where[one] for one in sorted(starts))}; the "
        f"recording has {FLOW:g} /s. Flow and variation are means of the runs that were not stuck, the flow with its standard "
        "error; shares have their 95 % interval."
    )


def doors(source: "Sources") -> Cells:
    """One row a shape and manner, one column a door: the flow per meter of the runs that were not stuck."""
    cells = []
    for row in _rows(source, "doors"):
        doors = row["more"]["widths"].values()
        names = [_OUTLINES[row["outline"]], row["manner"]]
        cells.append([*names, *(_door(one["flow"], one["stuck"], len(one["runs"])) for one in doors)])
    return cells


def doors_note(source: "Sources") -> str:
    """Say how often each was run."""
    return f"`hertz`, {_draws(source, 'doors')}; flow per meter in /(m s) of the runs that were not stuck."


def _rows(source: "Sources", case: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of a case under `hertz`, shape by shape."""
    for outline in _OUTLINES:
        yield from (row for row in source.rows(case, outline) if row["scheme"] == "hertz")


def _draws(source: "Sources", case: str) -> str:
    """Return how many draws a case has had; raise ValueError if shapes were run differently often."""
    found = {source.draws(case, outline) for outline in _OUTLINES}
    if len(found) > 1:
        raise ValueError(f"{case} has been run with {' and '.join(sorted(found))}; run discs and torsos equally often")
    return found.pop()


def _door(flow: float | None, stuck: int, runs: int) -> str:
    return _number(flow) + (f", {stuck} of {runs} stuck" if stuck else "")


def _number(value: float | None) -> str:
    """Return a number of a finished row, in which None stands for what is not finite."""
    return number(float("nan") if value is None else value)
