"""All draws of one configuration: how many cleared the room, how long that took, and how many blocked."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.rollout import Episode
from crowd_env.rendering.canvas import hex_of
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import RawTable, Result, Row

# As in the paper, a run is blocked after 2 minutes without an exit.
BLOCKED = "a run is blocked when nobody has got out for 2 minutes; medians are over the runs that cleared"


@dataclass(frozen=True, eq=False)
class Sample:
    """The draws of one configuration, R of them, none of which need have cleared."""

    case: Case
    episodes: Sequence[Episode]

    @property
    def exits(self) -> list[Floats]:
        """Exit times [s] of every draw, ascending, of the people who got out."""
        return [np.sort(one.exit_time[np.isfinite(one.exit_time)]) for one in self.episodes]

    @property
    def blocked_since(self) -> list[float | None]:
        """Time of the last exit before a draw blocked [s], 0 without an exit; None of draws that did not block."""
        since = [one.metrics.blocked_since for one in self.episodes]
        return [None if np.isnan(time) else time for time in since]

    @property
    def cleared(self) -> Floats:
        """Clearance times [s] of the draws that cleared."""
        return np.array([one.metrics.evacuation_time for one in self.episodes if not one.metrics.unfinished])

    @property
    def median(self) -> float | None:
        """Median clearance time [s] of the draws that cleared."""
        return float(np.median(self.cleared)) if len(self.cleared) else None

    @property
    def mean_flows(self) -> Floats:
        """People divided by clearance time [1/s] of the draws that cleared."""
        cleared = (one for one in self.episodes if not one.metrics.unfinished)
        return np.array([len(one.exit_time) / one.metrics.evacuation_time for one in cleared])

    @property
    def blocked(self) -> int:
        """Number of draws whose exit blocked."""
        return sum(since is not None for since in self.blocked_since)

    def count_blocked(self) -> str:
        """Return "2 of 5 blocked", and how many draws neither cleared nor blocked within the time."""
        unfinished = len(self.episodes) - len(self.cleared) - self.blocked
        text = f"{self.blocked or 'none'} of {len(self.episodes)} blocked"
        return text + (f", {unfinished} unfinished" if unfinished else "")


Samples = Mapping[Any, Sample]


def together(samples: Iterable[Sample]) -> Sample:
    """Return the draws of several configurations as one sample, whose case is the first."""
    first, *others = samples
    return Sample(first.case, [*first.episodes, *(one for other in others for one in other.episodes)])


def clearance_rows(of: str, found: Sample, paper: str | None = None, remark: str = "") -> list[Row]:
    """Return two rows: the median clearance time, and the number of draws that blocked.

    ``paper`` is the printed time, ``remark`` what the paper prints in words.
    """
    times = found.cleared
    spread = f"median, {times.min():.0f} to {times.max():.0f}" if len(times) > 1 else "one draw" if len(times) else ""
    reading = "; ".join(text for text in (spread, found.count_blocked(), remark) if text)
    return [Row(f"clearance, {of}", paper, found.median, "s", len(times), reading), _blocked_row(of, found)]


def _blocked_row(of: str, found: Sample) -> Row:
    """Return how many draws blocked, since when, and with how many people left."""
    pairs = zip(found.blocked_since, found.episodes, strict=True)
    ends = [(since, one.metrics.unfinished) for since, one in pairs if since is not None]
    reading = "nobody out for 2 minutes"
    if ends:
        reading = f"since {_span([end[0] for end in ends])} s, {_span([end[1] for end in ends])} left"
    draws = len(found.episodes)
    interval = share_interval(found.blocked, draws)
    return Row(f"blocked, {of}", None, found.blocked, "runs", draws, reading, ci95=interval)


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:.0f}" if f"{low:.0f}" == f"{high:.0f}" else f"{low:.0f} to {high:.0f}"


def result(
    settings: LinSettings,
    samples: Samples,
    sections: Sequence[Sequence[Row]],
    draw: Callable[[], Any],
    raw: Mapping[str, RawTable] | None = None,
    unit: str = "s",
) -> Result:
    """Return a figure that is made of samples, with what these rest on; ``raw`` is every run and every exit by default."""
    raw = raw or {"runs": raw_runs(samples), "exit-times": raw_exits(samples)}
    remarks = [f"{settings.readings()}; {BLOCKED}."]

    def drawn() -> Any:
        return foot(draw(), settings.readings())

    return Result(sections, raw, drawn, remarks, unit)


def foot(figure: Any, text: str) -> Any:
    """Return the figure with a line below everything."""
    figure.supxlabel(text, fontsize=8.5, color=hex_of(QUIET), x=0.012, ha="left")
    return figure


_HEADER = ("people", "desired_speed_mps", "strength_N", "rotation", "seed")


def raw_runs(samples: Samples) -> RawTable:
    """Return every run: cleared when, or blocked since when with how many left."""
    rows = [
        (
            *found.case.facts.values(),
            one.seed,
            *map(_seconds, (one.metrics.evacuation_time, since)),
            one.metrics.unfinished,
        )
        for found in samples.values()
        for one, since in zip(found.episodes, found.blocked_since, strict=True)
    ]
    return RawTable((*_HEADER, "clearance_time_s", "blocked_since_s", "left"), rows)


def raw_exits(samples: Samples) -> RawTable:
    """Return every exit: the run, how many are out by then, and when."""
    rows = [
        (*found.case.facts.values(), one.seed, k + 1, f"{time:.6f}")
        for found in samples.values()
        for one, times in zip(found.episodes, found.exits, strict=True)
        for k, time in enumerate(times)
    ]
    return RawTable((*_HEADER, "number_out", "time_s"), rows)


def _seconds(time: float | None) -> str:
    return "" if time is None or np.isnan(time) else f"{time:.6f}"
