"""People who keep a distance: a manner with all of its numbers, a few people in the open, and crowds before a door."""

import numpy as np
from shapely.geometry import box
from simulations import simulate

from crowd_env import Geometry, Simulation
from crowd_env.core.arrays.state import Bodies, make_bodies, make_state
from crowd_env.core.behaviors.headway import Headway

OPEN = Geometry.from_polygon(box(-12, -12, 40, 12))

# No test of a law depends on what a named manner is tuned to.
NUMBERS = {
    "time_gap": 0.8,
    "push": 0.0,
    "standing": 0.1,
    "width": 0.86,
    "strength": 0.2,
    "length": 0.1,
    "oncoming": 8.0,
    "keep_right": 0.15,
    "anticipation": 0.5,
    "overtaking": 0.7,
    "gain": 0.1,
    "berth": 1.3,
    "patience": 5.0,
    "impatience": 0.02,
    "sight": 2.0,
    "interval": 0.05,
}


def manner(**changed: float) -> Headway:
    """Return a manner with these numbers changed."""
    return Headway(**(NUMBERS | changed))


def standing(
    position,
    ways,
    keeps: Headway | None,
    *,
    place: Geometry = OPEN,
    velocity=None,
    bodies: Bodies | None = None,
    **options,
) -> tuple[Simulation, dict]:
    """Return people who want to go these ways in the axes of the world, and what to ask them for."""
    position, ways = np.array(position, dtype=float), np.array(ways, dtype=float)
    count = len(position)
    bodies = bodies or make_bodies(np.full(count, 0.2), np.full(count, 70.0), desired_speed=1.3)
    options = {"scheme": "dem", "fields": [None]} | options
    simulation = simulate(place, bodies, make_state(position, velocity), manner=keeps, **options)
    return simulation, {"command": ways, "relative": np.zeros(count, dtype=np.bool_)}


def decided(simulation: Simulation, asked: dict) -> np.ndarray:
    """Return the velocities (P, 2) [m/s] that people decide to walk at now."""
    simulation.history.have_decided[:] = False
    simulation.advance(**asked)
    return simulation.history.walking_velocity.copy()


def drawn_crowd(rng: np.random.Generator, count: int = 40, side: float = 6.0) -> dict[str, np.ndarray]:
    """Return who stands where in a square from -side/2 to side/2, how fast and where to; some overlap."""
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return {
        "position": rng.uniform(-0.5 * side, 0.5 * side, (count, 2)),
        "velocity": rng.normal(0.0, 0.6, (count, 2)),
        "ways": np.column_stack([np.cos(angle), np.sin(angle)]),
        "radius": rng.uniform(0.15, 0.22, count),
        "speed": rng.uniform(0.9, 1.6, count),
    }


def decided_by(crowd: dict[str, np.ndarray], keeps: Headway, place: Geometry = OPEN, waited=0.0) -> np.ndarray:
    """Return what a drawn crowd decides, who have stood still for so long [s]."""
    bodies = make_bodies(crowd["radius"], np.full(len(crowd["radius"]), 70.0), desired_speed=crowd["speed"])
    who = {"velocity": crowd["velocity"], "bodies": bodies}
    simulation, asked = standing(crowd["position"], crowd["ways"], keeps, place=place, **who)
    simulation.history.memory.manner.waited[:] = waited
    return decided(simulation, asked)


def before_a_door(
    count: int,
    keeps: Headway | None,
    *,
    scheme: str,
    density: float = 3.0,
    environments: int = 1,
    waited: float = 0.0,
    group: np.ndarray | int = -1,
    **options,
) -> Simulation:
    """Return people on a jittered lattice in a square room with a door, slots in random order; the same in each environment.

    They have stood still for up to ``waited`` [s].
    """
    rng = np.random.default_rng(0)
    side, columns = np.sqrt(count / density), int(np.ceil(np.sqrt(count)))
    place = Geometry.from_polygon(box(0, 0, side, side), exits=[[(side, 0.4 * side), (side, 0.6 * side)]])
    lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(columns)), -1).reshape(-1, 2)[:count]
    position = rng.permutation((lattice + 0.5 + rng.uniform(-0.1, 0.1, (count, 2))) * side / columns)
    radius, mass, speed = rng.uniform(0.16, 0.2, count), rng.uniform(60, 80, count), rng.uniform(1.0, 1.6, count)
    response, push = rng.uniform(0, 0.1, count), np.where(rng.random(count) < 0.2, 0.4, np.nan)
    bodies = make_bodies(
        np.tile(radius, environments),
        np.tile(mass, environments),
        desired_speed=np.tile(speed, environments),
        response_time=np.tile(response, environments),
        push=np.tile(push, environments),
        group=group,
        env_start=count * np.arange(environments + 1),
    )
    state = make_state(np.tile(position, (environments, 1)), environments=environments)
    simulation = simulate(place, bodies, state, scheme=scheme, manner=keeps, **options)
    if waited > 0.0:
        simulation.history.memory.manner.waited[:] = np.tile(rng.uniform(0.0, waited, count), environments)
    return simulation


def steps(simulation: Simulation, seconds: float) -> int:
    """Return how many physics steps that is."""
    return round(seconds / simulation.dt)
