"""The domain of a travel-time field, and the dilation of the walls at which all of it reaches an exit."""

import warnings
from collections.abc import Collection, Iterable, Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import known as require_known
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parts import NoWayOut
from crowd_env.geometry.passages import passages
from crowd_env.geometry.sheets import SEAM
from crowd_env.routing.fields import grid

_SPACING = 0.05  # m
_NODES = 4e5  # a big plan gets a coarser grid than _SPACING above this
_FINEST = 0.01  # m; narrow passages are looked for down to this spacing ...
_FINE_NODES = 1.6e6  # ... and up to this many nodes ...
_SLACK = 0.75  # spacings; ... and half as wide as this too narrow, so that four neighbors connect in any direction
_SIZES = 5  # sizes of bodies, with ways for each where larger ones do not get out
_OPEN_NODES = 1e6  # a larger place without narrow passages gets a coarser grid, of about this number of nodes ...
_COARSEST = 0.3  # m; ... or of this spacing
_MAX_NODES = 3e7
_MOST_DILATION = 0.4  # m, half a door: in the largest places
_SMALL_BODY = 0.1  # m; the grid of smaller ones is not made coarser: their passages would not be seen
SOURCE = 1.5  # spacings; nodes this near to an exit start the march
TOUCH = 1e-7  # m


class Grid(NamedTuple):
    """The walkable nodes at one spacing, and how far each is from the walls."""

    origin: Floats  # (2,)  m
    spacing: float  # m
    inside: Bools  # (rows, cols)
    clearance: Floats  # (rows, cols)  m   capped above every radius in question

    def points(self) -> Floats:
        """Return where the nodes lie (rows, cols, 2) [m]."""
        return grid.node_points(self.origin, self.spacing, self.inside.shape)


class Plan(NamedTuple):
    """The domain and goals of a field; exits that are not used are walls."""

    geometry: Geometry
    walls: Floats  # (W, 2, 2)  m
    two_sided: Bools  # (W,)
    exits: Floats  # (X, 2, 2)  m   the exits used
    rows: Ints  # (X,)  their rows in Geometry.exits
    names: list[str]  # (X,)
    widest: dict[str, float]  # m   the clear width of each exit
    radius: float  # m
    min_radius: float  # m
    partial: bool = False  # doors are closed: some people may be locked in
    goal: str | None = None  # region where the way leads instead of to exits
    one_way: bool = False  # some doors are passed one way only
    drawn: Floats | None = None  # (X, 2, 2)  m   the lines of these exits, where `exits` lie at the ends of aprons
    start: Floats | None = None  # (X,)  s   the time from each exit on, of seams to another sheet; None = 0
    spacing: float | None = None  # m   between nodes, that of other sheets; None = what suits the plan


def make_plan(
    geometry: Geometry,
    radius: float,
    exits: Iterable[str] | None,
    min_radius: float,
    goal: str | None = None,
    closed: Collection[str] = (),
    seams: bool = False,
) -> Plan:
    """Return the plan of a field that leads to the ``exits`` (names; None = all), or into the region ``goal``.

    Doors that are ``closed`` are walls; an exit behind one is no exit.  Ways lead to the ends of aprons.  Of a sheet with
    ``seams`` the way leads to the ``exits`` besides.

    Raises
    ------
    ValueError
        If a radius is impossible, a region is unknown, or an exit is unknown or narrower than the smallest body.
    """
    if not 0 < min_radius <= radius < np.inf:
        raise ValueError(f"radius {radius:g} m and min_radius {min_radius:g} m must satisfy 0 < min_radius <= radius")
    if goal is not None:
        require_known("region", goal, geometry.regions)
    wanted = open_exits(geometry, exits, closed) if goal is None else list(exits or ()) if seams else []
    use = np.isin(geometry.exit_names, wanted)
    names = [name for name in geometry.exit_names if name in wanted]
    clear = geometry.clear_widths(2 * radius)
    widest = {name: clear[name] for name in wanted}
    for name, width in widest.items():
        if width < 2 * min_radius - TOUCH:
            raise ValueError(
                f"exit {name!r} is {width:.2f} m wide, narrower than the smallest body ({2 * min_radius:.2f} m)"
            )
    drawn = geometry.exits[use] if geometry.ways_behind[use].any() else None
    geometry = geometry.with_ways_to(wanted)
    fixed, sides = geometry.walls_when(closed)
    shut = ~use & [not (seams and name.startswith(SEAM)) for name in geometry.exit_names]  # people come over the others
    walls = np.concatenate([fixed, geometry.exits[shut]])
    two_sided = np.concatenate([sides, np.zeros(int(shut.sum()), dtype=bool)])
    rows = np.flatnonzero(use)
    lines, partial = geometry.exits[use], bool(closed)
    return Plan(geometry, walls, two_sided, lines, rows, names, widest, radius, min_radius, partial, goal, drawn=drawn)


