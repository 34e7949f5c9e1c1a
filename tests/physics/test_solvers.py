"""The solver of NSM1 and NSM2: its start, its wall and its two ways to stop."""

import numpy as np
import pytest
from cases import looped
from crowds import people, scatter
from shapely.geometry import box

from crowd_env.core.arrays.state import make_state
from crowd_env.core.kernels.jit import kernel
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import NSM1, NSM2, constraints, solvers
from crowd_env.physics.allocation import allocate
from crowd_env.physics.constraints import Constraints, Extent
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.solvers import Stopping

DT = 0.01


# Only kernels call these: here they get an entrance for Python.
@kernel
def assemble_no_overlap(extent, contacts, mass, v, rows, dt, warm):
    return constraints.assemble_no_overlap(extent, contacts, mass, v, rows, dt, warm)


@kernel
def solve(extent, rows, active_rows, mass, v, room, compliance, stopping):
    return solvers.solve(extent, rows, active_rows, mass, v, room, compliance, stopping)


@kernel
def warm_start(pair, coefficients, reaction, mass, start, u):
    solvers._warm_start(pair, coefficients, reaction, mass, start, u)


def jam(scheme, count=150, side=9.0, steps=200, seed=0):
    """Return a crowd that has pressed into a corner, and the command that it follows."""
    rng = np.random.default_rng(seed)
    geometry = Geometry.from_polygon(box(0, 0, side, side))
    bodies = people(rng, count)
    state = make_state(scatter(rng, geometry, bodies.radius))
    simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=DT), fields=[None])
    relative = np.zeros(count, bool)
    for _ in range(steps):
        way = np.array([side, side]) - state.position
        simulation.advance(way / np.hypot(*way.T)[:, None], relative=relative)
    return simulation


def problem_of(simulation):
    """Return number of contacts, velocities without contact and the contacts of the last step, all of environment 0."""
    state, bodies = simulation.state, simulation.bodies
    way = 9.0 - state.position
    free = bodies.desired_speed[:, None] * way / np.hypot(*way.T)[:, None]
    return int(simulation.history.contacts.number[0]), free, simulation.history.contacts


def natural_residual(simulation, free):
    """Return min(a P, w) [m/s] of every contact of the last step without and with its impulses, from the contacts alone."""
    contacts, mass = simulation.contacts(), simulation.bodies.mass
    pair = contacts.j >= 0
    mobility = 1 / mass[contacts.i] + np.where(pair, 1 / mass[contacts.j], 0.0)

    def residual(impulse):
        v = free.copy()
        push = impulse[:, None] * contacts.normal
        np.add.at(v, contacts.i, push / mass[contacts.i][:, None])
        np.subtract.at(v, contacts.j[pair], (push / mass[contacts.j][:, None])[pair])
        speed = v[contacts.i] - np.where(pair[:, None], v[contacts.j], 0.0)
        return np.minimum(mobility * impulse, (speed * contacts.normal).sum(axis=1) + contacts.gap / DT)

    return residual(np.zeros(len(mobility))), residual(contacts.impulse[:, 0])


@looped("share", [1e-1, 1e-3, 1e-6])
def test_a_relative_tolerance_holds_for_the_residual_of_the_contacts(share):
    simulation = jam(NSM1(tolerance=10.0, relative_tolerance=share), steps=150)
    assert simulation.diagnostics.unconverged[0] == 0
    _, free, _ = problem_of(simulation)
    way = 9.0 - simulation.workspace.previous_position
    free = simulation.bodies.desired_speed[:, None] * way / np.hypot(*way.T)[:, None]
    none, solved = natural_residual(simulation, free)
    assert np.linalg.norm(none) > 1.0
    assert np.linalg.norm(solved) <= 1.001 * share * np.linalg.norm(none)
    assert np.linalg.norm(solved) > 1e-5 * share * np.linalg.norm(none)  # and is what it stopped at


@looped("tolerance", [0.05, 0.005])
def test_the_residual_is_that_of_the_worst_of_all_contacts(tolerance):
    # Looks at the rows end early where one is off by too much; the last must not.
    simulation = jam(NSM1(tolerance=tolerance), steps=150)
    way = 9.0 - simulation.workspace.previous_position
    free = simulation.bodies.desired_speed[:, None] * way / np.hypot(*way.T)[:, None]
    _, solved = natural_residual(simulation, free)
    assert simulation.results.diagnostics.iterations[0] > 5
    assert 0.1 * tolerance < abs(solved).max() <= tolerance
    assert simulation.results.diagnostics.residual[0] == pytest.approx(abs(solved).max(), rel=1e-6)


