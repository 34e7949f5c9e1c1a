"""Writers of recordings, part by part: a run that breaks off keeps the parts already written."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.boundary import add_aprons
from crowd_env.recording.exits import APRON
from crowd_env.recording.recording import Recording


class Writer(Protocol):
    """Writes one recording; every appended part is whole, whatever happens to the process afterwards."""

    def append(self, part: Recording) -> None:
        """Write the next frames, at least one."""

    def finish(self, facts: Mapping[str, Any]) -> Path:
        """Complete the recording with the facts known at its end, and return the path of its file."""

    def abandon(self) -> None:
        """Leave the recording as it is, unfinished, and let go of its file."""


def part_of(path: Path) -> Path:
    """Return the path of a recording until it is finished: beside its place, as a file of the same kind."""
    return path.with_name(f"{path.stem}.part{path.suffix}")


def remove_part(path: Path) -> None:
    """Remove an unfinished recording, and the journal that SQLite has left beside it."""
    part = part_of(path)
    for name in (part.name, f"{part.name}-journal"):
        part.with_name(name).unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """Return data as they come back from JSON."""
    return json.loads(as_json(value))


def area_with_aprons(recording: Recording) -> Any:
    """Return the area for other programs: the walkable area, and the ground just outside of its exits."""
    exits = np.array([line for _, line in recording.exits], dtype=np.float64).reshape(-1, 2, 2)
    return add_aprons(recording.geometry.walkable, exits, APRON) if len(exits) else recording.geometry.walkable


# Field of a recording -> its name in files, which are older than the word.
_IN_FILES = {"cohorts": "groups", "cohort": "group", "group": "company"}
PLACE = ("walkable", "thin_walls", "doors", "exits", "groups")  # of the place, as files name it


def in_files(name: str) -> str:
    """Return the name that a field of a recording has in files."""
    return _IN_FILES.get(name, name)


def place_of(recording: Recording) -> dict[str, Any]:
    """Return the fields ``PLACE`` of a recording."""
    return {name: recording.cohorts if name == "groups" else getattr(recording, name) for name in PLACE}


def as_json(value: Any) -> str:
    """Return data as JSON, arrays as lists."""
    return json.dumps(value, default=np.ndarray.tolist)


def recording_of(facts: Mapping[str, Any], place: Mapping[str, Any], **columns: Any) -> Recording:
    """Return a recording from its facts and the fields ``PLACE`` as they come back from JSON, and its columns."""
    for key in ("doors", "exits"):
        columns[key] = tuple((name, np.array(line, dtype=np.float64)) for name, line in place[key])
    thin_walls = np.array(place["thin_walls"], dtype=np.float64).reshape(-1, 2, 2)
    if facts["outline"] == "disc":
        columns["angle"] = None
    else:
        columns["outline"] = facts["outline"]
    named = {"walkable": place["walkable"], "cohorts": tuple(place["groups"])}
    return Recording(facts=facts, thin_walls=thin_walls, **named, **columns)


def facing(recording: Recording) -> Floats:
    """Return unit vectors (R, 2): the orientation of bodies, or (discs) their walking direction; x where unknown."""
    if recording.angle is not None:
        return np.stack([np.cos(recording.angle), np.sin(recording.angle)], axis=1)
    speed = np.hypot(*recording.velocity.T)[:, None]
    return np.where(speed > 0.0, recording.velocity / np.maximum(speed, 1e-300), (1.0, 0.0))
