"""How hard a crowd presses: closed forms, and brute force over all pairs."""

import numpy as np
import pytest

from crowd_env import (
    NSM1,
    CrowdEnv,
    Geometry,
    Simulation,
    contact_pressure,
    crowd_pressure,
    make_bodies,
    make_state,
)

pytestmark = pytest.mark.kernels

HALL = Geometry.from_polygon([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])


def test_someone_who_is_pushed_against_a_wall_bears_the_force_over_his_circumference():
    # 500 N towards the wall x = 0: at rest the wall answers with 500 N.
    bodies = make_bodies([0.25], [80.0])
    simulation = Simulation(
        HALL, bodies, make_state([[0.25, 5.0]]), physics=NSM1("inertial", tolerance=1e-9), driving=False
    )
    simulation.advance(n_substeps=20, external_force=np.array([[-500.0, 0.0]]))
    pressure = contact_pressure(simulation.results.impulse_magnitude, 20 * simulation.dt, bodies.radius)
    assert pressure == pytest.approx([500.0 / (2 * np.pi * 0.25)], rel=1e-6)


def test_a_file_of_people_hands_the_force_on_to_the_wall():
    # Each of three pushes with 300 N: the first bears 900 N from the wall and 600 N from behind, the last only 300 N.
    bodies = make_bodies([0.25] * 3, [60.0, 80.0, 100.0])
    state = make_state([[0.25, 5.0], [0.75, 5.0], [1.25, 5.0]])
    simulation = Simulation(HALL, bodies, state, physics=NSM1("inertial", tolerance=1e-9), driving=False)
    force = np.tile([-300.0, 0.0], (3, 1))
    simulation.advance(n_substeps=20, external_force=force)
    assert simulation.results.impulse_magnitude / 0.2 == pytest.approx([1500.0, 900.0, 300.0], rel=1e-5)
    contacts = simulation.contacts()
    assert contacts.converged
    assert sorted(contacts.impulse[:, 0] / simulation.dt) == pytest.approx([300.0, 600.0, 900.0], rel=1e-5)


def test_contacts_of_a_solver_that_gave_up_are_marked():
    bodies = make_bodies([0.25] * 3, [80.0] * 3)
    state = make_state([[0.25, 5.0], [0.75, 5.0], [1.25, 5.0]])
    scheme = NSM1("inertial", tolerance=1e-9, max_iterations=1)
    simulation = Simulation(HALL, bodies, state, physics=scheme, driving=False)
    simulation.advance(n_substeps=3, external_force=np.tile([-300.0, 0.0], (3, 1)))
    assert not simulation.contacts().converged


def test_crowd_pressure_is_density_times_velocity_variance_of_those_near():
    env = CrowdEnv("room-v0", num_envs=3)
    env.reset(seed=4)
    for _ in range(25):
        env.step(None)
    measured = crowd_pressure(env.simulation, radius=1.2)
    state = env.simulation.state
    assert not state.active.all()
    for e in range(3):
        for i in range(env.num_people)[env.people(e)]:
            if not state.active[i]:
                assert measured[i] == 0.0
                continue
            here = np.arange(env.num_people)[env.people(e)]
            near = here[state.active[here] & (np.hypot(*(state.position[here] - state.position[i]).T) < 1.2)]
            variance = ((state.velocity[near] - state.velocity[near].mean(axis=0)) ** 2).sum() / len(near)
            assert measured[i] == pytest.approx(len(near) / (np.pi * 1.2**2) * variance, rel=1e-9, abs=1e-12)


def test_people_who_walk_alike_press_on_nobody():
    bodies = make_bodies(np.full(9, 0.2), np.full(9, 80.0))
    grid = np.array([(3 + 0.5 * i, 3 + 0.5 * j) for i in range(3) for j in range(3)])
    simulation = Simulation(HALL, bodies, make_state(grid, np.tile([1.0, 0.5], (9, 1))), driving=False)
    assert crowd_pressure(simulation) == pytest.approx(np.zeros(9), abs=1e-12)
