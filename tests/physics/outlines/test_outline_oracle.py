"""`hertz` with bodies of several discs once more in plain NumPy: every pair of discs, every wall, one after the other.

Contacts are held against it, and against polygons of shapely; then whole runs, with friction that remembers.
"""

import itertools

import numpy as np
import pytest
import shapely
from cases import looped
from crowds import PLANS, half_plane
from outlined_crowds import LIMP, TORSO, bodies_as_shapes, discs_of, grains
from shapely.geometry import box
from simulations import simulate

from crowd_env import Geometry, Hertz, Outline, Physics, Simulation, make_bodies, make_state


def nearest_points(walls, center):
    """Yield the nearest point of each wall, and which it is; a corner only if nearest on every wall that ends there, once."""
    corners = {}
    for k, (start, end) in enumerate(walls):
        share = (center - start) @ (end - start) / ((end - start) @ (end - start))
        if 0.0 < share < 1.0:
            yield k, start + share * (end - start)
        for point, is_nearest in ((start, share <= 0.0), (end, share >= 1.0)):
            key = tuple(np.round(point, 9))
            corners[key] = corners.get(key, True) and is_nearest
    yield from ((corner, np.array(corner)) for corner, is_nearest in corners.items() if is_nearest)


def touches(walls, outline, bodies, state):
    """Yield (i, j, disc of i, disc of j, overlap, normal) of all pairs of discs; of discs and walls with None for j."""
    center, radius = discs_of(outline, bodies, state)
    away = center[:, None, :, None] - center[None, :, None]  # (P, P, K, K, 2)
    distance = np.hypot(away[..., 0], away[..., 1])
    overlap = radius[:, None, :, None] + radius[None, :, None] - distance
    once = np.triu(np.outer(state.active, state.active), 1)[..., None, None]
    for i, j, a, b in np.argwhere(once & (overlap > 0.0)).tolist():
        yield i, j, a, b, overlap[i, j, a, b], away[i, j, a, b] / distance[i, j, a, b]
    lines = shapely.multilinestrings(shapely.linestrings(walls))
    near = shapely.distance(shapely.points(center), lines) < radius
    for i, a in np.argwhere(near & state.active[:, None]).tolist():
        for which, point in nearest_points(walls, center[i, a]):
            away = center[i, a] - point
            distance = np.hypot(*away)
            if distance < radius[i, a]:
                yield i, None, a, which, radius[i, a] - distance, away / distance


class PlainHertz:
    """Velocity Verlet of bodies of several discs that rub (Lin, Ma, Lo, eqs 1-11), walking along ``ways`` in the world."""

    def __init__(self, walls, outline, scheme, bodies, state, ways, dt):
        self.walls, self.outline, self.scheme, self.bodies = np.asarray(walls), outline, scheme, bodies
        self.state, self.ways, self.dt, self.springs = state, ways, dt, {}
        self.force, self.torque = self.forces(0.0)

    def step(self):
        state, bodies, dt = self.state, self.bodies, self.dt
        for half in (0, 1):
            state.velocity[:] += 0.5 * dt * self.force / bodies.mass[:, None]
            state.spin[:] += 0.5 * dt * self.torque / bodies.inertia
            if half == 0:
                state.position[:] += dt * state.velocity
                state.angle[:] += dt * state.spin
                self.force, self.torque = self.forces(dt)

    def forces(self, elapsed):
        bodies, state, outline, half = self.bodies, self.state, self.outline, 0.5 * elapsed
        force, torque = np.zeros_like(state.velocity), np.zeros_like(state.spin)
        before, self.springs = self.springs, {}
        discs = discs_of(outline, bodies, state)
        for touch in touches(self.walls, outline, bodies, state):
            self.add(touch, discs, elapsed, before, force, torque)
        # People drive, and turn, by the velocity and the spin that all this leaves them after another half step.
        mass, tau, turn = bodies.mass[:, None], bodies.relaxation_time[:, None], outline.turning_time
        wanted = bodies.desired_speed[:, None] * self.ways
        velocity = (state.velocity + half * (force / mass + wanted / tau)) / (1.0 + half / tau)
        off = np.angle(np.exp(1j * (np.arctan2(*self.ways.T[::-1]) - state.angle)))
        spin = (state.spin + half * (torque / bodies.inertia + off / turn**2)) / (1.0 + 2.0 * half / turn)
        moment = np.clip(bodies.inertia * (off / turn**2 - 2.0 * spin / turn), -outline.max_torque, outline.max_torque)
        return force + mass / tau * (wanted - velocity), torque + moment

    def add(self, touch, discs, elapsed, before, force, torque):
        """Add what one contact does to two bodies, or to one and a wall."""
        i, j, a, b, overlap, normal = touch
        scheme, (center, radius) = self.scheme, discs
        left = np.array([-normal[1], normal[0]])
        arms = {i: center[i, a] - radius[i, a] * normal - self.state.position[i]}
        size, mass, friction = radius[i, a], self.bodies.mass[i], scheme.wall_friction
        if j is not None:
            arms[j] = center[j, b] + radius[j, b] * normal - self.state.position[j]
            other, heft = radius[j, b], self.bodies.mass[j]
            size, mass, friction = size * other / (size + other), mass * heft / (mass + heft), scheme.friction
        speed = {
            k: self.state.velocity[k] + self.state.spin[k] * np.array([-arm[1], arm[0]]) for k, arm in arms.items()
        }
        between = speed[i] - (0.0 if j is None else speed[j])
        alpha = np.sqrt(overlap * size)
        press = scheme.normal_stiffness * overlap - mass * scheme.normal_damping * between @ normal
        key = (i, j, a, b)
        stretch, slip = before.get(key, 0.0) + elapsed * between @ left, between @ left
        damping = mass * scheme.tangential_damping
        rub = -(scheme.tangential_stiffness * stretch + damping * slip)
        if abs(rub) > friction * abs(press):
            rub = np.sign(rub) * friction * abs(press)
            stretch = -(rub + damping * slip) / scheme.tangential_stiffness
        self.springs[key] = stretch
        push = alpha * (press * normal + rub * left)
        for k, sign in ((i, 1.0), (j, -1.0)):
            if k is not None:
                force[k] += sign * push
                torque[k] += sign * (arms[k][0] * push[1] - arms[k][1] * push[0])


