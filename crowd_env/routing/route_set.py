"""Routes made ready: their travel-time fields, and the arrays that the compiled step reads of routes, regions and rules."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from crowd_env.geometry.geometry import Geometry
from crowd_env.navigation.congestion import CongestionField
from crowd_env.navigation.extension import carried_along
from crowd_env.navigation.field import NavigationField, OneWay, regions_along, straight_field, travel_time_field
from crowd_env.routing.rules import MOST_REGIONS, Guidance, RegionArrays, RuleArrays
from crowd_env.routing.spec import OUT, Comfort, ControlRule, DoorEvent, Route, SpeedZone
from crowd_env.routing.speed_map import SpeedMap
from crowd_env.state import Floats, Ints

Target = Literal["path", "nearest", "centre", "width"]
_MARGINS = {"nearest": float("nan"), "centre": float("inf"), "width": 0.0}
_REGION_CELL = 0.05  # m
_REGION_CELLS = 4e6  # a place of more than 100 m x 100 m gets larger ones


class RouteField(NamedTuple):
    """One route of a place, ready to be looked up."""

    name: str
    field: NavigationField
    goal: int  # region that it leads to; -1 = exits
    following: int  # way that takes over there; -1 = none
    shut: bool  # it leads to closed exits alone
    congestion: (
        CongestionField | None
    )  # makes the field anew from the crowd of each environment; None = it never changes
    exits: tuple[str, ...]  # that it may lead to in the end; () = all
    rest: NavigationField | None = None  # of a way via a region: travel time to the exit, what follows included

    @property
    def potential(self) -> NavigationField:
        """The field by which progress is counted: it leads to the exit, and does not change with the crowd."""
        return self.field if self.rest is None else self.rest


@dataclass(frozen=True, eq=False)
class RouteSet:
    """All routes of one place with its regions and rules; made by `build_routes`."""

    geometry: Geometry
    routes: tuple[RouteField, ...]
    zones: tuple[SpeedZone, ...]
    rules: tuple[ControlRule, ...]
    radius: float  # m
    closed_at_start: tuple[str, ...]  # doors
    events: tuple[DoorEvent, ...]
    again: Callable[..., "RouteSet"]  # makes the same ways while other doors are closed
    _closed: dict[frozenset[str], "RouteSet | str"] = field(default_factory=dict)  # or why there are none

    @property
    def is_dynamic(self) -> bool:
        """Whether some way follows the crowd."""
        return any(way.congestion is not None for way in self.routes)

    def when(self, closed: frozenset[str]) -> "RouteSet":
        """Return the same ways while these doors are closed, made once.

        Raises
        ------
        ValueError
            If someone would be locked in.
        """
        if not closed:
            return self
        if closed not in self._closed:
            try:
                self._closed[closed] = self.again(closed=closed)
            except ValueError as error:
                self._closed[closed] = str(error)
        found = self._closed[closed]
        if isinstance(found, str):
            raise ValueError(found)
        return found

    def number(self, name: str) -> int:
        """Return the number of a route.

        Raises
        ------
        ValueError
            If it is unknown.
        """
        names = [way.name for way in self.routes]
        if name not in names:
            raise ValueError(f"unknown route {name!r}; known: {', '.join(n for n in names if '/' not in n)}")
        return names.index(name)

    def nearest(self, exits: Sequence[str], position: Floats) -> Ints:
        """Return for each position (K, 2) the number of the route, among those of open ``exits``, that is shortest there."""
        numbers = [self.number(name) for name in exits]
        numbers = [k for k in numbers if not self.routes[k].shut] or numbers
        times = np.stack([_travel_time(self.routes[k].field, position) for k in numbers])
        return np.array(numbers, dtype=np.int64)[np.nanargmin(times, axis=0)]


def build_routes(
    geometry: Geometry,
    radius: float,
    *,
    min_radius: float | None = None,
    routes: Sequence[Route] = (),
    zones: Sequence[SpeedZone] = (),
    rules: Sequence[ControlRule] = (),
    target: Target = "path",
    walking_speed: float = 1.4,
    comfort: Comfort | None = None,
    closed: frozenset[str] = frozenset(),
    closed_at_start: Sequence[str] = (),
    events: Sequence[DoorEvent] = (),
    one_way: Sequence[OneWay] = (),
) -> RouteSet:
    """Return the routes of a place: first "out", the shortest way to any exit; then ``routes``; then what rules need.

    The name of an exit is a route too: the shortest way to that exit.

    Parameters
    ----------
    radius, min_radius : m, of the largest and smallest body.
    target : what the shortest ways aim at, see `crowd_env.scenarios.scenario.Scenario`.
    walking_speed : m/s, of the people, to compare fixed speeds of zones with.
    closed : names of the doors that are closed; the ways are those of that moment.
    closed_at_start, events : doors that are closed at first, and what happens to doors.
    one_way : doors that nobody means to pass the other way.

    Raises
    ------
    ValueError
        If a name is unknown or taken, or an exit or region cannot be reached.
    """
    _check_names(geometry, routes, zones, rules)
    _check_doors(geometry, closed_at_start, events)
    wanted = {route.name: route for route in (Route(OUT), *routes)}
    for rule in rules:
        if rule.route not in wanted:
            wanted[rule.route] = Route(rule.route, (rule.route,))
    pace = SpeedMap(geometry, zones, walking_speed, comfort or Comfort())
    behind = {e for door, e in zip(geometry.doors, geometry.exits_of_door, strict=True) if door in closed}
    made: list[RouteField] = []
    names = list(wanted)
    following = len(names)  # the second halves of ways that lead via a region come last

    def way(name: str, route: Route, goal: int, then: int) -> RouteField:
        via = route.via if goal >= 0 else None
        exits = route.exits or None if via is None else None
        # A way to closed exits alone stays as it is: who means to take it waits there.
        shut = exits is not None and not set(exits) - behind
        at_this = frozenset() if shut else closed
        speed = {"shortest": None, "comfortable": pace.comfortable, "fastest": pace}[route.strategy]
        found = travel_time_field(
            geometry, radius, exits=exits, min_radius=min_radius, goal=via, speed=speed, closed=at_this, one_way=one_way
        )
        if route.strategy == "fastest":
            if one_way:
                raise ValueError(f"route {name!r}: the fastest way does not know one-way doors; take another strategy")
            congestion = CongestionField(found, geometry.walls_when(at_this)[0], pace)
            return RouteField(name, congestion.march(), goal, then, shut, congestion, route.exits)
        if target != "path" and via is None and route.strategy == "shortest":
            found = straight_field(found, geometry, _MARGINS[target])
        return RouteField(name, found, goal, then, shut, None, route.exits)

    second: list[RouteField] = []
    for route in wanted.values():
        if route.via is None:
            made.append(way(route.name, route, -1, -1))
        else:
            goal = list(geometry.regions).index(route.via)
            made.append(way(route.name, route, goal, following + len(second)))
            second.append(way(f"{route.name}/then", route, -1, -1))
    route_set = [_with_what_follows(found, second, following) for found in made] + second
    if rules:
        route_set = [found._replace(field=_with_regions(found.field, geometry)) for found in route_set]
        route_set = [_with_rest(found, route_set, geometry) for found in route_set]
    again = partial(
        build_routes,
        geometry,
        radius,
        min_radius=min_radius,
        routes=tuple(routes),
        zones=tuple(zones),
        rules=tuple(rules),
        target=target,
        walking_speed=walking_speed,
        comfort=comfort,
        closed_at_start=tuple(closed_at_start),
        events=tuple(events),
        one_way=tuple(one_way),
    )
    doors = (tuple(closed_at_start), tuple(events))
    return RouteSet(geometry, tuple(route_set), tuple(zones), tuple(rules), radius, *doors, again)


def _check_names(
    geometry: Geometry, routes: Sequence[Route], zones: Sequence[SpeedZone], rules: Sequence[ControlRule]
) -> None:
    exits, regions = list(dict.fromkeys(geometry.exit_names)), list(geometry.regions)
    if len(regions) > MOST_REGIONS:
        raise ValueError(f"{len(regions)} regions; at most {MOST_REGIONS} can be told apart")

    def known(kind: str, name: str, names: Sequence[str], what: str) -> None:
        if name not in names:
            raise ValueError(f"{kind} names an unknown {what} {name!r}; known: {', '.join(names) or 'none'}")

    taken = {OUT}
    for route in routes:
        if route.name in taken or "/" in route.name:
            raise ValueError(f"route {route.name!r}: the name is taken or holds a '/'; take another")
        if route.name in exits and route.exits != (route.name,):
            raise ValueError(f"route {route.name!r} has the name of an exit; it must lead to that exit alone")
        taken.add(route.name)
        for name in route.exits:
            known(f"route {route.name!r}", name, exits, "exit")
        if route.via is not None:
            known(f"route {route.name!r}", route.via, regions, "region")
    for zone in zones:
        known("speed zone", zone.region, regions, "region")
    for rule in rules:
        known("control rule", rule.region, regions, "region")
        known(f"control rule on {rule.region!r}", rule.route, [*taken, *exits], "route")


def _check_doors(geometry: Geometry, closed_at_start: Sequence[str], events: Sequence[DoorEvent]) -> None:
    def known(name: str | None, names: Sequence[str], what: str) -> None:
        if name is not None and name not in names:
            raise ValueError(f"unknown {what} {name!r} in what happens to doors; known: {', '.join(names) or 'none'}")

    for name in (*closed_at_start, *(event.door for event in events)):
        known(name, geometry.doors, "door")
    for event in events:
        known(event.region, list(geometry.regions), "region")
        known(event.exit, geometry.exit_names, "exit")


def region_masks(geometry: Geometry, x: Floats, y: Floats) -> Ints:
    """Return which regions places x, y (any shape) lie in, as bits."""
    mask = np.zeros(x.shape, dtype=np.int64)
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    for k, name in enumerate(geometry.regions):
        mask[geometry.contains(places, name).reshape(x.shape)] |= 1 << k
    return mask


def _nodes(field: NavigationField) -> tuple[Floats, Floats]:
    rows, cols = field.travel_time.shape
    x, y = np.meshgrid(
        field.origin[0] + field.spacing * np.arange(cols), field.origin[1] + field.spacing * np.arange(rows)
    )
    return x, y


def region_masks_of(field: NavigationField, geometry: Geometry) -> Ints:
    """Return which regions the nodes of a field lie in (rows, cols), as bits."""
    return region_masks(geometry, *_nodes(field))


def _with_regions(field: NavigationField, geometry: Geometry) -> NavigationField:
    return replace(field, through=regions_along(field, region_masks_of(field, geometry)))


def _with_what_follows(way: RouteField, second: Sequence[RouteField], first: int) -> RouteField:
    """Add to a way via a region the travel time to the exit: to the region, and from where one comes to it."""
    if way.following < 0:
        return way
    then, time = second[way.following - first].field, way.field.travel_time
    places = np.stack([coordinate.ravel() for coordinate in _nodes(way.field)], axis=1)
    on_from = _travel_time(then, places).reshape(time.shape)
    on_from[np.isnan(on_from)] = np.nanmax(then.travel_time)  # where closed doors lock people in
    return way._replace(rest=replace(way.field, travel_time=time + carried_along(time, on_from)))


def _with_rest(way: RouteField, route_set: Sequence[RouteField], geometry: Geometry) -> RouteField:
    """Add to a way via a region the regions that lie on the rest of it."""
    if way.following < 0 or way.field.through is None:
        return way
    rest, inside = route_set[way.following].field, 1 << way.goal
    assert rest.through is not None
    at_goal = (region_masks_of(rest, geometry) & inside) > 0
    beyond = int(np.bitwise_or.reduce(rest.through[at_goal], initial=0)) & ~inside
    return way._replace(field=replace(way.field, through=way.field.through | beyond))


def _travel_time(field: NavigationField, position: Floats) -> Floats:
    """Return the travel time at the nearest node to each position (K, 2)."""
    rows, cols = field.travel_time.shape
    j, i = np.rint((position - field.origin) / field.spacing).astype(np.int64).T
    return np.asarray(field.travel_time[np.clip(i, 0, rows - 1), np.clip(j, 0, cols - 1)])


def add_fields(
    route_set: RouteSet | NavigationField | None, fields: list[NavigationField | None]
) -> tuple[list[int], list[int]]:
    """Append the fields of a place to those of a batch; return for each route the row of its field and of its potential."""
    if not isinstance(route_set, RouteSet):
        fields.append(route_set)
        return [len(fields) - 1], [len(fields) - 1]
    rows = [len(fields) + r for r in range(len(route_set.routes))]
    fields += [way.field for way in route_set.routes]
    potentials = list(rows)
    for r, way in enumerate(route_set.routes):
        if way.congestion is not None or way.rest is not None:  # the field changes in place, or ends at the region
            potentials[r] = len(fields)
            fields.append(way.potential)
    return rows, potentials


def join_routes(
    places: Sequence[RouteSet | NavigationField | None], geometry_of_env: Ints
) -> tuple[list[NavigationField | None], list[int], Guidance, Ints]:
    """Return all fields of a batch, the geometry of each, the guidance that says which route is which, and the potentials.

    Places without `RouteSet` have one route, their field.  A dynamic way has a field of its own in every environment.  The
    potentials (E, R) are rows of the fields by which progress on each route is counted, see `RouteField.potential`.
    """
    fields: list[NavigationField | None] = []
    geometry_of_field: list[int] = []
    rows_of_place: list[tuple[list[int], list[int]]] = []
    for g, place in enumerate(places):
        rows_of_place.append(add_fields(place, fields))
        geometry_of_field += [g] * (len(fields) - len(geometry_of_field))
    most = max(len(rows) for rows, _ in rows_of_place)
    table = np.full((4, len(geometry_of_env), most), -1, dtype=np.int64)
    for e, g in enumerate(geometry_of_env):
        place = places[g]
        rows, potentials = rows_of_place[g]
        table[0, e, : len(rows)], table[3, e, : len(rows)] = rows, potentials
        for r, way in enumerate(place.routes if isinstance(place, RouteSet) else ()):
            table[1:3, e, r] = way.goal, way.following
            if way.congestion is not None:
                table[0, e, r] = len(fields)
                fields.append(way.field)
                geometry_of_field.append(int(g))
    guidance = Guidance(table[0].copy(), table[1].copy(), table[2].copy(), _join_regions(places), _join_rules(places))
    return fields, geometry_of_field, guidance, table[3].copy()


def _join_regions(places: Sequence[RouteSet | NavigationField | None]) -> RegionArrays:
    count = len(places)
    shape, origin = np.zeros((count, 2), dtype=np.int64), np.zeros((count, 2))
    fixed, factor = np.full((count, MOST_REGIONS), np.nan), np.ones((count, MOST_REGIONS))
    spacing = np.full(count, _REGION_CELL)
    masks: list[Ints] = []
    for g, place in enumerate(places):
        needed = isinstance(place, RouteSet) and (
            place.zones or place.rules or any(way.goal >= 0 for way in place.routes)
        )
        if not needed or not isinstance(place, RouteSet):
            masks.append(np.zeros(0, dtype=np.int64))
            continue
        geometry = place.geometry
        x0, y0, x1, y1 = geometry.bounds
        cell = spacing[g] = max(_REGION_CELL, float(np.sqrt((x1 - x0) * (y1 - y0) / _REGION_CELLS)))
        cols, rows = (int(np.ceil(length / cell)) + 1 for length in (x1 - x0, y1 - y0))
        middle = np.meshgrid(x0 + cell * (np.arange(cols) + 0.5), y0 + cell * (np.arange(rows) + 0.5))
        masks.append(region_masks(geometry, *middle).ravel())
        shape[g], origin[g] = (rows, cols), (x0, y0)
        names = list(geometry.regions)
        for zone in place.zones:
            k = names.index(zone.region)
            fixed[g, k] = np.nan if zone.speed is None else zone.speed
            factor[g, k] = zone.factor
    start = np.concatenate([[0], np.cumsum([len(mask) for mask in masks])]).astype(np.int64)
    return RegionArrays(start, shape, origin, spacing, np.concatenate(masks), fixed, factor)


def _join_rules(places: Sequence[RouteSet | NavigationField | None]) -> RuleArrays:
    rows: list[tuple[int, int, int, float, int, bool]] = []
    start = [0]
    for place in places:
        if isinstance(place, RouteSet):
            names = list(place.geometry.regions)
            for rule in place.rules:
                below = rule.at_least if rule.below is None else rule.below
                number = place.number(rule.route)
                rows.append((names.index(rule.region), rule.at_least, below, rule.hold, number, rule.commits))
        start.append(len(rows))
    columns = list(zip(*rows, strict=True)) or [()] * 6

    def whole(k: int) -> Ints:
        return np.array(columns[k], dtype=np.int64)

    return RuleArrays(
        np.array(start, dtype=np.int64),
        whole(0),
        whole(1),
        whole(2),
        np.array(columns[3], dtype=np.float64),
        whole(4),
        np.array(columns[5], dtype=np.bool_),
    )
