"""The crowds that are measured, the same for every scheme and every other program: places, people and where they stand."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env import (
    DEM,
    Bodies,
    Geometry,
    Normal,
    Population,
    Scenario,
    Simulation,
    Uniform,
    make_scenario,
    make_state,
)
from crowd_env.physics.settings import Physics

Floats = NDArray[np.float64]

JAM_DENSITY = 6.0  # 1/m2
HALL_DENSITY = 1.33  # 1/m2
_MARGIN = 0.2  # m between the walls and the centers of a jam
_JITTER = 0.15  # m
_CALM_STEPS = 250
_TOUCH = 1e-3  # m    bodies nearer than this touch


class Scene(NamedTuple):
    """One place with its people at the start, without overlaps."""

    place: str
    scenario: Scenario
    bodies: Bodies
    position: Floats  # (N, 2)  m
    side: float  # m    of the square room, from (0, 0)
    door: float  # m    width of the door, in the middle of the wall x = side
    settle: float  # s    simulated before anything is measured
    horizon: float  # s    simulated after that, before everyone is put back

    @property
    def people(self) -> int:
        """People at the start."""
        return len(self.position)

    @property
    def jambs(self) -> tuple[float, float]:
        """Y of the ends of the door [m]."""
        return 0.5 * (self.side - self.door), 0.5 * (self.side + self.door)

    @property
    def walls(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Ends of the five walls [m], from one end of the door around the room to the other."""
        side, (low, high) = self.side, self.jambs
        return list(pairwise(((side, low), (side, 0.0), (0.0, 0.0), (0.0, side), (side, side), (side, high))))

    @property
    def geometry(self) -> Geometry:
        """The place."""
        return self.scenario.geometry


def room20(people: int = 20, seed: int = 0) -> Scene:
    """Return the room of Pécol et al.: 5 m, a door of 0.82 m, 20 people; measured until it is empty."""
    return _drawn("room", make_scenario("room-v0", people=people), seed, 5.0, 0.82, 30.0)


def big(count: int, seed: int = 0) -> Scene:
    """Return a room of 15 m with a door of 1 m; the first 20 s, in which the crowd packs in front of the door."""
    scenario = make_scenario("room-v0", side=15.0, door_width=1.0, population=_walkers(count))
    return _drawn("room", scenario, seed, 15.0, 1.0, 20.0)


def hall(count: int, seed: int = 0) -> Scene:
    """Return a square hall at 1.33 people/m2 with an exit of 4 m: people walk, few touch."""
    side = float(np.sqrt(count / HALL_DENSITY))
    scenario = make_scenario("room-v0", side=side, door_width=min(4.0, 0.5 * side), population=_walkers(count))
    return _drawn("hall", scenario, seed, side, min(4.0, 0.5 * side), 4.0)


def jam(count: int, seed: int = 0) -> Scene:
    """Return a square crowd at 6 people/m2, radius up to 0.19 to 0.23 m, that touches and pushes to a door of 1.2 m."""
    rng = np.random.default_rng(seed)
    side = float(np.sqrt(count / JAM_DENSITY)) + 2.0 * _MARGIN
    door = min(1.2, 0.5 * side)
    people = Population(count, Uniform(0.19, 0.23), desired_speed=Uniform(1.2, 1.5))
    scenario = make_scenario("room-v0", side=side, door_width=door, population=people)
    bodies = people.draw_bodies(rng)._replace(relaxation_time=np.full(count, 0.5))
    bodies, position = relaxed(scenario.geometry, bodies, lattice(count, side, rng))
    return Scene("jam", scenario, bodies, position, side, door, 0.1, 1.0 if count <= 10_000 else 0.2)


def _drawn(place: str, scenario: Scenario, seed: int, side: float, door: float, horizon: float) -> Scene:
    bodies, position = scenario.population.draw(np.random.default_rng(seed), scenario.geometry)
    return Scene(place, scenario, bodies, position, side, door, 0.0, horizon)


def _walkers(count: int) -> Population:
    return Population(
        count, Uniform(0.20, 0.25), desired_speed=Normal(1.34, 0.1, 1.0, 1.7), relaxation_time=Uniform(0.5, 0.5)
    )


def lattice(count: int, side: float, rng: np.random.Generator) -> Floats:
    """Return positions (N, 2) on a hexagonal lattice, jittered out of its order: random draws cannot place a jam."""
    usable = side - 2.0 * _MARGIN
    rows = max(1, round(usable / np.sqrt(2.0 / (np.sqrt(3.0) * JAM_DENSITY))))  # along y, in a column
    columns = -(-count // rows)
    column, row = np.divmod(np.arange(count), rows)
    place = np.stack([(column + 0.5) / columns, (row + 0.25 + 0.5 * (column % 2)) / rows], axis=1)
    return _MARGIN + np.clip(usable * place + rng.uniform(-_JITTER, _JITTER, (count, 2)), 0.0, usable)


def relaxed(geometry: Geometry, bodies: Bodies, position: Floats) -> tuple[Bodies, Floats]:
    """Let the springs of dem push standing people apart; shrink bodies by what overlap is left, so that they touch."""
    calm = bodies._replace(relaxation_time=np.full(len(position), 0.05))
    closed = Geometry.from_polygon(geometry.walkable)
    crowd = Simulation(closed, calm, make_state(position), physics=Physics(DEM(), dt=0.004), fields=[None])
    crowd.advance(np.zeros((len(position), 2)), n_substeps=_CALM_STEPS)
    place = crowd.state.position.copy()
    check = Simulation(closed, calm, make_state(place), physics=Physics(DEM(), dt=1e-6), fields=[None], driving=False)
    check.advance(n_substeps=1)
    found = check.contacts()
    deepest = np.zeros(len(place))  # of everyone's overlaps
    between = found.j >= 0
    np.maximum.at(deepest, found.i, np.where(between, -found.gap, -2.0 * found.gap))
    np.maximum.at(deepest, found.j[between], -found.gap[between])
    return bodies._replace(radius=bodies.radius - 0.5 * deepest - 1e-9), place


def overlaps(geometry: Geometry, bodies: Bodies, position: Floats, near: float = _TOUCH) -> Floats:
    """Return how deep bodies overlap each other and walls [m], for each pair nearer than ``near``; the same for everybody."""
    wider = bodies._replace(radius=bodies.radius + 0.5 * near)
    scene = Simulation(
        geometry, wider, make_state(position), physics=Physics(DEM(), dt=1e-6), fields=[None], driving=False
    )
    scene.advance(n_substeps=1)  # lists the contacts of the positions that it starts from
    found = scene.contacts()
    depth = -found.gap - np.where(found.j >= 0, near, 0.5 * near)
    return np.maximum(0.0, depth[found.gap < 0.0])


def chosen(bodies: Bodies, who: NDArray[np.bool_]) -> Bodies:
    """Return the bodies of some people, alone in one place."""
    columns = [column[who] for column in bodies[:-1]]
    return Bodies._make([*columns, np.array([0, int(who.sum())])])