def crowd(seed, count, side, spread=0.0):
    """Return bodies and state of people at random places and angles, who may overlap."""
    rng = np.random.default_rng(seed)
    bodies = make_bodies(
        rng.uniform(0.15, 0.19, count), rng.uniform(60, 90, count), desired_speed=rng.uniform(1, 2, count)
    )
    state = make_state(rng.uniform(spread, side - spread, (count, 2)), rng.normal(0, 0.8, (count, 2)))
    state.angle[:], state.spin[:] = rng.uniform(-9, 9, count), rng.normal(0, 2, count)
    return bodies, state


@pytest.mark.kernels
def test_whole_runs_with_walls_friction_and_ways():
    # In a room of 2.2 m whose pillar has four corners: pressed together, and turning.
    place = Geometry.from_polygon(box(0, 0, 2.2, 2.2), obstacles=[box(1.0, 1.0, 1.2, 1.2)])
    scheme = Hertz(social=None, wall_friction=0.3, youngs_modulus=5e5)
    outline = Outline(TORSO.discs, turning_time=0.4, max_torque=15.0)
    around = np.array(
        [[0.5, 0.4], [1.1, 0.45], [1.7, 0.5], [0.45, 1.1], [1.75, 1.15], [0.5, 1.75], [1.1, 1.7], [1.7, 1.75]]
    )
    bodies, state = crowd(0, len(around), 2.2)
    state.position[:] = around
    ahead = np.array([0.2, 1.9]) - around
    ways = ahead / np.hypot(*ahead.T)[:, None]
    own = state.copy()
    simulation = Simulation(place, bodies, state, physics=Physics(scheme, dt=5e-4, outline=outline), fields=[None])
    plain = PlainHertz(place.walls, outline, scheme, bodies, own, ways, 5e-4)
    asked = {"command": ways, "relative": np.zeros(len(around), dtype=bool)}
    seen = {True: 0, False: 0}
    for _ in range(800):
        simulation.advance(**asked)
        plain.step()
        for j in simulation.contacts().j:
            seen[bool(j >= 0)] += 1
    assert seen[True] > 200
    assert seen[False] > 50
    for name in ("position", "velocity", "angle", "spin"):
        np.testing.assert_allclose(getattr(state, name), getattr(own, name), rtol=0, atol=1e-6, err_msg=name)


