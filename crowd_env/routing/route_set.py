"""The routes of a place with their travel-time fields."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Literal, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import known
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.congestion import CongestionField
from crowd_env.routing.fields.directions import regions_on_the_way
from crowd_env.routing.fields.domain import open_exits
from crowd_env.routing.fields.drain import spread
from crowd_env.routing.fields.extension import carried_along
from crowd_env.routing.fields.field import NavigationField, OneWay, straight_field, travel_time_field
from crowd_env.routing.rules import MOST_REGIONS
from crowd_env.routing.spec import OUT, ControlRule, DoorEvent, Gate, Route
from crowd_env.routing.speed_map import Comfort, SpeedMap, SpeedZone
from crowd_env.routing.strategies import STRATEGIES

Target = Literal["path", "nearest", "centre", "width"]
_MARGINS = {"nearest": float("nan"), "centre": float("inf"), "width": 0.0}


# The time limit, the environments and every batch need the way out of a place.
_field_of = lru_cache(maxsize=4)(travel_time_field)


class RouteField(NamedTuple):
    """One route of a place, ready to be looked up."""

    name: str
    field: NavigationField
    goal: int  # region that it leads to; -1 = exits
    following: int  # route that takes over there; -1 = none
    is_closed: bool  # it leads to closed exits alone
    congestion: CongestionField | None  # makes the field again from a crowd; None = it never changes
    exits: tuple[str, ...]  # that it may lead to in the end; () = all
    to_exit: NavigationField | None = None  # of a route via a region: travel time to the exit, second half included
    until: float = 0.0  # s, the time until which people wait in ``goal``
    walls: Floats | None = None  # (W, 2, 2) m, the standing ones; None = no spread of people that keep a distance

    @property
    def potential(self) -> NavigationField:
        """The field by which progress is counted: it leads to the exit, and does not change with the crowd."""
        return self.field if self.to_exit is None else self.to_exit


@dataclass(frozen=True, eq=False)
class RoutePlan:
    """The data from which the routes of a place are made.

    Parameters
    ----------
    geometry : the place.
    radius, min_radius : m, of the largest and smallest body; ``min_radius`` is ``radius`` by default.
    routes, zones, rules : besides the route "out", the shortest to any exit.  The name of an exit is a route too.
    target : the aim of the shortest routes, see `crowd_env.scenarios.scenario.Scenario`.
    walking_speed : m/s, of the people, to compare fixed speeds of zones with.
    comfort : costs of the most comfortable route.
    closed_at_start, events : doors that are closed at first, and events that open or close doors.
    one_way : doors that people mean to pass one way only.
    gates : doors that let people through one by one.

    Raises
    ------
    ValueError
        If a name is unknown or taken, or a door has two gates.
    """

    geometry: Geometry
    radius: float
    _: KW_ONLY
    min_radius: float | None = None
    routes: Sequence[Route] = ()
    zones: Sequence[SpeedZone] = ()
    rules: Sequence[ControlRule] = ()
    target: Target = "path"
    walking_speed: float = 1.4
    comfort: Comfort = field(default_factory=Comfort)
    closed_at_start: Sequence[str] = ()
    events: Sequence[DoorEvent] = ()
    one_way: Sequence[OneWay] = ()
    gates: Sequence[Gate] = ()

    def __post_init__(self) -> None:
        _check_routes(self)
        _check_doors(self)

    def build(self, closed: frozenset[str] = frozenset()) -> "RouteSet":
        """Return the routes while these doors are closed: "out", then ``routes``, then the routes that rules need.

        Raises
        ------
        ValueError
            If an exit or region cannot be reached.
        """
        wanted = {route.name: route for route in (Route(OUT), *self.routes)}
        for rule in self.rules:
            if rule.route not in wanted:
                wanted[rule.route] = Route(rule.route, (rule.route,))
        first_half: list[RouteField] = []
        second_half: list[RouteField] = []  # of routes that lead via regions; they come last
        for route in wanted.values():
            goals, half, name = [*map(list(self.geometry.regions).index, route.stops)], first_half, route.name
            for goal in goals:
                following = len(wanted) + len(second_half) + (half is second_half)
                half.append(self._field(name, route, closed, goal, following))
                half, name = second_half, f"{name}/then"
            half.append(self._field(name, route, closed))
        made = [*first_half, *second_half]
        if self.rules:
            made = [_with_regions(route, self.geometry) for route in made]
        for k in range(len(made) - 1, -1, -1):  # what follows comes later
            made[k] = _with_time_to_exit(made[k], made)
            if self.rules:
                made[k] = _with_regions_beyond(made[k], made, self.geometry)
        return RouteSet(self, tuple(made))

    def _field(
        self, name: str, route: Route, closed: frozenset[str], goal: int = -1, following: int = -1
    ) -> RouteField:
        """Return a route, or the half of it that leads to its region ``goal``."""
        via = list(self.geometry.regions)[goal] if goal >= 0 else None
        exits = route.exits or None if via is None else None
        doors = zip(self.geometry.doors, self.geometry.exits_of_door, strict=True)
        # A route to closed exits alone stays as it is: people that choose it wait there.
        is_closed = exits is not None and not set(exits) - {e for door, e in doors if door in closed}
        closed = frozenset() if is_closed else closed
        strategy = STRATEGIES[route.strategy]
        speed_map = SpeedMap(self.geometry, self.zones, self.walking_speed, self.comfort)
        open_to = [] if via is not None else open_exits(self.geometry, exits, closed)
        found = _field_of(
            self.geometry,
            self.radius,
            exits=exits,
            min_radius=self.min_radius,
            goal=via,
            speed=None if strategy.speed is None else partial(strategy.speed, speed_map),
            closed=closed,
            one_way=tuple(self.one_way),
        )
        ground = self.geometry.with_ways_to(open_to)
        congestion = walls = None
        if strategy.follows_crowd:
            if self.one_way:
                raise ValueError(
                    f"route {name!r}: the {route.strategy} way does not know one-way doors; take another strategy"
                )
            congestion = CongestionField(
                found,
                ground.walls_when(closed)[0],
                speed_map.walking,
                self.geometry.exits if via is None else None,
                None if self.geometry.building is None else ground,
            )
            found = congestion.march()
        elif self.target != "path" and via is None and strategy.speed is None:
            found = straight_field(found, self.geometry, _MARGINS[self.target])
        elif strategy.speed is None and not self.one_way:
            walls = ground.walls_when(closed)[0]
        until = route.until if goal >= 0 else 0.0
        return RouteField(name, found, goal, following, is_closed, congestion, route.exits, until=until, walls=walls)


@dataclass(frozen=True, eq=False)
class RouteSet:
    """All routes of one place; made by `RoutePlan.build`.

    Parameters
    ----------
    plan : source of the routes.
    routes : as its doors stand.
    """

    plan: RoutePlan
    routes: tuple[RouteField, ...]
    # Closed doors -> their routes, or why there are none: found once, since a door may move in every episode.
    _when_closed: "dict[frozenset[str], RouteSet | ValueError]" = field(default_factory=dict, repr=False)

    @property
    def geometry(self) -> Geometry:
        """The place."""
        return self.plan.geometry

    @property
    def is_dynamic(self) -> bool:
        """Whether some route follows the crowd."""
        return any(route.congestion is not None for route in self.routes)

    @cached_property
    def spread(self) -> "RouteSet":
        """The routes of people that keep a distance: over the whole width of openings, as the doors stand."""
        made = (r if r.walls is None else r._replace(field=spread(r.field, r.walls)) for r in self.routes)
        return replace(self, routes=tuple(made))

    def when(self, closed: frozenset[str]) -> "RouteSet":
        """Return the routes while these doors are closed.

        Raises
        ------
        ValueError
            If this would lock people in.
        """
        if not closed:
            return self
        if closed not in self._when_closed:
            try:
                self._when_closed[closed] = self.plan.build(closed)
            except ValueError as error:
                self._when_closed[closed] = error
        found = self._when_closed[closed]
        if isinstance(found, ValueError):
            raise ValueError(str(found))
        return found

    def number(self, name: str) -> int:
        """Return the number of a route.

        Raises
        ------
        ValueError
            If it is unknown.
        """
        names = [route.name for route in self.routes]
        if name not in names:
            raise ValueError(f"unknown route {name!r}; known: {', '.join(n for n in names if '/' not in n)}")
        return names.index(name)

    def nearest(self, exits: Sequence[str], position: Floats, radius: Floats | float = 0.0) -> Ints:
        """Return for each position (K, 2) the number of the shortest of the routes to open ``exits``.

        Ways that are too narrow for bodies of ``radius`` (K,) [m] count where there is no other.
        """
        numbers = [self.number(name) for name in exits]
        numbers = [k for k in numbers if not self.routes[k].is_closed] or numbers
        size = np.broadcast_to(radius, len(position))
        times = np.stack([self.routes[k].field.travel_time_for(position, size) for k in numbers])
        stuck = ~np.isfinite(times).any(axis=0)
        if stuck.any():
            times[:, stuck] = [self.routes[k].field.travel_time_for(position[stuck], 0.0) for k in numbers]
        return np.array(numbers, dtype=np.int64)[np.argmin(np.where(np.isnan(times), np.inf, times), axis=0)]


def _check_routes(plan: RoutePlan) -> None:
    geometry = plan.geometry
    exits, regions = list(dict.fromkeys(geometry.exit_names)), list(geometry.regions)
    if len(regions) > MOST_REGIONS:
        raise ValueError(f"{len(regions)} regions; a plan may have at most {MOST_REGIONS}")

    taken = {OUT}
    for route in plan.routes:
        if route.name in taken or "/" in route.name:
            raise ValueError(f"route {route.name!r}: the name is taken or holds a '/'; take another")
        if route.name in exits and route.exits != (route.name,):
            raise ValueError(f"route {route.name!r} has the name of an exit; it must lead to that exit alone")
        taken.add(route.name)
        for name in route.exits:
            known("exit", name, exits, f"route {route.name!r} names an ")
        for name in route.stops:
            known("region", name, regions, f"route {route.name!r} names an ")
    for zone in plan.zones:
        known("region", zone.region, regions, "speed zone names an ")
    for rule in plan.rules:
        known("region", rule.region, regions, "control rule names an ")
        known("route", rule.route, [*taken, *exits], f"control rule on {rule.region!r} names an ")


def _check_doors(plan: RoutePlan) -> None:
    gates = [gate.door for gate in plan.gates]
    for name in gates:
        if gates.count(name) > 1:
            raise ValueError(f"door {name!r} has {gates.count(name)} gates; give one flow for each door")
    for name in (*plan.closed_at_start, *(event.door for event in plan.events), *gates):
        known("door", name, plan.geometry.doors)
    for event in plan.events:
        if event.region is not None:
            known("region", event.region, plan.geometry.regions, f"event of door {event.door!r} names an ")
        if event.exit is not None:
            known("exit", event.exit, plan.geometry.exit_names, f"event of door {event.door!r} names an ")


def region_masks(geometry: Geometry, points: Floats) -> Ints:
    """Return which regions ``points`` (..., 2) [m] lie in: bit k is region k of the geometry."""
    mask = np.zeros(points.shape[:-1], dtype=np.int64)
    for k, name in enumerate(geometry.regions):
        mask[geometry.contains(points, name)] |= 1 << k
    return mask


def _with_regions(route: RouteField, geometry: Geometry) -> RouteField:
    """Add to a route the regions that it leads through; one that follows the crowd names none, so no rule turns people away."""
    if route.congestion is not None:
        return route
    field = route.field
    through = regions_on_the_way(field.travel_time, field.direction, region_masks(geometry, field.nodes()))
    return route._replace(field=replace(field, through=np.asarray(through)))


def _with_time_to_exit(route: RouteField, routes: Sequence[RouteField]) -> RouteField:
    """Add to a route via regions the travel time to the exit: to the first, and from where one comes to it."""
    if route.following < 0:
        return route
    then, time = routes[route.following].potential, route.field.travel_time
    on_from = then.travel_time_near(route.field.nodes())
    on_from[np.isnan(on_from)] = np.nanmax(then.travel_time)  # where closed doors lock people in
    to_exit = replace(route.field, travel_time=time + carried_along(time, on_from), behind=then.behind)
    return route._replace(to_exit=to_exit)


def _with_regions_beyond(route: RouteField, routes: Sequence[RouteField], geometry: Geometry) -> RouteField:
    """Add to a route via a region the regions that the rest of it leads through."""
    if route.following < 0 or route.field.through is None:
        return route
    rest, inside = routes[route.following].field, 1 << route.goal
    assert rest.through is not None  # of the same strategy
    at_goal = (region_masks(geometry, rest.nodes()) & inside) > 0
    beyond = int(np.bitwise_or.reduce(rest.through[at_goal], initial=0)) & ~inside
    return route._replace(field=replace(route.field, through=route.field.through | beyond))
