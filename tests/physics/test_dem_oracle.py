"""`dem` once more in plain NumPy: every pair of bodies, every wall, one person after the other.  Read this one first.

It has no neighbor list, no compiler and no shortcut; `crowd_env/physics/dem.py` computes the same, fast.  The law is that of
Pécol et al. 2011: a linear spring that pushes while two discs overlap (eqs 4, 5), the driving force (eq 11), and symplectic
Euler (eq 3).  Equation 5 prints the unit vector that would attract; here, as there, the force pushes apart.
"""

import itertools

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import DEM
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

pytestmark = pytest.mark.kernels
STIFFNESS = 1.2e5  # N/m


class PlainDEM:
    """Discs in a room, given as ``walls`` and ``exits``: arrays (n, 2, 2) of end points [m], the inside to the left."""

    def __init__(self, walls, exits, bodies, position, velocity):
        self.walls, self.exits, self.bodies = np.asarray(walls, float), np.asarray(exits, float), bodies
        self.position, self.velocity, self.time = position.copy(), velocity.copy(), 0.0
        self.inside = list(range(len(position)))
        self.exit_time = np.full(len(position), np.nan)  # s
        self.impulse = np.zeros((len(position), 2))  # N s  from contacts, in the last step

    def step(self, desired_direction, external_force, dt):
        """Advance everyone inside by ``dt`` [s]."""
        bodies, before = self.bodies, self.position.copy()
        force, contact_force = external_force + self.driving_force(desired_direction), np.zeros_like(before)
        for i, j, gap, normal in self.contacts():
            spring = -STIFFNESS * min(0.0, gap) * normal  # eq 5
            contact_force[i] += spring
            if j is not None:
                contact_force[j] -= spring
        for i in self.inside:
            self.velocity[i] += dt * (force[i] + contact_force[i]) / bodies.mass[i]  # eq 3
            self.position[i] += dt * self.velocity[i]
        self.inside = [i for i in self.inside if not self.leaves(i, before[i], self.position[i], dt)]
        self.impulse, self.time = dt * contact_force, self.time + dt

    def driving_force(self, desired_direction):
        """Return m (v_d e_d - u) / tau (eq 11), (P, 2) [N]; until the response time is over the desired velocity is 0."""
        bodies = self.bodies
        speed = np.where(self.time >= bodies.response_time, bodies.desired_speed, 0.0)
        wanted = speed[:, None] * desired_direction
        return (bodies.mass / bodies.relaxation_time)[:, None] * (wanted - self.velocity)

    def contacts(self):
        """Yield (i, j, gap, unit vector from j to i) of all pairs, and of bodies and walls with None for j."""
        for i, j in itertools.combinations(self.inside, 2):
            away = self.position[i] - self.position[j]
            distance = np.linalg.norm(away)
            yield i, j, distance - self.bodies.radius[i] - self.bodies.radius[j], away / distance
        for i in self.inside:
            for point in self.nearest_points(self.position[i]):
                away = self.position[i] - point
                distance = np.linalg.norm(away)
                yield i, None, distance - self.bodies.radius[i], away / distance

    def nearest_points(self, center):
        """Yield the nearest point of each wall; a corner only if it is nearest on every wall that ends there, and once."""
        corners = {}
        for start, end in self.walls:
            share = (center - start) @ (end - start) / ((end - start) @ (end - start))
            if 0.0 < share < 1.0:
                yield start + share * (end - start)
            corners[tuple(start)] = corners.get(tuple(start), True) and share <= 0.0
            corners[tuple(end)] = corners.get(tuple(end), True) and share >= 1.0
        yield from (np.array(corner) for corner, is_nearest in corners.items() if is_nearest)

    def leaves(self, i, old, new, dt):
        """Note when person ``i`` crosses an exit on the way from ``old`` to ``new``; return whether it happens."""
        for start, end in self.exits:
            along = (end - start) / np.linalg.norm(end - start)
            left = np.array([-along[1], along[0]])
            height_old, height_new = (old - start) @ left, (new - start) @ left
            if height_old >= 0.0 > height_new:
                share = height_old / (height_old - height_new)
                where = (old + share * (new - old) - start) @ along
                if 0.0 <= where <= np.linalg.norm(end - start):
                    self.exit_time[i] = self.time + share * dt
                    return True
        return False


# ------------------------------------------------------------------------------------------------- the same scene twice

