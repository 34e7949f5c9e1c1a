"""The way out: travel-time fields by fast marching, made for the center of a disc that keeps off the walls.

The walls are dilated by a body radius, so that the shortest path avoids concave corners and gaps that are too narrow.
scikit-fmm solves ``|grad T| = 1`` on the rest.  People may still stand closer to a wall (pushed there, or with smaller
bodies): there the field is extended along straight lines to the dilated area.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints, row_starts
from crowd_env.core.checks import check_fields, shown
from crowd_env.geometry.geometry import Boundary, Geometry
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.directions import cell_kinds, descend
from crowd_env.routing.fields.domain import (
    SOURCE,
    TOUCH,
    Dilation,
    Grid,
    Plan,
    choose_spacing,
    dilate,
    in_goal,
    make_plan,
    require_reached,
    source_distance,
)
from crowd_env.routing.fields.extension import extend_once, fill_from_nearest, lead_over_seams
from crowd_env.routing.fields.lookup import FieldArrays
from crowd_env.routing.fields.marching import Gate, gate, lead_through, march, march_on, march_through
from crowd_env.routing.fields.sheets import NOWHERE, SheetGround, Window, field_of_sheets
from crowd_env.routing.fields.string_pulling import make_targets, pull_strings


@dataclass(frozen=True)
class OneWay:
    """A door that people mean to pass one way only; a crowd may still push somebody back through it."""

    door: str
    """name of the door."""
    to: Literal["left", "right"]
    """the side where people come out, seen from the first towards the last point of the door's line."""

    def __post_init__(self) -> None:
        check_fields(f"one-way door {shown(self.door)}", self)

    def lines(self, geometry: Geometry) -> list[Floats]:
        """Return the lines (2, 2) [m] of its leaves, each passed from right to left.

        Raises
        ------
        ValueError
            If the door is unknown, or leads out of the area.
        """
        if self.door not in geometry.doors:
            raise ValueError(f"unknown one-way door {self.door!r}; known: {', '.join(geometry.doors) or 'none'}")
        number = geometry.doors.index(self.door)
        if geometry.exits_of_door[number] is not None:
            raise ValueError(f"one-way door {self.door!r} closes an exit; those are passed outwards anyway")
        leaves = geometry.walls[geometry.door_of_wall == number]
        return [leaf if self.to == "left" else leaf[::-1] for leaf in leaves]


@dataclass(frozen=True, eq=False)
class NavigationField:
    """The way out from every node of a grid; node [i, j] lies at ``origin + spacing * (j, i)``.

    Attributes
    ----------
    travel_time
        (rows, cols) travel time at 1 m/s on plain floor [s], there the length of the path of the center [m]; nan outside.
    direction
        (rows, cols, 2) unit vector along the shortest path; 0 outside.
    direct
        (rows, cols) row of ``Geometry.exits`` that is reached in a straight line; -1 = none.
    cell
        (rows, cols) how to look up in the cell right of and above the node: row of the exit that all its corners are
        direct to, or the codes `BLEND`, `ALONE` of `crowd_env.routing.fields.lookup`.
    origin
        (2,) place of node [0, 0] [m].
    spacing
        Distance between nodes [m].
    radius
        Radius of the disc that the field is made for [m].
    margin
        Distance kept from the ends of an exit in the aim [m]; nan = the body's radius.
    through
        (rows, cols) bit k: the way from the node leads through region k of the geometry; None = not known.
    free
        (rows, cols) whether the center of the disc can be there; None = not known.
    fits
        (rows, cols) radius of the largest body that gets out from the node [m]; nan = too near to a wall; None = not known.
    behind
        Part of every travel time that is spent on aprons, beyond the exit lines: the least of all exits [s].
    rest
        (rows, cols) part of the travel time on the sheet of the node [s]; None = all of it.
    windows
        Where the nodes of each sheet of a building lie.
    shift
        (2,) from the coordinates of ``origin`` to the layout [m]: of the field of one sheet.
    """

    travel_time: Floats
    direction: Floats
    direct: Ints
    cell: Ints
    origin: Floats
    spacing: float
    radius: float
    margin: float = float("nan")
    through: Ints | None = None
    free: Bools | None = None
    fits: Floats | None = None
    behind: float = 0.0
    rest: Floats | None = None
    windows: tuple[Window, ...] = ()
    shift: tuple[float, float] = (0.0, 0.0)

    def nodes(self) -> Floats:
        """Return where the nodes lie (rows, cols, 2) [m]."""
        return grid.node_points(self.origin, self.spacing, self.travel_time.shape)

    def travel_time_near(self, position: Floats) -> Floats:
        """Return the travel time [s] (...) at the node nearest to each ``position`` (..., 2) [m]."""
        return np.asarray(
            self.travel_time[grid.nearest_nodes(position, self.origin, self.spacing, self.travel_time.shape)]
        )

    def travel_time_for(self, position: Floats, radius: Floats | float) -> Floats:
        """Return the travel time [s] (K,) at ``position`` (K, 2) [m]; inf for bodies of ``radius`` [m] that do not get out."""

        def near(values: Floats) -> Floats:
            return np.asarray(values[grid.nearest_known(position, values, self.origin, self.spacing)])

        fits = np.inf if self.fits is None else near(self.fits)
        return np.where(fits >= np.asarray(radius) - 1e-9, near(self.travel_time), np.inf)


