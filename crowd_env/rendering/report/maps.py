"""Where it was crowded and where people pressed each other, in the runs of a folder: collected while they went on."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from crowd_env.analysis.figures import named
from crowd_env.analysis.plan_check import spot
from crowd_env.analysis.results.crowding import SERVICE, wall_pieces, zones_of
from crowd_env.analysis.results.measurements import CELL, Grid, grid_over
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.pressure import INJURY
from crowd_env.rendering.heat import HeatMap
from crowd_env.rendering.report.runs import Runs

_PLACES = 5  # that are named of each map
_APART = 2.0  # m, between two of them
_UNITS: dict[Literal["density", "pressure"], str] = {"density": "people/m²", "pressure": "N/m"}
_LEAST = 0.25  # of the largest value: what is less is not among the worst


class Worst(NamedTuple):
    """A place where the value of a map is largest of all around."""

    x: float  # m
    y: float  # m
    value: float
    where: str  # in words, in a building with the storey
    exit: str  # the nearest on its storey, as the crow flies; "" = none
    distance: float | None  # m, to its middle


class Zone(NamedTuple):
    """A region of the plan, and the people in it."""

    name: str
    area: float  # m2
    most: Plain  # people at once, over runs
    empty: Plain  # s  when it was empty for good, over runs
    densest: float  # 1/m2  of any moment of any run
    is_sheet: bool  # a storey or stair of a building


class Measured(NamedTuple):
    """Maps (rows, columns) of a folder: in each cell the largest value of any moment of any run."""

    name: str
    runs: int  # of which something was collected
    grid: Grid
    density: Floats  # 1/m2
    pressure: Floats  # N/m
    densest: list[Worst]
    hardest: list[Worst]
    loaded: list[Worst]  # N/m  of walls
    service: dict[str, float]  # level -> share of the time that people spent inside
    impact: float  # N/m  largest mean of 0.1 s, of anyone in any run
    squeezed: float  # s  that people spent beyond `INJURY`, means of 1 s, added up, mean over runs
    left_out: int  # decisions whose forces are left out, of all runs
    zones: list[Zone]

    def as_json(self) -> Plain:
        """Return what there is besides maps, ready for JSON."""
        places = {"density": self.densest, "pressure": self.hardest, "wall_load": self.loaded}
        return {
            "name": self.name,
            "runs": self.runs,
            "worst_places": {name: [place._asdict() for place in worst] for name, worst in places.items()},
            "service": self.service,
            "impact": self.impact,
            "person_seconds_beyond_injury": self.squeezed,
            "left_out": self.left_out,
            "zones": [zone._asdict() for zone in self.zones],
        }


def measure(runs: Runs) -> Measured | None:
    """Return what was collected while the runs of a folder went on; None if nothing was."""
    if not (found := runs.crowding):
        return None
    geometry = runs.scenario.geometry
    grid = grid_over(geometry)
    density, pressure = (np.max([getattr(one, name) for one in found], axis=0).astype(np.float64) for name in _UNITS)
    sheets = [] if geometry.building is None else [sheet.name for sheet in geometry.building.sheets]
    spent = np.sum([one.service for one in found], axis=0)
    service = dict(zip(SERVICE, (spent / max(spent.sum(), 1e-9)).tolist(), strict=True))
    zones = [
        Zone(
            name,
            geometry.area_of(name),
            named(np.array([one.zone_most[k] for one in found], dtype=np.float64)),
            named(np.array([one.zone_empty[k] for one in found])),
            float(density.ravel()[cells].max(initial=0.0)),
            name in sheets,
        )
        for k, (name, cells) in enumerate(zip(geometry.regions, zones_of(geometry, grid), strict=True))
    ]
    return Measured(
        name=runs.name,
        runs=len(found),
        grid=grid,
        density=density,
        pressure=pressure,
        densest=_worst(geometry, grid, density),
        hardest=_worst(geometry, grid, pressure),
        loaded=_most_loaded(geometry, np.max([one.wall_load for one in found], axis=0)),
        service=service,
        impact=max(one.impact for one in found),
        squeezed=float(np.mean([one.squeezed for one in found])),
        left_out=sum(one.left_out for one in found),
        zones=zones,
    )


def heat_of(found: Measured, every: Sequence[Measured]) -> list[HeatMap]:
    """Return the maps to draw: densities with the colors of all that they are compared with, pressures from 0 to `INJURY`."""
    full = {"density": max(float(one.density.max()) for one in every) or None, "pressure": INJURY}
    return [
        HeatMap(f"largest {name} of any run", getattr(found, name), found.grid.origin, CELL, unit, name, full[name])
        for name, unit in _UNITS.items()
    ]


def _worst(geometry: Geometry, grid: Grid, values: Floats) -> list[Worst]:
    """Return the places on the plan whose value nothing within `_APART` along x and y exceeds, the largest first.

    Places with less than a quarter of the largest value are left out.
    """
    points = grid.middles()
    inside = np.where(geometry.contains(points).reshape(grid.shape), values, 0.0)
    reach = round(_APART / CELL)
    around = inside
    for axis in (0, 1):
        pad = [(reach, reach) if k == axis else (0, 0) for k in (0, 1)]
        around = sliding_window_view(np.pad(around, pad), 2 * reach + 1, axis=axis).max(axis=-1)
    worth = (inside >= around) & (inside >= _LEAST * inside.max(initial=0.0))
    return _largest(geometry, points, np.where(worth, inside, 0.0).ravel())


def _most_loaded(geometry: Geometry, load: Floats) -> list[Worst]:
    """Return the pieces of walls that bear most, the largest first; one of several near each other."""
    return _largest(
        geometry, wall_pieces(geometry).mean(axis=1), np.where(load >= _LEAST * load.max(initial=0.0), load, 0.0)
    )


def _largest(geometry: Geometry, points: Floats, left: Floats) -> list[Worst]:
    """Return the places with the largest values that are ``left``, `_APART` from each other."""
    middles = geometry.exits.mean(axis=1)
    exit_sheet = geometry.on_sheets(middles)[1]
    found: list[Worst] = []
    while len(found) < _PLACES and left.max(initial=0.0) > 0.0:
        best = int(left.argmax())
        here = np.flatnonzero(exit_sheet == geometry.on_sheets(points[best])[1])
        gaps = np.hypot(*(middles[here] - points[best]).T)
        nearest = (geometry.exit_names[here[gaps.argmin()]], float(gaps.min())) if len(here) else ("", None)
        where = spot(geometry, points[best])
        found.append(Worst(float(points[best, 0]), float(points[best, 1]), float(left[best]), where, *nearest))
        left[np.hypot(*(points - points[best]).T) < _APART] = 0.0
    return found
