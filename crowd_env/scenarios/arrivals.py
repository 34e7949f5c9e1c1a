"""Arrivals: when people come in during an episode, and along which line."""

from dataclasses import dataclass
from math import ceil, inf, sqrt
from typing import Annotated, Literal

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import NOT_NEGATIVE, NotNegative, Positive, Range, check_fields, require_all
from crowd_env.geometry.entrances import NEVER
from crowd_env.geometry.parsing import read_lines

_NEVER = Range(0.0, above=True, infinite=True)
_SPREAD, _SPARE = (
    5.0,
    8,
)  # slots beyond the mean of a Poisson number, in standard deviations and people: one in 1e6 draws more


@dataclass(frozen=True, eq=False)
class Arrivals:
    """When people come in that are not there at the start: at a rate, at given times, or by a timetable.

    They come in along a line, in the start region, or each at a recorded start.  A person without room waits outside, in
    the order of coming.  Response times count from the entry.

    Raises
    ------
    ValueError
        If not one of rate, times and timetable is given, or a value is out of range.
    """

    rate: Positive | None = None
    """1/s, people per second from ``since`` until ``until``."""
    since: NotNegative = 0.0
    """s, the time at which the rate begins."""
    until: Annotated[float, _NEVER] = inf
    """s, the time at which the rate ends; by default when all people have come."""
    spacing: Literal["random", "regular"] = "random"
    """"random" for a Poisson process, with another number of people in each draw, or "regular"."""
    times: tuple[float, ...] = ()
    """s, the time of each person."""
    timetable: tuple[tuple[float, float], ...] = ()
    """(time [s], number of people) of each group."""
    line: Floats | None = None
    """(K, 2) m, line on the edge or inside along which people come in; by default in the start region."""

    def __post_init__(self) -> None:
        check_fields("arrivals", self)
        given = [name for name in ("rate", "times", "timetable") if getattr(self, name)]
        if len(given) != 1:
            raise ValueError(f"arrivals: give one of rate, times and timetable, not {' and '.join(given) or 'none'}")
        if self.line is not None:
            object.__setattr__(self, "line", read_lines([self.line], "line of arrivals")[0])
        if self.until <= self.since:
            raise ValueError(f"arrivals: until is {self.until:g} s; it must be later than since, {self.since:g} s")
        for k, entry in enumerate(self.timetable):
            if len(entry) != 2 or entry[1] < 1 or entry[1] % 1.0:
                raise ValueError(f"arrivals: timetable[{k}] is {[*entry]}; it must be (time, whole number of people)")
        require_all("arrivals: times", self._listed(), NOT_NEGATIVE)

    def _listed(self) -> Floats:
        """Return the given times [s], person by person."""
        many = [int(people) for _, people in self.timetable]
        return np.array([*self.times, *np.repeat([time for time, _ in self.timetable], many)], dtype=np.float64)

    @property
    def people(self) -> int | None:
        """Number of people: the most in any draw; None if they come at a rate without an end."""
        if self.rate is None:
            return len(self._listed())
        if self.until == inf:
            return None
        mean = self.rate * (self.until - self.since)
        return max(ceil(mean - 1e-9 if self.spacing == "regular" else mean + _SPREAD * sqrt(mean) + _SPARE), 1)

    def latest(self, people: int) -> float:
        """Return when the last of ``people`` comes [s], in all but one of 1e6 draws."""
        if self.rate is None:
            return float(self._listed().max())
        return min(self.until, self.since + (people + _SPREAD * sqrt(people)) / self.rate)

    def draw(self, rng: np.random.Generator, people: int) -> Floats:
        """Return when each of ``people`` comes (people,) [s]; `NEVER` = not in this draw."""
        if self.rate is None:
            return self._listed()
        if self.spacing == "regular":
            time = self.since + np.arange(people) / self.rate
        else:
            time = self.since + np.cumsum(rng.exponential(1.0 / self.rate, people))
        return np.where(time < self.until - 1e-9, time, NEVER)