def by_sheet(field: NavigationField | None) -> list[NavigationField | None]:
    """Return the field of each sheet of a building in true coordinates; of another place, its field."""
    if field is None or not field.windows:
        return [field]
    found: list[NavigationField | None] = []
    for window in field.windows:
        rows, cols = window.nodes
        part: dict[str, Any] = {
            name: getattr(field, name)[rows, cols] for name in ("travel_time", "direction", "direct", "cell")
        }
        through = None if field.through is None else field.through[rows, cols]
        others: dict[str, Any] = {"through": through, "free": None, "fits": None, "rest": None, "windows": ()}
        found.append(replace(field, **part, **others, origin=window.origin, shift=window.shift))
    return found


_NO_CODES = np.empty((0, 0), dtype=np.int64)
_NO_FIELD = NavigationField(
    np.empty((0, 0)), np.empty((0, 0, 2)), _NO_CODES, _NO_CODES, origin=np.zeros(2), spacing=1.0, radius=np.nan
)


def no_ways(geometry: Geometry) -> NavigationField | None:
    """Return no field, of a building one that leads nowhere on every sheet."""
    return None if geometry.building is None else replace(_NO_FIELD, windows=(NOWHERE,) * len(geometry.building.sheets))


def travel_time_field(
    geometry: Geometry,
    radius: float,
    *,
    exits: Iterable[str] | None = None,
    min_radius: float | None = None,
    goal: str | None = None,
    speed: Callable[[Floats], Floats] | None = None,
    closed: Collection[str] = (),
    one_way: Sequence[OneWay] = (),
) -> NavigationField:
    """Return the field that leads discs to the nearest of the exits, or into a region.

    Parameters
    ----------
    geometry
        The place.
    radius
        Radius of the body [m] by which the walls are dilated.
    exits
        Names of the exits to lead to; all by default.  The others count as walls.
    min_radius
        Radius of the smallest body [m], ``radius`` by default.  Where only smaller bodies get through, the field is made
        for the largest radius that does, with a warning.
    goal
        Name of the region to lead to instead of exits; all exits then count as walls.
    closed
        Names of the doors that are closed.
    one_way
        Doors that people mean to pass one way only.
    speed
        Walking speed (...) at points (..., 2) [m], relative to that on plain floor; > 0.  The way is the quickest one then.

    The nodes of the grid are 0.05 m apart, more in big plans, at most ``min_radius / 2``; the distance is halved (down to
    0.01 m) where a passage would be missed otherwise.  Beyond 100 m x 100 m it grows up to 0.3 m, as far as every passage
    is 5.5 times as wide.

    Raises
    ------
    ValueError
        If a region or exit is unknown, an exit is too narrow for the smallest body, or a part of the area reaches no exit.
    """
    lines = [line for door in one_way if door.door not in closed for line in door.lines(geometry)]
    least = radius if min_radius is None else min_radius

    def solve(sheet: SheetGround, exits: list[str], spacing: float | None) -> NavigationField:
        plan = make_plan(sheet.geometry, radius, exits, least, goal if sheet.has_goal else None, closed, seams=True)
        beyond = [sheet.start.get(name, (0.0, np.inf)) for name in plan.names]
        for name, (_, size) in zip(plan.names, beyond, strict=True):
            plan.widest[name] = min(plan.widest[name], 2.0 * size)
        times = [time for time, _ in beyond]
        start = np.array(times) if any(times) or sheet.speed_to is not None else None
        here = [line - sheet.offset for line in lines]
        here = [line for line in here if sheet.geometry.contains(line.mean(axis=0))]
        plan = plan._replace(one_way=bool(here), start=start, spacing=spacing)
        nodes, dilations = dilate(plan, choose_spacing(plan))
        of_sheet = None if speed is None else lambda points: speed(points + sheet.offset)
        return _solve(plan, nodes, dilations, of_sheet, here, sheet.speed_to)

    if geometry.building is not None:
        return field_of_sheets(geometry, solve, exits, goal, closed, least)
    plan = make_plan(geometry, radius, exits, least, goal, closed)
    plan = plan._replace(one_way=bool(lines))
    nodes, dilations = dilate(plan, choose_spacing(plan))
    return _solve(plan, nodes, dilations, speed, lines)


