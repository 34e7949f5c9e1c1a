"""The plan of a recording as plain data for the page: rings of the walkable area, thin walls, doors and exits."""

from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.parsing import from_wkt
from crowd_env.recording import Recording
from crowd_env.rendering.plan import holes_of, shells_of

_DIGITS = 4  # of a meter


def plain_plan(recording: Recording) -> tuple[dict[str, Any], Floats]:
    """Return the plan, and the point (2,) [m] from which all of the page is measured: coordinates of maps are large."""
    area = from_wkt(recording.walkable, "the walkable area of the recording")
    shells, holes = shells_of(area), holes_of(area)
    points = [*shells, *holes, recording.position, *(segment for _, segment in recording.exits)]
    every = np.concatenate([np.reshape(part, (-1, 2)) for part in points])
    border = np.concatenate(shells) if shells else every
    origin = np.floor(every.min(axis=0))

    def plain(points: Floats) -> Any:
        return np.round(np.asarray(points) - origin, _DIGITS).tolist()

    plan = {
        "origin": origin.tolist(),
        "bounds": [*plain(border.min(axis=0)), *plain(border.max(axis=0))],
        "shells": [plain(ring) for ring in shells],
        "holes": [plain(ring) for ring in holes],
        "thin_walls": [plain(wall) for wall in recording.thin_walls],
        "doors": [plain(leaf) for _, leaf in recording.doors],
        "exits": [{"name": name, "ends": plain(segment)} for name, segment in recording.exits],
    }
    return plan, origin
