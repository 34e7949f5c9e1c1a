"""One decision of the headway rule in plain Python: every pair of people, every wall.  Read this one first.

It has no cells, no compiler and no shortcut; `crowd_env/physics/walking/decide.py` computes the same, fast.
"""

import math

import numpy as np
import pytest
import shapely
from cases import looped
from shapely.geometry import box
from simulations import simulate

from crowd_env import Geometry
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.core.behaviors.headway import Headway
from crowd_env.physics.workspace import BLOCK

pytestmark = pytest.mark.kernels

STILL, WALKING = 0.02, 0.25  # of the desired speed: who is slower stands, who is faster walks
MOST_IMPATIENT = 0.2  # push of those who have stood for long
FARTHEST = 8.0  # of the length D: beyond it nobody is stepped aside for
SIDES = (0.0, -0.13, 0.13, -0.27, 0.27, -0.58, 0.58)  # on which one overtakes, as a share of the way
MEETING = 0.5  # of the desired speed: above, a queue is overtaken where people come towards it
ONCOMING = -0.5  # cosine of the angle between two ways
MOST_ASIDE = 2.0  # of the way: nobody turns further than atan 2 from it


def decide(simulation, manner):
    """Return the velocity (P, 2) [m/s] that everyone wants to walk at, and for how long each has stood still (P,) [s]."""
    velocity, waited = simulation.history.walking_velocity.copy(), simulation.history.memory.manner.waited.copy()
    start = simulation.bodies.env_start
    for e in range(len(start) - 1):
        inside = [i for i in range(start[e], start[e + 1]) if simulation.state.active[i]]
        ways = {i: way_of(simulation, i) for i in inside}
        for i in inside:
            velocity[i], waited[i] = decide_one(simulation, manner, e, i, inside, ways)
    return velocity, waited


def way_of(simulation, i):
    """Return the unit vector along the way of a person, and the desired speed [m/s]."""
    control, history = simulation.batch.control, simulation.history
    way = control.command[i]
    if control.relative[i]:
        (ex, ey), (forward, left) = history.direction[i], way
        way = np.array([forward * ex - left * ey, forward * ey + left * ex])
    size = math.hypot(*way)
    return (way / size if size > 0.0 else np.zeros(2)), size * history.local_speed[i]


def decide_one(simulation, manner, e, i, inside, ways):
    """Return the velocity that person ``i`` wants, and how long that one has stood still."""
    bodies, state, waited = simulation.bodies, simulation.state, simulation.history.memory.manner.waited[i]
    way, speed = ways[i]
    if speed == 0.0 or not simulation.batch.control.gives_way[i]:
        return speed * way, waited
    time_gap, push = (
        getattr(manner, name) if np.isnan(getattr(bodies, name)[i]) else getattr(bodies, name)[i]
        for name in ("time_gap", "push")
    )
    push = max(min(push + manner.impatience * max(waited - manner.patience, 0.0), MOST_IMPATIENT), push)
    seen = [j for j in inside if j != i and sees(simulation, manner, e, i, j, way)]
    left = np.array([-way[1], way[0]])
    aside = sum(step_aside(simulation, manner, i, j, left, ways) for j in seen)
    sidestep, passes = overtake(simulation, manner, time_gap, i, seen, ways, e)
    aside += sidestep
    if manner.off_walls:
        free = [min(gap_to_walls(simulation, e, i, side), manner.off_walls) for side in (left, -left)]
        aside += manner.shyness * (free[0] - free[1]) / manner.off_walls
    heading = turned(way, np.clip((1.0 - push) * aside, -MOST_ASIDE, MOST_ASIDE))
    behind, leader = speed_behind(simulation, manner, time_gap, manner.width, i, heading, seen, ways, passes)
    # The push grows from `patience` on, sooner against those who come the other way, and falls back when one walks again.
    pace = state.velocity[i] @ way
    if pace < STILL * speed:
        against = max(-way @ ways[leader][0], 0.0) if behind < speed else 0.0
        waited += manner.interval * (1.0 + manner.oncoming * against)
    elif pace > WALKING * speed:
        waited = max(min(waited, manner.patience + MOST_IMPATIENT / manner.impatience) - manner.interval, 0.0)
    return np.clip(behind, push * speed, speed) * heading, waited


