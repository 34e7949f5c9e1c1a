"""The limit of the driving force: it is a force that is exerted, whatever the scheme, and nothing at all when it is off."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from cases import looped
from crowds import crowd_in, half_plane, plain
from simulations import simulate

from crowd_env import CrowdEnv, Physics
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import DEM, SCHEMES, make_scheme
from crowd_env.physics.simulation.simulation import Simulation

LIMIT = 300.0  # N
DRIVEN = [name for name, scheme in SCHEMES.items() if scheme.drives]
driven = pytest.mark.parametrize("name", DRIVEN)


def one(geometry, position, scheme, *, speed=2.0, **options):
    """Return a simulation of one person of 80 kg whose unlimited drive at rest is 1600 N at 2 m/s."""
    bodies = make_bodies(np.array([0.25]), np.array([80.0]), desired_speed=speed, relaxation_time=0.1)
    return simulate(geometry, bodies, make_state(np.array([position])), scheme=scheme, **options)


def walk(simulation, seconds, command):
    """Advance by ``seconds`` with a command along the axes of the world; return how many steps that were."""
    people, steps = len(simulation.bodies.radius), round(seconds / simulation.dt)
    simulation.advance(np.tile(command, (people, 1)), relative=np.zeros(people, bool), n_substeps=steps)
    return steps


@driven
def test_people_start_and_brake_with_the_limit_and_walk_at_their_desired_speed(name):
    direction = np.array([0.6, 0.8])
    simulation = one(plain(), (0.0, 0.0), name, max_drive=LIMIT)
    walk(simulation, 0.3, direction)
    np.testing.assert_allclose(simulation.state.velocity[0], LIMIT / 80.0 * 0.3 * direction, rtol=1e-9)
    walk(simulation, 3.0, direction)
    np.testing.assert_allclose(simulation.state.velocity[0], 2.0 * direction, rtol=1e-6)
    walk(simulation, 0.3, (0.0, 0.0))
    # hertz feels a new command from the second half of a step on.
    late = 0.5 * simulation.dt * LIMIT / 80.0 if name.startswith("hertz") else 0.0
    np.testing.assert_allclose(simulation.state.velocity[0], (2.0 - LIMIT / 80.0 * 0.3 + late) * direction, rtol=1e-6)


@driven
@looped(("limit", "push"), [(LIMIT, LIMIT), (5000.0, 1600.0), (None, 1600.0)])
def test_the_push_on_a_wall_is_the_limit_or_the_drive_if_that_is_less(name, limit, push):
    # Without the social force of the wall; what the drive gave is what the wall took and what moves, bouncing or not.
    scheme = replace(SCHEMES[name], social=None)
    simulation = one(half_plane(), (0.25, 0.0), scheme, max_drive=limit)
    walk(simulation, 2.0, (-1.0, 0.0))
    before = simulation.state.velocity[0, 0]
    walk(simulation, 2.0, (-1.0, 0.0))
    taken = simulation.results.impulse[0, 0] - 80.0 * (simulation.state.velocity[0, 0] - before)
    assert taken / 2.0 == pytest.approx(push, rel=1e-6 if push == LIMIT else 0.02)


@driven
def test_a_limit_that_nobody_reaches_changes_no_trajectory(name):
    geometry, count = Geometry.from_polygon(shapely.box(0, 0, 3, 3)), 20
    found = []
    for limit in (None, 1e6):
        bodies, state, command = crowd_in(np.random.default_rng(5), geometry, count)
        simulation = Simulation(geometry, bodies, state, physics=Physics(name, max_drive=limit))
        simulation.advance(command, relative=np.zeros(count, bool), n_substeps=round(0.3 / simulation.dt))
        found.append(state.position.copy())
    np.testing.assert_allclose(*found, atol=1e-9)


def test_the_limit_counts_beside_a_social_force_and_an_external_one():
    # It cuts the drive alone: 500 N from outside are added whole.
    for name in DRIVEN:
        simulation = one(plain(), (0.0, 0.0), make_scheme({"name": name, "social": "lin"}), max_drive=LIMIT)
        steps = round(0.1 / simulation.dt)
        force = np.array([[500.0, 0.0]])
        command, straight = np.array([[0.0, 1.0]]), np.zeros(1, bool)
        simulation.advance(command, relative=straight, n_substeps=steps, external_force=force)
        vx, vy = simulation.state.velocity[0]
        drive = np.hypot(80.0 * vx / 0.1 - 500.0, 80.0 * vy / 0.1)
        assert LIMIT * 0.9 < drive <= LIMIT * (1.0 + 1e-9), name


def test_a_large_crowd_in_slabs_is_limited_on_any_number_of_threads():
    geometry = Geometry.from_polygon(shapely.box(0, 0, 60, 60))
    found = []
    for threads in (1, 3):
        x, y = np.meshgrid(np.arange(0.5, 59.5, 0.6), np.arange(0.5, 20.5, 0.46))
        position = np.stack([x.ravel(), y.ravel()], axis=1)[:4100]
        count = len(position)
        bodies = make_bodies(np.full(count, 0.22), np.full(count, 80.0), desired_speed=2.0, relaxation_time=0.1)
        simulation = Simulation(
            geometry, bodies, make_state(position), physics=Physics(DEM(), max_drive=LIMIT, threads=threads)
        )
        simulation.advance(np.tile([0.0, 1.0], (count, 1)), relative=np.zeros(count, bool), n_substeps=20)
        found.append(simulation.state.velocity.copy())
    np.testing.assert_array_equal(*found)
    front = position[:, 1] == position[:, 1].max()
    assert np.median(found[0][front, 1]) == pytest.approx(LIMIT / 80.0 * 0.2, rel=1e-9)


def test_a_checkpoint_of_another_limit_is_refused():
    checkpoint = one(plain(), (0.0, 0.0), "nsm2", max_drive=LIMIT).checkpoint()
    with pytest.raises(ValueError, match=r"its max_drive differs: DriveLimit"):
        one(plain(), (0.0, 0.0), "nsm2").restore(checkpoint)


def test_crowds_without_such_a_force_and_bad_limits_are_refused():
    with pytest.raises(
        ValueError, match="nsm1 has no driving force that max_drive could limit; schemes that can: dem, "
    ):
        one(plain(), (0.0, 0.0), "nsm1", max_drive=LIMIT)
    with pytest.raises(ValueError, match="passive grains"):
        one(plain(), (0.0, 0.0), "dem", max_drive=LIMIT, driving=False)
    for limit in (0.0, -1.0, np.nan, "strong"):
        with pytest.raises(ValueError, match=r"max_drive is .*; it must be "):
            CrowdEnv("room-v0", physics=Physics(max_drive=limit))


def test_people_in_an_environment_press_less_with_a_limit():
    pushed = []
    for limit in (None, 100.0):
        env = CrowdEnv("room-v0", physics=Physics("dem", max_drive=limit))
        env.reset(seed=0)
        pushed.append(sum(env.step(None) and env.simulation.results.impulse_magnitude.sum() for _ in range(30)))
    assert pushed[1] < 0.7 * pushed[0]


@looped(("limit", "pushed"), [(LIMIT, 0.0), (LIMIT, 500.0), (None, 500.0)])
def test_hertz_with_a_limited_drive_is_of_second_order(limit, pushed):
    # Pushed from the side: at first the drive is at its limit, then below it.
    ends = []
    for steps in (60, 120, 240, 6000):
        simulation = one(plain(), (0.0, 0.0), "hertz", max_drive=limit, dt=0.8 / steps)
        push, ahead = np.array([[0.0, pushed]]), np.array([[1.0, 0.0]])
        simulation.advance(ahead, relative=np.zeros(1, bool), external_force=push, n_substeps=steps)
        ends.append(simulation.state.position[0].copy())
    errors = np.array([np.abs(end - ends[-1]).max() for end in ends[:-1]])
    assert errors[0] > 6.0 * errors[2]