@pytest.mark.kernels
@looped("plan", PLANS)
@looped("count", [25, 120])
def test_contacts_are_all_that_there_are(plan, count):
    # One person at most is deeper in a wall than a disc: on which side it then is, the next tests say.
    geometry = PLANS[plan]()
    total = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        bodies, state = crowd(seed, count, 1.0)
        x0, y0, x1, y1 = geometry.bounds
        place = rng.uniform((x0, y0), (x1, y1), (40 * count, 2))
        state.position[:] = place[geometry.contains(place) & (geometry.clearance(place) > 0.2)][:count]
        options = {"scheme": Hertz(social=None), "dt": 1e-9, "fields": [None], "driving": False, "outline": LIMP}
        simulation = simulate(geometry, bodies, state, allow_unstable=True, **options)
        simulation.advance()
        found = simulation.contacts()
        expected = [
            (i, -1 if j is None else j, a, -1 if j is None else b, -overlap, *normal)
            for i, j, a, b, overlap, normal in touches(geometry.walls, LIMP, bodies, state)
        ]
        columns = (found.i, np.maximum(found.j, -1), found.disc_i, found.disc_j, found.gap, *found.normal.T)
        expected, listed = (np.array(sorted(map(tuple, rows))) for rows in (expected, np.column_stack(columns)))
        total += len(expected)
        np.testing.assert_allclose(listed, expected, rtol=0, atol=1e-7)
        rows = np.column_stack([found.i, np.where(found.j >= 0, found.j, 10**6 - found.j), found.disc_i, found.disc_j])
        assert (np.diff(rows, axis=0) != 0).any(axis=1).all()
        np.testing.assert_array_equal(rows, rows[np.lexsort(rows.T[::-1])])
    assert total > 60


@pytest.mark.kernels
def test_bodies_touch_where_their_outlines_overlap():
    _, state = crowd(3, 40, 2.5)
    simulation = grains(state.position, state.angle, LIMP, dt=1e-9)
    simulation.advance()
    shapes = bodies_as_shapes(LIMP, simulation.bodies, simulation.state)
    found = simulation.contacts()
    listed = set(zip(found.i.tolist(), found.j.tolist(), strict=True))
    expected = {
        (i, j) for i, j in itertools.combinations(range(40), 2) if shapes[i].intersection(shapes[j]).area > 1e-5
    }
    assert len(expected) > 20
    assert expected <= listed
    assert all(shapely.distance(shapes[i], shapes[j]) < 1e-4 for i, j in listed)


# ------------------------------------------------------------------------------------- shoulders pressed through walls


def pushed_back(geometry, position, angle, *, steps=3000):
    """Return a body at rest after so many steps of a soft, damped law, and whether it ever turned."""
    scheme = Hertz(
        youngs_modulus=5e4, normal_damping=1.0, damping_unit="critical", friction=0.0, wall_friction=0.0, social=None
    )
    simulation = grains([position], angle, LIMP, place=geometry, scheme=scheme, dt=1e-3)
    simulation.advance(n_substeps=steps)
    return simulation


@looped("depth", [0.02, 0.05, 0.1, 0.14])
@looped("side", [1, -1])
def test_a_shoulder_behind_a_wall_comes_back(depth, side):
    # Facing along the wall, one shoulder in it, up to deeper than the radius of its disc; a thin wall has two sides.
    breadth = 0.17 * (TORSO.shape.y + TORSO.shape.radius).max()
    thin = Geometry.from_polygon(box(-3, -3, 3, 3), thin_walls=[[(0, -2), (0, 2)]])
    for geometry, sides in ((half_plane(), (1,)), (thin, (1, -1))):
        for where in sides:
            x = where * (breadth - depth)
            simulation = pushed_back(geometry, (x, 0.0), side * 0.5 * np.pi)
            assert where * simulation.state.position[0, 0] > abs(x)
            assert abs(simulation.state.position[0, 1]) < 0.05
            shape = bodies_as_shapes(LIMP, simulation.bodies, simulation.state)[0]
            assert shape.intersection(box(-4, -4, 0, 4) if where > 0 else box(0, -4, 4, 4)).area < 1e-4


def test_a_shoulder_in_a_corner_of_the_room_comes_back():
    room = Geometry.from_polygon(box(0, 0, 3, 3))
    simulation = pushed_back(room, (0.12, 0.12), 0.75 * np.pi)  # the right shoulder over the corner
    shape = bodies_as_shapes(LIMP, simulation.bodies, simulation.state)[0]
    assert shape.difference(box(0, 0, 3, 3)).area < 1e-4


@pytest.mark.kernels
def test_a_body_astride_of_the_end_of_a_thin_wall_touches_it_from_both_sides():
    thin = Geometry.from_polygon(box(-3, -3, 3, 3), thin_walls=[[(0, -2), (0, 0)]])
    simulation = grains([(0.0, 0.1)], 0.5 * np.pi, LIMP, place=thin, dt=1e-9)  # facing along the wall, beyond its end
    simulation.advance()
    found = simulation.contacts()
    assert len(found.gap) > 0
    assert (found.normal[:, 1] > -1e-9).all()  # away from it, none towards