def gap_to(simulation, i, j):
    """Return the gap [m] between two bodies."""
    position, radius = simulation.state.position, simulation.bodies.radius
    return math.dist(position[i], position[j]) - radius[i] - radius[j]


def sees(simulation, manner, e, i, j, way):
    """Whether ``j`` is ahead of ``i``, near enough, and not behind a wall or a closed door."""
    position, place = simulation.state.position, simulation.geometries[simulation.world.geometry_of_env[e]]
    closed = [name for k, name in enumerate(place.doors) if not simulation.history.door_open[e, k]]
    walls, _ = place.walls_when(closed)
    sight = shapely.LineString([position[i], position[j]])
    return (
        gap_to(simulation, i, j) < manner.sight
        and (position[j] - position[i]) @ way > 0.0
        and not shapely.intersects(shapely.linestrings(walls), sight).any()
    )


def step_aside(simulation, manner, i, j, left, ways):
    """Return how far ``i`` steps aside for ``j``, as a share of the way: to the left where it is positive."""
    position, velocity = simulation.state.position, simulation.state.velocity
    away = position[j] - position[i]
    closing = (velocity[i] - velocity[j]) @ away / math.hypot(*away)
    foreseen = max(gap_to(simulation, i, j) - manner.anticipation * closing, 0.0)
    if foreseen > FARTHEST * manner.length:
        return 0.0
    oncoming = max(-ways[i][0] @ ways[j][0], 0.0)
    size = manner.strength * (1.0 + manner.oncoming * oncoming) * math.exp(-foreseen / manner.length)
    will_be = away + manner.anticipation * velocity[j]
    return size if will_be @ left < -manner.keep_right * oncoming else -size  # straight ahead: to the right


def overtake(simulation, manner, time_gap, i, seen, ways, e):
    """Return how far to step aside, as a share of the way, to pass someone slower who is not held up; and whether one does."""
    way, speed = ways[i]
    behind, leader = speed_behind(simulation, manner, time_gap, manner.width, i, way, seen, ways)
    if behind >= speed:
        return 0.0, False
    pace, wanted = simulation.state.velocity[leader] @ way, ways[leader][1]
    meets = any(ways[j][0] @ way < ONCOMING for j in seen)
    if wanted and pace < min(manner.overtaking, MEETING if meets else math.inf) * wanted:
        return 0.0, False
    paces = {None: behind + manner.gain * speed}
    for aside in SIDES if manner.keep_right >= 0.0 else [-side for side in SIDES]:
        heading = turned(way, aside)
        behind, _ = speed_behind(simulation, manner, time_gap, manner.berth, i, heading, seen, ways, passes=True)
        to_wall = gap_to_walls(simulation, e, i, heading)
        paces[aside] = min(behind, to_wall / time_gap, speed) * (heading @ way)
    best = max(paces, key=paces.__getitem__)  # the first of equal ones
    return best or 0.0, best is not None


def gap_to_walls(simulation, e, i, heading):
    """Return the gap [m] to the first wall or door, open or not, along a heading."""
    walls = simulation.geometries[simulation.world.geometry_of_env[e]].walls
    start = simulation.state.position[i]
    hits = shapely.intersection(shapely.linestrings(walls), shapely.LineString([start, start + 100.0 * heading]))
    distance = shapely.distance(hits[~shapely.is_empty(hits)], shapely.Point(start))
    return distance.min(initial=math.inf) - simulation.bodies.radius[i]


def turned(way, aside):
    """Return the unit vector ``aside`` to the left of a way."""
    heading = way + aside * np.array([-way[1], way[0]])
    return heading / math.hypot(*heading)


def speed_behind(simulation, manner, time_gap, width, i, heading, seen, ways, passes=False):
    """Return the least speed [m/s] that anyone in the strip along a heading allows, infinite if nobody is, and who that is.

    Those beside the strip count unless one passes.
    """
    speeds = {}
    for j in seen:
        same = max(ways[i][0] @ ways[j][0], 0.0)
        onward = max(simulation.state.velocity[j] @ heading, 0.0)
        room = gap_to(simulation, i, j) + same * (manner.anticipation * onward - manner.standing)
        if is_in_front(simulation, width, i, j, heading, ways):
            speeds[j] = room / (time_gap + same * manner.anticipation)
        elif (
            not passes
            and manner.beside
            and same
            and (beyond := beside(simulation, width, i, j, heading, ways)) is not None
        ):
            following = room / (time_gap + same * manner.anticipation)
            hurry = (time_gap / 0.5) ** 2
            speeds[j] = max(following, beyond / (same * manner.beside * hurry), manner.keep_up * onward)
    leader = min(speeds, key=speeds.__getitem__, default=None)
    return (math.inf if leader is None else max(speeds[leader], 0.0)), leader


