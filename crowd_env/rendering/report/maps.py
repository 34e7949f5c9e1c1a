"""Where it was crowded and where people pressed each other, in the recorded runs of a folder."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from crowd_env.analysis.results.measurements import CELL, Grid, Spread, grid_over
from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.recording import load
from crowd_env.recording.formats import recordings_in
from crowd_env.rendering.heat import HeatMap
from crowd_env.rendering.report.runs import Runs

_PLACES = 5  # that are named of each map
_APART = 2.0  # m, between two of them
_AT_ONCE = 50  # frames
_UNITS: dict[Literal["density", "pressure"], str] = {"density": "people/m²", "pressure": "N/m"}
_LEAST = 0.25  # of the largest value: what is less is not among the worst


class Worst(NamedTuple):
    """A place where the value of a map is largest of all around."""

    x: float  # m
    y: float  # m
    value: float
    exit: str  # the nearest, as the crow flies
    distance: float  # m, to its middle


class Measured(NamedTuple):
    """Maps (rows, columns) of some runs of a folder: in each cell the largest value of any moment of any run."""

    name: str
    runs: int  # that were recorded
    grid: Grid
    density: Floats  # 1/m2
    pressure: Floats  # N/m
    densest: list[Worst]
    hardest: list[Worst]

    def as_json(self) -> dict[str, Any]:
        """Return the worst places, ready for JSON."""
        places = {"density": self.densest, "pressure": self.hardest}
        found = {name: [place._asdict() for place in worst] for name, worst in places.items()}
        return {"name": self.name, "runs": self.runs, "worst_places": found}


def measure(runs: Runs) -> Measured | None:
    """Return the maps of the recorded runs of a folder; None if there are none.

    Raises
    ------
    ValueError
        If a recording cannot be read.
    """
    files, geometry = recordings_in(runs.folder), runs.scenario.geometry
    grid = grid_over(geometry)
    spread, most = Spread(grid), np.zeros((2, *grid.shape))
    for file in files:
        recording = load(file)
        pressure = np.nan_to_num(recording.pressure)
        for first in range(0, len(recording.times), _AT_ONCE):
            stop = min(first + _AT_ONCE, len(recording.times))
            rows = np.arange(recording.frame_start[first], recording.frame_start[stop])
            rows = rows[~recording.beyond[rows]]
            found = spread(recording.position[rows], pressure[rows], recording.frame[rows] - first, stop - first)
            most = np.maximum(most, [field.max(axis=0).reshape(grid.shape) for field in found])
    if not files:
        return None
    return Measured(runs.name, len(files), grid, *most, *(_worst(geometry, grid, values) for values in most))


def heat_of(found: Measured, every: Sequence[Measured]) -> list[HeatMap]:
    """Return the maps to draw, with the colors of the same values as all others that they are compared with."""
    maps = []
    for name, unit in _UNITS.items():
        full = max(float(getattr(one, name).max()) for one in every) or None
        said = f"largest {name} at any moment"
        maps.append(HeatMap(said, getattr(found, name), found.grid.origin, CELL, unit, name, full))
    return maps


def _worst(geometry: Geometry, grid: Grid, values: Floats) -> list[Worst]:
    """Return the places on the plan whose value nothing within `_APART` along x and y exceeds, the largest first.

    Places with less than a quarter of the largest value are left out.
    """
    rows, columns = np.indices(grid.shape)
    points = np.asarray(grid.origin) + CELL * (np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5)
    inside = np.where(geometry.contains(points).reshape(grid.shape), values, 0.0)
    reach = round(_APART / CELL)
    around = inside
    for axis in (0, 1):
        pad = [(reach, reach) if k == axis else (0, 0) for k in (0, 1)]
        around = sliding_window_view(np.pad(around, pad), 2 * reach + 1, axis=axis).max(axis=-1)
    worth = (inside >= around) & (inside >= _LEAST * inside.max(initial=0.0))
    left = np.where(worth, inside, 0.0).ravel()
    middles = geometry.exits.mean(axis=1)
    found: list[Worst] = []
    while len(found) < _PLACES and left.max(initial=0.0) > 0.0:
        best = int(left.argmax())
        gaps = np.hypot(*(middles - points[best]).T)
        nearest = int(gaps.argmin())
        place = (float(points[best, 0]), float(points[best, 1]), float(left[best]))
        found.append(Worst(*place, geometry.exit_names[nearest], float(gaps[nearest])))
        left[np.hypot(*(points - points[best]).T) < _APART] = 0.0
    return found
