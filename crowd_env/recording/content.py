"""The arrays of a recording, checked: what every format writes."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.behaviors.pulls import ALONE
from crowd_env.core.checks import Plain, array
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.sheets import from_plain

OF_PEOPLE = (
    "radius",
    "desired_speed",
    "cohort",
    "exit_time",
    "exit_index",
    "group",
)  # fields with a number for each person
_WHOLE = {"frame_start", "cohort", "exit_index", "group", "person", "start", "i", "j"}


class FrameContacts(NamedTuple):
    """The K contacts of F frames: all contacts since the frame before, of pedestrians still inside.

    Gap, normal and point come from the last physics step of the contact, at the positions of `Simulation.contacts`: a gap may
    differ from the frame's by the motion in one step, and by more if the bodies parted before.
    """

    start: Ints  #: (F+1,) contacts of frame f are start[f]:start[f + 1]
    i: Ints  #: (K,) person
    j: Ints  #: (K,) other person > i, or -1 - k: wall feature k
    gap: Floats  #: (K,) m, < 0 is overlap
    normal: Floats  #: (K, 2) unit vector from j to i
    point: Floats  #: (K, 2) m, where they touch: in the middle of gap or overlap
    force: Floats  #: (K, 2) N, mean since the frame before, normal (> 0 pushes apart) and tangential; times that time: impulse


@dataclass(frozen=True, eq=False)
class Frames:
    """The arrays of a `Recording`, where they are explained."""

    facts: Plain  #: plain data: scenario, scheme, dt, decision_dt, seed, strategy, time_limit, versions ...
    walkable: str  #: WKT of the walkable area [m]
    thin_walls: Floats  #: (W, 2, 2) m, walls without thickness inside the area
    doors: tuple[tuple[str, Floats], ...]  #: name, (2, 2) m, of each leaf: a wall while the door is closed
    exits: tuple[tuple[str, Floats], ...]  #: name, (2, 2) m, of each row of Geometry.exits; an exit may have several
    cohorts: tuple[str, ...]  #: names of the cohorts of people; ("",) if there are none
    times: Floats  #: (F,) s
    frame_start: Ints  #: (F+1,) rows of frame f are frame_start[f]:frame_start[f + 1]
    # of N people
    radius: Floats  #: (N,) m, of the disc, or of the disc of the same area
    desired_speed: Floats  #: (N,) m/s
    cohort: Ints  #: (N,) which of `cohorts` each belongs to
    exit_time: Floats  #: (N,) s, nan for pedestrians still inside at the end
    exit_index: Ints  #: (N,) which of `exits`; -1 for pedestrians still inside at the end
    # of R rows
    person: Ints  #: (R,)
    position: Floats  #: (R, 2) m
    velocity: Floats  #: (R, 2) m/s
    pressure: Floats  #: (R,) N/m, mean since the frame before, see `contact_pressure`
    angle: Floats | None = None  #: (R,) rad, orientation of bodies that are no discs
    group: Ints = None  # type: ignore[assignment]  #: (N,) group in which each walks; -1, the default, = alone
    memory: Mapping[str, Floats] = field(default_factory=dict)  #: (R, ...) rows of behaviors: see `Behavior.rows`
    outline: Any = None  #: shape of the bodies as plain data, see `Outline.plain_of`
    contacts: FrameContacts | None = None  #: if they were recorded

    def __post_init__(self) -> None:
        frames, people, rows = len(self.times), len(self.radius), len(self.person)
        if self.group is None:
            object.__setattr__(self, "group", np.full(people, ALONE))  # type: ignore[unreachable]
        shapes: dict[str, tuple[int, ...]] = {
            "thin_walls": (len(self.thin_walls), 2, 2),
            "times": (frames,),
            "frame_start": (frames + 1,),
            **dict.fromkeys(OF_PEOPLE, (people,)),
            **dict.fromkeys(("person", "pressure") if self.angle is None else ("person", "pressure", "angle"), (rows,)),
            **dict.fromkeys(("position", "velocity"), (rows, 2)),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, _column(name, getattr(self, name), shape))
        kept = {name: _column(name, one, (rows, *np.shape(one)[1:])) for name, one in self.memory.items()}
        object.__setattr__(self, "memory", kept)
        if not frames or not (np.diff(self.times) > 0).all():
            raise ValueError("a recording needs at least one frame, and its times must increase")
        _check_starts("frame_start", self.frame_start, rows)
        _check_numbers("person", self.person, 0, people)
        _check_numbers("cohort", self.cohort, 0, len(self.cohorts))
        _check_numbers("exit_index", self.exit_index, -1, len(self.exits))
        if self.contacts is not None:
            one, two = (len(self.contacts.i),), (len(self.contacts.i), 2)
            of_each = ((frames + 1,), one, one, one, two, two, two)
            contacts = FrameContacts(*map(_column, FrameContacts._fields, self.contacts, of_each))
            object.__setattr__(self, "contacts", contacts)
            _check_starts("start of contacts", contacts.start, len(contacts.i))

    @cached_property
    def frame(self) -> Ints:
        """Frame of each row (R,)."""
        return np.repeat(np.arange(len(self.times)), np.diff(self.frame_start))

    @property
    def frame_interval(self) -> float:
        """Time from one frame to the next [s]; the last frame may come sooner."""
        return float(self.facts.get("every") or (self.times[1] - self.times[0] if len(self.times) > 1 else 1.0))

    def places(self) -> tuple[Floats, Floats, Ints]:
        """Return where people are in a building: true coordinates (R, 2) [m], heights (R,) [m] and sheets (R,).

        Positions of a recording are in the layout, in which the sheets lie side by side.
        """
        true, sheet = self.geometry.on_sheets(self.position)
        return true, self.geometry.heights(true, sheet), sheet

    @cached_property
    def geometry(self) -> Geometry:
        """The place; doors are walls."""
        with warnings.catch_warnings():  # its warnings appeared when the place was made
            warnings.simplefilter("ignore")
            lines = {str(k): line for k, (_, line) in enumerate(self.exits)}
            if "building" in self.facts:
                made = Geometry.from_sheets(*from_plain(self.facts["building"]), exits=lines)
            else:
                made = Geometry.from_wkt(self.walkable, exits=lines)
        inner = np.concatenate([self.thin_walls, *(line[None] for _, line in self.doors)])
        walls = np.concatenate([made.walls, inner])
        return replace(
            made,
            walls=walls,
            two_sided=np.repeat([False, True], [len(made.walls), len(inner)]),
            door_of_wall=np.full(len(walls), -1, dtype=np.int64),
            exit_names=tuple(self.exits[int(name)][0] for name in made.exit_names),
        )


def _column(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    kind = np.int64 if name in _WHOLE else np.float64
    return np.ascontiguousarray(array(f"recording: {name}", values, shape), dtype=kind)


def _check_starts(name: str, starts: Ints, rows: int) -> None:
    if starts[0] != 0 or starts[-1] != rows or (np.diff(starts) < 0).any():
        raise ValueError(f"recording: {name} must ascend from 0 to the number of rows, {rows}")


def _check_numbers(name: str, values: Ints, low: int, stop: int) -> None:
    bad = np.flatnonzero((values < low) | (values >= stop))
    if len(bad):
        raise ValueError(f"recording: {name}[{bad[0]}] is {values[bad[0]]}; it must be in {low} to {stop - 1}")
