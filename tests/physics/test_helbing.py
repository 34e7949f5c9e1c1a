"""The contact of Helbing, Farkas, Vicsek 2000: sliding friction in closed form, and all of it against another integrator."""

from dataclasses import replace

import numpy as np
import pytest
from crowds import half_plane, kinetic_energy, people, plain
from scipy.integrate import solve_ivp

from crowd_env import Helbing, Physics, Simulation, make_bodies, make_state

BARE = Helbing(stiffness=1e-9, social=None, relative_tolerance=1e-6)  # friction alone
OVERLAP = 0.03  # m


def slide(dt, friction=2.4e5):
    """Return two discs that have slid past one another for one step, and their simulation."""
    bodies = make_bodies([0.3, 0.25], [80.0, 60.0])
    state = make_state([[0.0, 0.0], [0.55 - OVERLAP, 0.0]], [[0.0, 1.2], [0.0, -0.3]])
    physics = Physics(replace(BARE, friction=friction), dt=dt)
    simulation = Simulation(plain(), bodies, state, physics=physics, driving=False)
    simulation.advance()
    return bodies, state, simulation


def test_two_discs_that_slide_lose_tangential_momentum_by_overlap_and_slip():
    dt, slip = 1e-7, 1.5
    bodies, state, simulation = slide(dt)
    lost = 2.4e5 * OVERLAP * slip * dt
    assert bodies.mass[0] * (1.2 - state.velocity[0, 1]) == pytest.approx(lost, rel=1e-4)
    assert bodies.mass[1] * (state.velocity[1, 1] + 0.3) == pytest.approx(lost, rel=1e-4)
    assert simulation.contacts().impulse[0, 1] == pytest.approx(lost, rel=1e-4)  # along the normal turned left
    assert np.hypot(*simulation.results.impulse[0]) == pytest.approx(lost, rel=1e-4)
    assert np.abs(state.velocity[:, 0]).max() < 1e-12


@pytest.mark.parametrize("dt", [1e-4, 5e-3, 0.1])
def test_a_step_of_any_length_slows_a_slip_as_backward_euler_does(dt):
    bodies, state, _ = slide(dt)
    reduced = 80.0 * 60.0 / 140.0
    slip = state.velocity[0, 1] - state.velocity[1, 1]
    assert slip == pytest.approx(1.5 / (1.0 + dt * 2.4e5 * OVERLAP / reduced), rel=1e-3)
    assert bodies.mass @ state.velocity[:, 1] == pytest.approx(80.0 * 1.2 - 60.0 * 0.3, abs=1e-10)


def test_a_wall_rubs_as_people_do():
    state = make_state([[0.3 - OVERLAP, 0.0]], [[0.0, 1.5]])
    simulation = Simulation(
        half_plane(), make_bodies([0.3], 80.0), state, physics=Physics(BARE, dt=1e-7), driving=False
    )
    simulation.advance()
    lost = 2.4e5 * OVERLAP * 1.5 * 1e-7
    assert 80.0 * (1.5 - state.velocity[0, 1]) == pytest.approx(lost, rel=1e-4)
    np.testing.assert_allclose(simulation.results.wall_impulse[0], [0.0, -lost], rtol=1e-4, atol=1e-12)


def test_without_friction_nothing_tangential_is_left():
    _, state, simulation = slide(5e-3, friction=0.0)
    np.testing.assert_array_equal(state.velocity[:, 1], [1.2, -0.3])
    assert simulation.contacts().impulse[0, 1] == 0.0


@pytest.mark.parametrize("dt", [5e-3, 0.04])
def test_friction_takes_energy_from_a_heap_whatever_the_step(dt):
    # 60 discs on 3 m2 overlap with a dozen others each, by up to their size.
    rng = np.random.default_rng(1)
    bodies = people(rng, 60)
    state = make_state(rng.uniform(0.0, 1.7, (60, 2)), rng.normal(0.0, 1.0, (60, 2)))
    before, momentum = kinetic_energy(bodies, state.velocity).sum(), bodies.mass @ state.velocity
    simulation = Simulation(plain(), bodies, state, physics=Physics(BARE, dt=dt), driving=False)
    simulation.advance()
    assert len(simulation.contacts().i) > 300 and simulation.diagnostics.unconverged.sum() == 0
    assert kinetic_energy(bodies, state.velocity).sum() < 0.8 * before
    np.testing.assert_allclose(bodies.mass @ state.velocity, momentum, atol=1e-8)