def is_in_front(simulation, width, i, j, heading, ways):
    """Whether the body of ``j`` overlaps the strip along the heading of ``i``, and ``j`` does not give way to ``i``."""
    away, width = (
        simulation.state.position[j] - simulation.state.position[i],
        width * simulation.bodies.radius[[i, j]].sum(),
    )
    if away @ heading <= 0.0 or abs(cross(heading, away)) >= width:
        return False
    mine, other = ways[i][0], ways[j][0]
    gives_way = mine @ other > 0.0 and -away @ other > away @ mine and abs(cross(other, away)) < width
    return not (gives_way and simulation.batch.control.gives_way[j])


def beside(simulation, width, i, j, heading, ways):
    """Return how far [m] the strip of ``i`` misses the body of ``j``; None if it does not, or ``i`` is further ahead."""
    away = simulation.state.position[j] - simulation.state.position[i]
    beyond = abs(cross(heading, away)) - width * simulation.bodies.radius[[i, j]].sum()
    gives_way = -away @ ways[j][0] > away @ ways[i][0] and simulation.batch.control.gives_way[j]
    return None if away @ heading <= 0.0 or beyond < 0.0 or gives_way else beyond


def cross(a, b):
    """Return the third component of the cross product of two vectors in the plane."""
    return a[0] * b[1] - a[1] * b[0]


# ------------------------------------------------------------------------------------------------------------ comparison

HALL = Geometry.from_polygon(
    box(0, 0, 8, 6),
    obstacles=[box(3, 2.5, 4, 3.5)],
    thin_walls=[[(1.5, 0), (1.5, 2), (2.2, 2.6)], [(6, 0), (6, 2)], [(6, 4), (6, 6)]],
    doors={"middle": [(6, 2), (6, 4)], "pillar": [(4, 3), (6, 3.9)]},
)
YARD = Geometry.from_polygon(box(-20, -20, 20, 20), thin_walls=[[(3, 1), (3, 5)]])


def crowd(rng, manner, counts=(40, 17, 25), **options):
    """Return people in two halls and a yard, who move and want to go every way; some overlap, some are out."""
    count, starts = sum(counts), np.cumsum([0, *counts])
    bodies = make_bodies(
        rng.uniform(0.15, 0.25, count),
        np.full(count, 70.0),
        desired_speed=rng.uniform(0.8, 1.6, count),
        time_gap=np.where(rng.random(count) < 0.5, np.nan, rng.uniform(0.3, 2.0, count)),
        push=np.where(rng.random(count) < 0.5, np.nan, rng.uniform(0.0, 1.0, count)),
        env_start=starts,
    )
    state = make_state(
        rng.uniform((0.3, 0.3), (7.7, 5.7), (count, 2)), rng.normal(0.0, 0.7, (count, 2)), environments=3
    )
    state.velocity[rng.random(count) < 0.3] *= 0.01
    state.active[rng.random(count) < 0.1] = False
    simulation = simulate(
        [HALL, YARD], bodies, state, manner=manner, fields=[None, None], geometry_of_env=np.array([0, 0, 1]), **options
    )
    simulation.close_doors(0, ["middle"])
    simulation.close_doors(1, ["pillar"])
    angle = rng.uniform(0.0, 2.0 * math.pi, count)
    simulation.history.direction[:] = np.column_stack([np.cos(angle), np.sin(angle)])
    simulation.history.directions_known[:] = True
    simulation.history.memory.manner.waited[:] = rng.uniform(0.0, 2.0 * manner.patience, count)
    command = rng.normal(0.0, 0.7, (count, 2))
    command[rng.random(count) < 0.1] = 0.0
    return simulation, {"command": command, "relative": rng.random(count) < 0.5, "gives_way": rng.random(count) < 0.9}


def expected_after(simulation, manner, command, relative, gives_way):
    """Return what people decide who are asked for this now."""
    control = simulation.batch.control
    control.command[:], control.relative[:], control.gives_way[:] = command, relative, gives_way
    return decide(simulation, manner)


