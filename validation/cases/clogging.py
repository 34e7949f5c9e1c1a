"""Clogging: how long are the gaps between people who press through a narrow door, and how large their bursts?

Zuriguel et al. 2014 find power-law tails of the gaps in crowds, sheep herds, grains and colloids; where the exponent is 2 or
less the mean gap diverges.  Garcimartín et al. 2014 find such a tail in drills with students.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crowd_env.analysis.clogging import Clogging, RunExits, clogging, exits_of_run
from crowd_env.core.behaviors.headway import Headway
from crowd_env.rendering import save_figure, survival_curves
from validation.cases.case import COMPARED, Row, Setting, number, row, share
from validation.cases.crowds import Passages, draw_crowds
from validation.cases.doors import door

_PEOPLE, _DOOR = 100, 0.7  # m
_LINE = 0.3  # m, where the neck ends
_PATIENCE, _LIMIT = 30.0, 400.0  # s


def exits(setting: Setting) -> list[RunExits]:
    """Return when people pass the door in each draw; a draw ends when all have, or after 30 s without a passage."""
    crowds = draw_crowds([door(_DOOR, _PEOPLE)], setting)
    passages = Passages(crowds, 0, _LINE)
    *_, (_, last) = passages.moments(_LIMIT, _PATIENCE)
    return [exits_of_run(passages.times(e), passages.stuck.get(e, last.time)) for e in range(crowds.count)]


def told(found: Clogging, runs: int) -> str:
    """Return the statistics as a sentence."""
    gaps = found.gaps.closed
    spread = float(gaps.std() / gaps.mean()) if len(gaps) else float("nan")
    largest = int(found.bursts.max()) if len(found.bursts) else 0
    tail = (
        f"no exponent: {found.no_tail}"
        if found.tail is None
        else f"exponent {found.tail.alpha:.2f} ± {found.tail.error:.2f} from {found.tail.x_min:.2f} s"
        + (f", {number(found.tail.alpha_open)} with open gaps" if np.isfinite(found.tail.alpha_open) else "")
        + f"; against an exponential {found.tail.ratio:+.1f} (p = {found.tail.p:.2g})"
    )
    bursts = f"{len(gaps)} gaps, sd / mean {number(spread)}; largest burst {largest}"
    return f"{tail}; {bursts}; {share(found.blocked, runs)} blocked"


def met(found: Clogging) -> bool:
    """Whether a power law describes the tail better than an exponential does."""
    return found.tail is not None and found.tail.ratio > 0.0 and found.tail.p < 0.05


def run(setting: Setting) -> list[Row]:
    """Return the row."""
    runs = exits(setting)
    found = clogging(runs, blocked_after=_PATIENCE - 1.0)
    presses = Headway.of(setting.manner) is None
    more = found.as_json() | {"exits": [list(one.time) for one in runs], "until": [one.until for one in runs]}
    return [row("clogging", setting, met(found) if presses else None, told(found, len(runs)), **more)]


def draw(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``clogging-MANNER.png``: the survival function of the gaps under each scheme that is compared by default."""
    for manner in dict.fromkeys(one.manner for one in rows):
        found = {one.scheme: _again(one) for one in rows if one.manner == manner and one.scheme in COMPARED}
        sets = {scheme: each for scheme, each in found.items() if each.gaps.closed.any()}
        if sets:
            title = f"gaps at a door of {_DOOR:g} m, {manner}"
            save_figure(survival_curves(sets, title=title), folder / f"clogging-{manner}.png")


def _again(one: Row) -> Clogging:
    """Return the statistics of a row."""
    ends = (np.nan if until is None else until for until in one.more["until"])
    runs = (RunExits(np.array(t), np.zeros(len(t)), until) for t, until in zip(one.more["exits"], ends, strict=True))
    return clogging(list(runs), blocked_after=_PATIENCE - 1.0)
