"""Places without end: a seed draws a plan, its people, and their physics and manner, always the same.

Ten kinds of places: a room with one to four doors, a room before a passage, a corridor with a door at its end, a corner, a
room with pillars, rooms behind rooms, rooms on a corridor, streams that merge, cross, and meet.  Doors are 0.6 to 2.4 m wide,
in one place of four no wider than two bodies.  One exit of several may shut in mid-run.  10 to 400 people have desired speeds
of 0.6 to 2.5 m/s and radii of 0.15 to 0.3 m, and respond at once or late.  Places are turned by any angle, half of them
mirrored.  A place is as large as its people need: they start at 0.2 to 2 /m2.  `conditions_of` returns contact law and manner.

An eleventh kind is drawn only where it is asked for: a ``building`` of one to five storeys, with a stair at one end or both.

`VERSION` goes up where a seed draws another place: results of training and evaluation in these places name it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Range, known, whole
from crowd_env.geometry.geometry import Geometry, turning
from crowd_env.routing.route_set import Target
from crowd_env.routing.spec import DoorEvent
from crowd_env.scenarios.buildings import building
from crowd_env.scenarios.cohorts import People, people_of
from crowd_env.scenarios.distributions import LogNormal, Normal, Uniform
from crowd_env.scenarios.file import Line
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario, changed_place
from crowd_env.scenarios.shapes import circle, rectangle
from crowd_env.scenarios.shipped.office import Office

VERSION = 2
SEEDS = Range(0, 2**62)
LAWS = ("dem", "nsm1", "nsm2", "hertz")
MANNERS = ("competitive", "hurried")

_FEWEST, _MOST = 10, 400  # people
_NARROWEST = 0.6  # m
_COVER = 0.3  # share of the floor that bodies cover at the start, at most
_WALL = 0.2  # m, between two rooms
_SPARSEST, _LONGEST = 0.6, 30.0  # 1/m2 and m of a stream at the start: thinner ones never meet
_LEAST_FLOW = 0.25  # people a second and meter of exits: the time limit covers no slower crowd
_FREE_FLOW = 1.3  # the same of a calm crowd (Seyfried et al. 2009 measure 1.2 to 1.8): an exit shuts before all are out
_ADULTS = Normal(1.34, 0.26, 0.6, 2.1)  # m/s (Weidmann 1993)
_ALL_AGES = Uniform(0.6, 2.0)  # m/s


class Conditions(NamedTuple):
    """Conditions of a place beside the plan and the people: contact law, manner, and observation noise."""

    law: str  #: of contacts, one of `LAWS`
    manner: str  #: one of `MANNERS`
    noise: float  #: standard deviation of noise on every number that a policy sees, which lie in [-1, 1]
    delay: float = 0.0  #: s, until a decision takes effect


class _People(NamedTuple):
    """The people, before their positions are drawn."""

    number: int
    density: float  # 1/m2, at the start
    fields: dict[str, Any]  # of a Population
    body: float  # m, diameter of the largest
    door: float  # m, width of the narrowest door
    widest: float  # m, width of the widest door

    @property
    def area(self) -> float:
        """Floor that the people need at the start [m2]."""
        return self.number / self.density


class _Plan(NamedTuple):
    """The drawing of a place, in its own axes: shapes are rows of corners (K, 2) [m]."""

    about: str
    walkable: Sequence[Floats]
    exits: Mapping[str, Line]  # name -> its ends
    starts: Mapping[str, Floats]  # name of the region -> its corners
    routes: Mapping[str, str] = {}  # region -> exit of the people that start there
    obstacles: Sequence[Floats] = ()
    office: Office | None = None  # a building; the exits above are the widths of its ways alone


class _Turn(NamedTuple):
    """How a place is moved."""

    angle: float
    mirrored: bool
    shift: Floats  # (2,) m

    def moved(self, shape: ArrayLike) -> Floats:
        """Return a shape in its place, in whole millimeters before the turn."""
        return turning(self.angle, self.mirrored)(np.round(np.asarray(shape), 3)) + self.shift


def draw_place(
    *,
    seed: int = 0,
    kind: str | None = None,
    people: int | None = None,
    population: People | None = None,
    time_limit: float | None = None,
    blocked_after: float | None = None,
    target: Target | None = None,
) -> Scenario:
    """Return the place of a ``seed``; of one ``kind`` (a name in `KINDS`) if that is given.

    Raises
    ------
    ValueError
        If the seed is out of range or the kind is unknown, or for what `changed_place` refuses in other options.
    """
    seed = whole("generated: seed", seed, SEEDS)
    rng = np.random.default_rng((VERSION, seed))
    drawn = list(KINDS)[int(rng.integers(len(KINDS)))]
    drawn = drawn if kind is None else known("kind of place", kind, ALL_KINDS)
    crowd = _draw_people(rng)
    plan = ALL_KINDS[drawn](rng, crowd)
    turn = _turn(rng)
    about, widths = plan.about, {name: float(np.hypot(*np.diff(line, axis=0)[0])) for name, line in plan.exits.items()}
    shuts: list[DoorEvent] = []
    if len(widths) > 1 and not plan.routes and rng.random() < 0.3:
        shuts = [DoorEvent(str(rng.choice(list(widths))), False, at=_shutting(rng, crowd.number, sum(widths.values())))]
        about += f", {shuts[0].door} shuts after {shuts[0].at:g} s"
    geometry = _geometry(plan, turn, [one.door for one in shuts])
    shares = np.full(len(plan.starts), crowd.number // len(plan.starts))
    shares[: crowd.number % len(plan.starts)] += 1
    cohorts = [
        Population(int(n), start_region=name, route=plan.routes.get(name), name=name, **crowd.fields)
        for n, name in zip(shares, plan.starts, strict=True)
        if n > 0
    ]
    slow, late = crowd.fields["desired_speed"].low, crowd.fields["response_time"].high
    walk = 2.0 * np.ptp(shapely.get_coordinates(geometry.walkable), axis=0).sum() / slow
    queue = crowd.number / (_LEAST_FLOW * (sum(widths.values()) - sum(widths[one.door] for one in shuts)))
    place = Scenario(
        "generated-v0",
        geometry,
        people_of(cohorts),
        float(np.ceil(60.0 + walk + queue + late)),
        f"place {seed}: {about}",
        f"drawn by version {VERSION} of crowd_env.scenarios.generated from the seed {seed}",
        **{**FULL_SPEED, "strategy": None, "blocked_after": 30.0 + late, "door_events": tuple(shuts)},
    )
    given = {"people": people, "population": population, "time_limit": time_limit}
    return changed_place(place, {**given, "blocked_after": blocked_after, "target": target})


def _geometry(plan: _Plan, turn: _Turn, doors: Sequence[str]) -> Geometry:
    """Return the geometry of a plan; ``doors`` are exits that shut."""
    if plan.office is not None:
        return building(plan.office.levels(), plan.office.stairs()).turned(turn.angle, turn.mirrored)
    # In whole millimeters, and before the turn, so that touching shapes still touch.
    floor = shapely.union_all(shapely.polygons([np.round(shape, 3) for shape in plan.walkable]))
    return Geometry.from_polygon(
        shapely.transform(floor, turn.moved),
        exits={name: turn.moved(line) for name, line in plan.exits.items()},
        doors={name: name for name in doors},
        obstacles=[turn.moved(shape) for shape in plan.obstacles],
        regions={name: turn.moved(shape) for name, shape in plan.starts.items()},
    )


def kind_of(seed: int) -> str:
    """Return the kind of the place of a seed, a name in `KINDS`."""
    return list(KINDS)[int(np.random.default_rng((VERSION, seed)).integers(len(KINDS)))]


def conditions_of(seed: int) -> Conditions:
    """Return the conditions of the place of a seed.

    Each law is as frequent.  One crowd in five keeps a distance.  One in four sees noise, one in four decides late.
    """
    rng = np.random.default_rng((VERSION, seed, 1))
    law, manner = LAWS[int(rng.integers(len(LAWS)))], MANNERS[int(rng.random() < 0.2)]
    noise = float(rng.uniform(0.0, 0.1) * (rng.random() < 0.25))
    return Conditions(law, manner, noise, int(rng.integers(1, 5) * (rng.random() < 0.25)) / 10.0)


def _draw_people(rng: np.random.Generator) -> _People:
    """Draw the people: adults of one size or several, with one desired speed or one each, and how wide their doors are."""
    people = round(_FEWEST * (_MOST / _FEWEST) ** rng.random())
    radius = rng.uniform(0.15, 0.25)
    bodies = Uniform(radius, radius + rng.choice([0.0, 0.05]))
    speed = rng.uniform(0.8, 2.5)
    own = Normal(speed, 0.15 * speed, 0.7 * speed, 1.3 * speed)
    kind = int(rng.choice(4, p=[0.35, 0.35, 0.15, 0.15]))
    fields = {
        "radius": bodies,
        "desired_speed": (Uniform(speed, speed), own, _ADULTS, _ALL_AGES)[kind],
        "relaxation_time": Uniform(0.1, 0.5) if rng.random() < 0.5 else Uniform(0.5, 0.5),
        "response_time": LogNormal(3.0, 0.5, 12.0) if rng.random() < 0.25 else Uniform(0.0, 0.0),
    }
    density = min(np.exp(rng.uniform(np.log(0.2), np.log(2.0))), _COVER / (np.pi * bodies.high**2))
    body = 2.0 * bodies.high
    return _People(people, float(density), fields, body, _NARROWEST, 2.0 * body if rng.random() < 0.25 else np.inf)


def _shutting(rng: np.random.Generator, people: int, width: float) -> float:
    """Draw when an exit shuts [s]: after 2 s, while pedestrians still leave through exits of this width [m] in all."""
    return round(float(rng.uniform(2.0, 3.0 + 0.7 * people / (_FREE_FLOW * width))), 1)


def _turn(rng: np.random.Generator) -> _Turn:
    """Draw how a place is turned, by any angle, half of all mirrored, and moved."""
    angle, mirror, shift = rng.uniform(0.0, 2.0 * np.pi), rng.choice([-1.0, 1.0]), rng.uniform(-20.0, 20.0, 2)
    return _Turn(float(angle), bool(mirror < 0.0), shift)


def _width(rng: np.random.Generator, people: _People, most: float = 2.4) -> float:
    """Draw the width of a door: the largest bodies fit through."""
    least = max(people.door, people.body + 0.05)
    return float(np.exp(rng.uniform(np.log(least), np.log(max(min(most, people.widest), least)))))


def _room(rng: np.random.Generator, people: _People, floor: float = 1.0) -> tuple[float, float]:
    """Draw length and depth of a room that is ``floor`` times as large as its people need, and no side below 3 m."""
    area, aspect = max(floor * people.area, 9.0), np.exp(rng.uniform(-0.7, 0.7))
    length = max(np.sqrt(area * aspect), 3.0)
    return float(length), float(max(area / length, 3.0))


def _opening(rng: np.random.Generator, length: float, width: float) -> tuple[float, float]:
    """Draw where in a wall of this length a door begins and ends, 0.1 m or more off its ends."""
    begin = rng.uniform(0.1, max(length - width - 0.1, 0.1))
    return float(begin), float(begin + width)


def _doors_of(rng: np.random.Generator, people: _People, length: float, depth: float, number: int) -> dict[str, Line]:
    """Draw exits of a room, each in a wall of its own."""
    exits = {}
    for side in rng.permutation(4)[:number]:
        wall = length if side % 2 == 0 else depth
        a, b = _opening(rng, wall, min(_width(rng, people), wall - 0.3))
        line = [[(a, 0.0), (b, 0.0)], [(length, a), (length, b)], [(a, depth), (b, depth)], [(0.0, a), (0.0, b)]]
        exits[("south", "east", "north", "west")[side]] = line[side]
    return exits


def _doors(rng: np.random.Generator, people: _People) -> _Plan:
    """A room with one to four doors; everyone anywhere in it."""
    length, depth = _room(rng, people)
    exits = _doors_of(rng, people, length, depth, int(rng.choice([1, 2, 3, 4], p=[0.55, 0.25, 0.1, 0.1])))
    room = rectangle(0.0, 0.0, length, depth)
    return _Plan(f"a room of {length:.1f} x {depth:.1f} m, {len(exits)} exits", [room], exits, {"room": room})


def _bottleneck(rng: np.random.Generator, people: _People) -> _Plan:
    """A room that leads into a corridor with the exit at its end."""
    length, depth = _room(rng, people)
    low, high = _opening(rng, depth, _width(rng, people))
    end = length + rng.uniform(0.5, 6.0)
    room, passage = rectangle(0.0, 0.0, length, depth), rectangle(length, low, end, high)
    about = f"a room before a passage {high - low:.2f} m wide"
    return _Plan(about, [room, passage], {"end": [(end, low), (end, high)]}, {"room": room})


def _corridor(rng: np.random.Generator, people: _People) -> _Plan:
    """A corridor with a door at its end; half of the crowds, and all too large for it, start in a room before it."""
    width, (length, depth) = float(rng.uniform(1.2, 4.0)), _room(rng, people)
    room = rng.random() < 0.5 or people.area > _LONGEST * width
    end = rng.uniform(3.0, 12.0) if room else people.area / width + rng.uniform(1.0, 10.0)
    begin, low = _opening(rng, width, min(_width(rng, people), width - 0.3)), rng.uniform(0.0, max(depth - width, 0.0))
    shapes = [rectangle(0.0, 0.0, end, width)]
    starts = {"corridor": rectangle(0.0, 0.0, people.area / width, width)}
    if room:
        starts = {"room": rectangle(-length, -low, 0.0, max(depth, width) - low)}
        shapes += starts.values()
    about = f"a corridor {width:.1f} m wide with a door at its end"
    return _Plan(about, shapes, {"end": [(end, begin[0]), (end, begin[1])]}, starts)


def _corner(rng: np.random.Generator, people: _People) -> _Plan:
    """A corridor with a corner."""
    width = max(rng.uniform(1.2, 4.0), people.area / _LONGEST)
    arm, out = people.area / width, width + rng.uniform(3.0, 10.0)
    first, second = rectangle(0.0, 0.0, arm + width + 1.0, width), rectangle(arm + 1.0, 0.0, arm + 1.0 + width, out)
    exits = {"end": [(arm + 1.0, out), (arm + 1.0 + width, out)]}
    return _Plan(
        f"a corridor of {width:.1f} m with a corner", [first, second], exits, {"arm": rectangle(0.0, 0.0, arm, width)}
    )


def _pillars(rng: np.random.Generator, people: _People) -> _Plan:
    """A room with round pillars, and room to pass between them."""
    length, depth = _room(rng, people, 1.3)
    exits, pillars = _doors_of(rng, people, length, depth, int(rng.integers(1, 3))), []
    middles = np.mean([*exits.values()], axis=1)
    placed: list[tuple[Floats, float]] = []
    for _ in range(12):
        radius = rng.uniform(0.15, 0.6)
        free = radius + 2.0 * people.body
        if 2.0 * free >= min(length, depth):
            continue
        at = np.array([rng.uniform(free, length - free), rng.uniform(free, depth - free)])
        if np.hypot(*(middles - at).T).min() < free + 0.3 or any(
            np.hypot(*(at - other)) < free + size for other, size in placed
        ):
            continue
        pillars.append(circle(at[0], at[1], radius, 16))
        placed.append((at, radius))
        if len(placed) == 6:
            break
    room = rectangle(0.0, 0.0, length, depth)
    about = f"a room of {length:.1f} x {depth:.1f} m with {len(pillars)} pillars"
    return _Plan(about, [room], exits, {"room": room}, obstacles=pillars)


def _row_of_rooms(rng: np.random.Generator, people: _People) -> _Plan:
    """Rooms one behind the other, the exit in the last."""
    number, (length, depth) = int(rng.integers(2, 5)), _room(rng, people)
    each = max(length / number, 2.5)
    shapes, starts, left = [], {}, 0.0
    for k in range(number):
        shapes.append(rectangle(left, 0.0, left + each, depth))
        starts[f"room-{k}"] = shapes[-1]
        low, high = _opening(rng, depth, min(_width(rng, people), depth - 0.3))
        left += each + _WALL
        if k < number - 1:
            shapes.append(rectangle(left - _WALL, low, left, high))
    exits = {"end": [(left - _WALL, low), (left - _WALL, high)]}
    return _Plan(f"{number} rooms one behind the other", shapes, exits, starts)


def _rooms_on_a_corridor(rng: np.random.Generator, people: _People) -> _Plan:
    """Rooms on both sides of a corridor with an exit at one end or both."""
    number, width = int(rng.integers(2, 5)), rng.uniform(1.5, 3.0)
    side = max(np.sqrt(people.area / (2 * number)), 2.5)
    end = number * (side + _WALL) - _WALL
    shapes, starts = [rectangle(0.0, 0.0, end, width)], {}
    for k in range(2 * number):
        left, up = (k // 2) * (side + _WALL), k % 2 == 0
        low, high = _opening(rng, side, min(_width(rng, people, 1.6), side - 0.3))
        wall = (width, width + _WALL) if up else (-_WALL, 0.0)
        floor = (wall[1], wall[1] + side) if up else (wall[0] - side, wall[0])
        shapes += [
            rectangle(left, floor[0], left + side, floor[1]),
            rectangle(left + low, wall[0], left + high, wall[1]),
        ]
        starts[f"room-{k}"] = shapes[-2]
    exits = {"east": [(end, 0.0), (end, width)], "west": [(0.0, 0.0), (0.0, width)]}
    if rng.random() < 0.5:
        del exits["west"]
    return _Plan(f"{2 * number} rooms on a corridor of {width:.1f} m", shapes, exits, starts)


def _streams(rng: np.random.Generator, people: _People) -> tuple[float, float]:
    """Return width [m] and length [m] of where each of two streams starts: at 0.6 to 1.2 /m2, and 30 m long at most."""
    area = people.number / min(max(people.density, _SPARSEST), 1.2) / 2.0
    width = max(rng.uniform(2.0, 5.0), area / _LONGEST)
    return width, area / width


def _merging(rng: np.random.Generator, people: _People) -> _Plan:
    """Two streams meet and go on as one."""
    width, arm = _streams(rng, people)
    half, far, out = width / 2, width / 2 + 1.0, width + rng.uniform(3.0, 8.0)
    shapes = [rectangle(-far - arm, 0.0, far + arm, width), rectangle(-half, 0.0, half, out)]
    starts = {"left": rectangle(-far - arm, 0.0, -far, width), "right": rectangle(far, 0.0, far + arm, width)}
    exits = {"end": [(-half, out), (half, out)]}
    return _Plan(f"two streams merge in corridors of {width:.1f} m", shapes, exits, starts)


def _crossing(rng: np.random.Generator, people: _People) -> _Plan:
    """Two streams cross at right angles."""
    width, arm = _streams(rng, people)
    half, far, out = width / 2, width / 2 + 1.0, width / 2 + rng.uniform(3.0, 8.0)
    shapes = [rectangle(-far - arm, -half, out, half), rectangle(-half, -far - arm, half, out)]
    starts = {"west": rectangle(-far - arm, -half, -far, half), "south": rectangle(-half, -far - arm, half, -far)}
    exits = {"east": [(out, -half), (out, half)], "north": [(-half, out), (half, out)]}
    routes = {"west": "east", "south": "north"}
    return _Plan(f"two streams cross in corridors of {width:.1f} m", shapes, exits, starts, routes)


def _counter_flow(rng: np.random.Generator, people: _People) -> _Plan:
    """Two streams walk towards each other in a corridor."""
    width, arm = _streams(rng, people)
    length = 2.0 * arm + rng.uniform(3.0, 12.0)
    starts = {
        "left": rectangle(0.5, 0.0, arm + 0.5, width),
        "right": rectangle(length - arm - 0.5, 0.0, length - 0.5, width),
    }
    exits = {"west": [(0.0, 0.0), (0.0, width)], "east": [(length, 0.0), (length, width)]}
    about = f"two streams meet in a corridor of {width:.1f} m"
    return _Plan(about, [rectangle(0.0, 0.0, length, width)], exits, starts, {"left": "east", "right": "west"})


def _building(rng: np.random.Generator, people: _People) -> _Plan:
    """An office building of one to five storeys, a stair and an exit at one end or both."""
    storeys, ends = int(rng.integers(1, 6)), ("west", "east")[: int(rng.integers(1, 3))]
    corridor, depth, rooms = rng.uniform(1.5, 3.0), rng.uniform(4.0, 8.0), int(rng.integers(1, 5))
    length = max(people.area / storeys / (2.0 * depth + corridor), 3.0 * rooms, 8.0)
    door, out = _width(rng, people, 1.6), _width(rng, people)
    stair = float(rng.uniform(max(1.0, 2.0 * people.body), 2.0))
    office = Office(
        storeys,
        0.35 * int(rng.integers(8, 13)),
        float(length),
        corridor,
        depth,
        rooms,
        door,
        stair,
        min(out, 2.0),
        ends,
    )
    way = min(office.exit, stair) if storeys > 1 else office.exit
    exits = {end: [(0.0, 0.0), (way, 0.0)] for end in ends}
    about = f"a building of {storeys} storeys, {len(ends)} stairs of {stair:.1f} m"
    return _Plan(about, [], exits, dict.fromkeys(office.names, np.empty((0, 2))), office=office)


KINDS: Mapping[str, Callable[[np.random.Generator, _People], _Plan]] = {
    "doors": _doors,
    "bottleneck": _bottleneck,
    "corridor": _corridor,
    "corner": _corner,
    "pillars": _pillars,
    "row of rooms": _row_of_rooms,
    "rooms on a corridor": _rooms_on_a_corridor,
    "merging": _merging,
    "crossing": _crossing,
    "counter-flow": _counter_flow,
}
# Beside them, kinds that are drawn only where they are asked for.
ALL_KINDS: Mapping[str, Callable[[np.random.Generator, _People], _Plan]] = {**KINDS, "building": _building}