MANNERS = [
    Headway(
        time_gap=0.8, push=0.0, width=0.86, strength=0.2, length=0.1, oncoming=8.0, anticipation=0.5, overtaking=0.4,
        gain=0.1, berth=1.3, patience=5.0,
        impatience=0.02, sight=2.0, interval=0.05,
    ),
    Headway(
        time_gap=0.5, push=0.3, width=1.0, strength=1.0, length=0.4, oncoming=1.0, anticipation=0.0, overtaking=0.0,
        gain=0.0, berth=0.9, patience=0.4,
        impatience=0.5, sight=0.7, interval=0.03,
    ),
    Headway(
        time_gap=0.3, width=0.8, strength=0.12, beside=0.2, keep_up=0.7, off_walls=0.3, shyness=0.5, interval=0.05,
    ),
]  # fmt: skip


@pytest.mark.parametrize("manner", MANNERS, ids=["alert", "blunt", "wide"])
@looped("seed", range(3), quick=1)
def test_a_decision_is_the_rule_written_plainly(manner, seed):
    simulation, asked = crowd(np.random.default_rng(seed), manner, scheme="dem")
    velocity, waited = expected_after(simulation, manner, **asked)
    inside = simulation.state.active.copy()
    simulation.advance(**asked)
    np.testing.assert_allclose(simulation.history.walking_velocity[inside], velocity[inside], rtol=0, atol=1e-12)
    np.testing.assert_allclose(simulation.history.memory.manner.waited[inside], waited[inside], rtol=0, atol=1e-12)
    # The crowd has to hold what it is meant to test.
    wanted = np.hypot(*asked["command"].T) * simulation.bodies.desired_speed
    at_full_speed = np.abs(np.hypot(*velocity.T) - wanted) < 1e-9
    assert (inside & at_full_speed & (wanted > 0.0)).sum() > 5
    assert (inside & ~at_full_speed).sum() > 5


@looped("seed", range(2), quick=1)
def test_who_looks_at_more_people_than_are_looked_at_together_decides_alike(seed):
    rng = np.random.default_rng(seed)
    manner = Headway(time_gap=0.3, width=0.3, strength=0.03, length=1.0, berth=0.4, beside=0.02, sight=9.0)
    simulation, asked = crowd(rng, manner, counts=(1, 1, 2 * BLOCK), scheme="dem")
    control = simulation.batch.control
    for name, values in asked.items():
        getattr(control, name)[:] = values
    inside = [i for i in range(2, 2 + 2 * BLOCK) if simulation.state.active[i]]
    ways = {i: way_of(simulation, i) for i in inside}
    numbers = {i: sum(sees(simulation, manner, 2, i, j, ways[i][0]) for j in inside if j != i) for i in inside[::6]}
    asked_of = sorted(numbers, key=numbers.__getitem__)[-4:]
    assert numbers[asked_of[0]] > BLOCK
    expected = [decide_one(simulation, manner, 2, i, inside, ways) for i in asked_of]
    simulation.advance(**asked)
    velocity = simulation.history.walking_velocity[asked_of]
    np.testing.assert_allclose(velocity, [velocity for velocity, _ in expected], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        simulation.history.memory.manner.waited[asked_of], [waited for _, waited in expected], rtol=0, atol=1e-12
    )
    assert np.ptp(np.hypot(*velocity.T)) > 0.1


def test_people_decide_at_every_interval_and_keep_to_it_in_between():
    manner = MANNERS[0]
    simulation, asked = crowd(np.random.default_rng(7), manner, scheme="dem", dt=0.01)
    inside = simulation.state.active
    for _ in range(3):
        velocity, _ = expected_after(simulation, manner, **asked)
        for _ in range(5):
            simulation.advance(**asked)
            np.testing.assert_allclose(
                simulation.history.walking_velocity[inside], velocity[inside], rtol=0, atol=1e-11
            )


def test_no_way_no_wish():
    manner = MANNERS[0]
    simulation, asked = crowd(np.random.default_rng(1), manner, scheme="dem")
    nobody = np.zeros_like(asked["command"])
    simulation.advance(nobody)
    assert not simulation.history.walking_velocity.any()
    simulation.history.direction[:] = 0.0  # as where no way leads out
    simulation.history.have_decided[:] = False
    simulation.advance()
    assert not simulation.history.walking_velocity.any()
