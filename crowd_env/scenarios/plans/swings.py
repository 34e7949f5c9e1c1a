"""Doors as architects draw them: a leaf that stands open, and the arc along which it shuts."""

from collections.abc import Sequence

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats

_ROUND = 0.02  # of the radius; points of an arc are no further from it
_SWEEP = np.deg2rad([25.0, 125.0])  # angles of an arc that is a swing
_SYMBOL = 1.06  # radii from the hinge within which all belongs to the door
_BESIDE = 0.12  # of the radius; a leaf is no further from where it is drawn


def openings(lines: Sequence[Floats]) -> list[Floats]:
    """Return lines (K, 2) of doors, with the opening, from hinge to where the leaf shuts, in place of each swing.

    Of the two ends of an arc the leaf stands at one, and shuts at the other.
    """
    hinges = [(line, _hinge(line)) for line in lines]
    rest = [line for line, hinge in hinges if hinge is None]
    found: list[Floats] = []
    for arc, hinge in hinges:
        if hinge is None:
            continue
        radius = float(np.hypot(*(arc[0] - hinge)))
        symbol = [line for line in rest if np.hypot(*(line - hinge).T).max() < _SYMBOL * radius]
        ends = [end for end in (arc[0], arc[-1]) if not _leaf(hinge, end, symbol, _BESIDE * radius)]
        found.append(np.stack([hinge, (ends or [arc[0]])[0]]))
        rest = [line for line in rest if not any(line is part for part in symbol)]
    return found + rest


def _hinge(line: Floats) -> Floats | None:
    """Return the center (2,) of a line that is the arc of a door, None of another."""
    if len(line) < 5 or np.array_equal(line[0], line[-1]):
        return None
    middle = line.mean(axis=0)
    x, y = (line - middle).T
    found, *_ = np.linalg.lstsq(np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)]), x * x + y * y, rcond=None)
    radius = np.sqrt(max(found[2] + found[0] ** 2 + found[1] ** 2, 0.0))
    away = np.hypot(x - found[0], y - found[1])
    if radius == 0.0 or np.abs(away - radius).max() > _ROUND * radius:
        return None
    angle = np.unwrap(np.arctan2(y - found[1], x - found[0]))
    return middle + found[:2] if _SWEEP[0] < abs(angle[-1] - angle[0]) < _SWEEP[1] else None


def _leaf(hinge: Floats, end: Floats, parts: Sequence[Floats], beside: float) -> bool:
    """Return whether a leaf is drawn from the hinge to an end of the arc."""
    radius = shapely.LineString([hinge, end])
    long = [part for part in map(shapely.LineString, parts) if part.length > 0.5 * radius.length]
    return any(shapely.buffer(radius, beside).covers(part) for part in long)
