"""A recording: who was where, and how hard they were pressed, at some moments of one evacuation."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import array


class FrameContacts(NamedTuple):
    """The K contacts of F frames: everything that touched since the frame before, of people who are still inside.

    Gap, normal and point are those of the last physics step in which the two touched, found where `Simulation.contacts` finds
    them: a gap may differ from the frame's by what people move in a step, and more if they parted before.
    """

    start: Ints  #: (F+1,) contacts of frame f are start[f]:start[f + 1]
    i: Ints  #: (K,) person
    j: Ints  #: (K,) other person > i, or -1 - k: wall feature k
    gap: Floats  #: (K,) m, < 0 is overlap
    normal: Floats  #: (K, 2) unit vector from j to i
    point: Floats  #: (K, 2) m, where they touch: in the middle of gap or overlap
    force: Floats  #: (K, 2) N, mean since the frame before, normal (> 0 pushes apart) and tangential; times that time: impulse


@dataclass(frozen=True, eq=False)
class Recording:
    """One evacuation of N people, seen in F frames; its R rows lie frame by frame, those of a frame in the order of people.

    A frame has a row for everyone inside.  In the two frames after someone got out there is one row more for that person,
    beyond the exit line: where the straight way on leads by then, and at least a few centimeters past the line.  If people get
    out in the last frame of a run, one more follows in which they alone have a row.

    Raises
    ------
    ValueError
        If an array does not have the shape named here, the times do not increase, or a number points nowhere.
    """

    facts: Mapping[
        str, Any
    ]  #: plain data: scenario, scheme, dt, decision_dt, seed, strategy, time_limit, end, versions ...
    walkable: str  #: WKT of the walkable area [m]
    thin_walls: Floats  #: (W, 2, 2) m, walls without thickness inside the area
    doors: tuple[tuple[str, Floats], ...]  #: name, (2, 2) m, of each leaf: a wall while the door is closed
    exits: tuple[tuple[str, Floats], ...]  #: name, (2, 2) m, of each row of Geometry.exits; an exit may have several
    groups: tuple[str, ...]  #: names of the groups of people; ("",) if there are none
    times: Floats  #: (F,) s
    frame_start: Ints  #: (F+1,) rows of frame f are frame_start[f]:frame_start[f + 1]
    # of N people
    radius: Floats  #: (N,) m, of the disc, or of the disc of the same area
    desired_speed: Floats  #: (N,) m/s
    group: Ints  #: (N,) which of `groups`
    exit_time: Floats  #: (N,) s, nan for people who did not get out
    exit_index: Ints  #: (N,) which of `exits`; -1 for people who did not get out
    # of R rows
    person: Ints  #: (R,)
    position: Floats  #: (R, 2) m
    velocity: Floats  #: (R, 2) m/s
    pressure: Floats  #: (R,) N/m, mean since the frame before, see `contact_pressure`
    angle: Floats | None = None  #: (R,) rad, where bodies face that are no discs
    outline: Any = None  #: their shape as plain data, see `plain_outline`
    contacts: FrameContacts | None = None  #: if they were recorded

    def __post_init__(self) -> None:
        frames, people, rows = len(self.times), len(self.radius), len(self.person)
        shapes: dict[str, tuple[int, ...]] = {
            "thin_walls": (len(self.thin_walls), 2, 2),
            "times": (frames,),
            "frame_start": (frames + 1,),
            **dict.fromkeys(("radius", "desired_speed", "group", "exit_time", "exit_index"), (people,)),
            **dict.fromkeys(("person", "pressure"), (rows,)),
            **dict.fromkeys(("position", "velocity"), (rows, 2)),
        }
        if self.angle is not None:
            shapes["angle"] = (rows,)
        for name, shape in shapes.items():
            array(f"recording: {name}", getattr(self, name), shape)
        if not frames or not (np.diff(self.times) > 0).all():
            raise ValueError("a recording needs at least one frame, and its times must increase")
        _check_starts("frame_start", self.frame_start, rows)
        _check_numbers("person", self.person, 0, people)
        _check_numbers("group", self.group, 0, len(self.groups))
        _check_numbers("exit_index", self.exit_index, -1, len(self.exits))
        if self.contacts is not None:
            count = len(self.contacts.i)
            for name, shape in {"start": (frames + 1,), "i": (count,), "j": (count,), "gap": (count,)}.items():
                array(f"recording: contacts: {name}", getattr(self.contacts, name), shape)
            for name in ("normal", "point", "force"):
                array(f"recording: contacts: {name}", getattr(self.contacts, name), (count, 2))
            _check_starts("contacts: start", self.contacts.start, count)

    @cached_property
    def frame(self) -> Ints:
        """Frame of each row (R,)."""
        return np.repeat(np.arange(len(self.times)), np.diff(self.frame_start))

    @cached_property
    def beyond(self) -> Bools:
        """Which rows (R,) lie beyond the exit line: the last two rows of each person who got out."""
        return self.times[self.frame] >= np.nan_to_num(self.exit_time[self.person], nan=np.inf)

    @property
    def frame_interval(self) -> float:
        """Time from one frame to the next [s]; the last frame may come sooner."""
        return float(self.times[1] - self.times[0]) if len(self.times) > 1 else float(self.facts.get("every", 1.0))

    def inside(self, time: Floats | float) -> Ints:
        """Return how many people are inside at ``time`` (...) [s]; by exit times, not by frames."""
        left = np.searchsorted(np.sort(self.exit_time[np.isfinite(self.exit_time)]), time, side="right")
        return np.asarray(len(self.radius) - left)


def _check_starts(name: str, starts: Ints, rows: int) -> None:
    if starts[0] != 0 or starts[-1] != rows or (np.diff(starts) < 0).any():
        raise ValueError(f"recording: {name} must ascend from 0 to the number of rows, {rows}")


def _check_numbers(name: str, values: Ints, low: int, stop: int) -> None:
    bad = np.flatnonzero((values < low) | (values >= stop))
    if len(bad):
        raise ValueError(f"recording: {name}[{bad[0]}] is {values[bad[0]]}; it must be in {low} to {stop - 1}")
