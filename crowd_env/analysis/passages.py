"""The narrowest passages on the ways out: the widest body that still gets from where people start to an exit.

The distance to the walls is a landscape: between two rooms the best way leads over the pass between two peaks, and that
pass is the middle of the door.  Nodes of a grid are flooded from the peaks down (a watershed); where two basins meet is a
pass, and all passes together are a tree that holds a way of greatest width between any two places (a maximum spanning
tree: Hu, Operations Research 9, 1961).  What the grid has found is made exact on the walls.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.analysis.terrain import Terrain
from crowd_env.core.arrays.state import Floats, Ints, segment_lengths
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields import grid

_SHARE = 0.05  # of the people; a niche in which fewer start is not what the others have to pass
_NEAR = 0.75  # spacings; a node lies at most so far beside the middle of a passage
_REFINED = 3000  # passes at most
_ROUNDS, _CLOSE = 30, 1e-9  # m; of following walls to where they are nearest to each other
_SAME = 0.5e-9  # m; halves of widths that differ by less are equal but for rounding

Way = tuple[Ints, Floats]
"""For each basin the pass that is the narrowest on its way to an exit (-1 = no way), and half the width there [m]."""


class Gap(NamedTuple):
    """The narrowest line across a passage."""

    width: float  # m
    line: Floats  # (2, 2)  m   its ends on the walls


class Passage(NamedTuple):
    """The narrowest passage on the way to an exit."""

    exit: str
    gap: Gap
    is_exit: bool  # it is the exit itself
    behind: float  # share of the people with a way to this exit that pass here, or where it is narrower
    tighter: Gap | None = None  # the narrowest of all, if only a few have to pass there
    few: float = 0.0  # share of these few


def narrowest_passages(geometry: Geometry, terrain: Terrain, starts: Floats) -> dict[str, Passage | None]:
    """Return the narrowest passage to each exit; None without a way there from any start.

    Parameters
    ----------
    starts : (rows, cols) how many people start at each node of the terrain; any measure will do.
    """
    walls, _ = geometry.walls_when(())
    basins, passes = int(terrain.basin.max(initial=-1)) + 1, len(terrain.passes)
    free = terrain.basin >= 0
    people: Floats = np.bincount(terrain.basin[free], weights=starts[free], minlength=basins).astype(np.float64)
    neighbors = _neighbors(terrain.passes, basins)
    # Openings of exits are passes too, after the terrain's, and then seams; of equally wide passes they are the narrowest.
    goals: dict[str, list[tuple[int, int]]] = {name: [] for name in geometry.exit_names}
    gaps: dict[int, Gap] = {}
    for k, (name, rows) in enumerate(geometry.openings(), passes):
        goal, gaps[k] = _goal(walls, terrain, geometry.exits[rows])
        goals[name].append((goal, k))
    stop = passes + len(gaps)
    for k, lines in enumerate(_seams(geometry), stop):
        (one, gaps[k]), (other, _) = (_goal(walls, terrain, line[None]) for line in lines)
        if min(one, other) >= 0:
            neighbors[one].append((k, other))
            neighbors[other].append((k, one))
    half = np.append(
        terrain.clearance.ravel()[terrain.passes[:, 2]], [0.5 * own.width - _SAME for own in gaps.values()]
    )
    # First as the grid has it; what could be the narrowest is made exact, until nothing that could be is left.
    seen = np.arange(len(half)) >= passes
    while True:
        found = [_critical(*_ways(goal, neighbors, half), people)[1] for goal in goals.values()]
        most = max((width for width in found if np.isfinite(width)), default=0.0) + _NEAR * terrain.spacing
        near = np.flatnonzero(~seen & (half <= most))
        near = near[np.argsort(half[near], kind="stable")][: _REFINED - int(seen[:passes].sum())]
        if not len(near):
            break
        for k in near.tolist():
            gap = gap_at(walls, terrain.at(int(terrain.passes[k, 2])), half[k], _NEAR * terrain.spacing)
            half[k] = np.inf if gap is None else 0.5 * gap.width  # walls that only converge are no passage
            if gap is not None:
                gaps[k] = gap
        seen[near] = True
    half[~seen] = np.inf  # wider than the narrowest, or too many
    return {
        name: _passage(name, range(passes, stop), _ways(goal, neighbors, half), gaps, people)
        for name, goal in goals.items()
    }


def _seams(geometry: Geometry) -> list[Floats]:
    """Return the lines (2, 2, 2) of each seam in the layout."""
    building = geometry.building
    return [] if building is None else [building.lines[building.seam == k] for k in range(len(building.seams))]


def _goal(walls: Floats, terrain: Terrain, lines: Floats) -> tuple[int, Gap]:
    """Return the basin in front of an opening of ``lines`` (K, 2, 2) (-1 = none), and how wide it is between walls."""
    along = np.linspace(0.0, 1.0, 33)[:, None]
    points = np.concatenate([a + along * (b - a) for a, b in lines])
    away = distances(points, walls)
    best = int(np.argmax(away))
    lengths = segment_lengths(lines)
    whole = Gap(float(lengths.sum()), lines[int(np.argmax(lengths))])
    if (np.unique(lines.reshape(-1, 2), axis=0, return_counts=True)[1] > 1).all():
        own = whole  # all around an area that people walk into
    elif len(lines) > 1:  # round a corner
        own = gap_at(walls, points[best], float(away[best]), 0.0) or whole
    else:  # less wide than it is long only if something stands right before it
        own = across(walls, points[best])
    own = own if own.width < whole.width - 1e-6 else whole
    shape = terrain.clearance.shape
    reach = 1.5 * terrain.spacing
    near = grid.capped_distance(lines - terrain.origin, shape, np.zeros(2), terrain.spacing, 2 * reach) < reach
    nodes = np.flatnonzero(near.ravel() & (terrain.basin.ravel() >= 0))
    if not len(nodes):
        return -1, own
    return int(terrain.basin.ravel()[nodes[np.argmax(terrain.clearance.ravel()[nodes])]]), own


def _neighbors(passes: Ints, basins: int) -> list[list[tuple[int, int]]]:
    """Return for each basin the passes out of it, and the basins that they lead to."""
    found: list[list[tuple[int, int]]] = [[] for _ in range(basins)]
    for k, (a, b, _) in enumerate(passes.tolist()):
        found[a].append((k, b))
        found[b].append((k, a))
    return found


def _ways(goals: Iterable[tuple[int, int]], neighbors: Sequence[Sequence[tuple[int, int]]], half: Floats) -> Way:
    """Return for each basin the narrowest pass on its widest way to one of ``goals``, and half its width; -1 = no way.

    A goal is a basin (-1 = none) and the pass that it starts with.
    """
    narrowest, value = np.full(len(neighbors), -1, dtype=np.int64), np.full(len(neighbors), -1.0)
    stack: list[int] = []
    for goal, own in goals:
        if goal >= 0 and half[own] > value[goal]:
            narrowest[goal], value[goal] = own, half[own]
            stack.append(goal)
    while stack:
        here = stack.pop()
        for k, there in neighbors[here]:
            passed = half[k] < value[here]
            reached = half[k] if passed else value[here]
            if reached > value[there]:
                narrowest[there], value[there] = k if passed else narrowest[here], reached
                stack.append(there)
    return narrowest, value


def _critical(narrowest: Ints, value: Floats, people: Floats) -> tuple[int, float, float]:
    """Return the pass that enough people have no way around, half its width, and their share; inf if there is none."""
    rows = np.flatnonzero((value >= 0) & (people > 0))
    if not len(rows):
        return -1, np.nan, 0.0
    rows = rows[np.argsort(value[rows], kind="stable")]
    most = people[rows].sum()
    k = int(np.searchsorted(np.cumsum(people[rows]) / most, _SHARE))
    width = float(value[rows[k]])
    return int(narrowest[rows[k]]), width, float(people[rows][value[rows] <= width + _SAME].sum() / most)


def _passage(name: str, openings: range, way: Way, gaps: dict[int, Gap], people: Floats) -> Passage | None:
    narrowest, value = way
    found, width, behind = _critical(narrowest, value, people)
    if np.isnan(width):
        return None
    passage = Passage(name, gaps[found], found in openings, behind)
    rows = np.flatnonzero((value >= 0) & (people > 0))
    tightest = int(rows[np.argmin(value[rows])])
    least = int(narrowest[tightest])
    if gaps[least].width < passage.gap.width - 1e-9:
        few = value[rows] < 0.5 * passage.gap.width - 1e-9
        passage = passage._replace(tighter=gaps[least], few=float(people[rows][few].sum() / people[rows].sum()))
    return passage


# ------------------------------------------------------------------------- how wide it is, measured on the walls


def distances(points: Floats, segments: Floats) -> Floats:
    """Return the distance (K,) of points (K, 2) to the nearest of ``segments`` (W, 2, 2) [m]; inf without any."""
    return np.array([np.hypot(*(_nearest(point, segments) - point).T).min(initial=np.inf) for point in points])


def _nearest(point: Floats, segments: Floats) -> Floats:
    """Return the point (W, 2) of each segment that is nearest to ``point`` (2,)."""
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    s = np.clip(((point - a) * along).sum(axis=1) / square, 0.0, 1.0)
    return a + s[:, None] * along


def gap_at(walls: Floats, at: Floats, half: float, reach: float) -> Gap | None:
    """Return the gap whose middle lies near ``at`` (2,), where the nearest wall is ``half`` [m] away.

    From both sides the walls are followed to where they are nearest to each other.  None if that leads further away than
    ``reach`` allows (half the width of the gap is at most ``half + reach``), for example into a corner.
    """
    walls = _within(walls, at, 3.0 * (half + reach) + 1e-6)
    if not len(walls):
        return None
    middle, gap = at, Gap(0.0, np.stack([at, at]))
    for _ in range(_ROUNDS):
        points = _nearest(middle, walls)
        away = points - middle
        length = np.hypot(*away.T)
        near = int(np.argmin(length))
        opposite = np.where(away @ away[near] < 0, length, np.inf)
        far = int(np.argmin(opposite))
        if not np.isfinite(opposite[far]):
            return None
        a, b = points[near], points[far]
        for _ in range(_ROUNDS):
            b = _nearest(a, walls[far : far + 1])[0]
            a = _nearest(b, walls[near : near + 1])[0]
        gap = Gap(float(np.hypot(*(b - a))), np.stack([a, b]))
        moved = float(np.hypot(*(0.5 * (a + b) - middle)))
        middle = 0.5 * (a + b)
        if moved < _CLOSE:
            break
    clear = float(np.hypot(*(_nearest(middle, walls) - middle).T).min())
    is_gap = abs(2.0 * clear - gap.width) < 1e-6 and gap.width > 0.0
    return gap if is_gap and 2.0 * half - 1e-6 <= gap.width <= 2.0 * (half + reach) + 1e-6 else None


def _within(walls: Floats, at: Floats, reach: float) -> Floats:
    """Return the walls whose box comes within ``reach`` of a point."""
    near = (walls.min(axis=1) <= at + reach) & (walls.max(axis=1) >= at - reach)
    return walls[near.all(axis=1)]


def across(walls: Floats, at: Floats) -> Gap:
    """Return the line through ``at`` (2,) from the nearest wall to as far on the other side."""
    if not len(walls):
        return Gap(np.inf, np.stack([at, at]))
    points = _nearest(at, walls)
    a = points[int(np.argmin(np.hypot(*(points - at).T)))]
    return Gap(2.0 * float(np.hypot(*(a - at))), np.stack([a, 2.0 * at - a]))