def straight_field(field: NavigationField, geometry: Geometry, margin: float) -> NavigationField:
    """Return ``field`` with all people aiming straight at the nearest exit, even through obstacles.

    The rule of crowd models without path planning, for comparison: it leads into walls and corners.

    Parameters
    ----------
    margin
        Distance kept from the ends of the exit [m]: nan = the body's radius, 0 = the whole width, inf = its middle.
    """
    return replace(field, cell=geometry.nearest_exit(field.nodes()), margin=margin)


def join_fields(
    fields: Sequence[NavigationField | None], boundary: Boundary, geometry_of_field: Sequence[int] | None = None
) -> FieldArrays:
    """Return fields one behind the other, each on a geometry of ``boundary``; None = no field.

    Parameters
    ----------
    geometry_of_field
        Row of the geometry of each field; by default there is one field a geometry.

    Raises
    ------
    ValueError
        If there is not one entry per geometry.
    """
    count = len(boundary.exit_start) - 1
    if geometry_of_field is None and len(fields) != count:
        raise ValueError(f"{len(fields)} fields for {count} geometries; give one (or None) for each")
    place = np.arange(count) if geometry_of_field is None else np.asarray(geometry_of_field)
    every = [_NO_FIELD if field is None else field for field in fields]
    made = [(field, boundary.exit_start[g]) for g, field in zip(place, every, strict=True)]
    shapes = [field.travel_time.shape for field in every]
    return FieldArrays(
        geometry=place.astype(np.int64),
        node_start=row_starts([rows * cols for rows, cols in shapes]),
        shape=np.array(shapes, dtype=np.int64),
        origin=np.array([field.origin for field in every], dtype=np.float64),
        spacing=np.array([field.spacing for field in every], dtype=np.float64),
        travel_time=np.concatenate([field.travel_time.ravel() - field.behind for field in every]),
        behind=np.array([field.behind for field in every], dtype=np.float64),
        direction=np.concatenate([field.direction.reshape(-1, 2) for field in every]),
        direct=np.concatenate([rows_in_batch(field.direct, first) for field, first in made]),
        # Looked up for each pedestrian a hundred times a second: as little to fetch from memory as possible.
        cell=np.concatenate([rows_in_batch(field.cell, first) for field, first in made]).astype(np.int16),
        margin=np.array([field.margin for field in every], dtype=np.float64),
        through=np.concatenate([np.zeros_like(f.direct) if f.through is None else f.through for f in every], axis=None),
    )


def rows_in_batch(exits: Ints, first: int) -> Ints:
    """Return rows of exits of one geometry as rows of the batch, flat; negative codes stay."""
    return np.where(exits >= 0, exits + first, exits).ravel()


