"""What writes recordings, part by part, so that a run that breaks off leaves what was written so far."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.boundary import add_aprons
from crowd_env.recording.exits import APRON
from crowd_env.recording.recording import Recording


class Writer(Protocol):
    """Writes one recording; all that was appended is whole, whatever happens to the process afterwards."""

    def append(self, part: Recording) -> None:
        """Write the next frames, at least one."""
        ...

    def finish(self, facts: Mapping[str, Any]) -> Path:
        """Complete the recording with the facts known at its end, and return the path of its file."""
        ...

    def abandon(self) -> None:
        """Leave the recording as it is, unfinished, and let go of its file."""
        ...


def part_of(path: Path) -> Path:
    """Return where a recording lies until it is finished: beside its place, as a file of the same kind."""
    return path.with_name(f"{path.stem}.part{path.suffix}")


def plain(value: Any) -> Any:
    """Return data as they come back from JSON."""
    return json.loads(json.dumps(value))


class Area(NamedTuple):
    """The walkable area and the ground just outside of its exits, where rows beyond them lie."""

    wkt: str
    bounds: tuple[float, float, float, float]  # m


def area_with_aprons(recording: Recording) -> Area:
    """Return the area that other programs are told of."""
    exits = np.array([line for _, line in recording.exits], dtype=np.float64).reshape(-1, 2, 2)
    area = add_aprons(recording.geometry.walkable, exits, APRON) if len(exits) else recording.geometry.walkable
    return Area(area.wkt, area.bounds)


def plain_place(recording: Recording) -> dict[str, Any]:
    """Return the place and the names of groups as plain data; `read_place` takes them back."""
    return {
        "walkable": recording.walkable,
        "thin_walls": recording.thin_walls.tolist(),
        "doors": [[name, line.tolist()] for name, line in recording.doors],
        "exits": [[name, line.tolist()] for name, line in recording.exits],
        "groups": list(recording.groups),
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


def facing(recording: Recording) -> Floats:
    """Return unit vectors (R, 2): where bodies face, or (discs) where they walk; x where nobody knows."""
    if recording.angle is not None:
        return np.stack([np.cos(recording.angle), np.sin(recording.angle)], axis=1)
    speed = np.hypot(*recording.velocity.T)[:, None]
    return np.where(speed > 0.0, recording.velocity / np.maximum(speed, 1e-300), (1.0, 0.0))
