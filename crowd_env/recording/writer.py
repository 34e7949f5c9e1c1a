"""What writes frames: whole batches of them at a time, so that a run that breaks off leaves what was written so far."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.recording.frames import Frame, Head
from crowd_env.recording.recording import FrameContacts, Recording


class Writer(Protocol):
    """Writes one recording; all that was appended is whole, whatever happens to the process afterwards."""

    def append(self, frames: Sequence[Frame]) -> None:
        """Write the next frames, at least one."""
        ...

    def finish(self, facts: Mapping[str, Any]) -> Any:
        """Complete the recording with the facts known at its end; return it, or the path of its file."""
        ...

    def abandon(self) -> None:
        """Leave the recording as it is, unfinished, and let go of its files."""
        ...


def part_of(path: Path) -> Path:
    """Return where a recording lies until it is finished: beside its place, as a file of the same kind."""
    return path.with_name(f"{path.stem}.part{path.suffix}")


def plain(value: Any) -> Any:
    """Return data as they come back from JSON."""
    return json.loads(json.dumps(value))


def plain_place(head: Head) -> dict[str, Any]:
    """Return the place and the names of groups as plain data; `read_place` takes them back."""
    return {
        "walkable": head.walkable,
        "thin_walls": head.thin_walls.tolist(),
        "doors": [[name, line.tolist()] for name, line in head.doors],
        "exits": [[name, line.tolist()] for name, line in head.exits],
        "groups": list(head.groups),
    }


def read_place(place: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a `Recording` that `plain_place` has written."""
    return {
        "walkable": place["walkable"],
        "thin_walls": np.array(place["thin_walls"], dtype=np.float64).reshape(-1, 2, 2),
        "doors": tuple((name, np.array(line, dtype=np.float64)) for name, line in place["doors"]),
        "exits": tuple((name, np.array(line, dtype=np.float64)) for name, line in place["exits"]),
        "groups": tuple(place["groups"]),
    }


def outline_of(facts: Mapping[str, Any]) -> Any:
    """Return the outline of bodies as plain data, None for discs."""
    return None if facts["outline"] == "disc" else facts["outline"]


def joined(frames: Sequence[Frame], name: str) -> Any:
    """Return a column of the rows of frames, one behind the other."""
    return np.concatenate([getattr(frame, name) for frame in frames])


def frame_of_rows(frames: Sequence[Frame], first: int) -> Ints:
    """Return the number of the frame (R,) of each row; that of ``frames[0]`` is ``first``."""
    return np.repeat(np.arange(first, first + len(frames)), [len(frame.person) for frame in frames])


def join_contacts(frames: Sequence[Frame]) -> FrameContacts:
    """Return the contacts of frames that have some, one behind the other."""
    parts = [frame.contacts for frame in frames if frame.contacts is not None]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in FrameContacts._fields[1:]}
    return FrameContacts(start=row_starts([len(part.i) for part in parts]), **columns)


def nobody_out(count: int) -> tuple[Floats, Ints]:
    """Return exit times and exits (N,) of people of whom none has got out."""
    return np.full(count, np.nan), np.full(count, -1, dtype=np.int64)


class MemoryWriter:
    """Keeps the frames; its recording is a `Recording`."""

    def __init__(self, head: Head) -> None:
        self._head = head
        self._frames: list[Frame] = []

    def append(self, frames: Sequence[Frame]) -> None:
        """Keep the next frames."""
        self._frames += frames

    def finish(self, facts: Mapping[str, Any]) -> Recording:
        """Return the recording."""
        head, frames = self._head, self._frames
        exit_time, exit_index = nobody_out(len(head.radius))
        for frame in frames:
            exit_time[frame.left], exit_index[frame.left] = frame.exit_time, frame.exit_index
        return Recording(
            facts=plain(head.facts | dict(facts)),
            **read_place(plain_place(head)),
            times=np.array([frame.time for frame in frames]),
            frame_start=row_starts([len(frame.person) for frame in frames]),
            radius=head.radius,
            desired_speed=head.desired_speed,
            group=head.group,
            exit_time=exit_time,
            exit_index=exit_index,
            **{name: joined(frames, name) for name in ("person", "position", "velocity", "pressure")},
            angle=None if head.outline is None else joined(frames, "angle"),
            outline=plain(head.outline),
            contacts=join_contacts(frames) if head.contacts else None,
        )

    def abandon(self) -> None:
        """Forget the frames."""
        self._frames = []
