"""People pressed against walls and a door: overlap, residual, and an independent solver for the same velocities.

The reference is clarabel, an interior-point method, on the problems as the paper prints them, with contacts found by brute
force: it shares no line with the schemes.
"""

from dataclasses import replace

import clarabel
import numpy as np
import pytest
from cases import looped
from crowds import copied, people, scatter, tight, touches
from late import late
from shapely.geometry import box

from crowd_env.core.arrays.state import make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import NSM1, NSM2, SCHEMES
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

sparse = late("scipy.sparse")

DT = 0.01
SIDE = {20: 5.0, 100: 9.0, 1000: 24.0}


def closed_room(side):
    return Geometry.from_polygon(box(0, 0, side, side))


def door_room(side):
    """Return a room whose door nobody fits through: they press on both jambs for good."""
    return Geometry.from_polygon(box(0, 0, side, side), exits=[[(side, side / 2 - 0.18), (side, side / 2 + 0.18)]])


def towards(goal, state):
    """Return commands at full speed towards ``goal``, along the world's axes."""
    way = goal - state.position
    return way / np.hypot(*way.T)[:, None]


def start(geometry, count, seed=0):
    rng = np.random.default_rng(seed)
    bodies = people(rng, count)
    return bodies, make_state(scatter(rng, geometry, bodies.radius))


def press(geometry, bodies, state, goal, scheme, steps, watch=lambda simulation: None):
    """Advance a crowd that wants to ``goal`` step by step."""
    simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=DT), fields=[None])
    relative = np.zeros(len(state.position), bool)
    for _ in range(steps):
        simulation.advance(towards(goal, state), relative=relative)
        watch(simulation)
    return simulation


def deepest(geometry, bodies, state):
    """Return the deepest overlap [m] of any two bodies or of a body and a wall, over all pairs."""
    x, r = state.position[state.active], bodies.radius[state.active]
    i, j = np.triu_indices(len(x), 1)
    gap = np.hypot(*(x[i] - x[j]).T) - r[i] - r[j]
    return -min(gap.min(), (geometry.clearance(x) - r).min())


# --------------------------------------------------------------------------------------------- overlap and residual


@looped("goal", [(9.0, 4.5), (9.0, 9.0)], ids=["door", "corner"], quick=1)
@pytest.mark.parametrize("name", SCHEMES)
def test_a_jam_of_100_stays_within_the_stated_overlap_and_residual(name, goal):
    geometry = closed_room(9.0) if goal == (9.0, 9.0) else door_room(9.0)
    bodies, state = start(geometry, 100)
    scheme = SCHEMES[name]
    bound = scheme.overlap_bound(bodies, DT)
    worst, inside = [], []

    def watch(simulation):
        worst.append(deepest(geometry, bodies, state))
        inside.append(geometry.contains(state.position[state.active]).all())

    simulation = press(geometry, bodies, state, np.array(goal), scheme, 300, watch)
    totals = simulation.diagnostics
    assert (simulation.contacts().gap < 1e-3).sum() > 20  # it is a jam, also where a social force keeps many apart
    assert all(inside)
    assert max(worst) <= bound
    assert totals.max_overlap[0] == pytest.approx(max(worst[:-1]), abs=1e-12)
    assert totals.max_outside[0] <= totals.max_overlap[0]
    assert totals.unconverged[0] == 0
    assert totals.residual[0] <= getattr(scheme, "tolerance", 0.0)


@looped("trial", ["spontaneous", "inertial"])
@looped("tolerance", [1e-1, 1e-3])
def test_the_overlap_of_nsm1_follows_its_tolerance(trial, tolerance):
    geometry = closed_room(SIDE[20])
    bodies, state = start(geometry, 20)
    scheme = NSM1(trial=trial, tolerance=tolerance)
    worst = []
    goal = np.array([5.0, 5.0])
    press(geometry, bodies, state, goal, scheme, 300, lambda s: worst.append(deepest(geometry, bodies, state)))
    assert max(worst) <= scheme.overlap_bound(bodies, DT)
    assert max(worst[150:]) <= max(worst) + 1e-12  # does not build up
    assert max(worst) > 1e-12


@looped("seed", [0, 1, 2], quick=1)
def test_a_crowd_that_stands_costs_hardly_a_sweep(seed):
    # Elastic contacts at rest rattle: their impulses are those of the step before the last.
    geometry, goal, sweeps = door_room(SIDE[20]), np.array([5.0, 2.5]), []
    bodies, state = start(geometry, 20, seed)
    press(geometry, bodies, state, goal, NSM2(), 1500, lambda s: sweeps.append(s.results.diagnostics.iterations[0]))
    assert state.active.all()
    assert max(sweeps[:900]) > 30  # they came to rest with pushing
    assert np.mean(sweeps[1200:]) < 10.0


def test_a_solver_out_of_iterations_says_so():
    geometry = closed_room(SIDE[20])
    bodies, state = start(geometry, 20)
    scheme = NSM1(max_iterations=1, tolerance=1e-6)
    simulation = press(geometry, bodies, state, np.array([5.0, 5.0]), scheme, 200)
    assert simulation.diagnostics.unconverged[0] > 20
    assert simulation.diagnostics.residual[0] > 1e-6


# ------------------------------------------------------------------------------------- an independent solver's answer


