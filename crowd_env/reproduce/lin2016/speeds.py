"""Figures 7 and 8 of Lin, Ma, Lo: leaving process and clearance time against the desired speed, 200 and 300 people."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

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
from crowd_env.reproduce.result import Result, Row

SPEEDS = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)  # m/s
PAPER_BLOCKED = 1.8  # m/s, "1.8 m/s or higher could lead to the totally blockage of the exit"


@dataclass(frozen=True)
class BySpeed:
    """One of the two figures."""

    name: str
    people: int
    speeds: tuple[float, ...] = SPEEDS  # m/s
    printed: Mapping[float, str] = field(default_factory=dict)  # speed -> s
    printed_mean: tuple[float, float, str] | None = None  # from speed, to speed, s

    @property
    def title(self) -> str:
        """What the table is called."""
        figure = self.name.removeprefix("lin-fig")
        return f"Lin, Ma, Lo, Figure {figure}: {self.people} people, by desired speed"

    def runs(self, settings: LinSettings) -> list[Run]:
        """Return the runs that the figure needs."""
        return [run for speed in self.speeds for run in settings.draws(self.people, speed)]

    def reproduce(self, settings: LinSettings, work: Work) -> Result:
        """Return the figure, made of the records of its runs."""
        found = {speed: sample(work.records, settings.draws(self.people, speed)) for speed in self.speeds}
        rows = []
        for speed, draws in found.items():
            remark = "paper: blocked" if speed >= PAPER_BLOCKED else ""
            rows += clearance_rows(f"{speed:.1f} m/s", draws, self.printed.get(speed), remark)
        if self.printed_mean is not None:
            rows.append(self._mean(found, self.printed_mean))
        remarks = [*verdict(rows), *states(found), *unfinished_remarks(found.values()), *settings.remarks()]
        if not self.printed:
            remarks.insert(
                0, "The paper prints no time for 300 people: it says that they are consistent with those for 200."
            )
        raw = {"runs": raw_runs(found.values()), "exit-times": raw_exits(found.values())}
        draw = partial(self._draw, settings, found)
        return Result(self.name, self.title, rows, raw, draw, remarks, settings.changed(), "s")

    def _mean(self, found: Mapping[float, Sample], printed: tuple[float, float, str]) -> Row:
        low, high, paper = printed
        times = np.concatenate([draws.cleared for speed, draws in found.items() if low <= speed <= high])
        lost = sum(draws.blocked for speed, draws in found.items() if low <= speed <= high)
        reading = f"mean of the draws that cleared; {lost or 'none'} of {lost + len(times)} blocked"
        mean = float(times.mean()) if len(times) else None
        return Row(f"clearance, {low:.1f} to {high:.1f} m/s", paper, mean, "s", len(times), reading)

    def _draw(self, settings: LinSettings, found: Mapping[float, Sample], path: Path) -> Path:
        from crowd_env.reproduce.lin2016.figures.clearance import clearance_times, speed_color

        slowest, fastest = min(self.speeds), max(self.speeds)
        mean = self.printed_mean
        return clearance_times(
            path,
            self.people,
            [
                draws.curve(f"{speed:.1f} m/s", speed_color((speed - slowest) / (fastest - slowest)))
                for speed, draws in found.items()
            ],
            {speed: draws.times for speed, draws in found.items()},
            {speed: draws.blocked for speed, draws in found.items()},
            {speed: float(text) for speed, text in self.printed.items()},
            None if mean is None else (mean[0], mean[1], float(mean[2])),
            PAPER_BLOCKED,
            settings.readings(),
        )


FIG7 = BySpeed("lin-fig7", 200, (*SPEEDS, 2.2), {0.6: "340", 1.0: "210"}, (1.0, 1.8, "220"))
FIG8 = BySpeed("lin-fig8", 300)


def states(found: Mapping[float, Sample]) -> list[str]:
    """Return which of the three states of the paper come out: smooth to 1 m/s, transition, blocked from 1.8 m/s on."""
    medians = {speed: draws.median for speed, draws in found.items()}
    smooth = [medians[speed] for speed in (0.6, 0.8, 1.0)]
    remarks = []
    if None not in smooth:
        falls = all(b < a for a, b in pairwise(smooth) if a is not None and b is not None)
        text = " to ".join(f"{time:.0f}" for time in smooth)
        remarks.append(
            f"Smooth state: from 0.6 to 1.0 m/s the median {'falls' if falls else 'does NOT fall'}, {text} s."
        )
    middle = [time for speed, time in medians.items() if 1.0 <= speed <= 1.6 and time is not None]
    if middle:
        remarks.append(
            f"Transition state: from 1.0 to 1.6 m/s the medians lie between {min(middle):.0f} and {max(middle):.0f} s; the "
            "paper sees no trend."
        )
    first = next((speed for speed, draws in found.items() if draws.mostly_blocked), None)
    some = next((speed for speed, draws in found.items() if draws.blocked), None)
    if first is None or some is None:
        remarks.append(
            f"At no speed do half of the draws block; the paper: from {PAPER_BLOCKED:g} m/s on. NOT reproduced."
        )
    else:
        higher = all(draws.mostly_blocked for speed, draws in found.items() if speed >= first)
        also = "" if some == first else f", some from {some:g} m/s on"
        remarks.append(
            f"Phase separation: half of the draws or more block {'from' if higher else 'at'} {first:g} m/s"
            f"{' on' * higher}{also}; the paper: from {PAPER_BLOCKED:g} m/s on."
        )
    return remarks