EXITS = [[(5, 1.6), (5, 2.4)], [(1.2, 4), (0.4, 4)]]
WALLS = [
    *([(0, 0), (5, 0)], [(5, 0), (5, 1.6)], [(5, 2.4), (5, 4)]),
    *([(5, 4), (1.2, 4)], [(0.4, 4), (0, 4)], [(0, 4), (0, 0)]),
    *([(2, 1.5), (2, 2.1)], [(2, 2.1), (2.6, 2.1)], [(2.6, 2.1), (2.6, 1.5)], [(2.6, 1.5), (2, 1.5)]),  # a pillar
]
ROOM = Geometry.from_polygon(box(0, 0, 5, 4), exits=EXITS, obstacles=[box(2, 1.5, 2.6, 2.1)])

# Position [m], velocity [m/s] and target [m] of each person.
PEOPLE = [
    ((0.18, 0.17), (-0.5, -0.4), (0, 0)),  # pressed into the corner of the room
    ((0.55, 0.25), (-0.9, 0.1), (0, 0)),  # and someone behind
    ((0.30, 0.58), (0.1, -0.7), (0, 0)),
    ((1.84, 1.75), (1.2, 0.1), (5, 2)),  # on the face of the pillar
    ((1.45, 1.80), (1.5, 0.0), (5, 2)),
    ((2.72, 2.24), (-0.8, -0.6), (2, 1)),  # on its corner
    ((3.05, 2.42), (-0.9, -0.5), (2, 1)),
    ((4.90, 1.55), (0.9, 0.8), (5, 2)),  # at the jamb of the door
    ((4.93, 2.05), (1.4, 0.1), (6, 2)),  # on the way out
    ((4.52, 2.12), (1.8, 0.0), (6, 2)),
    ((4.30, 1.78), (1.1, 0.4), (6, 2)),
    ((4.22, 2.34), (1.3, -0.5), (6, 2)),
    ((0.80, 3.99), (0.1, 1.2), (0.8, 5)),  # through the other exit
    ((0.86, 3.56), (0.0, 1.5), (0.8, 5)),
    ((3.30, 0.70), (0.0, 0.0), (5, 2)),  # alone, late to start, pushed from outside
]


@looped(("dt", "steps"), [(0.01, 40), (0.001, 200)], quick=1)
def test_dem_is_the_law_written_plainly(dt, steps):
    rng = np.random.default_rng(5)
    position, velocity, target = (np.array(column, dtype=float) for column in zip(*PEOPLE, strict=True))
    count = len(PEOPLE)
    bodies = make_bodies(
        rng.uniform(0.2, 0.25, count),
        rng.uniform(60, 100, count),
        desired_speed=rng.uniform(1.2, 2.0, count),
        relaxation_time=rng.uniform(0.2, 0.5, count),
        response_time=np.where(np.arange(count) == count - 1, 0.05, 0.0),
    )
    push = np.zeros((count, 2))
    push[-1] = 30.0, -20.0
    plain = PlainDEM(WALLS, EXITS, bodies, position, velocity)
    state = make_state(position, velocity)
    fast = Simulation(ROOM, bodies, state, physics=Physics(DEM(STIFFNESS), dt=dt), fields=[None])
    along_axes = np.zeros(count, dtype=np.bool_)
    pairs, walls = set(), set()  # who has touched whom
    for _ in range(steps):
        desired = target - plain.position
        desired /= np.linalg.norm(desired, axis=1, keepdims=True)
        contacts = sorted((i, -1 if j is None else j, gap) for i, j, gap, _ in plain.contacts() if gap < 0.0)
        pairs |= {(i, j) for i, j, _ in contacts if j >= 0}
        walls |= {i for i, j, _ in contacts if j < 0}
        plain.step(desired, push, dt)
        fast.advance(desired, relative=along_axes, external_force=push)
        np.testing.assert_allclose(state.position, plain.position, rtol=0, atol=1e-10)
        np.testing.assert_allclose(state.velocity, plain.velocity, rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.exit_time, plain.exit_time, rtol=0, atol=1e-10)
        np.testing.assert_allclose(fast.results.impulse, plain.impulse, rtol=0, atol=1e-7)
        found = fast.contacts()
        listed = sorted(zip(found.i.tolist(), np.maximum(found.j, -1).tolist(), found.gap.tolist(), strict=True))
        assert [(i, j) for i, j, _ in listed] == [(i, j) for i, j, _ in contacts]
        gaps = np.array([gap for _, _, gap in contacts])
        np.testing.assert_allclose([gap for _, _, gap in listed], gaps, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.impulse[:, 0], -STIFFNESS * found.gap * dt, rtol=1e-12)
        assert (found.impulse[:, 1] == 0.0).all()
    # The scene has to hold what it is meant to test.
    assert len(pairs) >= 8
    assert walls >= {0, 3, 5, 7}
    left = set(np.flatnonzero(~np.isnan(plain.exit_time)).tolist())
    assert left >= {8, 12}
    assert left < set(range(count))