def test_the_stable_step_is_the_one_that_it_states():
    bodies = make_bodies([0.25, 0.3], [60.0, 60.0], relaxation_time=0.5)
    assert Helbing().stable_dt(bodies) == pytest.approx(2.0 / np.sqrt(2.0 * (1.2e5 + 2000.0 / 0.08) / 60.0))
    scheme = Helbing(friction=0.0, social=None)
    bound = scheme.stable_dt(bodies)
    for share, holds in ((0.95, True), (1.05, False)):
        # Two bodies pressed together, a little off their balance: an overlap of 60 kN / k = 5 cm.
        state = make_state([[0.0, 0.0], [0.55 - 0.0501, 0.0]])
        physics = Physics(scheme, dt=share * bound, allow_unstable=True)
        simulation = Simulation(plain(), bodies, state, physics=physics, driving=False)
        simulation.advance(external_force=np.array([[6000.0, 0.0], [-6000.0, 0.0]]), n_substeps=100)
        assert (np.abs(state.velocity).max() < 0.1) == holds


# -------------------------------------------------------------------------------------------- against another integrator


def forces(position, velocity, bodies, desired):
    """Return the force [N] on each person right of a wall at x = 0, by the equations of the paper."""
    force = bodies.mass[:, None] * (desired - velocity) / bodies.relaxation_time[:, None]
    pairs = [(i, j) for i in range(len(position)) for j in (*range(len(position)), None) if i != j]
    for i, j in pairs:
        if j is None:
            apart, distance, slip = np.array([1.0, 0.0]), position[i, 0] - bodies.radius[i], -velocity[i]
        else:
            line = position[i] - position[j]
            apart, slip = line / np.hypot(*line), velocity[j] - velocity[i]
            distance = np.hypot(*line) - bodies.radius[i] - bodies.radius[j]
        if distance < 8.0 * 0.08:
            force[i] += 2000.0 * np.exp(-distance / 0.08) * apart
        if distance < 0.0:
            along = np.array([-apart[1], apart[0]])
            force[i] += -1.2e5 * distance * apart - 2.4e5 * distance * (slip @ along) * along
    return force


def test_people_and_a_wall_move_as_another_integrator_moves_them():
    bodies = make_bodies(
        [0.3, 0.27, 0.33, 0.25, 0.3], [80.0, 70.0, 90.0, 60.0, 80.0], desired_speed=3.0, relaxation_time=0.5
    )
    start = np.array([[0.5, 0.1], [1.05, -0.1], [0.85, 0.6], [1.5, 0.3], [0.55, 1.2]])
    speed = np.array([[-1.0, 0.5], [-1.5, 0.8], [0.0, -2.0], [-2.0, -1.0], [0.2, -1.5]])
    desired, duration = np.tile([-2.4, 1.8], (5, 1)), 0.3

    def rate(_, y):
        position, velocity = y.reshape(2, 5, 2)
        force = forces(position, velocity, bodies, desired)
        return np.ravel([velocity, force / bodies.mass[:, None]])

    exact = solve_ivp(rate, (0.0, duration), np.ravel([start, speed]), method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]

    def found(steps):
        state = make_state(start, speed)
        physics = Physics(Helbing(tolerance=1e-12), dt=duration / steps)
        simulation = Simulation(half_plane(), bodies, state, physics=physics)
        simulation.advance(np.tile([-0.8, 0.6], (5, 1)), relative=np.zeros(5, bool), n_substeps=steps)
        assert simulation.diagnostics.overlap_count[0] > steps / 3  # they do touch
        return np.ravel([state.position, state.velocity])

    coarse, fine = found(30_000), found(60_000)
    assert np.abs(coarse - exact).max() / np.abs(fine - exact).max() == pytest.approx(2.0, rel=0.05)  # of first order
    np.testing.assert_allclose(2.0 * fine - coarse, exact, rtol=0.0, atol=1e-6)  # without what the step leaves