@looped("make", [NSM1, NSM2])
def test_both_tolerances_must_be_met(make):
    strict = jam(make(tolerance=1e-6, relative_tolerance=0.5), steps=60)
    assert strict.diagnostics.residual[0] <= 1e-6
    with pytest.raises(ValueError, match=r"relative_tolerance is 0\.0; it must be > 0"):
        make(relative_tolerance=0.0)


def test_a_wall_does_not_move():
    simulation = jam(NSM1())
    number, free, contacts = problem_of(simulation)
    assert (contacts.j[:number] < 0).sum() > 10
    rows, mass = simulation.workspace.constraints, simulation.bodies.mass
    extent = Extent(0, 0, len(mass), 0, number)
    active_rows = assemble_no_overlap(extent, contacts, mass, free, rows, DT, True)
    sweeps, _, converged = solve(extent, number, active_rows, mass, free, rows, None, Stopping(1e-9, np.inf, 20_000))
    assert converged and sweeps > 50
    np.testing.assert_array_equal(rows.velocity[len(mass)], 0.0)


@looped("factor", [0.0, 1.0, -1.0, 30.0])
def test_a_start_is_never_worse_than_none(factor):
    # In the energy that the solution minimises: 1/2 |v|_M^2 + P . bias.
    simulation = jam(NSM1())
    number, free, contacts = problem_of(simulation)
    mass, count = simulation.bodies.mass, len(free)
    rows = allocate(Constraints, {"M": number, "B": count + 1})
    rng = np.random.default_rng(1)
    contacts.impulse[:number, 0] *= factor * rng.uniform(0.5, 1.5, number)
    assemble_no_overlap(Extent(0, 0, count, 0, number), contacts, mass, free, rows, DT, True)
    u = np.vstack([free, [[0.0, 0.0]]])
    warm_start(rows.pair, rows.coefficients, rows.reaction, mass, free, u)
    share, first = rows.coefficients[:, 3], rows.pair[:, 0]
    impulse = rows.reaction[:, 0] * share * mass[first]
    energy = 0.5 * (mass[:, None] * u[:-1] ** 2).sum() + impulse @ rows.coefficients[:, 2]
    none = 0.5 * (mass[:, None] * free**2).sum()
    assert energy <= none + 1e-9
    assert (rows.reaction[:, 0] >= 0).all() or factor < 0
    if factor > 0:
        assert energy < none - 1.0
    back = np.zeros_like(u)  # the velocities belong to the reactions
    push = rows.reaction[:, :1] * rows.coefficients[:, :2]
    np.add.at(back, first, share[:, None] * push)
    np.subtract.at(back, rows.pair[:, 1], (1 - share)[:, None] * push)
    np.testing.assert_allclose(u - np.vstack([free, [[0.0, 0.0]]]), back, atol=1e-9)


def test_rough_contacts_find_room_for_their_second_row():
    # 40 people in one heap: far more contacts than half of the entries of a list.
    rng = np.random.default_rng(3)
    bodies = people(rng, 40)
    state = make_state(rng.uniform(4.0, 4.6, (40, 2)), rng.normal(0, 1, (40, 2)))
    geometry = Geometry.from_polygon(box(0, 0, 9, 9))
    scheme = NSM2(tangential_dissipation=50.0, max_iterations=100)
    simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=1e-4), driving=False)
    momentum = bodies.mass @ state.velocity
    simulation.advance()
    assert simulation.workspace.constraints.pair.shape[0] >= 2 * simulation.history.contacts.number[0] > 1200
    assert (simulation.contacts().impulse[:, 1] != 0).sum() > 100
    np.testing.assert_allclose(bodies.mass @ state.velocity, momentum, atol=1e-8)


def test_momentum_that_runs_away_is_taken_out():
    # The same heap, 16 contacts a person: with full momentum the sweeps diverge (1e9 m/s), without they shrink slowly.
    rng = np.random.default_rng(3)
    bodies = people(rng, 40)
    state = make_state(rng.uniform(4.0, 4.6, (40, 2)), rng.normal(0, 1, (40, 2)))
    geometry = Geometry.from_polygon(box(0, 0, 9, 9))
    simulation = Simulation(geometry, bodies, state, physics=Physics(NSM2(), dt=1e-4), driving=False)
    simulation.advance()
    assert np.isfinite(state.velocity).all()
    assert 0.0 < simulation.diagnostics.residual[0] < 0.5
