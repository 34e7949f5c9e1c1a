"""What a film is made of: an evacuation sampled in time, and what is seen at any moment of it."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.outline import Outline
from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.geometry.geometry import Geometry


class Moment(NamedTuple):
    """N people at one time."""

    position: Floats  # (N, 2)  m
    velocity: Floats  # (N, 2)  m/s
    active: Bools  # (N,)    still inside
    pressure: Floats  # (N,)    N/m
    angle: Floats | None  # (N,)    rad  where bodies face that are no discs


@dataclass(frozen=True, eq=False)
class Recording:
    """An evacuation sampled at T times, N people.

    Raises
    ------
    ValueError
        If an array does not have the shape named here, or the times do not increase.
    """

    time: Floats  # (T,)       s
    position: Floats  # (T, N, 2)  m
    velocity: Floats  # (T, N, 2)  m/s
    active: Bools  # (T, N)     still inside
    pressure: Floats  # (T, N)     N/m    since the sample before, see `contact_pressure`
    radius: Floats  # (N,)       m
    geometry: Geometry
    title: str = ""
    exit_time: Floats | None = None  # (N,)  s  exact times; without them people leave at a sample; nan = did not
    angle: Floats | None = None  # (T, N)     rad    of bodies that are no discs
    outline: Outline | None = None  # their shape
    group: Ints | None = None  # (N,)  which of ``groups``
    groups: tuple[str, ...] = ()  # names of the groups of people, if there are several

    def __post_init__(self) -> None:
        times, people = len(self.time), len(self.radius)
        shapes = {
            "position": (times, people, 2),
            "velocity": (times, people, 2),
            "active": (times, people),
            "pressure": (times, people),
        }
        if self.outline is not None:
            shapes["angle"] = (times, people)
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(
                    f"{name} has shape {np.shape(getattr(self, name))}; {times} times of {people} need {shape}"
                )
        if times == 0 or not (np.diff(self.time) > 0).all():
            raise ValueError("a recording needs at least one time, and its times must increase")
        shape = () if self.group is None else np.shape(self.group)
        if self.groups and shape != (people,):
            raise ValueError(f"group has shape {shape}; it needs {(people,)}")
        if self.exit_time is not None and np.shape(self.exit_time) != (people,):
            raise ValueError(f"exit_time has shape {np.shape(self.exit_time)}; it needs {(people,)}")

    @cached_property
    def departure(self) -> Floats:
        """When each person left (N,) [s]; inf for those who did not."""
        if self.exit_time is not None:
            return np.where(np.isfinite(self.exit_time), self.exit_time, np.inf)
        gone = ~self.active
        first = np.asarray(self.time)[np.argmax(gone, axis=0)]
        return np.where(gone[-1], first, np.inf)

    @property
    def end(self) -> float:
        """When the last person left, or the last time recorded if someone stays inside [s]."""
        last = float(self.departure.max(initial=-np.inf))
        return last if np.isfinite(last) else float(self.time[-1])

    def inside(self, time: Floats | float) -> np.ndarray:
        """Return how many are inside at ``time`` (...) [s]."""
        left = np.searchsorted(np.sort(self.departure), time, side="right")
        return np.asarray(len(self.radius) - left)

    def at(self, time: float, *, average: float = 0.3) -> Moment:
        """Return the moment ``time`` [s], interpolated between samples; before the first and after the last, those.

        The pressure is the mean over ``average`` [s] around it: what a body bears, not single blows.
        """
        first, last = float(self.time[0]), float(self.time[-1])
        since, until = np.clip((time - 0.5 * average, time + 0.5 * average), first, last)
        borne = self._between(self._borne, until) - self._between(self._borne, since)
        return Moment(
            self._between(self.position, time),
            self._between(self.velocity, time),
            self.departure > time,
            borne / max(until - since, 1e-9),
            None if self.angle is None else self._between(self.angle, time),
        )

    @cached_property
    def _borne(self) -> Floats:
        """Pressure summed over time (T, N) [N s/m]."""
        span = np.diff(self.time, prepend=self.time[0])[:, None]
        return np.asarray(np.cumsum(self.pressure * span, axis=0))

    def _between(self, values: Floats, time: float) -> Floats:
        k = int(np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, max(len(self.time) - 2, 0)))
        after = min(k + 1, len(self.time) - 1)
        span = float(self.time[after] - self.time[k])
        part = float(np.clip((time - self.time[k]) / span, 0.0, 1.0)) if span > 0 else 0.0
        return np.asarray((1.0 - part) * values[k] + part * values[after])

    def peak_time(self) -> float:
        """Return when people press each other most [s]; if they never do, when half of them are out."""
        total = np.where(self.active, self.pressure, 0.0).sum(axis=1)
        window = np.ones(5) / 5.0  # over neighboring samples: a crowd, not a collision
        if len(total) >= len(window) and total.max() > 0:
            return float(self.time[np.argmax(np.convolve(total, window, mode="same"))])
        return float(np.sort(np.minimum(self.departure, self.time[-1]))[len(self.radius) // 2])
