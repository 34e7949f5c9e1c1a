"""The border of an area as straight oriented edges, cut into walls and exits; depth behind walls, and walls at corners."""

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.core.checks import counted
from crowd_env.geometry.parsing import ROUNDED, SLIVER, Area, border_edges, place, tangents

_SAME = 1e-9  # m; a point nearer than this to a straight line is on it
_SNAP = 0.01  # m; an exit may be drawn this far from the boundary ...
_WALL = 0.3  # m; ... and is moved onto it from the other face of a wall
_NARROW = 0.3  # m; what an obstacle leaves of an exit is no opening if it is narrower


def open_boundary(area: Area, exits: Mapping[str, BaseGeometry]) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Return the walls (W, 2, 2) and exits (X, 2, 2) [m] of the border of ``area``, and the name of each exit.

    A line opens the border along it; a polygon (already cut out of ``area``) opens their common border.

    Raises
    ------
    ValueError
        If an exit is not on the border, or two of them overlap.
    """
    edges = _edges(area)
    return _cut(edges, [opening for name, shape in exits.items() for opening in _openings(edges, name, shape, area)])


class _Opening(NamedTuple):
    """A stretch of boundary edge ``edge`` from ``low`` to ``high`` [m along it] that belongs to exit ``name``."""

    edge: int
    low: float
    high: float
    name: str


def _edges(area: Area) -> Floats:
    """Return the straight edges (N, 2, 2) of all rings of ``area``, the area to their left."""
    rings = [ring for rings in rings_of(area) for ring in rings]
    return np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])


def rings_of(area: Area) -> list[list[Floats]]:
    """Return, for each polygon of ``area``, the corners (K, 2) [m] of its rings, shell first, the area to their left."""
    return [
        [_straighten(shapely.get_coordinates(ring)[:-1]) for ring in (polygon.exterior, *polygon.interiors)]
        for polygon in map(orient, shapely.get_parts(area))
    ]


def _straighten(ring: Floats) -> Floats:
    """Return the closed ring (K, 2) without doubled points and without points in the middle of a straight edge.

    A seam in a straight wall would be a corner that people catch on.
    """
    ring = ring[np.hypot(*(ring - np.roll(ring, 1, axis=0)).T) > _SAME]
    while len(ring) > 3:
        before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
        chord = before + after
        offset = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) / np.hypot(*chord.T)
        seam = (offset <= _SAME) & ((before * after).sum(axis=1) > 0)
        if not seam.any():
            break
        ring = ring[~seam]
    return ring


def _openings(edges: Floats, name: str, shape: BaseGeometry, area: Area) -> list[_Opening]:
    """Return the stretches of the boundary that exit ``name`` opens.

    Raises
    ------
    ValueError
        If a line or polygon is further from the boundary than a wall is thick.
    """
    away = float(shapely.distance(shape, area))
    if isinstance(shape, Polygon | MultiPolygon):
        border = _edges(shape)
        # Drawn inside the area or exactly at it; else a hair away from it; else behind the wall.
        for tolerance in (SLIVER, _SNAP, *((away + _SNAP,) if _SNAP < away <= _WALL else ())):
            found = [opening for segment in border for opening in _overlaps(edges, name, segment, tolerance)]
            if found:
                if tolerance > _SNAP:
                    _say_moved(name, away)
                return found
        raise ValueError(
            f"exit {name!r} does not touch the walkable area: it is {away:.3g} m away; move it to the boundary"
        )
    found = []
    for part in shapely.get_parts(shape):
        line = shapely.get_coordinates(part)
        for segment in np.stack([line[:-1], line[1:]], axis=1):
            pieces = _along(edges, name, segment)
            for moved in () if pieces else _moved_to(area, segment):
                pieces = _along(edges, name, moved)
                if pieces:
                    _say_moved(name, float(np.hypot(*(moved - segment).T).max()))
                    break
            if not pieces:
                raise ValueError(_off_boundary(edges, name, segment, area))
            found += pieces
    return found


def clear_exits(exits: Mapping[str, BaseGeometry], drawn: Area, area: Area) -> dict[str, BaseGeometry]:
    """Return the exits, their lines cut to what obstacles leave of them.

    Parameters
    ----------
    exits : name -> line or area; areas stay as they are.
    drawn : walkable area with the obstacles.
    area : the same without them.

    Raises
    ------
    ValueError
        If an obstacle thicker than a wall covers an exit all along.

    Warns
    -----
    UserWarning
        If a line is cut.
    """
    if drawn is area:
        return dict(exits)
    edges = _edges(drawn), _edges(area)
    lines = {name for name, shape in exits.items() if "Line" in shape.geom_type and shape.length > 0.0}
    return {
        name: _clear(name, shape, (drawn, area), edges)
        if name in lines and np.isfinite(shapely.get_coordinates(shape)).all()
        else shape
        for name, shape in exits.items()
    }


def _clear(name: str, shape: BaseGeometry, areas: tuple[Area, Area], edges: tuple[Floats, Floats]) -> BaseGeometry:
    """Return the line of an exit without what obstacles cover of it; as it is if it is on no border, or nothing is covered."""
    free, total, by = [], 0.0, 0.0
    for part in shapely.get_parts(shape):
        line = shapely.get_coordinates(part)
        for segment in np.stack([line[:-1], line[1:]], axis=1):
            on = next((m for m in (segment, *_moved_to(areas[0], segment)) if _along(edges[0], name, m)), None)
            if on is None:
                return shape
            by = max(by, float(np.hypot(*(on - segment).T).max()))
            total += float(np.hypot(*(on[1] - on[0])))
            rows = _overlaps(edges[1], name, on, _SNAP)
            ends = [(edges[1][row.edge], np.array([[row.low], [row.high]])) for row in rows]
            free += [shapely.LineString(a + s * (b - a) / np.hypot(*(b - a))) for (a, b), s in ends]
    pieces = shapely.get_parts(shapely.line_merge(shapely.union_all(free, grid_size=ROUNDED)))
    lost = total - float(shapely.length(pieces).sum())
    if lost <= 2 * _SNAP:
        return shape
    wide = [piece for piece in pieces if piece.length >= _NARROW]
    if not wide:
        segment = shapely.get_coordinates(shape)[[0, -1]]
        if any(_along(edges[1], name, moved) for moved in _moved_to(areas[1], segment)):
            return shape  # behind a wall that is drawn as an obstacle
        raise ValueError(
            f"exit {name!r} at {place(segment[0])}: an obstacle covers it, and leaves no opening of {_NARROW} m"
        )
    if by > _SNAP:
        _say_moved(name, by)
    widths = " and ".join(dict.fromkeys(f"{piece.length:.2f}" for piece in wide))
    left = f"{counted(len(wide), 'opening', 'openings')} of {widths} m {'is' if len(wide) == 1 else 'are'} left"
    slits = f", without {len(pieces) - len(wide)} narrower than {_NARROW} m" if len(wide) < len(pieces) else ""
    warnings.warn(f"exit {name!r}: an obstacle covers {lost:.2f} of {total:.2f} m; {left}{slits}", stacklevel=5)
    return shapely.MultiLineString(wide) if len(wide) > 1 else wide[0]


def _along(edges: Floats, name: str, segment: Floats) -> list[_Opening]:
    """Return the stretches of the boundary that ``segment`` (2, 2) runs along; none if a part of it leaves the boundary."""
    pieces = _overlaps(edges, name, segment, _SNAP)
    length = float(np.hypot(*(segment[1] - segment[0])))
    return pieces if sum(piece.high - piece.low for piece in pieces) >= length - 2 * _SNAP else []


def _moved_to(area: Area, segment: Floats) -> list[Floats]:
    """Return the places on the border that may be meant by a segment (2, 2) within the thickness of a wall."""
    border = shapely.boundary(area)
    points = np.concatenate([segment, segment.mean(axis=0)[None]])
    onto = np.array(
        [shapely.get_coordinates(shapely.shortest_line(shapely.Point(point), border))[1] for point in points]
    )
    candidates = [onto[:2], segment + (onto[2] - points[2])]  # each end by itself (not parallel), or as a whole
    length = np.hypot(*(segment[1] - segment[0]))
    return [
        moved
        for moved in candidates
        if np.hypot(*(moved - segment).T).max() <= _WALL and np.hypot(*(moved[1] - moved[0])) > 0.5 * length
    ]


def _say_moved(name: str, by: float) -> None:
    warnings.warn(
        f"exit {name!r} is drawn {by:.2f} m off the boundary of the walkable area: moved onto it", stacklevel=5
    )


def _overlaps(edges: Floats, name: str, segment: Floats, tolerance: float) -> list[_Opening]:
    """Return where ``segment`` (2, 2) runs along ``edges`` (N, 2, 2), no further than ``tolerance`` from them."""
    along, length = tangents(edges)
    relative = segment[None] - edges[:, :1]  # (N, 2 ends, 2)
    s = np.einsum("nek,nk->ne", relative, along)
    offset = relative[..., 1] * along[:, None, 0] - relative[..., 0] * along[:, None, 1]
    flip = s[:, 0] > s[:, 1]
    s[flip], offset[flip] = s[flip, ::-1], offset[flip, ::-1]
    low, high = np.clip(s[:, 0], 0, length), np.clip(s[:, 1], 0, length)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (offset[:, 1] - offset[:, 0]) / (s[:, 1] - s[:, 0])
        far = np.maximum(
            np.abs(offset[:, 0] + slope * (low - s[:, 0])), np.abs(offset[:, 0] + slope * (high - s[:, 0]))
        )
        near = (far <= tolerance) & (high - low > min(tolerance, _SNAP))
    low[low < SLIVER] = 0.0
    high = np.where(length - high < SLIVER, length, high)
    return [_Opening(int(row), float(low[row]), float(high[row]), name) for row in np.flatnonzero(near)]


def _off_boundary(edges: Floats, name: str, segment: Floats, area: Area) -> str:
    samples = segment[0] + np.linspace(0, 1, 101)[:, None] * (segment[1] - segment[0])
    away = shapely.distance(shapely.boundary(area), shapely.points(samples))
    worst = int(np.argmax(away))
    if away[worst] <= _WALL:
        return (
            f"exit {name!r} does not run along the boundary of the walkable area: from {place(segment[0])} to "
            f"{place(segment[1])} the boundary leaves its line, by {away[worst]:.3g} m at {place(samples[worst])}; draw it "
            "in the pieces that the boundary has, or as a polygon"
        )
    how, then = "is not on", f"a line must lie within {_WALL} m of it"
    if on := _overlaps(edges, name, segment, _WALL):
        row, low, high, _ = max(on, key=lambda one: one.high - one.low)
        (a, b), (length,) = edges[row], tangents(edges[[row]])[1]
        ends = (place(a + (b - a) * (s / length)) for s in (low, high))
        how, then = "reaches beyond", f"shorten it to {high - low:.3g} m, from {' to '.join(ends)}"
    return (
        f"exit {name!r} {how} the boundary of the walkable area: its point {place(samples[worst])} is "
        f"{away[worst]:.3g} m away from it; {then} (or give the exit as a polygon)"
    )


def _cut(edges: Floats, openings: list[_Opening]) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Return walls (W, 2, 2), exits (X, 2, 2) and the name of each exit: the edges, cut at the ends of the openings.

    Pieces of one exit are joined; different exits must not overlap.
    """
    walls: list[Floats] = []
    exits: list[tuple[str, Floats]] = []
    for row, (a, b) in enumerate(edges):
        length = float(np.hypot(*(b - a)))

        def at(s: float, a: Floats = a, b: Floats = b, length: float = length) -> Floats:
            return b if s == length else a + (b - a) * (s / length)  # b itself, so that neighboring edges share it

        end, last = 0.0, None
        for _, low, high, name in sorted(o for o in openings if o.edge == row):
            if low < end - SLIVER and name != last:
                raise ValueError(f"exits {last!r} and {name!r} overlap at {place(at(low))}; exits must be apart")
            if low < end + SLIVER and name == last:  # pieces of one exit
                end = max(end, high)
                exits[-1][1][1] = at(end)
                continue
            if low - end > SLIVER:
                walls.append(np.array([at(end), at(low)]))
            exits.append((name, np.array([at(low), at(high)])))
            end, last = high, name
        if length - end > SLIVER:
            walls.append(np.array([at(end), b]))
    order = {name: i for i, name in enumerate(dict.fromkeys(o.name for o in openings))}
    exits.sort(key=lambda exit_: order[exit_[0]])  # stable: rows follow the exits as they were given
    return (
        np.array(walls).reshape(-1, 2, 2),
        np.array([segment for _, segment in exits]).reshape(-1, 2, 2),
        tuple(name for name, _ in exits),
    )


