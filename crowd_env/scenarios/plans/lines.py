"""Areas from the lines of a drawing: closed ones, and ends that nearly meet."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.parsing import place

GAP = 0.01  # m; ends nearer to each other, or to another line, were meant to meet
_PAST = 1e-4  # share of the gap by which an end is moved beyond the line that it was meant to meet, so that they cross


class Enclosed(NamedTuple):
    """The areas that lines enclose, and the lines left over."""

    areas: list[Polygon]
    open: list[LineString]
    closed_gap: float  # the largest gap that was closed, in units of the lines; 0 = none


def enclosed(lines: Sequence[Floats], gap: float) -> Enclosed:
    """Return the areas that lines (K, 2) each enclose, one by one or together, if gaps up to ``gap`` are closed.

    An area inside another is returned beside it, not cut out of it.
    """
    areas, chains, widest = [], [], 0.0
    for line in lines:
        line = line[np.r_[True, np.hypot(*np.diff(line, axis=0).T) > 0]]
        apart = float(np.hypot(*(line[-1] - line[0])))
        if len(line) > 3 and apart <= gap:
            widest = max(widest, apart)
            areas.append(Polygon(line if apart > 0 else line[:-1]))
        elif len(line) > 1:
            chains.append(line)
    if not chains:
        return Enclosed(areas, [], widest)
    met, moved = _meeting(chains, gap)
    faces, cuts, dangles, _ = shapely.polygonize_full([shapely.union_all(met)])
    left = shapely.line_merge(shapely.union_all([*shapely.get_parts(cuts), *shapely.get_parts(dangles)]))
    rest = [part for part in shapely.get_parts(left) if part.length > gap]
    areas += [Polygon(face.exterior) for face in shapely.get_parts(faces)]
    return Enclosed(areas, rest, max(widest, moved))


def _meeting(chains: Sequence[Floats], gap: float) -> tuple[list[LineString], float]:
    """Return the lines with ends moved onto each other, or over another line, and how far the furthest was moved."""
    ends = np.array([chain[k] for chain in chains for k in (0, -1)])
    _, of, count = np.unique(np.round(ends / (_PAST * gap)), axis=0, return_inverse=True, return_counts=True)
    lines, moved = shapely.STRtree([LineString(chain) for chain in chains]), 0.0
    for number in np.flatnonzero(count[of.ravel()] == 1)[::-1].tolist():  # others meet already
        own, last = divmod(number, 2)
        end, inward = ends[number], chains[own][-2 if last else 1]
        near = lines.query(shapely.Point(end), predicate="dwithin", distance=gap)
        others = [chains[k] for k in near if k != own]
        if not others:
            continue
        corners = np.concatenate([other[[0, -1]] for other in others])
        away = np.hypot(*(corners - end).T)
        to_end = corners[np.argmin(away)] if away.min() <= gap else None
        target = _beyond(end, inward, LineString(others[0]), gap) if to_end is None else to_end
        moved = max(moved, float(np.hypot(*(target - end))))
        chains[own][-last] = target
    met = [LineString(chain) for chain in chains if np.ptp(chain, axis=0).any()]
    return met, moved if moved > 1e-3 * gap else 0.0


def _beyond(end: Floats, inward: Floats, other: LineString, gap: float) -> Floats:
    """Return a place a hair beyond ``other`` for an end (2,), so that the lines cross and do not only nearly touch."""
    onto = shapely.get_coordinates(shapely.shortest_line(shapely.Point(end), other))[1]
    step = onto - end if np.hypot(*(onto - end)) > _PAST * gap else end - inward
    return onto + (_PAST * gap / float(np.hypot(*step))) * step


def open_line(line: BaseGeometry, meters: float) -> str:
    """Return, for a message, where a line that encloses nothing is open."""
    points = shapely.get_coordinates(line)
    apart = meters * float(np.hypot(*(points[-1] - points[0])))
    return f"its ends {place(points[0])} and {place(points[-1])} are {apart:.3g} m apart"
