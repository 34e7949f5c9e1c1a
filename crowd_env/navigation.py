"""The way out: travel-time fields by fast marching, made for the centre of a disc that keeps off the walls.

The walls are dilated by a body radius, so that the shortest path never leads into a concave corner or a gap that is too
narrow; scikit-fmm solves ``|grad T| = 1`` on what is left.  People may still stand closer to a wall than that (they are
pushed, or are smaller): there the field is extended along straight lines to the dilated area.
"""

import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import skfmm
from numpy.typing import NDArray

from crowd_env import navigation_grid as grid
from crowd_env.geometry import Boundary, Geometry
from crowd_env.navigation_lookup import FieldArrays, direction_at, exit_target, travel_time_at

__all__ = [
    "FieldArrays",
    "NavigationField",
    "direction_at",
    "exit_target",
    "join_fields",
    "travel_time_at",
    "travel_time_field",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_SPACING = 0.05  # m
_NODES = 4e5  # a big plan gets a coarser grid than _SPACING above this
_FINEST = 0.01  # m; narrow passages are looked for down to this spacing ...
_MAX_FINE_NODES = 1.6e6  # ... and up to this many nodes
_MAX_NODES = 3e7
_SOURCE = 1.5  # spacings; nodes this near to an exit start the march
_TOUCH = 1e-7  # m


@dataclass(frozen=True, eq=False)
class NavigationField:
    """The way out from every node of a grid; node [i, j] lies at ``origin + spacing * (j, i)``.

    Attributes
    ----------
    travel_time
        (rows, cols) travel time at 1 m/s [s], i.e. length of the path of the centre [m]; nan outside of the area.
    direction
        (rows, cols, 2) unit vector along the shortest path; 0 outside.
    direct
        (rows, cols) row of ``Geometry.exits`` that is reached in a straight line; -1 = none.
    cell
        (rows, cols) how to look up in the cell right of and above the node: row of the exit that all its corners are
        direct to, or the codes `BLEND`, `ALONE` of `crowd_env.navigation_lookup`.
    origin
        (2,) place of node [0, 0] [m].
    spacing
        Distance between nodes [m].
    radius
        Radius of the disc that the field is made for [m].
    """

    travel_time: Floats
    direction: Floats
    direct: Ints
    cell: Ints
    origin: Floats
    spacing: float
    radius: float


class _Grid(NamedTuple):
    """The walkable nodes at one spacing, and how far each is from the walls."""

    origin: Floats  # (2,)  m
    spacing: float  # m
    inside: Bools  # (rows, cols)
    clearance: Floats  # (rows, cols)  m   capped above every radius in question


class _Plan(NamedTuple):
    """What a field is made for; exits that are not used are walls."""

    geometry: Geometry
    walls: Floats  # (W, 2, 2)  m
    exits: Floats  # (X, 2, 2)  m   those used
    rows: Ints  # (X,)  their rows in Geometry.exits
    names: list[str]  # (X,)
    widest: dict[str, float]  # m   the widest segment of each exit
    radius: float  # m
    min_radius: float  # m


def travel_time_field(
    geometry: Geometry,
    radius: float,
    *,
    exits: Iterable[str] | None = None,
    spacing: float | None = None,
    min_radius: float | None = None,
) -> NavigationField:
    """Return the field that leads discs to the nearest of the exits.

    Parameters
    ----------
    geometry
        The place.
    radius
        Radius of the body [m] by which the walls are dilated.
    exits
        Names of the exits to lead to; all by default.  The others count as walls.
    spacing
        Distance between the nodes of the grid [m]; by default 0.05 m, more for big plans, at most ``min_radius / 2``.
        It is halved (down to 0.01 m) where a passage would be missed otherwise.
    min_radius
        Radius of the smallest body [m], ``radius`` by default.  Where only smaller bodies get through, the field is made
        for the largest radius that does, with a warning.

    Raises
    ------
    ValueError
        If an exit is unknown or too narrow for the smallest body, or a part of the area cannot reach any exit.
    """
    plan = _plan(geometry, radius, exits, radius if min_radius is None else min_radius)
    nodes, used, reached = _dilate(plan, _spacing(plan, spacing))
    if used < radius - nodes.spacing:
        warnings.warn(
            f"the way out is too narrow for a body of radius {radius:g} m: the field is made for {used:.3g} m, "
            "larger people will squeeze",
            stacklevel=2,
        )
    return _solve(plan, nodes, used, reached)


def join_fields(fields: Sequence[NavigationField | None], boundary: Boundary) -> FieldArrays:
    """Return the fields of the geometries of ``boundary`` one behind the other; None = no field there.

    Raises
    ------
    ValueError
        If there is not one entry per geometry.
    """
    count = len(boundary.exit_start) - 1
    if len(fields) != count:
        raise ValueError(f"{len(fields)} fields for {count} geometries; give one (or None) for each")
    made = [(field, boundary.exit_start[g]) for g, field in enumerate(fields) if field is not None]
    shapes = [(0, 0) if field is None else field.travel_time.shape for field in fields]
    sizes = [rows * cols for rows, cols in shapes]
    return FieldArrays(
        node_start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        shape=np.array(shapes, dtype=np.int64).reshape(-1, 2),
        origin=np.array([(0.0, 0.0) if f is None else f.origin for f in fields], dtype=np.float64).reshape(-1, 2),
        spacing=np.array([1.0 if f is None else f.spacing for f in fields], dtype=np.float64),
        travel_time=np.concatenate([np.empty(0), *(f.travel_time.ravel() for f, _ in made)]),
        direction=np.concatenate([np.empty((0, 2)), *(f.direction.reshape(-1, 2) for f, _ in made)]),
        direct=np.concatenate([np.empty(0, dtype=np.int64), *(_offset(f.direct, first) for f, first in made)]),
        cell=np.concatenate([np.empty(0, dtype=np.int64), *(_offset(f.cell, first) for f, first in made)]),
    )


def _offset(exits: Ints, first: int) -> Ints:
    """Return rows of exits of one geometry as rows of the batch, flat; negative codes stay."""
    return np.where(exits >= 0, exits + first, exits).ravel()


def _plan(geometry: Geometry, radius: float, exits: Iterable[str] | None, min_radius: float) -> _Plan:
    if not 0 < min_radius <= radius < np.inf:
        raise ValueError(f"radius {radius:g} m and min_radius {min_radius:g} m must satisfy 0 < min_radius <= radius")
    known = list(dict.fromkeys(geometry.exit_names))
    if not known:
        raise ValueError("the geometry has no exit to lead to")
    wanted = known if exits is None else [exits] if isinstance(exits, str) else list(exits)
    unknown = [name for name in wanted if name not in known]
    if unknown or not wanted:
        raise ValueError(f"exits {unknown or wanted} are not among those of the geometry; choose from {known}")
    use = np.array([name in wanted for name in geometry.exit_names])
    segments = geometry.exits[use]
    names = [name for name in geometry.exit_names if name in wanted]
    widths = np.hypot(*(segments[:, 1] - segments[:, 0]).T)
    widest = {name: max(float(w) for w, n in zip(widths, names, strict=True) if n == name) for name in wanted}
    for name, width in widest.items():
        if width < 2 * min_radius - _TOUCH:
            raise ValueError(
                f"exit {name!r} is {width:.2f} m wide, narrower than the smallest body ({2 * min_radius:.2f} m)"
            )
    walls = np.concatenate([geometry.walls, geometry.exits[~use]])
    return _Plan(geometry, walls, segments, np.flatnonzero(use), names, widest, radius, min_radius)


def _nodes(geometry: Geometry, spacing: float) -> tuple[int, int]:
    x0, y0, x1, y1 = geometry.bounds
    rows, cols = (max(int(np.ceil(length / spacing - 1e-9)) + 1, 2) for length in (y1 - y0, x1 - x0))
    return rows, cols


def _spacing(plan: _Plan, spacing: float | None) -> float:
    x0, y0, x1, y1 = plan.geometry.bounds
    largest = plan.min_radius / 2
    if spacing is None:
        spacing = min(max(_SPACING, float(np.sqrt((x1 - x0) * (y1 - y0) / _NODES))), largest)
    elif not 0 < spacing <= largest * (1 + 1e-9):
        raise ValueError(
            f"spacing is {spacing:g} m; it must be positive and at most half the smallest radius, {largest:g} m"
        )
    if np.prod([float(n) for n in _nodes(plan.geometry, spacing)]) > _MAX_NODES:
        raise ValueError(
            f"a plan of {x1 - x0:.0f} m x {y1 - y0:.0f} m with bodies of {plan.min_radius:g} m needs more than "
            f"{_MAX_NODES:.0e} nodes; check that its coordinates are in metres"
        )
    return spacing


def _make_grid(plan: _Plan, spacing: float) -> _Grid:
    geometry = plan.geometry
    rows, cols = _nodes(geometry, spacing)
    origin = np.array(geometry.bounds[:2])
    x, y = np.meshgrid(origin[0] + spacing * np.arange(cols), origin[1] + spacing * np.arange(rows))

    def distance(segments: Floats, cap: float) -> Floats:
        return np.asarray(grid.capped_distance(segments, rows, cols, origin, spacing, cap))

    inside = geometry.contains(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(rows, cols)
    border = np.concatenate([geometry.walls[~geometry.two_sided], geometry.exits])
    inside |= distance(border, 2 * _TOUCH) < _TOUCH  # nodes on the border, whichever way they were rounded
    inside &= distance(geometry.walls[geometry.two_sided], 2 * _TOUCH) > _TOUCH  # a node on a thin wall has no side
    return _Grid(origin, spacing, inside, distance(plan.walls, plan.radius + 2 * spacing))


def _attempts(plan: _Plan, spacing: float) -> Iterator[tuple[float, float]]:
    """Yield (dilation, spacing) in the order of preference: the full radius on finer grids, then smaller radii."""
    fine = spacing
    while (
        fine / 2 >= _FINEST - 1e-9 and np.prod([float(n) for n in _nodes(plan.geometry, fine / 2)]) <= _MAX_FINE_NODES
    ):
        fine /= 2
    finer = [spacing / 2**n for n in range(20) if spacing / 2**n >= fine * (1 - 1e-9)]
    fits = min(plan.widest.values()) / 2 + _TOUCH
    # A passage of exactly the width of the body has no node in it, unless one happens to lie on its axis: allow for it.
    for radius in (plan.radius, plan.radius - fine / 2):
        if radius <= fits:
            yield from ((radius, h) for h in (finer if radius == plan.radius else [fine]))
    for radius in np.linspace(plan.radius, plan.min_radius, 5)[1:]:
        if plan.min_radius < plan.radius and radius <= fits:
            yield from ((float(radius), h) for h in finer[:2])
    if plan.min_radius < plan.radius:
        yield from ((plan.min_radius, h) for h in finer[2:])
        yield plan.min_radius - fine / 2, fine


def _dilate(plan: _Plan, spacing: float) -> tuple[_Grid, float, Bools]:
    """Return the grid, the dilation [m] at which all of the area reaches an exit, and the nodes that do."""
    nodes: _Grid | None = None
    problem = ""
    for radius, h in _attempts(plan, spacing):
        if nodes is None or nodes.spacing != h:
            nodes = _make_grid(plan, h)
        free = nodes.inside & (nodes.clearance >= radius - _TOUCH)
        seeds = np.zeros_like(free)
        closed = set(plan.widest)
        for segment, name in zip(plan.exits, plan.names, strict=True):
            near = free & (_source_distance(segment[None], nodes, radius) < _SOURCE * h)
            seeds |= near
            if near.any():
                closed.discard(name)
        label = np.asarray(grid.connected_parts(free, seeds))
        lost = _lost_part(label, nodes, plan.min_radius)
        if not closed and lost is None:
            return nodes, radius, label == 1
        if closed:
            problem = f"the way to exit {sorted(closed)[0]!r} is blocked right in front of it"
        else:
            problem = f"no exit can be reached from ({lost[0]:.2f}, {lost[1]:.2f})"  # type: ignore[index]
    raise ValueError(
        f"{problem} for a body of diameter {2 * plan.min_radius:.2f} m; widen the passage or open an exit there"
    )


def _lost_part(label: Ints, nodes: _Grid, min_radius: float) -> tuple[float, float] | None:
    """Return the most open place [m] of the largest part that reaches no exit; None if it is smaller than a body."""
    sizes = np.bincount(label.ravel())
    sizes[:2] = 0
    largest = int(np.argmax(sizes))
    if sizes[largest] * nodes.spacing**2 < np.pi * min_radius**2:
        return None
    i, j = np.unravel_index(np.argmax(np.where(label == largest, nodes.clearance, -1.0)), label.shape)
    return float(nodes.origin[0] + j * nodes.spacing), float(nodes.origin[1] + i * nodes.spacing)


def _source_distance(exits: Floats, nodes: _Grid, radius: float, cap: float | None = None) -> Floats:
    """Return the distance [m] of every node to the nearest exit, each shrunk by ``radius`` at both ends (or ``cap``)."""
    along = exits[:, 1] - exits[:, 0]
    width = np.hypot(*along.T)[:, None]
    cut = along / width * np.minimum(radius, width / 2)
    shrunk = np.stack([exits[:, 0] + cut, exits[:, 1] - cut], axis=1)
    rows, cols = nodes.inside.shape
    cap = 2 * _SOURCE * nodes.spacing if cap is None else cap
    return np.asarray(grid.capped_distance(shrunk, rows, cols, nodes.origin, nodes.spacing, cap))


def _solve(plan: _Plan, nodes: _Grid, radius: float, reached: Bools) -> NavigationField:
    """March through the free nodes, extend to all walkable ones, and find directions and straight lines."""
    h = nodes.spacing
    rows, cols = reached.shape
    # Half a spacing of fringe, so that the ragged edge of the nodes lies at the radius on average, not beyond it.
    free = grid.with_fringe(reached, nodes.inside & (nodes.clearance >= radius - h / 2))
    distance = _source_distance(plan.exits, nodes, radius, cap=4 * _SOURCE * h)
    seeds = free & (distance < _SOURCE * h)
    time = np.where(seeds, distance, np.nan)
    if (free & ~seeds).any():
        level = np.ma.MaskedArray(distance - _SOURCE * h, ~free)
        marched = skfmm.travel_time(level, np.ones((rows, cols)), dx=h, order=2)
        far = free & ~seeds & ~np.ma.getmaskarray(marched)
        time[far] = np.ma.getdata(marched)[far] + _SOURCE * h
    direction = grid.descend(time, h)
    lean = radius
    while grid.extend_once(time, direction, nodes.inside, plan.walls, nodes.origin, h, radius + _SOURCE * h, lean):
        lean = 0.0  # further passes fill gaps that are narrower than the disc: straight to the better end
    _require_reached(plan, nodes, np.isnan(time))
    grid.fill_from_nearest(time, direction, nodes.inside, ~np.isnan(time), h)
    direct = grid.straight_lines(time, direction, plan.walls, plan.exits, plan.rows, nodes.origin, h, radius)
    return NavigationField(
        travel_time=time,
        direction=direction,
        direct=direct,
        cell=grid.cell_kinds(time, direct, grid.blocked_lines(plan.walls, rows, cols, nodes.origin, h)),
        origin=nodes.origin,
        spacing=h,
        radius=radius,
    )


def _require_reached(plan: _Plan, nodes: _Grid, unknown: Bools) -> None:
    """Refuse a place that the smallest body stands in but that the extension did not reach."""
    stands = unknown & nodes.inside & (nodes.clearance >= plan.min_radius - _TOUCH)
    label = grid.connected_parts(stands, np.zeros_like(stands))
    lost = _lost_part(np.asarray(label), nodes, plan.min_radius)
    if lost is not None:
        raise ValueError(f"no exit can be reached from ({lost[0]:.2f}, {lost[1]:.2f}); open an exit there")