def open_exits(geometry: Geometry, exits: Iterable[str] | None, closed: Collection[str]) -> list[str]:
    """Return the names of the ``exits`` (None = all) that no ``closed`` door shuts.

    Raises
    ------
    ValueError
        If there is none, or a name is unknown.
    """
    known = list(dict.fromkeys(geometry.exit_names))
    if not known:
        raise ValueError("the geometry has no exit to lead to")
    wanted = known if exits is None else [exits] if isinstance(exits, str) else list(exits)
    unknown = [name for name in wanted if name not in known]
    if unknown or not wanted:
        raise ValueError(f"exits {unknown or wanted} are not among those of the geometry; choose from {known}")
    shut = {e for name, e in zip(geometry.doors, geometry.exits_of_door, strict=True) if name in closed}
    wanted = [name for name in wanted if name not in shut]
    if not wanted:
        raise ValueError(f"all exits that the way may lead to are closed: {', '.join(sorted(filter(None, shut)))}")
    return wanted


def _nodes(geometry: Geometry, spacing: float) -> tuple[int, int]:
    x0, y0, x1, y1 = geometry.bounds
    rows, cols = (max(int(np.ceil(length / spacing - 1e-9)) + 1, 2) for length in (y1 - y0, x1 - x0))
    return rows, cols


def _finest(geometry: Geometry, wanted: float) -> float:
    """Return the smallest distance between nodes [m], not below ``wanted``, with which the box of a place holds few enough."""
    while np.prod([float(n) for n in _nodes(geometry, wanted)]) > _MAX_NODES:
        x0, y0, x1, y1 = geometry.bounds
        wanted = max(1.001 * wanted, float(np.sqrt((x1 - x0) * (y1 - y0) / _MAX_NODES)))
    return wanted


def require_grid(geometry: Geometry, min_radius: float) -> None:
    """Raise ValueError, before anything is allocated, if a place is too large for a grid that resolves ways for such bodies.

    Nodes lie no further apart than half the dilation of the walls, so that no way leads across a thin wall.  In a place too
    large for this number of nodes, walls are dilated by more than a body.  The dilation always leaves a door of 0.8 m
    passable.
    """
    x0, y0, x1, y1 = geometry.bounds
    spacing = _finest(geometry, min_radius / 2)
    if 2 * spacing > max(_MOST_DILATION, min_radius):
        raise ValueError(
            f"a plan of {x1 - x0:.0f} m x {y1 - y0:.0f} m needs more than {_MAX_NODES:.0e} nodes; check that its "
            "coordinates are in meters, or take a part of it"
        )
    if spacing > min_radius / 2 and min_radius < _SMALL_BODY:
        raise ValueError(
            f"bodies of radius {min_radius:g} m in a plan of {x1 - x0:.1f} m x {y1 - y0:.1f} m need more than "
            f"{_MAX_NODES:.0e} nodes; take larger bodies or a smaller plan"
        )


def choose_spacing(plan: Plan) -> float:
    """Return the distance between nodes [m] that suits the plan.

    Raises
    ------
    ValueError
        If the plan needs too many nodes.

    Warns
    -----
    UserWarning
        If the plan is so large that ways keep further from walls than a body needs.
    """
    if plan.spacing is not None:
        return plan.spacing
    x0, y0, x1, y1 = plan.geometry.bounds
    largest = plan.min_radius / 2
    require_grid(plan.geometry, plan.min_radius)
    spacing = min(max(_SPACING, float(np.sqrt((x1 - x0) * (y1 - y0) / _NODES))), largest)
    finest = _finest(plan.geometry, spacing)
    if finest > largest * (1 + 1e-9) and next(_coarse(plan, finest), None) is None:
        warnings.warn(
            f"the plan is {x1 - x0:.0f} m x {y1 - y0:.0f} m: ways are looked for on a grid of {finest:.3f} m, and only through "
            f"passages wider than {4 * finest:.2f} m",
            stacklevel=3,
        )
    return finest


def _coarse(plan: Plan, spacing: float) -> Iterator[float]:
    """Yield a distance between nodes [m] that is greater by a quarter or more, if it shows all passages of a large place."""
    x0, y0, x1, y1 = plan.geometry.bounds
    wanted = min(_COARSEST, float(np.sqrt((x1 - x0) * (y1 - y0) / _OPEN_NODES)))
    if plan.one_way or wanted < 1.25 * spacing:
        return
    room = 2.0 * (2.0 + _SLACK)  # spacings in a passage: walls are dilated by two, and four neighbors connect
    least = 2.0 * (plan.min_radius - _SLACK * spacing)  # narrower passages are closed to all bodies
    widths = passages(plan.geometry, plan.walls, least, room * wanted).tolist()
    coarse = min([wanted, *(width / room for width in (*widths, *plan.widest.values()))])
    if coarse >= 1.25 * spacing:
        yield coarse


