"""Figures 7 and 8 of Lin, Ma, Lo: leaving process and clearance time against the desired speed, 200 and 300 people."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from crowd_env.reproduce.lin2016.figures.clearance import clearance_times
from crowd_env.reproduce.lin2016.sample import Cases, Sample, clearance_rows, result, verdict
from crowd_env.reproduce.lin2016.settings import LinSettings
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

    @property
    def cases(self) -> Cases[float]:
        """The samples that it is made of, by desired speed."""
        return {speed: {"count": self.people, "desired_speed": speed} for speed in self.speeds}

    def reproduce(self, settings: LinSettings, found: Mapping[float, Sample]) -> Result:
        """Return the figure, made of a sample for each desired speed [m/s]."""
        rows = []
        for speed, draws in found.items():
            remark = "paper: blocked" if speed >= PAPER_BLOCKED else ""
            rows += clearance_rows(f"{speed:.1f} m/s", draws, self.printed.get(speed), remark)
        if self.printed_mean is not None:
            rows.append(_mean(found, *self.printed_mean))
        remarks = [*verdict(rows), *states(found)]
        if not self.printed:
            remarks.insert(
                0, "The paper prints no time for 300 people: it says that they are consistent with those for 200."
            )

        def draw() -> object:
            return clearance_times(self.people, found, self.printed, self.printed_mean, PAPER_BLOCKED)

        return result(self.name, self.title, settings, found.values(), rows, remarks, draw)


FIG7 = BySpeed("lin-fig7", 200, (*SPEEDS, 2.2), {0.6: "340", 1.0: "210"}, (1.0, 1.8, "220"))
FIG8 = BySpeed("lin-fig8", 300)


def _mean(found: Mapping[float, Sample], low: float, high: float, paper: str) -> Row:
    some = [draws for speed, draws in found.items() if low <= speed <= high]
    times, lost = np.concatenate([draws.cleared for draws in some]), sum(draws.blocked for draws in some)
    reading = f"mean of the draws that cleared; {lost or 'none'} of {lost + len(times)} blocked"
    mean = float(times.mean()) if len(times) else None
    return Row(f"clearance, {low:.1f} to {high:.1f} m/s", paper, mean, "s", len(times), reading)


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
