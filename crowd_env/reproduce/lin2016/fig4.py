"""Figure 4 of Lin, Ma, Lo: how 100 people leave at 1 m/s, for several strengths A of the social force."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.sample import (
    Sample,
    clearance_rows,
    raw_exits,
    raw_runs,
    sample,
    unfinished_remarks,
    verdict,
)
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.result import Result

TITLE = "Lin, Ma, Lo, Figure 4: 100 people at 1 m/s, by the strength A of the social force"

PEOPLE, SPEED = 100, 1.0  # m/s
STRENGTHS = (200.0, 300.0, 400.0, 500.0)  # N
PRINTED = {200.0: "170", 300.0: "120"}  # s
_REMARK = "paper: barely differs from 300 N"


def runs(settings: LinSettings) -> list[Run]:
    """Return the runs that the figure needs."""
    return [run for strength in STRENGTHS for run in settings.draws(PEOPLE, SPEED, strength=strength)]


def reproduce(settings: LinSettings, work: Work) -> Result:
    """Return the figure, made of the records of its runs."""
    found = {a: sample(work.records, settings.draws(PEOPLE, SPEED, strength=a)) for a in STRENGTHS}
    rows = []
    for strength, draws in found.items():
        paper = PRINTED.get(strength)
        rows += clearance_rows(f"A = {strength:g} N", draws, paper, "" if paper else _REMARK)
    remarks = [*verdict(rows), *_plateau(found), *unfinished_remarks(found.values()), *settings.remarks()]
    raw = {"runs": raw_runs(found.values()), "exit-times": raw_exits(found.values())}
    return Result("lin-fig4", TITLE, rows, raw, partial(_draw, settings, found), remarks, settings.changed(), "s")


def _plateau(found: Mapping[float, Sample]) -> list[str]:
    """Return whether more than 300 N changes anything, and whether less does."""
    medians = {strength: draws.median for strength, draws in found.items()}
    base, strongest, weakest = medians[300.0], medians[500.0], medians[200.0]
    remarks = []
    if base is not None and strongest is not None:
        change = 100 * (strongest / base - 1)
        agrees = "as the paper says: barely" if abs(change) <= 10 else "NOT barely, as the paper says"
        remarks.append(f"From 300 to 500 N the median changes by {change:+.1f} % ({agrees}).")
    if base is not None and weakest is not None:
        paper = 100 * (float(PRINTED[200.0]) / float(PRINTED[300.0]) - 1)
        change = 100 * (weakest / base - 1)
        remarks.append(
            f"With 200 N instead of 300 N the median is {change:+.1f} % here, {paper:+.0f} % in the paper; "
            f"{found[200.0].count_blocked()} with 200 N, {found[300.0].count_blocked()} with 300 N."
        )
    return remarks


def _draw(settings: LinSettings, found: Mapping[float, Sample], path: Path) -> Path:
    from crowd_env.reproduce.lin2016.figures.clearance import Panel, leaving_curves, series

    curves = [
        draws.curve(f"A = {strength:g} N", series(k), PRINTED.get(strength))
        for k, (strength, draws) in enumerate(found.items())
    ]
    title = f"{PEOPLE} people who want {SPEED:g} m/s, by the strength A of the social force"
    return leaving_curves(path, [Panel(title, PEOPLE, curves)], settings.readings())
