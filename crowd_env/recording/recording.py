"""A recording: position and pressure of each pedestrian, at some moments of one evacuation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints, joined_starts
from crowd_env.core.checks import path as path_of
from crowd_env.core.files.atomic import check_suffix
from crowd_env.core.files.foreign import require_file
from crowd_env.recording.content import FrameContacts, Frames
from crowd_env.recording.formats import FORMATS, check_writable, open_writer, require_library
from crowd_env.recording.writer import part_of

_LEAP = 3.0  # m between two frames: to another sheet of a building: its layout sets them apart


class Moment(NamedTuple):
    """K people at one time."""

    person: Ints  # (K,)
    position: Floats  # (K, 2)  m
    velocity: Floats  # (K, 2)  m/s
    pressure: Floats  # (K,)    N/m
    angle: Floats | None  # (K,)    rad  orientation of bodies that are no discs
    memory: Mapping[str, Floats]  # (K, ...)  rows that behaviors keep


@dataclass(frozen=True, eq=False)
class Recording(Frames):
    """One evacuation of N people, seen in F frames; its R rows lie frame by frame, within a frame in the order of people.

    A frame has a row for every pedestrian inside, from the entry on.  In the two frames after an exit that pedestrian has one
    row more, beyond the exit line: on the straight way on, and at least a few centimeters past the line.  If people get out in
    the last frame of a run, one more follows in which they alone have a row.

    Arrays may be given as lists, or of another kind of number.

    Raises
    ------
    ValueError
        If an array does not have the shape named here, the times do not increase, or a number is out of range.
    """

    @cached_property
    def beyond(self) -> Bools:
        """Which rows (R,) lie beyond the exit line: the last two rows of each pedestrian that got out."""
        return self.times[self.frame] >= np.nan_to_num(self.exit_time[self.person], nan=np.inf)

    @cached_property
    def first_seen(self) -> Floats:
        """The time (N,) [s] of the first row of each person: -inf in the first frame, inf for people without a row."""
        first = np.full(len(self.radius), np.inf)
        np.minimum.at(first, self.person, self.times[self.frame])
        return np.where(first == self.times[0], -np.inf, first)

    @property
    def came(self) -> int:
        """How many people were inside at some time."""
        return int((self.first_seen < np.inf).sum())

    @cached_property
    def left_inside(self) -> int:
        """How many people were inside at the end."""
        return int((np.isnan(self.exit_time) & (self.first_seen < np.inf)).sum())

    def inside(self, time: Floats | float) -> Ints:
        """Return how many people are inside at ``time`` (...) [s]; by exit times, not by frames."""
        left = np.searchsorted(np.sort(self.exit_time[np.isfinite(self.exit_time)]), time, side="right")
        come = np.searchsorted(np.sort(self.first_seen), np.add(time, 1e-6), side="right")
        return np.asarray(come - left)

    @cached_property
    def end(self) -> float:
        """When the last person got out [s], or the last frame with a person inside."""
        if np.isfinite(self.exit_time).any() and not self.left_inside:
            return float(np.nanmax(self.exit_time))
        return float(self.times[self.frame[~self.beyond].max(initial=0)])

    def at(self, time: float, *, average: float = 0.3) -> Moment:
        """Return the pedestrians inside at ``time`` [s], on straight ways between frames; after the end, as they were then.

        The pressure is the mean over ``average`` [s] around it: the load on a body, not single impacts.
        """
        time = min(max(time, float(self.times[0])), self.end)
        first, last = np.searchsorted(self.times, [time, time + 1e-12], side="right") - 1
        after = min(int(last) + 1, len(self.times) - 1)
        rows, later = self.rows_of(int(first)), self.rows_of(after)
        here = rows[np.nan_to_num(self.exit_time[self.person[rows]], nan=np.inf) > time]
        person = self.person[here]
        place = np.searchsorted(self.person[later], person).clip(max=max(len(later) - 1, 0))
        then = later[place] if len(later) else here
        then = np.where(self.person[then] == person, then, here)
        span = float(self.times[after] - self.times[first])
        part = (time - float(self.times[first])) / span if span > 0.0 else 0.0
        pressure = self._mean_pressure(person, time - 0.5 * average, time + 0.5 * average)

        def between(values: Floats) -> Floats:
            return np.asarray((1.0 - part) * values[here] + part * values[then])

        angle = None if self.angle is None else between(self._steady_angle)
        if angle is not None and first == 0:
            angle = self._steady_angle[then]  # bodies face their way from the first step on
        kept = {name: between(one) for name, one in self.memory.items()}
        ahead = self.position[then] - self.position[here]
        onto = np.hypot(*ahead.T)[:, None] > _LEAP  # another sheet
        position = np.where(onto, self.position[here], between(self.position))
        return Moment(person, position, between(self.velocity), pressure, angle, kept)

    def peak_time(self) -> float:
        """Return when people press each other most [s]; if they never do, when half of them are out."""
        total = np.bincount(self.frame, self.pressure * ~self.beyond, minlength=len(self.times))
        window = np.ones(5) / 5.0  # over neighboring frames: a crowd, not a collision
        if len(total) >= len(window) and total.max() > 0.0:
            return float(self.times[np.argmax(np.convolve(total, window, mode="same"))])
        return float(np.sort(np.nan_to_num(self.exit_time, nan=self.end))[len(self.radius) // 2])

    def save(self, path: str | Path) -> Path:
        """Write the recording to a file, .sqlite or .h5, and return its path."""
        writer = open_writer(check_writable("the recording", path), self)
        writer.append(self)
        return writer.finish(self.facts)

    def rows_of(self, frame: int) -> Ints:
        """Return the rows of a frame."""
        return np.arange(self.frame_start[frame], self.frame_start[frame + 1])

    def _mean_pressure(self, person: Ints, since: float, until: float) -> Floats:
        """Return the mean pressure (K,) on some people between two times; each frame counts for the time before it."""
        first = max(int(np.searchsorted(self.times, since, side="right")), 1)
        last = min(int(np.searchsorted(self.times, until, side="left")), len(self.times) - 1)
        borne, seen = np.zeros(len(self.radius)), 0.0
        for frame in range(first, last + 1):
            share = min(until, float(self.times[frame])) - max(since, float(self.times[frame - 1]))
            rows = self.rows_of(frame)
            borne[self.person[rows]] += share * np.nan_to_num(self.pressure[rows])
            seen += share
        return borne[person] / max(seen, 1e-9)

    @cached_property
    def _steady_angle(self) -> Floats:
        """Angles (R,) [rad] without jumps by full turns from one frame of a person to the next."""
        assert self.angle is not None
        order = np.argsort(self.person, kind="stable")
        steady = np.empty(len(order))
        steady[order] = np.unwrap(self.angle[order])
        return steady


def joined(parts: Sequence[Recording]) -> Recording:
    """Return successive parts of one recording as one; people and facts come from the last part."""
    rows = ("times", "person", "position", "velocity", "pressure", *(() if parts[0].angle is None else ("angle",)))
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in rows}
    columns["memory"] = {name: np.concatenate([part.memory[name] for part in parts]) for name in parts[0].memory}
    found = [part.contacts for part in parts if part.contacts is not None]
    if found:
        start, *pairs = zip(*found, strict=True)
        columns["contacts"] = FrameContacts(joined_starts(start), *map(np.concatenate, pairs))
    return replace(parts[-1], **columns, frame_start=joined_starts([part.frame_start for part in parts]))


def load(path: str | Path) -> Recording:
    """Return the recording in a file: ours in any format, finished or not, and trajectories of JuPedSim and PedPy.

    An unfinished recording (`NAME.part.sqlite`, `.part.h5`) holds the frames written so far, and ``facts["finished"]`` is
    False.  Files of other programs hold positions alone: see `docs/recordings.md`.

    Raises
    ------
    ValueError
        If the suffix is unknown, the file is missing or damaged, or its content is not a recording.
    ModuleNotFoundError
        If the library that reads the format is not installed.
    """
    path = check_suffix(path_of("the file of the recording", path), tuple(FORMATS))
    if not path.exists():
        part = part_of(path)
        hint = f"; {part} holds what was recorded before its run broke off" if part.exists() else ""
        raise ValueError(f"there is no recording {path}{hint}")
    require_file(path)
    require_library(path, "reading")
    try:
        return Recording(**FORMATS[path.suffix.lower()].read(path))
    except Exception as error:  # a damaged file fails in many ways, and each library has exceptions of its own
        words = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(words if str(path) in words else f"cannot read {path}: {words}") from None
