"""Writers of recordings, part by part: a run that breaks off keeps the parts already written."""

import json
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from crowd_env.core.arrays.state import Floats, unit_vectors
from crowd_env.core.checks import Plain
from crowd_env.geometry.aprons import add_aprons
from crowd_env.recording.content import OF_PEOPLE, Frames
from crowd_env.recording.exits import APRON


class Writer(Protocol):
    """Writes one recording; every appended part is whole, whatever happens to the process afterwards."""

    def append(self, part: Frames) -> None:
        """Write the next frames, at least one."""

    def finish(self, facts: Plain) -> Path:
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


def area_with_aprons(recording: Frames) -> Any:
    """Return the area for other programs: the walkable area, and the ground just outside of its exits."""
    exits = np.array([line for _, line in recording.exits], dtype=np.float64).reshape(-1, 2, 2)
    return add_aprons(recording.geometry.walkable, exits, APRON) if len(exits) else recording.geometry.walkable


# Field of a recording -> its name in files, which are older than the word.
_IN_FILES = {"cohorts": "groups", "cohort": "group", "group": "company"}
PLACE = ("walkable", "thin_walls", "doors", "exits", "groups")  # of the place, as files name it


def in_files(name: str) -> str:
    """Return the name that a field of a recording has in files."""
    return _IN_FILES.get(name, name)


def place_of(recording: Frames) -> Plain:
    """Return the fields ``PLACE`` of a recording."""
    return {name: recording.cohorts if name == "groups" else getattr(recording, name) for name in PLACE}


def as_json(value: Any) -> str:
    """Return data as JSON, arrays as lists."""
    return json.dumps(value, default=np.ndarray.tolist)


def fields_of(
    facts: Plain,
    place: Plain,
    people: Any,
    rows: Any,
    **others: Any,
) -> dict[str, Any]:
    """Return the fields of a recording from what both formats hold.

    Parameters
    ----------
    facts, place : as they come back from JSON; the place has the fields ``PLACE``.
    people : columns of the people by name, those in ``OF_PEOPLE``, as files name them.
    rows : columns of the rows by name: id, x, y, vx, vy, pressure and, of bodies that are no discs, angle.
    others : other fields.
    """
    is_disc = facts["outline"] == "disc"
    lines = {
        key: tuple((name, np.array(line, dtype=np.float64)) for name, line in place[key]) for key in ("doors", "exits")
    }
    return {
        **{name: people[in_files(name)] for name in OF_PEOPLE},
        "walkable": place["walkable"],
        **lines,
        "thin_walls": np.array(place["thin_walls"], dtype=np.float64).reshape(-1, 2, 2),
        "cohorts": tuple(place["groups"]),
        "facts": facts,
        "outline": None if is_disc else facts["outline"],
        "person": rows["id"],
        "position": np.stack([rows["x"], rows["y"]], axis=1),
        "velocity": np.stack([rows["vx"], rows["vy"]], axis=1),
        "pressure": rows["pressure"],
        "angle": None if is_disc else rows["angle"],
        **others,
    }


def facing(recording: Frames) -> Floats:
    """Return unit vectors (R, 2): the orientation of bodies, or (discs) their walking direction; x where unknown."""
    if recording.angle is not None:
        return unit_vectors(recording.angle)
    speed = np.hypot(*recording.velocity.T)[:, None]
    return np.where(speed > 0.0, recording.velocity / np.maximum(speed, 1e-300), (1.0, 0.0))