def _make_grid(plan: Plan, spacing: float) -> Grid:
    geometry = plan.geometry
    shape, origin = _nodes(geometry, spacing), np.array(geometry.bounds[:2])

    def distance(segments: Floats, cap: float) -> Floats:
        return grid.capped_distance(segments, shape, origin, spacing, cap)

    inside = geometry.contains(grid.node_points(origin, spacing, shape))
    border = np.concatenate([geometry.walls[~geometry.two_sided], geometry.exits])
    inside |= distance(border, 2 * TOUCH) < TOUCH  # nodes on the border, whichever way they were rounded
    inside &= distance(plan.walls[plan.two_sided], 2 * TOUCH) > TOUCH  # a node on a thin wall has no side
    return Grid(origin, spacing, inside, distance(plan.walls, plan.radius + 2 * spacing))


class Dilation(NamedTuple):
    """The walls dilated for bodies of one size: the nodes from which these get out, and smaller ones."""

    radius: float  # m, of the body
    depth: float  # m, by which the walls are dilated
    reached: Bools  # (rows, cols)  where the center may be, the nodes of larger bodies included
    parts: Ints  # (rows, cols)  1 = reached, 2, 3 ... = parts that are not, 0 = too near to a wall
    closed: set[str]  # exits that such a body cannot pass


def _dilations(plan: Plan, nodes: Grid, spacing: float) -> Iterator[Dilation]:
    """Yield a dilation for each size of body, the largest first: a smaller body may go wherever a larger one goes."""
    least = max(plan.min_radius, 2 * spacing)  # nodes on both sides of a thin wall must be no neighbors
    sizes = np.linspace(max(plan.radius, least), least, _SIZES if least < plan.radius else 1).tolist()
    before = np.zeros_like(nodes.inside)
    depths = [(body, body) for body in sizes]
    if next(_finer(plan, nodes.spacing), None) is None:
        # A passage exactly as wide as a body holds no chain of nodes, unless one lies on its axis: the finest grid allows it.
        slack = _SLACK * nodes.spacing
        depths = [depths[0], (sizes[0], sizes[0] - slack), *depths[1:], (sizes[-1], sizes[-1] - slack)]
    for body, depth in depths:
        free = nodes.inside & (nodes.clearance >= depth - TOUCH)
        seeds, closed = free & (in_goal(plan, nodes) | before), set(plan.widest)
        for segment, name in zip(plan.exits, plan.names, strict=True):
            near = free & (source_distance(segment[None], nodes, depth) < SOURCE * nodes.spacing)
            if plan.widest[name] >= 2 * body - TOUCH and near.any():
                seeds |= near
                closed.discard(name)
        parts = grid.connected_parts(free, seeds)
        before = parts == 1
        yield Dilation(body, depth, before, parts, closed)


def _finer(plan: Plan, spacing: float) -> Iterator[float]:
    """Yield smaller and smaller spacings [m], as long as they have few enough nodes."""
    while (spacing := spacing / 2) >= _FINEST - 1e-9:
        rows, cols = _nodes(plan.geometry, spacing)
        if rows * cols >= min(_FINE_NODES, _MAX_NODES):
            return
        yield spacing


def _most_open(plan: Plan, spacing: float) -> tuple[Grid, list[Dilation]]:
    """Return the grid on which the largest bodies get furthest, the coarsest of equally good ones, and its dilations.

    These are left to the caller, [], unless the first is sufficient, as in most places.
    """
    smallest, most, best = max(plan.min_radius, 2 * spacing), -np.inf, None
    others = plan.spacing is None
    for h in chain(_coarse(plan, spacing) if others else (), [spacing], () if plan.partial else _finer(plan, spacing)):
        nodes = _make_grid(plan, h)
        for k, dilation in enumerate(_dilations(plan, nodes, max(h, spacing))):
            if dilation.radius < plan.radius:
                break
            whole = not dilation.closed and _lost_part(dilation.parts, nodes, smallest) is None
            if h > spacing and not whole:
                break  # such as a goal region that is too small for it
            area = float(dilation.reached.sum()) * h**2
            if best is None or area > most + np.pi * smallest**2:
                best, most = nodes, area
            if whole:
                return nodes, [] if k else [dilation]
    assert best is not None
    return best, []