def _solve(
    plan: Plan,
    nodes: Grid,
    dilations: Sequence[Dilation],
    speed_at: Callable[[Floats], Floats] | None,
    one_way: Sequence[Floats] = (),
    speed_to: Callable[[str | None, Floats], Floats] | None = None,
) -> NavigationField:
    """March through the free nodes, extend to all walkable ones, and find directions and straight lines."""
    points = nodes.points()
    speed = None if speed_at is None else np.asarray(speed_at(points), dtype=np.float64)
    speeds: dict[str | None, Floats] = {}
    if speed_to is not None:
        level = 1.0 if speed is None else speed
        speeds = {name: level * speed_to(name, points) for name in (None, *plan.names)}
        if speed is not None or (speeds[None] != 1.0).any():
            speed = speeds[None]
    h, dilation = nodes.spacing, dilations[0].depth
    # In large places walls are dilated by more than a body.
    radius, reach = min(dilation, plan.radius), dilation + SOURCE * h
    free = _free(nodes, dilations[0])
    gates = [gate(line, free, nodes.points(), h) for line in one_way]
    time, fits = _march(plan, nodes, dilations, np.ones(free.shape) if speed is None else speed, gates, speeds)
    direction = descend(time, h)
    lead_through(time, direction, gates)
    # No straight line may lead back through a one-way door.
    lines, target = np.concatenate([plan.walls, *(line[None] for line in one_way)]), np.full(time.shape, -1, np.int64)
    targets, around = make_targets(plan.exits, lines, time, nodes.origin, h, dilation)
    targets, near = targets._replace(radius=radius), np.empty(len(plan.walls), dtype=np.int64)
    if plan.start is not None:
        targets = targets._replace(start=plan.start)

    def extend(band: float) -> int:
        return extend_once(
            time, direction, target, targets, nodes.inside, plan.walls, plan.two_sided, nodes.origin, h, reach, band,
            time.copy(), near,
        )  # fmt: skip

    while dilation > radius and extend(0.0):  # where a body may be that the march kept out
        pass
    strip = np.any([np.zeros_like(free), *(g.strip for g in gates)], axis=0)
    clear = (nodes.clearance >= radius - TOUCH) & ~strip
    plain = np.empty((0, 0), dtype=bool) if speed is None else speed == 1.0
    order = np.argsort(time, axis=None, kind="stable")
    pull_strings(time, direction, target, order, clear, targets, around, plain, nodes.origin, h)
    del order  # the next arrays are as large
    # The ragged edge of the march belongs to the band along the walls, unless it alone leads through a passage.
    edge = free if dilation == radius else ~np.isnan(time)
    time[edge & ~(clear | strip) & (target < 0) & grid.with_fringe(target >= 0, edge)] = np.nan
    band = radius
    while extend(band):
        band = 0.0  # further passes fill gaps that are narrower than the disc: straight to the better end
    if plan.start is not None:
        lead_over_seams(plan.exits[plan.start > 0.0], time, direction, target, nodes.origin, h, radius)
    require_reached(plan, nodes, np.isnan(time))
    fill_from_nearest(time, direction, nodes.inside, ~np.isnan(time), h)
    target[:] = np.append(plan.rows, np.full(len(targets.rest) + 1, -1))[target]  # from here on rows of exits
    return NavigationField(
        travel_time=time,
        direction=direction,
        direct=target,
        cell=cell_kinds(time, target, grid.blocked_lines(plan.walls, time.shape, nodes.origin, h)),
        origin=nodes.origin,
        spacing=h,
        radius=radius,
        free=free,
        fits=fits,
        behind=_behind(plan, time, nodes, speed),
    )


def _behind(plan: Plan, time: Floats, nodes: Grid, speed: Floats | None) -> float:
    """Return the least travel time [s] from the middle of a drawn line to the end of its apron."""
    if plan.drawn is None:
        return 0.0
    middle = plan.drawn.mean(axis=1)
    if speed is None:
        return float(np.hypot(*(plan.exits.mean(axis=1) - middle).T).min())
    return float(time[grid.nearest_known(middle, time, nodes.origin, nodes.spacing)].min())


