"""All draws of one configuration: how many cleared the room, how long that took, and how many blocked."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.rendering.canvas import hex_of
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.lin2016.record import Record
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import RawTable, Result, Row

Key = TypeVar("Key")
Cases = Mapping[Key, Mapping[str, Any]]  # the configurations of a figure: arguments of `LinSettings.draws`

_CLOSE = 0.10


@dataclass(frozen=True, eq=False)
class Sample:
    """The draws of one configuration, R of them, none of which need have cleared."""

    runs: tuple[Run, ...]
    records: tuple[Record, ...]

    @property
    def times(self) -> list[float | None]:
        """Clearance time of every draw [s]; None if it did not clear."""
        return [record.clearance_time for record in self.records]

    @cached_property
    def cleared(self) -> Floats:
        """Clearance times [s] of the draws that cleared."""
        return np.array([time for time in self.times if time is not None])

    @property
    def median(self) -> float | None:
        """Median clearance time [s] of the draws that cleared."""
        return float(np.median(self.cleared)) if len(self.cleared) else None

    @property
    def mean_flows(self) -> Floats:
        """People divided by clearance time [1/s] of the draws that cleared."""
        return self.runs[0].count / self.cleared

    @property
    def blocked(self) -> int:
        """Number of draws whose exit blocked."""
        return sum(record.blocked_since is not None for record in self.records)

    @property
    def mostly_blocked(self) -> bool:
        """Whether at least half of the draws blocked."""
        return 2 * self.blocked >= len(self.records)

    @property
    def unfinished(self) -> int:
        """Number of draws that neither cleared nor blocked within the time."""
        return len(self.records) - len(self.cleared) - self.blocked

    def count_blocked(self) -> str:
        """Return "2 of 5 blocked"."""
        text = f"{self.blocked or 'none'} of {len(self.records)} blocked"
        return text + (f", {self.unfinished} unfinished" if self.unfinished else "")

    def blocked_share(self) -> str:
        """Return "2 of 10 blocked (95 %: 6 to 51 %)", with Wilson's interval of the share."""
        low, high = share_interval(self.blocked, len(self.records))
        return f"{self.count_blocked()} (95 %: {100 * low:.0f} to {100 * high:.0f} %)"


def sample(records: Mapping[Run, Record], runs: Sequence[Run]) -> Sample:
    """Return what came of the draws ``runs``."""
    return Sample(tuple(runs), tuple(records[run] for run in runs))


def clearance_rows(of: str, found: Sample, paper: str | None = None, remark: str = "") -> list[Row]:
    """Return two rows: the median clearance time, and the number of draws that blocked.

    ``paper`` is the printed time, ``remark`` what the paper prints in words.
    """
    times = found.cleared
    spread = f"median, {times.min():.0f} to {times.max():.0f}" if len(times) > 1 else "one draw" if len(times) else ""
    reading = "; ".join(text for text in (spread, found.count_blocked(), remark) if text)
    return [Row(f"clearance, {of}", paper, found.median, "s", len(times), reading), blocked_row(of, found)]


def blocked_row(of: str, found: Sample) -> Row:
    """Return how many draws blocked, since when, and with how many people left."""
    ends = [(record.blocked_since, record.left) for record in found.records if record.blocked_since is not None]
    reading = "nobody out for 2 minutes"
    if ends:
        since, left = [end[0] for end in ends], [end[1] for end in ends]
        reading = f"since {_span(since)} s, {_span(left)} left"
    draws = len(found.records)
    interval = share_interval(found.blocked, draws)
    return Row(f"blocked, {of}", None, found.blocked, "runs", draws, reading, ci95=interval, closes=True)


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:.0f}" if f"{low:.0f}" == f"{high:.0f}" else f"{low:.0f} to {high:.0f}"


def verdict(rows: Iterable[Row]) -> list[str]:
    """Return which printed numbers are met to 10 %, and which are not; nothing if none is printed."""
    close: list[str] = []
    far: list[str] = []
    for row in rows:
        if row.paper is None:
            continue
        number = f"{row.quantity} ({row.shown()} {row.unit}, printed {row.paper})"
        met = row.here is not None and abs(row.here / float(row.paper) - 1) <= _CLOSE
        (close if met else far).append(number)
    if not close and not far:
        return []
    return [f"Within 10 %: {', '.join(close) or 'none'}" + (f"; NOT reproduced: {', '.join(far)}." if far else ".")]


def result(
    name: str,
    title: str,
    settings: LinSettings,
    samples: Collection[Sample],
    rows: list[Row],
    remarks: list[str],
    draw: Callable[[], Any],
    *,
    raw: Mapping[str, RawTable] | None = None,
    unit: str = "s",
) -> Result:
    """Return a figure that is made of samples, with what these rest on; ``raw`` is every run and every exit by default."""

    def drawn() -> Any:
        figure = draw()
        foot(figure, settings.readings())
        return figure

    open_ended = sum(found.unfinished for found in samples)
    unfinished = [f"{open_ended} runs neither cleared nor blocked within their time limit."] if open_ended else []
    raw = raw or {"runs": raw_runs(samples), "exit-times": raw_exits(samples)}
    remarks = [*remarks, *unfinished, *settings.remarks()]
    return Result(name, title, rows, raw, drawn, remarks, settings.changed(), unit)


def foot(figure: Any, text: str) -> None:
    """Write a line below everything."""
    figure.supxlabel(text, fontsize=8.5, color=hex_of(QUIET), x=0.012, ha="left")


_HEADER = ("people", "desired_speed_mps", "strength_N", "rotation", "seed")


def _key(run: Run) -> tuple[object, ...]:
    return run.count, run.desired_speed, run.strength, run.rotation, run.seed


def raw_runs(samples: Iterable[Sample]) -> RawTable:
    """Return every run: cleared when, or blocked since when with how many left."""
    rows = [
        (*_key(run), _seconds(record.clearance_time), _seconds(record.blocked_since), record.left)
        for found in samples
        for run, record in zip(found.runs, found.records, strict=True)
    ]
    return RawTable((*_HEADER, "clearance_time_s", "blocked_since_s", "left"), rows)


def raw_exits(samples: Iterable[Sample]) -> RawTable:
    """Return every exit: the run, how many are out by then, and when."""
    rows = [
        (*_key(run), k + 1, f"{time:.6f}")
        for found in samples
        for run, record in zip(found.runs, found.records, strict=True)
        for k, time in enumerate(record.exit_times)
    ]
    return RawTable((*_HEADER, "number_out", "time_s"), rows)


def _seconds(time: float | None) -> str:
    return "" if time is None else f"{time:.6f}"