def dilate(plan: Plan, spacing: float) -> tuple[Grid, list[Dilation]]:
    """Return the grid, and the dilations that lead all of the area to an exit: one, unless only small bodies leave a part.

    Raises
    ------
    ValueError
        If at the smallest radius an exit, or a part of the area larger than a body, is still closed off.
    """
    smallest, (best, whole) = max(plan.min_radius, 2 * spacing), _most_open(plan, spacing)
    if whole:
        return best, whole
    leads_anywhere = len(plan.rows) == len(plan.geometry.exits)  # a field to some of the exits gives no warning
    for nodes in chain([best], (_make_grid(plan, h) for h in _finer(plan, best.spacing))):
        dilations: list[Dilation] = []
        lost, closed = None, set(plan.widest)
        for dilation in _dilations(plan, nodes, spacing):
            if dilation.reached.any() and (not dilations or (dilation.reached & (dilations[-1].parts > 1)).any()):
                if lost is not None and dilation.radius < plan.radius and leads_anywhere:
                    warnings.warn(
                        f"the way out from ({lost[0]:.2f}, {lost[1]:.2f}) is too narrow for a body of radius {plan.radius:g} m:"
                        f" it is made for {dilation.radius:.3g} m, larger people will squeeze",
                        stacklevel=3,
                    )
                dilations.append(dilation)
            lost, closed = _lost_part(dilation.parts, nodes, smallest), closed & dilation.closed
            if dilations and lost is None and not closed:
                return nodes, dilations
        if plan.partial and dilations and lost is not None and not closed:
            warnings.warn(
                f"as the doors stand, no exit can be reached from ({lost[0]:.2f}, {lost[1]:.2f}): people wait there",
                NoWayOut,
                stacklevel=3,
            )
            return nodes, dilations
    if closed:
        narrowest = min(closed, key=plan.widest.__getitem__)
        problem = f"the way to exit {narrowest!r} is blocked right in front of it"
        if plan.widest[narrowest] < 2 * smallest - TOUCH:
            problem = f"exit {narrowest!r} is too narrow"
    else:
        assert lost is not None  # or the dilations would do
        what = "no exit can" if plan.goal is None else "the region that the way leads to cannot"
        problem = f"{what} be reached from ({lost[0]:.2f}, {lost[1]:.2f})"
    raise ValueError(f"{problem} for a body of diameter {2 * smallest:.2f} m; widen the passage or open an exit there")


def in_goal(plan: Plan, nodes: Grid) -> Bools:
    """Return (rows, cols) which nodes lie in the region that the way leads to."""
    if plan.goal is None:
        return np.zeros_like(nodes.inside)
    return plan.geometry.contains(nodes.points(), plan.goal)


def _lost_part(label: Ints, nodes: Grid, min_radius: float) -> tuple[float, float] | None:
    """Return the most open place [m] of the largest part that reaches no exit; None if it is smaller than a body."""
    sizes = np.bincount(label.ravel())
    sizes[:2] = 0
    largest = int(np.argmax(sizes))
    if sizes[largest] * nodes.spacing**2 < np.pi * min_radius**2:
        return None
    i, j = np.unravel_index(np.argmax(np.where(label == largest, nodes.clearance, -1.0)), label.shape)
    return float(nodes.origin[0] + j * nodes.spacing), float(nodes.origin[1] + i * nodes.spacing)


def source_distance(exits: Floats, nodes: Grid, radius: float, cap: float | None = None) -> Floats:
    """Return the distance [m] of every node to the nearest exit, each shrunk by ``radius`` at both ends (or ``cap``)."""
    along = exits[:, 1] - exits[:, 0]
    width = np.hypot(*along.T)[:, None]
    cut = along / width * np.minimum(radius, width / 2)
    shrunk = np.stack([exits[:, 0] + cut, exits[:, 1] - cut], axis=1)
    cap = 2 * SOURCE * nodes.spacing if cap is None else cap
    return grid.capped_distance(shrunk, nodes.inside.shape, nodes.origin, nodes.spacing, cap)


def require_reached(plan: Plan, nodes: Grid, unknown: Bools) -> None:
    """Refuse a place that the smallest body stands in but that the extension did not reach."""
    if plan.partial:
        return
    least = max(plan.min_radius, 2 * nodes.spacing)
    stands = unknown & nodes.inside & (nodes.clearance >= least - TOUCH)
    label = grid.connected_parts(stands, np.zeros_like(stands))
    lost = _lost_part(label, nodes, least)
    if lost is not None:
        raise ValueError(f"no exit can be reached from ({lost[0]:.2f}, {lost[1]:.2f}); open an exit there")
