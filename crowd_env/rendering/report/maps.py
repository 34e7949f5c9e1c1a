"""Where it was crowded and where people pressed each other: runs of a folder made again, with a look at every step."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from crowd_env.analysis.results.measurements import CELL, Grid, MeasurementRecorder
from crowd_env.core.arrays.state import Floats
from crowd_env.envs.rollout import run_episodes
from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.heat import HeatMap
from crowd_env.rendering.report.runs import Runs

_PLACES = 5  # that are named of each map
_APART = 2.0  # m, between two of them
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
    runs: int  # that were made again
    same: bool  # whether they came out as in the folder, to the last bit
    grid: Grid
    density: Floats  # 1/m2
    pressure: Floats  # N/m
    densest: list[Worst]
    hardest: list[Worst]

    def as_json(self) -> dict[str, Any]:
        """Return the worst places, ready for JSON."""
        places = {"density": self.densest, "pressure": self.hardest}
        found = {name: [place._asdict() for place in worst] for name, worst in places.items()}
        return {"name": self.name, "runs": self.runs, "same_as_before": self.same, "worst_places": found}


def measure(runs: Runs, most: int, progress: Callable[[int], object] | None = None) -> Measured:
    """Return the maps of the first runs of a folder, at most so many, which are made again.

    Raises
    ------
    ValueError
        If they cannot be made.
    """
    config, wanted = runs.config, [episode.run for episode in runs.episodes[:most]]
    geometry = runs.scenario.geometry
    recorder = MeasurementRecorder(geometry)
    again = run_episodes(
        runs.scenario,
        config["runs"],
        only=wanted,
        seed=config["seed"],
        scheme=runs.scheme,
        dt=config["dt"],
        strategy=config["strategy"],
        rules=config["rules"],
        recorder=recorder,
        progress=progress,
    )
    same = all(
        np.array_equal(one.exit_time, other.exit_time, equal_nan=True)
        for one, other in zip(again, runs.episodes, strict=False)
    )
    density, pressure = recorder.maps.density_max, recorder.maps.pressure_max
    worst = [_worst(geometry, recorder.grid, values) for values in (density, pressure)]
    return Measured(runs.name, len(wanted), same, recorder.grid, density, pressure, *worst)


def heat_of(found: Measured, every: Sequence[Measured]) -> list[HeatMap]:
    """Return the maps to draw, with the colors of the same values as all others that they are compared with."""
    fields = (
        ("largest density at any moment", "density", "people/m²"),
        ("largest pressure at any moment", "pressure", "N/m"),
    )
    return [
        HeatMap(
            title,
            getattr(found, name),
            found.grid.origin,
            CELL,
            unit,
            "density" if name == "density" else "pressure",
            max(float(getattr(one, name).max()) for one in every) or None,
        )
        for title, name, unit in fields
    ]


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
