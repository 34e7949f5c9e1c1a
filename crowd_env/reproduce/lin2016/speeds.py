"""Figures 7 and 8 of Lin, Ma, Lo: leaving process and clearance time against the desired speed, 200 and 300 people."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.figures.clearance import clearance_times
from crowd_env.reproduce.lin2016.sample import Samples, clearance_rows, result
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import Result, Row

SPEEDS = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)  # m/s
PAPER_BLOCKED = 1.8  # m/s, "1.8 m/s or higher could lead to the totally blockage of the exit"


class BySpeed(NamedTuple):
    """One of the two figures."""

    name: str
    people: int
    speeds: tuple[float, ...] = SPEEDS  # m/s
    printed: Mapping[float, str] = {}  # speed -> s
    printed_mean: tuple[float, float, str] | None = None  # from speed, to speed, s

    @property
    def title(self) -> str:
        """What the table is called."""
        figure = self.name.removeprefix("lin-fig")
        return f"Lin, Ma, Lo, Figure {figure}: {self.people} people, by desired speed"

    def cases(self, settings: LinSettings) -> dict[float, Case]:
        """Return the draws for each desired speed [m/s]."""
        return {speed: settings.case(self.people, speed) for speed in self.speeds}

    def reproduce(self, settings: LinSettings, found: Samples) -> Result:
        """Return the figure, made of a sample for each desired speed [m/s]."""
        rows = []
        for speed, draws in found.items():
            remark = "paper: blocked" if speed >= PAPER_BLOCKED else ""
            rows += clearance_rows(f"{speed:.1f} m/s", draws, self.printed.get(speed), remark)
        if self.printed_mean is not None:
            rows.append(_mean(found, *self.printed_mean))

        def draw() -> object:
            return clearance_times(self.people, found, self.printed, self.printed_mean, PAPER_BLOCKED)

        return result(self.name, self.title, settings, found, rows, draw)


FIG7 = BySpeed("lin-fig7", 200, (*SPEEDS, 2.2), {0.6: "340", 1.0: "210"}, (1.0, 1.8, "220"))
FIG8 = BySpeed("lin-fig8", 300)


def _mean(found: Samples, low: float, high: float, paper: str) -> Row:
    some = [draws for speed, draws in found.items() if low <= speed <= high]
    times, lost = np.concatenate([draws.cleared for draws in some]), sum(draws.blocked for draws in some)
    reading = f"mean of the draws that cleared; {lost or 'none'} of {lost + len(times)} blocked"
    mean = float(times.mean()) if len(times) else None
    return Row(f"clearance, {low:.1f} to {high:.1f} m/s", paper, mean, "s", len(times), reading)
