"""People with shoulders: what a few and many of them are made of, and their discs in plain NumPy."""

import numpy as np
import shapely
from shapely.geometry import box
from simulations import simulate

from crowd_env import OUTLINES, Geometry, Hertz, Outline, make_bodies, make_state

TORSO = OUTLINES["torso"]
# Nothing but contacts turns it.
LIMP = Outline(TORSO.discs, turning_time=np.inf)
# Two equal discs, side by side; the bodies of tests in closed form.
DUMBBELL = Outline(((0.0, 0.12, 0.15), (0.0, -0.12, 0.15)), turning_time=np.inf)
DISC = Outline(((0.0, 0.0, 0.3),), turning_time=np.inf)
ELASTIC = Hertz(normal_damping=0.0, tangential_damping=0.0, friction=0.0, wall_friction=0.0, social=None)


def discs_of(outline, bodies, state):
    """Return centers (P, K, 2) and radii (P, K) of everyone's discs."""
    shape = outline.shape
    cosine, sine = np.cos(state.angle)[:, None], np.sin(state.angle)[:, None]
    x, y = cosine * shape.x - sine * shape.y, sine * shape.x + cosine * shape.y
    radius = bodies.radius[:, None]
    return state.position[:, None] + radius[..., None] * np.stack([x, y], -1), radius * shape.radius


def bodies_as_shapes(outline, bodies, state):
    """Return everyone's outline (P,) as a polygon of many corners."""
    center, radius = discs_of(outline, bodies, state)
    discs = shapely.buffer(shapely.points(center), radius, quad_segs=64)
    return shapely.union_all(discs, axis=1)


def before_a_door(count, *, scheme="hertz", outline=TORSO, density=2.0, environments=1, **options):
    """Return people on a jittered lattice in a square room with a door, slots in random order; the same in each environment."""
    rng = np.random.default_rng(0)
    side, columns = np.sqrt(count / density), int(np.ceil(np.sqrt(count)))
    place = Geometry.from_polygon(box(0, 0, side, side), exits=[[(side, 0.4 * side), (side, 0.6 * side)]])
    lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(columns)), -1).reshape(-1, 2)[:count]
    position = rng.permutation((lattice + 0.5 + rng.uniform(-0.1, 0.1, (count, 2))) * side / columns)
    radius, mass, speed = rng.uniform(0.16, 0.18, count), rng.uniform(60, 80, count), rng.uniform(1.2, 2.0, count)
    bodies = make_bodies(
        np.tile(radius, environments),
        np.tile(mass, environments),
        desired_speed=np.tile(speed, environments),
        env_start=count * np.arange(environments + 1),
    )
    state = make_state(np.tile(position, (environments, 1)), environments=environments)
    return simulate(place, bodies, state, scheme=scheme, outline=outline, **options)


def grains(position, angle, outline, *, place=None, velocity=None, spin=0.0, scheme=ELASTIC, dt=1e-4, **options):
    """Return bodies that nothing drives: 0.17 m, 80 kg, as they lie and fly."""
    count = len(position)
    bodies = make_bodies(np.full(count, 0.17), np.full(count, 80.0))
    state = make_state(position, velocity)
    state.angle[:], state.spin[:] = angle, spin
    place = place or Geometry.from_polygon(box(-100, -100, 100, 100))
    options = {"fields": [None], "driving": False} | options
    return simulate(place, bodies, state, scheme=scheme, dt=dt, outline=outline, **options)
