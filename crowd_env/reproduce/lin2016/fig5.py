"""Figure 5 of Lin, Ma, Lo: how 100 people leave at 1 and 2 m/s, with and without rotation."""

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
)
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.result import Result

TITLE = "Lin, Ma, Lo, Figure 5: 100 people with and without rotation"

PEOPLE = 100
SPEEDS = (1.0, 2.0)  # m/s, panels a and b
_REMARKS = {
    (1.0, True): "",
    (1.0, False): "paper: basically the same as with rotation",
    (2.0, True): "",
    (2.0, False): "paper: clogs more, barely recovers",
}


def runs(settings: LinSettings) -> list[Run]:
    """Return the runs that the figure needs."""
    return [run for speed, turning in _REMARKS for run in settings.draws(PEOPLE, speed, rotation=turning)]


def reproduce(settings: LinSettings, work: Work) -> Result:
    """Return the figure, made of the records of its runs."""
    found = {key: sample(work.records, settings.draws(PEOPLE, key[0], rotation=key[1])) for key in _REMARKS}
    rows = []
    for (speed, turning), draws in found.items():
        of = f"{speed:g} m/s, {'rotation' if turning else 'no rotation'}"
        rows += clearance_rows(of, draws, None, _REMARKS[speed, turning])
    remarks = [_slow(found), _fast(found), *unfinished_remarks(found.values()), *settings.remarks()]
    raw = {"runs": raw_runs(found.values()), "exit-times": raw_exits(found.values())}
    return Result("lin-fig5", TITLE, rows, raw, partial(_draw, settings, found), remarks, settings.changed(), "s")


def _slow(found: Mapping[tuple[float, bool], Sample]) -> str:
    turning, rigid = found[1.0, True], found[1.0, False]
    counts = f"{turning.count_blocked()} with rotation, {rigid.count_blocked()} without"
    if turning.median is None or rigid.median is None:
        return f"At 1 m/s there is no clearance time to compare; {counts}. The paper finds basically the same: NOT reproduced."
    change = rigid.median / turning.median - 1
    verdict = "reproduced" if abs(change) <= 0.1 else "NOT reproduced"
    if rigid.blocked > turning.blocked:
        verdict += " in the times; but more draws block"
    return (
        f"At 1 m/s the median without rotation is {100 * change:+.1f} % off that with it; {counts}. The paper finds basically "
        f"the same: {verdict}."
    )


def _fast(found: Mapping[tuple[float, bool], Sample]) -> str:
    turning, rigid = found[2.0, True], found[2.0, False]
    more = rigid.blocked > turning.blocked
    return (
        f"At 2 m/s, {rigid.count_blocked()} without rotation, {turning.count_blocked()} with it. The paper finds clogging more "
        f"likely without: {'reproduced' if more else 'NOT reproduced'}."
    )


def _draw(settings: LinSettings, found: Mapping[tuple[float, bool], Sample], path: Path) -> Path:
    from crowd_env.reproduce.lin2016.figures.clearance import Panel, leaving_curves, series

    panels = []
    for letter, speed in zip("ab", SPEEDS, strict=True):
        curves = [found[speed, True].curve("with rotation", series(0)), found[speed, False].curve("without", series(1))]
        panels.append(Panel(f"{letter}. {PEOPLE} people who want {speed:g} m/s", PEOPLE, curves))
    return leaving_curves(path, panels, settings.readings())
