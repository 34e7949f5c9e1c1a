"""A scenario is pure data: a plan, a population, a time limit and where the numbers come from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeVar

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.behaviors import BEHAVIORS, IN_WORDS
from crowd_env.core.behaviors.balance import Balancing
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.behaviors.headway import Manner
from crowd_env.core.behaviors.outline import BodyShape, Outline, room_of
from crowd_env.core.behaviors.pulls import Pulls
from crowd_env.core.checks import Plain, Positive, Range, check_fields, flag, refuse, shown
from crowd_env.core.files.fingerprint import UNSAID
from crowd_env.geometry.aprons import APRON, APRONS
from crowd_env.geometry.geometry import Geometry, turning
from crowd_env.geometry.placement import lattice
from crowd_env.routing.fields.domain import require_grid
from crowd_env.routing.fields.field import NavigationField, OneWay
from crowd_env.routing.route_set import RoutePlan, RouteSet, Target
from crowd_env.routing.spec import OUT, ControlRule, DoorEvent, Gate, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios.cohorts import People, as_people, people_of
from crowd_env.scenarios.groups import same_route
from crowd_env.scenarios.population import Population, require_names, require_room
from crowd_env.scenarios.sections import Section, require_sections

Kind = TypeVar("Kind", bound=Behavior)

# Options of every place: people, and fields of the scenario.
COMMON = ("people", "population", "time_limit", "blocked_after", "target")

_SHORTEST_LIMIT = 300.0  # s; a time limit that follows from the place is no shorter, ...
_DETOUR, _QUEUE_FLOW = (
    1.5,
    0.5,
)  # ... lets people walk this many times as far, and pass the exits at this flow, 1/(s m), ...
_ROUND = 100.0  # ... and is a multiple of this [s]
_LARGE = 40_000.0  # m2, of the box around a place
_SLOW = 0.1  # m/s, lower bound of the desired speed in this time limit
_PERHAPS_NEVER = Range(0.0, above=True, infinite=True)

# How people walk in the papers, and vanish at the exit line: `Scenario(..., **FULL_SPEED)`.
FULL_SPEED: Mapping[str, Any] = {"manner": None, "strategy": "shortest", "max_drive": np.inf, "apron": 0.0}


@dataclass(frozen=True, eq=False)
class Scenario:
    """What is evacuated; knows neither physics nor rewards.

    ``target`` is the goal of each walk: "path", the shortest path of a disc (the default); or straight to the nearest exit,
    across obstacles: to the "nearest" point that keeps the body off the jambs, to the "centre" of the door, or to the
    nearest point of its whole "width".  The straight ones are for comparison with models that have no path planning.

    ``manner`` defines how people walk before they touch, unless the run overrides it: a name in ``MANNERS``, a Headway, or a
    table of its parameters; None = at full speed, even towards people in front.  By default people keep a distance, and
    their driving force is at most a person's, and a pedestrian that is out is a body up to 2 m behind the jambs, the
    ``apron``; ``**FULL_SPEED`` gives the people of the papers, without any of these.

    ``strategy`` is how people choose their way, unless the run overrides it.  It defaults to the fastest in a place with
    several exits, or a building where ways part, and without routes, rules, one-way doors or a straight ``target``, else to
    the shortest.  A place of more than 200 m x 200 m also defaults to the shortest: there the search for the fastest way
    dominates the run time.

    ``outline`` is the shape of all bodies, unless the run overrides it: a name in ``OUTLINES``, an Outline, or a table of its
    parameters; by default they are discs.  People are placed with room to turn.

    ``pulls`` defines how groups keep together (the population defines their sizes), and what attracts people.
    ``balance`` is how standing people keep upright, unless the run overrides it: a name in ``BALANCES``, a Balance, or a
    table of its parameters; by default their drive brakes them.

    An episode ends when all are out, at the time limit, or after ``blocked_after`` seconds without an exit.  These count from
    the last exit, or at first from the shortest free walk of any person, response time included.

    Raises
    ------
    ValueError
        If the geometry has no exit, a time is not positive, people start or go somewhere that does not exist, an attraction
        is outside of the place, there are more of them than there can be room for, the plan is too large for bodies so
        small, or the manner or the outline is unknown.
    """

    name: str
    """name of the scenario; in a file by default that of the file."""
    geometry: Geometry
    """the plan: walls, exits, regions and doors."""
    population: People
    """the people, of one kind or in cohorts; in a file also what all cohorts have in common."""
    time_limit: Positive
    """s, when an evacuation ends at the latest; in a file by default enough to walk out."""
    title: str = ""
    """one line that says what the scenario is."""
    reference: str = ""
    """source of the numbers."""
    target: Target = "path"
    """what people walk to: the shortest path, or a point of the nearest exit."""
    blocked_after: Annotated[float, _PERHAPS_NEVER] = np.inf
    """s without anyone leaving after which exits count as blocked."""
    routes: tuple[Route, ...] = ()
    """routes beside those to every exit, which have its name."""
    zones: tuple[SpeedZone, ...] = ()
    """regions where people walk slower or faster."""
    rules: tuple[ControlRule, ...] = ()
    """rules that change routes while a region is crowded."""
    closed_doors: tuple[str, ...] = ()
    """names of the doors that are closed at the start."""
    door_events: tuple[DoorEvent, ...] = ()
    """events that open and close doors."""
    one_way: tuple[OneWay, ...] = ()
    """doors that people mean to pass one way only."""
    sections: tuple[Section, ...] = field(default=(), metadata={UNSAID: ()})
    """lines at which people are counted, beside doors and the narrowest passages."""
    gates: tuple[Gate, ...] = field(default=(), metadata={UNSAID: ()})
    """doors that let people through one by one, such as turnstiles."""
    comfort: Comfort = field(default_factory=Comfort)
    """costs that the most comfortable route keeps low."""
    manner: Manner | None = "hurried"
    outline: BodyShape | None = None
    strategy: str | None = None
    """how people choose their way: a strategy, or the name of a route or exit."""
    pulls: Pulls = field(default_factory=Pulls)
    balance: Balancing | None = None
    max_drive: Annotated[float, _PERHAPS_NEVER] = 300.0
    apron: Annotated[float, APRONS] = field(default=APRON, metadata={UNSAID: 0.0})
    """m behind the jambs of an exit up to which people go on being bodies; 0 = they vanish at the line."""

    def __post_init__(self) -> None:
        if self.population is None:
            refuse(f"scenario {shown(self.name)}: population", None, "a Population or a Cohorts")
        object.__setattr__(self, "population", as_people(self.population))
        for name, kind in BEHAVIORS.items():
            object.__setattr__(self, name, kind.stored(getattr(self, name)))
        check_fields(f"scenario {shown(self.name)}", self)
        if len(self.geometry.exits) == 0:
            raise ValueError(f"scenario {self.name!r} has no exit; name at least one")
        object.__setattr__(self, "geometry", self.geometry.with_apron(self.apron))
        require_grid(self.geometry, self.population.radius.low)
        for part in self.population.parts:
            require_names("start region", [part.start_region], self.geometry.regions)
            require_names("exit", part.exits, self.exits)
            require_names("route", [part.route], [*(route.name for route in self.routes), *self.exits])
            if part.wait is not None and not any(one.via and one.name == part.route for one in self.routes):
                raise ValueError("people wait in the region that their route is via: wait needs such a route")
            if part.arrivals is not None:
                part.spots(self.geometry, self.room)  # ValueError without room
        for one in self.pulls.attractions:
            if not self.geometry.contains(np.array([[one.x, one.y]]))[0]:
                raise ValueError(
                    f"scenario {self.name!r}: attraction at ({one.x:g}, {one.y:g}) is outside the walkable area"
                )
        require_room(self.geometry, self.population.parts, self.room)
        require_sections(self.sections, self.geometry)
        self.strategy_of_run()

    def behavior(self, kind: type[Kind], given: Any = None) -> Kind | None:
        """Return a behavior of people in a run with the ``given`` one; None = the scenario's.

        Raises
        ------
        ValueError
            If it is unknown.
        """
        return kind.of(getattr(self, kind.NAME) if given is None else given)

    def plain_behaviors(self) -> Plain:
        """Return name -> plain form of each behavior that is set, see `Behavior.WORDS`."""
        return {name: BEHAVIORS[name].plain_of(self.behavior(BEHAVIORS[name])) for name in IN_WORDS}

    @property
    def room(self) -> float:
        """The radius within which a body can turn freely, as a multiple of its nominal radius."""
        return room_of(self.behavior(Outline))

    def strategy_of_run(self, strategy: str | None = None) -> str:
        """Return the strategy of people in a run with this ``strategy``; None = the scenario's.

        Raises
        ------
        ValueError
            If the strategy is unknown.
        """
        strategy = self.strategy if strategy is None else strategy
        if strategy is None:
            building = self.geometry.building
            parts = building is not None and len(building.seams) >= len(building.sheets)  # ways part at stairs
            one = len(self.exits) == 1 and not parts
            said = self.routes or self.rules or self.one_way or self.target != "path" or one
            x0, y0, x1, y1 = self.geometry.bounds
            large = (x1 - x0) * (y1 - y0) > _LARGE
            return "shortest" if said or large else "fastest"
        known = (*STRATEGIES, *(route.name for route in self.routes), *self.exits)
        if not isinstance(strategy, str) or strategy not in known:
            raise ValueError(f"{self.name}: unknown strategy {shown(strategy)}; known: {', '.join(known)}")
        return strategy

    @property
    def exits(self) -> tuple[str, ...]:
        """Names of the exits; several lines may make one."""
        return tuple(dict.fromkeys(self.geometry.exit_names))

    @property
    def ways(self) -> tuple[str, ...]:
        """Names of all that people may choose among or be sent along: the exits, then the routes of other names."""
        return tuple(dict.fromkeys((*self.exits, *(route.name for route in self.routes))))

    def field(self) -> NavigationField:
        """Return the travel-time field of the shortest way out, for the largest body of the population."""
        return self.route_set(rules=False).routes[0].field

    def longest_walk(self) -> tuple[float, Floats]:
        """Return when freely walking people are out [s], and the start (2,) [m] of the last of them.

        It is the time of the slowest person at the furthest start with the latest arrival and response.
        """
        field, longest = self.field(), (0.0, np.zeros(2))
        for part in self.population.parts:
            at, time = self.walks(part, field)
            walk = float(time.max(initial=0.0)) / max(part.desired_speed.low, _SLOW) + part.response_time.high
            walk += max((route.until for route in self.routes), default=0.0)
            walk += 0.0 if part.wait is None else part.wait.high
            if part.arrivals is not None:
                walk += part.arrivals.latest(part.people)
            if walk > longest[0] and len(at):
                longest = walk, at[np.argmax(time)]
        return longest

    def walks(self, part: Population, field: NavigationField) -> tuple[Floats, Floats]:
        """Return where (K, 2) [m] people of a cohort may start, and their travel times (K,) by a field."""
        if part.starts is not None or part.arrivals is not None:
            at = part.spots(self.geometry, self.room)
            return at, field.travel_time_for(at, 0.0) - field.behind
        rows, cols = np.nonzero(np.isfinite(field.travel_time))
        at = field.origin + field.spacing * np.column_stack([cols, rows])
        time = field.travel_time[rows, cols] - field.behind
        inside = slice(None) if part.start_region is None else self.geometry.contains(at, part.start_region)
        return at[inside], time[inside]

    def with_enough_time(self) -> "Scenario":
        """Return the place with a time limit in which people can walk out and queue at the exits: at least 300 s."""
        try:
            walk, _ = self.longest_walk()
        except ValueError:  # a person cannot get out; a run reports it
            walk = 0.0
        queue = self.population.people / (_QUEUE_FLOW * sum(self.geometry.exit_widths.values()))
        limit = _ROUND * np.ceil((_DETOUR * walk + queue) / _ROUND)
        return replace(self, time_limit=max(_SHORTEST_LIMIT, float(limit)))

    def turned(self, angle: float, mirrored: bool = False) -> "Scenario":
        """Return the place as `crowd_env.geometry.geometry.turning` moves it, with starts, arrivals and attractions."""
        turn = turning(angle, mirrored)
        moved = [part.moved(turn) for part in self.population.parts]
        points = turn(np.array([(one.x, one.y) for one in self.pulls.attractions]).reshape(-1, 2))
        return replace(
            self,
            geometry=self.geometry.turned(angle, mirrored),
            population=people_of(moved),
            pulls=self.pulls.moved(points),
            sections=tuple(one.moved(turn(np.array(one.line))) for one in self.sections),
        )

    def route_set(self, strategy: str = "shortest", *, rules: bool = True, ways: bool = False) -> RouteSet:
        """Return all routes for people of this strategy, cohorts, rules and controllers; route 0 leads to any exit.

        Parameters
        ----------
        strategy : a name in `crowd_env.routing.strategies.STRATEGIES`, or that of a route or exit.
        rules : whether the control rules are in force.
        ways : whether there is a route to each exit too, by the shortest path: all `ways`.

        Raises
        ------
        ValueError
            If the strategy is unknown or a route leads nowhere.
        """
        flag("rules", rules)
        strategy, routes = self.strategy_of_run(strategy), list(self.routes)
        for part in self.population.parts:
            names = [OUT, *(route.name for route in routes)]
            routes += [route for route in self.routes_of(part, strategy) if route.name not in names]
        if ways:
            taken = [route.name for route in routes]
            routes += [Route(name, (name,)) for name in self.ways if name not in taken]
        radius = self.population.radius
        return RoutePlan(
            self.geometry,
            radius.high,
            min_radius=radius.low,
            routes=routes,
            zones=self.zones,
            rules=self.rules if rules else (),
            target=self.target,
            comfort=self.comfort,
            closed_at_start=self.closed_doors,
            events=self.door_events,
            one_way=self.one_way,
            gates=self.gates,
            walking_speed=0.5 * (self.population.desired_speed.low + self.population.desired_speed.high) or 1.0,
        ).build()

    def routes_of(self, part: Population, strategy: str) -> list[Route]:
        """Return the routes of a cohort under the strategy of the run; of several, the nearest."""
        own = {route.name: route for route in self.routes}
        if part.route is not None:
            return [own.get(part.route, Route(part.route, (part.route,)))]
        if strategy in own or strategy in self.exits:
            if not part.exits or strategy in part.exits:
                return [own.get(strategy, Route(strategy, (strategy,)))]
            return [_best_of(part.exits, "shortest")]
        if STRATEGIES[strategy].per_exit:
            return [own.get(name, Route(name, (name,))) for name in part.exits or self.exits]
        return [_best_of(part.exits, strategy)]

    def depends_on_place(self, strategy: str) -> bool:
        """Return whether the routes of people depend on their starts."""
        return any(len(self.routes_of(part, strategy)) > 1 for part in self.population.parts)

    def draw_stays(self, rng: np.random.Generator, routes: Sequence[str]) -> tuple[Floats, Floats] | None:
        """Draw how long (N,) [s] and where (N, 2) [m] people wait on these ``routes`` (N,); None if none wait."""
        halts = [route for route in self.routes if route.via is not None and (self._waits or route.until)]
        if not halts:
            return None
        lengths = (
            np.zeros(p.people) if p.wait is None else p.wait.sample(rng, p.people) for p in self.population.parts
        )
        stay, spot, taken = np.concatenate([*lengths]), np.full((len(routes), 2), np.nan), np.array(routes)
        for route in halts:
            here = np.flatnonzero(taken == route.name)
            spots = lattice(self.geometry, self.room * self.population.radius.high, route.stops[0])
            if len(spots):
                spot[here] = spots[rng.permutation(len(spots))[np.arange(len(here)) % len(spots)]]
        return stay, spot

    @property
    def has_arrivals(self) -> bool:
        """Whether some people come in during an episode."""
        return any(part.arrivals is not None for part in self.population.parts)

    @property
    def goes_on(self) -> bool:
        """Whether a crowd at rest may walk on by itself: people come in, wait, or pass gates."""
        held = self._waits or any(one.until for one in self.routes)
        return self.has_arrivals or held or bool(self.gates)

    @property
    def _waits(self) -> bool:
        return any(part.wait is not None for part in self.population.parts)

    def choose(
        self,
        route_set: RouteSet,
        strategy: str,
        position: Floats,
        radius: Floats | float = 0.0,
        group: Ints | None = None,
    ) -> Ints:
        """Return the number (K,) of the route of each person at ``position`` (K, 2).

        Bodies of ``radius`` (K,) [m] have to get through; a ``group`` (K,) takes one way.

        Raises
        ------
        ValueError
            If the cohorts have routes of their own, and there are not as many people as in all of them.
        """
        parts = self.population.parts
        if len(parts) > 1 and len(position) != self.population.people:
            raise ValueError(f"{len(position)} positions for cohorts of {self.population.people} people")
        chosen, size = np.zeros(len(position), dtype=np.int64), np.broadcast_to(radius, len(position))
        end = 0
        for part in parts:
            begin, end = end, len(position) if len(parts) == 1 else end + part.people
            names = [route.name for route in self.routes_of(part, strategy)]
            one = len(names) == 1
            chosen[begin:end] = (
                route_set.number(names[0]) if one else route_set.nearest(names, position[begin:end], size[begin:end])
            )
        return chosen if group is None else same_route(chosen, group)


def _best_of(exits: tuple[str, ...], strategy: str) -> Route:
    """Return the route to the best of these exits; () = all."""
    name = " or ".join(exits)
    if strategy == "shortest":
        return Route(name or OUT, exits)
    return Route(f"{strategy} to {name}" if name else strategy, exits, strategy=strategy)


def changed_place(place: Scenario, options: Plain) -> Scenario:
    """Return a scenario with the ``options`` that are `COMMON` to all and not None; a population brings its own people.

    Raises
    ------
    ValueError
        If one does not suit the place.
    """
    given = {name: options[name] for name in COMMON if options.get(name) is not None}
    people, crowd = given.pop("people", None), as_people(given.pop("population", None))
    if crowd is None:
        crowd = place.population if people is None else place.population.changed(people=people)
    return replace(place, **given, population=crowd)