def contact_problem(geometry, bodies, state, below):
    """Return gaps (C,), and the matrices (C, 2P) of the normal and tangential speed of separation."""
    found = touches(geometry, bodies, state, below)
    normal, tangent = (sparse.lil_matrix((len(found), 2 * len(bodies.radius))) for _ in range(2))
    for c, touch in enumerate(found):
        nx, ny = touch.normal
        for k, sign in ((touch.i, 1.0), (touch.j, -1.0)):
            if k >= 0:
                normal[c, 2 * k], normal[c, 2 * k + 1] = sign * nx, sign * ny
                tangent[c, 2 * k], tangent[c, 2 * k + 1] = -sign * ny, sign * nx
    return np.array([t.gap for t in found]), normal.tocsr(), tangent.tocsr()


def minimise(quadratic, linear, rows, least):
    """Return argmin x.Q.x / 2 + l.x subject to rows @ x >= least."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    settings.static_regularization_constant = 1e-12  # with the defaults it can stop short, some mm/s away
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = 1e-15
    settings.iterative_refinement_max_iter = 50
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix(sparse.triu(quadratic)),
        linear,
        sparse.csc_matrix(-rows),
        -least,
        [clarabel.NonnegativeConeT(len(least))],
        settings,
    ).solve()
    assert str(solution.status) == "Solved"
    return np.array(solution.x)


def reference_nsm1(scheme, geometry, bodies, state, desired):
    """Equation 6: the admissible velocity nearest to the trial velocity, in the norm of the masses."""
    pull = (desired - state.velocity) / bodies.relaxation_time[:, None]
    trial = (desired if scheme.trial == "spontaneous" else state.velocity + DT * pull).ravel()
    gap, normal, _ = contact_problem(geometry, bodies, state, below=0.3)
    weight = np.repeat(bodies.mass, 2) / 80.0
    return minimise(sparse.diags(weight), -weight * trial, normal, -gap / DT).reshape(-1, 2)


def reference_nsm2(scheme, geometry, bodies, state, desired):
    """Equations 8-10 as printed, dissipation only where people approach: X = (u- + u+) / 2."""
    before = state.velocity.ravel()
    mass = np.repeat(bodies.mass, 2)
    percussion = DT * mass * ((desired - state.velocity) / bodies.relaxation_time[:, None]).ravel()
    _, normal, tangent = contact_problem(geometry, bodies, state, below=1e-12)
    approach = sparse.diags((normal @ before < 0).astype(float))
    dissipation = scheme.normal_dissipation * normal.T @ approach @ normal
    dissipation += scheme.tangential_dissipation * tangent.T @ approach @ tangent
    quadratic = 2 * sparse.diags(mass) + dissipation
    linear = -(2 * before + percussion / mass) * mass
    mean = minimise(quadratic / 80.0, linear / 80.0, normal, 0.5 * (normal @ before))
    return (2 * mean - before).reshape(-1, 2)


PROBLEMS = {
    "nsm1": (NSM1(), reference_nsm1),
    "nsm1-inertial": (NSM1("inertial"), reference_nsm1),
    "nsm2-printed": (NSM2(reaction="printed"), reference_nsm2),
    "nsm2-soft-rough": (NSM2(300.0, 40.0, reaction="printed"), reference_nsm2),
}


@pytest.mark.parametrize("count", [20, 100, pytest.param(1000, marks=pytest.mark.more)])
@looped("place", ["door", "corner"], quick=1)
@looped("problem", PROBLEMS)
def test_velocities_in_a_jam_agree_with_an_interior_point_solver(problem, place, count):
    scheme, reference = PROBLEMS[problem]
    scheme = tight(scheme, 1e-9)
    side = SIDE[count]
    geometry, goal = (closed_room(side), (side, side)) if place == "corner" else (door_room(side), (side, side / 2))
    bodies, state = start(geometry, count)
    # NSM2 is solved in a jam that DEM has pressed together: everyone overlaps, so that the problem is large.
    crush = replace(scheme, tolerance=1e-3) if isinstance(scheme, NSM1) else "dem"
    press(geometry, bodies, state, np.array(goal), crush, 700 if count == 1000 and crush == "dem" else 250)
    bodies, state = copied(bodies, state)
    inside = state.active.copy()
    command = towards(np.array(goal), state)
    expected = reference(scheme, geometry, bodies, state, bodies.desired_speed[:, None] * command)
    simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=DT), fields=[None])
    simulation.advance(command, relative=np.zeros(count, bool))
    pushed = (simulation.results.impulse_magnitude > 1e-3).sum()
    assert pushed > 0.5 * inside.sum()
    assert simulation.diagnostics.residual[0] <= 1e-9
    np.testing.assert_allclose(state.velocity[inside], expected[inside], rtol=0, atol=1e-6)


@pytest.mark.more
@looped("trial", ["spontaneous", "inertial"])
def test_a_jam_of_1000_overlaps_by_less_than_a_fifth_of_a_millimeter_with_the_defaults(trial):
    side = SIDE[1000]
    geometry = door_room(side)
    bodies, state = start(geometry, 1000)
    simulation = press(geometry, bodies, state, np.array([side, side / 2]), NSM1(trial), 500)
    assert (simulation.contacts().gap < 1e-3).sum() > 700  # it is a jam
    assert deepest(geometry, bodies, state) < 0.2e-3
    assert simulation.diagnostics.max_overlap[0] < 0.2e-3
    assert simulation.diagnostics.unconverged[0] == 0
