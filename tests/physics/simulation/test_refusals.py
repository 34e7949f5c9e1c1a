"""What a simulation refuses, and what it says of a run."""

import subprocess
import sys

import numpy as np
import pytest
from crowds import every_scheme, joined, people, plain, scatter
from repository import ROOT
from shapely.geometry import box

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import DEM, NSM1, SCHEMES
from crowd_env.physics.scheme import arrays_of
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.workspace import grow
from crowd_env.scenarios.population import Population

# ------------------------------------------------------------------------------------------------------- wrong input


def people_at(*positions, **options):
    return make_bodies(np.full(len(positions), 0.2), 80.0, **options), make_state(positions)


@pytest.mark.parametrize("dt", [0.0, -0.01, float("nan"), float("inf")])
def test_a_step_must_be_positive_and_finite(dt):
    with pytest.raises(ValueError, match=r"dt is .* s; it must be > 0 and finite"):
        Simulation(plain(), *people_at([0, 0]), physics=Physics(dt=dt))


@every_scheme
def test_a_step_above_the_stable_one_is_refused_with_both_numbers(name):
    bodies, state = people_at([0, 0], relaxation_time=0.05)
    limit = SCHEMES[name].stable_dt(bodies)
    if np.isinf(limit):
        Simulation(plain(), bodies, state, physics=Physics(name, dt=10.0))
        return
    with pytest.raises(ValueError, match=rf"dt = 1 s is above the stable step of \S+, {limit:.4g} s"):
        Simulation(plain(), bodies, state, physics=Physics(name, dt=1.0))
    Simulation(plain(), bodies, state, physics=Physics(name, dt=1.0, allow_unstable=True))
    Simulation(plain(), bodies, state, physics=Physics(name, dt=0.999 * limit))


@every_scheme
def test_the_stable_step_is_stable(name):
    # At the step the scheme calls stable (or 0.5 s), bouncing pairs and relaxing velocities stay bounded.
    scheme = SCHEMES[name]
    bodies = make_bodies([0.2, 0.25], [60.0, 62.0], desired_speed=1.5, relaxation_time=0.01)
    state = make_state([[0.0, 0.0], [0.44, 0.0]], [[0.5, 0.0], [-0.5, 0.1]])
    dt = min(0.97 * scheme.stable_dt(bodies), 0.5)
    simulation = Simulation(
        plain(), bodies, state, physics=Physics(name, dt=dt, allow_unstable=True)
    )  # however far they go
    command = np.array([[1.0, 0.0], [-1.0, 0.0]])
    simulation.advance(command, relative=np.zeros(2, bool), n_substeps=400)
    assert np.abs(state.velocity).max() < 100


@pytest.mark.parametrize("name", ["position", "velocity"])
def test_positions_and_velocities_must_be_finite(name):
    bodies, state = people_at([0, 0], [1, 1])
    getattr(state, name)[1, 0] = np.nan
    with pytest.raises(ValueError, match=f"{name} of pedestrian 1 is not finite"):
        Simulation(plain(), bodies, state)


def test_shapes_must_agree():
    bodies, state = people_at([0, 0], [1, 1])
    with pytest.raises(ValueError, match=r"^state\.position has the shape \(1, 2\); it must be \(2, 2\)$"):
        Simulation(plain(), bodies, make_state([[0, 0]]))
    with pytest.raises(ValueError, match=r"env_start is \[0, 1\]; it must ascend from 0 to the number of people, 2"):
        Simulation(plain(), bodies._replace(env_start=np.array([0, 1])), state)
    with pytest.raises(ValueError, match=r"^state\.time has the shape \(2,\); it must be \(1,\)$"):
        Simulation(plain(), bodies, make_state(state.position, environments=2))


@pytest.mark.parametrize(
    "wrong",
    [
        dict(command=np.ones((1, 2))),
        dict(command=np.ones(2)),
        dict(command=np.ones((2, 3))),
        dict(relative=np.ones(1, bool)),
        dict(external_force=np.ones((1, 2))),
        dict(n_substeps=-1),
    ],
    ids=["few commands", "flat commands", "wide commands", "few relative", "few forces", "backwards"],
)
def test_what_is_asked_must_have_the_right_shape(wrong):
    # A kernel would read past the end of an array that is too short.
    simulation = Simulation(plain(), *people_at([0, 0], [1, 1]))
    with pytest.raises(ValueError):
        simulation.advance(**wrong)


@pytest.mark.parametrize("which", [[1], [-1], [0, 0]])
def test_every_environment_needs_a_plan(which):
    with pytest.raises(ValueError):
        Simulation([plain()], *people_at([0, 0]), geometry_of_env=np.array(which))


def test_one_field_a_plan():
    with pytest.raises(ValueError, match="2 fields for 1 geometries"):
        Simulation(plain(), *people_at([0, 0]), fields=[None, None])


def test_restart_with_another_number_of_people_is_refused():
    simulation = Simulation(plain(), *people_at([0, 0], [1, 1]))
    with pytest.raises(ValueError, match="environment 0 holds 2 people, not 1"):
        simulation.restart(0, *people_at([0, 0])[:1], np.zeros((1, 2)))


def test_grains_have_no_spontaneous_velocity():
    with pytest.raises(ValueError, match=r"nsm1: passive grains have no spontaneous velocity; use NSM1\(trial="):
        Simulation(plain(), *people_at([0, 0]), physics=NSM1(), driving=False)


# ------------------------------------------------------------------------------------------------------ what diverges