def _march(
    plan: Plan,
    nodes: Grid,
    dilations: Sequence[Dilation],
    speed: Floats,
    gates: list[Gate],
    speeds: Mapping[str | None, Floats],
) -> tuple[Floats, Floats]:
    """Return the travel times [s] that the march finds, and the largest body [m] that gets out; both nan where it left out."""
    free, h = _free(nodes, dilations[0]), nodes.spacing
    if plan.start is not None:
        time = _march_from_each(plan, nodes, dilations[0], free, speed, gates, speeds)
    else:
        time, level = _sources(plan, nodes, dilations[0].depth, free, speed)
        start = SOURCE * h if plan.goal is None else 0.0
        if gates:
            time = march_through(time, level, free, speed, h, start, gates)
        else:
            time = march(time, level, free, speed, h, start)
    fits = np.where(np.isnan(time), np.nan, dilations[0].radius)
    for smaller in dilations[1:]:
        free = _free(nodes, smaller)
        if plan.start is not None:
            sources = _march_from_each(plan, nodes, smaller, free, speed, gates, speeds, marches=False)
            time = march_on(np.where(np.isnan(time), sources, time), free, speed, h)
        else:
            sources, _ = _sources(plan, nodes, smaller.depth, free, speed)
            time = march_on(np.fmin(time, sources) if plan.goal is None else time, free, speed, h)
        fits[np.isnan(fits) & ~np.isnan(time)] = smaller.radius
    return time, fits


def _march_from_each(
    plan: Plan,
    nodes: Grid,
    dilation: Dilation,
    free: Bools,
    speed: Floats,
    gates: list[Gate],
    speeds: Mapping[str | None, Floats],
    marches: bool = True,
) -> Floats:
    """Return the travel times [s] on a sheet: the least by any of its exits and seams.

    Up and down the same stairs people are not equally fast, so each has its own ``speeds``.
    """
    h, found = nodes.spacing, [np.full(free.shape, np.nan)]

    def reach(time: Floats, level: Floats, start: float, pace: Floats) -> Floats:
        if not marches:  # where it would begin
            return time
        if gates:
            return march_through(time, level, free, pace, h, start, gates)
        return march(time, level, free, pace, h, start)

    if plan.goal is not None:
        inside = in_goal(plan, nodes)
        found.append(reach(np.where(free & inside, 0.0, np.nan), np.where(inside, -0.5, 0.5) * h, 0.0, speed))
    assert plan.start is not None
    for segment, name, start in zip(plan.exits, plan.names, plan.start.tolist(), strict=True):
        pace = speeds.get(name, speed)
        distance = source_distance(segment[None], nodes, dilation.depth, cap=4 * SOURCE * h)
        known = np.where(free & (distance < SOURCE * h), distance / pace, np.nan)
        if name not in dilation.closed and not np.isnan(known).all():
            first = SOURCE * h / float(np.median(pace[~np.isnan(known)]))
            found.append(start + reach(known, distance - SOURCE * h, first, pace))
    return np.asarray(np.fmin.reduce(found))


def _free(nodes: Grid, dilation: Dilation) -> Bools:
    """Return where the center of a body of this size is on its way.

    That is half a spacing more, so that the ragged edge of the nodes lies at the radius on average, not beyond it.
    """
    return grid.with_fringe(dilation.reached, nodes.inside & (nodes.clearance >= dilation.depth - nodes.spacing / 2))


def _sources(plan: Plan, nodes: Grid, radius: float, free: Bools, speed: Floats) -> tuple[Floats, Floats]:
    """Return the travel times [s] of the nodes that start the march (nan elsewhere), and the level set it starts from."""
    h = nodes.spacing
    if plan.goal is None:
        distance = source_distance(plan.exits, nodes, radius, cap=4 * SOURCE * h)
        return np.where(free & (distance < SOURCE * h), distance / speed, np.nan), distance - SOURCE * h
    inside = in_goal(plan, nodes)
    return np.where(free & inside, 0.0, np.nan), np.where(inside, -0.5, 0.5) * h
