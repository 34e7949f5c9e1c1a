"""A building as a page shows it: the storeys of the layout, and all of them drawn above one another, joined by stairs.

The picture is a cabinet projection: u = x + `_SHEAR` y, v = `_SQUASH` y + lift z in true coordinates.  Heights are lifted until
storeys do not hide each other.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain
from crowd_env.geometry.sheets import Building, sheets_at
from crowd_env.recording import Recording
from crowd_env.rendering.plan import holes_of, shells_of

_SHEAR, _SQUASH = 0.4, 0.45
_CLEAR = 1.2  # times the depth of a storey in the picture lies between two
_DIGITS = 4  # of a meter


def stack_of(recording: Recording, building: Building) -> Callable[[Floats], Floats]:
    """Return what finds where points (K, 2) [m] of the layout lie in the picture of storeys above one another."""
    geometry, sheets = recording.geometry, building.sheets
    boxes = np.array([sheet.area.bounds for sheet in sheets])
    heights = np.unique([sheet.middle for sheet in sheets if sheet.level == sheet.level])
    apart = float(np.median(np.diff(heights))) if len(heights) > 1 else 3.0
    lift = max(_CLEAR * _SQUASH * float(np.ptp(boxes[:, [1, 3]])) / apart, 1.0)

    def projected(points: Floats) -> Floats:
        true, sheet = geometry.on_sheets(points)
        x, y = (true - boxes[:, :2].min(axis=0)).T
        return np.stack([x + _SHEAR * y, _SQUASH * y + lift * geometry.heights(true, sheet)], axis=1)

    return projected


def stacked_plan(recording: Recording, building: Building, projected: Callable[[Floats], Floats]) -> Plain:
    """Return the picture of the plan as `stack_of` projects it: floors from below, a sheet each."""

    def plain(lines: Any) -> Any:
        return [np.round(projected(np.asarray(line)), _DIGITS).tolist() for line in lines]

    of_wall, parts = sheets_at(recording.thin_walls.mean(axis=1), building.sheets), []
    for s, sheet in sorted(enumerate(building.sheets), key=lambda one: one[1].middle):
        rings = (
            plain(ring + sheet.offset for floor in sheet.floors for ring in find(floor))
            for find in (shells_of, holes_of)
        )
        part = dict(zip(("shells", "holes"), rings, strict=True))
        name = sheet.title if sheet.level == sheet.level else ""
        parts.append({**part, "name": name, "thin_walls": plain(recording.thin_walls[of_wall == s])})
    return {
        "parts": parts,
        "doors": plain(leaf for _, leaf in recording.doors),
        "exits": [{"ends": ends} for ends in plain(line for _, line in recording.exits)],
        "seams": [{"ends": ends} for ends in plain(building.lines)],
    }


def storeys_of(building: Building, origin: Floats) -> Plain:
    """Return seams and storeys of the layout, measured from ``origin``; levels before stairs, the highest first."""
    lines = np.round(building.lines - origin, _DIGITS).tolist()
    order = sorted(enumerate(building.sheets), key=lambda one: (bool(one[1].slopes), -one[1].middle))
    boxes = (np.add(sheet.area.bounds, np.tile(sheet.offset - origin, 2)).tolist() for _, sheet in order)
    return {
        "seams": [{"letter": letter, "ends": ends} for letter, ends in zip(building.letters, lines, strict=True)],
        "storeys": [{"sheet": s, "name": one.title, "box": box} for (s, one), box in zip(order, boxes, strict=True)],
    }