def test_a_step_far_too_large_ends_in_a_sentence_not_in_a_crash():
    geometry = Geometry.from_polygon(box(0, 0, 3, 3))
    rng = np.random.default_rng(14)
    bodies = people(rng, 20)
    state = make_state(scatter(rng, geometry, bodies.radius), rng.normal(0, 1, (20, 2)))
    simulation = Simulation(geometry, bodies, state, physics=Physics(DEM(stiffness=1e12), dt=0.5, allow_unstable=True))
    with pytest.raises(FloatingPointError, match=r"dem: positions of environment 0 .*dt = 0.5 s; take a smaller dt"):
        for _ in range(400):
            simulation.advance(n_substeps=5)


@every_scheme
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("who", [0, 3, 6])
def test_a_position_that_is_not_finite_is_reported(name, value, who):
    positions = [[k, 0.5 * k] for k in range(7)]
    bodies, state = people_at(*positions)
    simulation = Simulation(plain(), bodies, state, physics=name)
    simulation.advance()
    state.position[who, 1] = value
    with pytest.raises(FloatingPointError, match="environment 0"):
        simulation.advance()


@every_scheme
def test_an_unheard_of_force_is_reported_within_the_call_or_the_next(name):
    bodies, state = people_at([0, 0], [1, 1])
    simulation = Simulation(plain(), bodies, state, physics=name)
    force = np.array([[0.0, 0.0], [np.nan, 0.0]])
    with pytest.raises((FloatingPointError, ValueError)):
        simulation.advance(external_force=force, n_substeps=2)


def test_only_the_environment_that_diverged_is_named():
    bodies, state = joined([people_at([0, 0]), people_at([1, 1]), people_at([2, 2])])
    simulation = Simulation(plain(), bodies, state)
    state.position[1] = np.nan
    with pytest.raises(FloatingPointError, match="environment 1"):
        simulation.advance()


# Programs that a kernel could crash or hang in; pytest would go down with it.
NAN_IN_A_JAM = """
geometry = Geometry.from_polygon(box(0, 0, 6, 6))
people = Population(90, radius=Uniform(0.2, 0.2))
bodies, position = people.draw(np.random.default_rng(0), geometry)
simulation = Simulation(geometry, bodies, make_state(position), physics=SCHEMES["nsm1-inertial"])
east = dict(command=np.tile([1.0, 0.0], (90, 1)), relative=np.zeros(90, bool))
simulation.advance(n_substeps=300, **east)
assert len(simulation.contacts().gap) > 150, "enough contacts for the accelerated solver"
force = np.zeros((90, 2))
force[5] = np.nan
for _ in range(3):
    simulation.advance(external_force=force, **east)
"""
FLYING_APART = """
rng = np.random.default_rng(0)
bodies = make_bodies(np.full(30, 0.2), 80.0)
state = make_state(rng.uniform(10, 20, (30, 2)), rng.normal(0, 2e7, (30, 2)))
plan = Geometry.from_polygon(box(0, 0, 3, 3))
simulation = Simulation(plan, bodies, state, physics=SCHEMES["dem"], driving=False)
for _ in range(100):
    simulation.advance(n_substeps=1000)
"""


@pytest.mark.more
@pytest.mark.parametrize("program", [NAN_IN_A_JAM, FLYING_APART], ids=["nan in a jam", "flying apart"])
def test_a_hopeless_run_neither_crashes_nor_hangs(program):
    head = "import numpy as np\nfrom shapely.geometry import box\nfrom crowd_env import *\n"
    command = [sys.executable, "-c", head + program]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert result.returncode in (0, 1), result.stderr  # not a signal
    if result.returncode:
        assert result.stderr.strip().splitlines()[-1].startswith(("FloatingPointError", "ValueError")), result.stderr


@every_scheme
def test_every_step_says_what_went_on_in_it(name):
    geometry = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)])
    bodies, position = Population(40).draw(np.random.default_rng(3), geometry)
    simulation = Simulation(geometry, bodies, make_state(position), physics=Physics(name, dt=0.01))
    east = dict(command=np.tile([1.0, 0.0], (40, 1)), relative=np.zeros(40, bool))
    deepest, iterations = [], []
    for _ in range(200):
        simulation.advance(**east)
        step = simulation.results.diagnostics
        deepest.append(float(step.max_overlap[0]))
        iterations.append(int(step.iterations[0]))
        gap = simulation.contacts().gap
        assert step.max_overlap[0] == max(-gap.min(initial=0.0), 0.0)
    total = simulation.diagnostics
    assert total.max_overlap[0] == max(deepest) > min(deepest)
    assert total.iterations[0] == sum(iterations)


@pytest.mark.parametrize("threads", [0, -1])
def test_there_is_at_least_one_thread(threads):
    with pytest.raises(ValueError, match=rf"^threads is {threads}; it must be 1 to 1024$"):
        Simulation(plain(), *people_at([0, 0]), physics=Physics(threads=threads))


def test_more_memory_keeps_all_that_others_hold_on_to():
    """Environments and kernels refer to a batch once: they must see what is replaced when lists of neighbors grow."""
    geometry = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2), (5, 3)]])
    bodies = make_bodies(np.full(3, 0.2), np.full(3, 70.0))
    simulation = Simulation(geometry, bodies, make_state(np.array([[1.0, 1], [2, 2], [3, 3]])), physics="hertz")
    history, workspace, batch = simulation.history, simulation.workspace, simulation.batch
    before = len(workspace.neighbors.owner)
    grow(history, workspace, bodies, arrays_of(simulation.scheme))
    seen = batch.workspace
    for rows in (seen.neighbors.owner, seen.narrow_phase.candidates, seen.social_pairs.size, batch.history.contacts.i):
        assert len(rows) == len(workspace.neighbors.owner) > before
    assert all(
        getattr(batch.results, name) is getattr(simulation.results, name) for name in ("impulse", "impulse_magnitude")
    )