def solid_depth(walls: Floats, area: Area, most: float = 0.25) -> Floats:
    """Return (W,) half the thickness [m] of the solid behind (to the right of) each wall, ``most`` at the most.

    A center that was pressed into a wall belongs to the nearer face of it.
    """
    depth = np.full(len(walls), most)
    if not len(walls):
        return depth
    along, _ = tangents(walls)
    behind = 2 * most * np.column_stack([along[:, 1], -along[:, 0]])
    a, b = walls[:, 0] + SLIVER * along, walls[:, 1] - SLIVER * along
    strips = shapely.polygons(np.stack([a, b, b + behind, a + behind], axis=1))
    # The nearest walkable part of a strip lies on the border of the area: the edges near the strip are sufficient.
    room = shapely.buffer(area, -SLIVER)
    border = shapely.linestrings(border_edges(room))
    row, edge = shapely.STRtree(border).query(strips, predicate="intersects")
    faces = shapely.linestrings(np.stack([a, b], axis=1))
    away = shapely.distance(faces[row], shapely.intersection(strips[row], border[edge]))
    np.minimum.at(depth, row, 0.5 * away)
    shapely.prepare(room)
    depth[shapely.intersects_xy(room, *a.T)] = 0.0  # a thin wall: there is nothing solid behind it
    return depth


def ends_together(ends: Floats) -> tuple[Ints, Ints]:
    """Return, as compressed rows (V+1,) and (M,), which of the ``ends`` (M, 2) [m] of walls lie at each corner."""
    if not len(ends):
        return np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int64)
    points = shapely.points(ends)
    end, twin = shapely.STRtree(points).query(points, predicate="dwithin", distance=_SAME)
    first = np.arange(len(ends))
    np.minimum.at(first, end, twin)  # an end is called by the first end at its place
    distinct, corner_of_end = np.unique(first, return_inverse=True)
    order = np.argsort(corner_of_end, kind="stable")
    return row_starts(np.bincount(corner_of_end, minlength=len(distinct))), order.astype(np.int64)
