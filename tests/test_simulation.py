"""Simulation: exits and clocks, the same bits however a crowd is run, and one clear sentence for wrong input."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from crowds import PLANS, copied, crowd_in, joined, part, people, plain, scatter
from shapely.geometry import box

from crowd_env.geometry import Geometry
from crowd_env.navigation import travel_time_field
from crowd_env.physics import DEM, NSM1, SCHEMES, make_scheme
from crowd_env.physics.world import allocate_memory, grow_memory
from crowd_env.population import Population
from crowd_env.simulation import Simulation
from crowd_env.state import make_bodies, make_state

every_scheme = pytest.mark.parametrize("name", SCHEMES)
ROOM = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2.09), (5, 2.91)]])
TWO_DOORS = Geometry.from_polygon(box(0, 0, 6, 4), exits={"east": [(6, 1), (6, 3)], "south": [(1, 0), (3, 0)]})


def march(geometry, position, velocity, *, scheme, radius=0.2, dt=0.01, **options):
    """Return a simulation of people who already walk at their desired velocity, and what to ask for."""
    velocity = np.atleast_2d(np.asarray(velocity, dtype=float))
    count = len(velocity)
    speed = np.hypot(*velocity.T)
    bodies = make_bodies(np.full(count, radius), 80.0, desired_speed=speed, relaxation_time=0.3)
    state = make_state(position, velocity)
    simulation = Simulation(geometry, bodies, state, scheme=scheme, dt=dt, fields=[None], **options)
    command = velocity / np.where(speed > 0, speed, 1.0)[:, None]
    return simulation, dict(command=command, relative=np.zeros(count, bool))


# ------------------------------------------------------------------------------------------------------------- exits


@every_scheme
@pytest.mark.parametrize("dt", [0.01, 0.03])
def test_exit_time_is_exact_for_uniform_motion(name, dt):
    simulation, asked = march(
        TWO_DOORS,
        [[4.3, 1.4], [2.0, 1.1], [3.0, 3.4]],
        [[1.37, 0.4], [0.15, -1.21], [0.0, 0.0]],
        scheme=name,
        dt=dt,
        allow_unstable=True,
    )
    simulation.advance(n_substeps=round(3 / dt), **asked)
    state = simulation.state
    assert state.active.tolist() == [False, False, True]
    assert state.exit_index.tolist() == [0, 1, -1]
    np.testing.assert_allclose(state.exit_time, [1.7 / 1.37, 1.1 / 1.21, np.nan], atol=1e-12)
    assert simulation.inside.tolist() == [1]
    assert state.time == pytest.approx(3.0)


@every_scheme
def test_who_is_out_stays_as_he_left_and_is_counted_once(name):
    simulation, asked = march(ROOM, [[4.95, 2.5], [1.0, 1.0]], [[1.2, 0], [0, 0]], scheme=name)
    simulation.advance(n_substeps=5, **asked)
    left = simulation.state.copy()
    assert left.active.tolist() == [False, True]
    turned_back = dict(asked, command=np.array([[-1.0, 0.0], [1.0, 0.0]]))
    simulation.advance(n_substeps=50, external_force=np.array([[-500.0, 0.0], [0.0, 0.0]]), **turned_back)
    for before, after in zip(left[:-1], simulation.state[:-1], strict=True):
        np.testing.assert_array_equal(before[0], after[0])
    assert simulation.memory.crush.tolist() == [0.0, 0.0]


@every_scheme
def test_who_is_out_pushes_nobody(name):
    # The second follows into the place where the first one stopped being there.
    scheme = make_scheme(name, social="none")
    simulation, asked = march(ROOM, [[4.95, 2.5], [4.5, 2.5]], [[1.2, 0], [1.2, 0]], scheme=scheme)
    simulation.advance(n_substeps=60, **asked)
    assert not simulation.state.active.any()
    assert simulation.diagnostics.max_overlap[0] == 0.0
    np.testing.assert_allclose(simulation.state.exit_time, [0.05 / 1.2, 0.5 / 1.2], atol=1e-12)


@every_scheme
def test_an_exit_is_passed_outwards_only(name):
    # Began outside, beyond the line: walks in, is not counted; walks out again, is.
    wide = Geometry.from_polygon(box(0, 0, 50, 50), exits=[[(50, 1), (50, 49)]])
    simulation, asked = march(wide, [[50.3, 25.0]], [[-1.5, 0.0]], scheme=name)
    simulation.advance(n_substeps=40, **asked)
    assert simulation.state.active.tolist() == [True]
    assert simulation.state.position[0, 0] == pytest.approx(49.7)
    simulation.advance(n_substeps=200, command=-asked["command"], relative=asked["relative"])
    assert simulation.state.active.tolist() == [False]


@every_scheme
def test_nobody_leaves_through_a_wall(name):
    # Everyone runs east; only those in front of the door get out, and only by it.
    geometry = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2), (5, 3)]])
    rng = np.random.default_rng(11)
    bodies = people(rng, 25)
    state = make_state(scatter(rng, geometry, bodies.radius))
    simulation = Simulation(geometry, bodies, state, scheme=name, dt=0.01, fields=[None])
    east = np.tile([1.0, 0.0], (25, 1))
    simulation.advance(east, relative=np.zeros(25, bool), n_substeps=800)
    out = ~state.active
    assert 2 <= out.sum() < 25
    assert ((state.position[out, 1] > 2) & (state.position[out, 1] < 3) & (state.position[out, 0] >= 5)).all()
    assert (state.exit_index[out] == 0).all()
    assert geometry.contains(state.position[state.active]).all()
    assert np.isnan(state.exit_time[state.active]).all()


@every_scheme
def test_the_line_of_an_exit_counts_only_within_its_ends(name):
    # The exit lies on x = 3 in the upper leg of an L; who crosses x = 3 in the lower leg is still inside.
    plan = Geometry.from_polygon([(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)], exits=[[(3, 4), (3, 5)]])
    simulation, asked = march(plan, [[2.5, 1.5], [2.5, 4.5]], [[1.0, 0.0], [1.0, 0.0]], scheme=name)
    simulation.advance(n_substeps=100, **asked)
    assert simulation.state.active.tolist() == [True, False]
    assert simulation.state.position[0, 0] == pytest.approx(3.5)


@every_scheme
def test_response_time_is_waited_for(name):
    bodies = make_bodies([0.2, 0.2], 80.0, desired_speed=1.5, response_time=[0.0, 0.5])
    state = make_state([[0.0, 0.0], [0.0, 5.0]])
    simulation = Simulation(plain(), bodies, state, scheme=name, dt=0.01)
    asked = dict(command=np.tile([1.0, 0.0], (2, 1)), relative=np.zeros(2, bool))
    simulation.advance(n_substeps=50, **asked)
    assert state.position[0, 0] > 0.2
    assert state.position[1, 0] == 0.0
    simulation.advance(n_substeps=52, **asked)
    assert state.position[1, 0] > 0.001


# ------------------------------------------------------------------------------------------------------ the same bits


def evacuations(count=5):
    """Return crowds of different sizes that jam at the door of the room."""
    crowds = []
    for e, size in enumerate([17, 1, 26, 9, 22][:count]):
        rng = np.random.default_rng(100 + e)
        bodies = people(rng, size)
        crowds.append((bodies, make_state(scatter(rng, ROOM, bodies.radius))))
    return crowds


def run(name, crowds, *, calls=15, n_substeps=10, prepare=None, before_each=None, **options):
    bodies, state = joined([copied(*crowd) for crowd in crowds])
    simulation = Simulation(ROOM, bodies, state, scheme=name, dt=0.01, fields=[room_field()], **options)
    if prepare is not None:
        prepare(simulation)
    for _ in range(calls):
        if before_each is not None:
            before_each(simulation)
        simulation.advance(n_substeps=n_substeps)
    return simulation


@cache
def room_field():
    """Return the travel-time field of the room, made once."""
    return travel_time_field(ROOM, 0.25, min_radius=0.2)


def same_bits(a, b):
    for name in a.state._fields:
        np.testing.assert_array_equal(getattr(a.state, name), getattr(b.state, name), err_msg=name)


@every_scheme
def test_alone_or_anywhere_in_a_batch(name):
    crowds = evacuations()
    order = [3, 0, 4, 2, 1]
    batches = [(crowds, range(5)), ([crowds[e] for e in order], order)]
    alone = [run(name, [crowd]) for crowd in crowds]
    assert sum(int(a.inside[0]) for a in alone) < 70  # some are out
    assert max(a.diagnostics.max_overlap[0] for a in alone) > 0
    for batch, numbers in batches:
        together = run(name, batch)
        for place, e in enumerate(numbers):
            for field, expected in part(alone[e].state, alone[e].bodies, 0).items():
                np.testing.assert_array_equal(part(together.state, together.bodies, place)[field], expected)
            rows = slice(together.bodies.env_start[place], together.bodies.env_start[place + 1])
            np.testing.assert_array_equal(together.memory.push[rows], alone[e].memory.push)
            np.testing.assert_array_equal(together.memory.crush[rows], alone[e].memory.crush)
            for total, expected in zip(together.diagnostics, alone[e].diagnostics, strict=True):
                assert total[place] == expected[0]
            for listed, expected in zip(together.contacts(place), alone[e].contacts(), strict=True):
                np.testing.assert_array_equal(listed, expected)


@every_scheme
def test_one_thread_or_two(name):
    same_bits(run(name, evacuations()), run(name, evacuations(), threads=2))


@every_scheme
def test_ten_steps_at_once_or_one_by_one(name):
    same_bits(run(name, evacuations()), run(name, evacuations(), calls=150, n_substeps=1))


@every_scheme
def test_neighbour_list_built_at_every_step_or_on_demand(name):
    def forget(simulation):
        simulation.memory.near.reach[:] = -1.0

    on_demand = run(name, evacuations(), calls=150, n_substeps=1)
    every_step = run(name, evacuations(), calls=150, n_substeps=1, before_each=forget)
    same_bits(on_demand, every_step)
    np.testing.assert_array_equal(on_demand.diagnostics.max_overlap, every_step.diagnostics.max_overlap)


@every_scheme
def test_memory_that_grows_or_is_large_from_the_start(name):
    def shrink(simulation):
        simulation.memory = allocate_memory(simulation.bodies, per_person=1)

    rng = np.random.default_rng(12)
    bodies = people(rng, 55)
    crowd = bodies, make_state(scatter(rng, ROOM, bodies.radius))
    grown, expected = run(name, [crowd], prepare=shrink), run(name, [crowd])
    assert len(grown.memory.contacts.gap) > 55 + 16
    same_bits(grown, expected)
    np.testing.assert_array_equal(grown.diagnostics.iterations, expected.diagnostics.iterations)


@every_scheme
def test_growth_forgets_no_impulse(name):
    def grow(simulation):
        if simulation.state.time[0] > 0.75:
            simulation.memory = grow_memory(simulation.memory, simulation.bodies)

    crowds = evacuations()
    grown, expected = run(name, crowds, calls=9, before_each=grow), run(name, crowds, calls=9)
    same_bits(grown, expected)
    np.testing.assert_array_equal(grown.diagnostics.iterations, expected.diagnostics.iterations)


@every_scheme
def test_growth_in_the_middle_of_a_call_goes_on_where_it_was(name):
    # One environment of the batch runs full; the others must not be advanced twice.
    crowds = evacuations()

    def small(simulation):
        simulation.memory = allocate_memory(simulation.bodies, per_person=1)

    grown = run(name, crowds, calls=1, n_substeps=150, prepare=small)
    same_bits(grown, run(name, crowds, calls=1, n_substeps=150))
    np.testing.assert_allclose(grown.state.time[grown.inside > 0], 1.5)


@every_scheme
def test_a_restarted_environment_is_a_new_one_and_the_others_do_not_notice(name):
    crowds = evacuations()
    simulation = run(name, crowds, calls=8)
    # Other people where those before them stand now: impulses left over from these would be taken up.
    people_of_2 = slice(simulation.bodies.env_start[2], simulation.bodies.env_start[3])
    fresh = people(np.random.default_rng(13), 26), simulation.state.position[people_of_2].copy()
    simulation.restart(2, fresh[0], fresh[1])
    for _ in range(7):
        simulation.advance(n_substeps=10)
    undisturbed = run(name, crowds)
    new = run(name, [(fresh[0], make_state(fresh[1]))], calls=7)
    for e in range(5):
        expected = part(new.state, new.bodies, 0) if e == 2 else part(undisturbed.state, undisturbed.bodies, e)
        for field, values in expected.items():
            np.testing.assert_array_equal(part(simulation.state, simulation.bodies, e)[field], values)
    for total, expected in zip(simulation.diagnostics, new.diagnostics, strict=True):
        assert total[2] == expected[0]


@every_scheme
def test_environments_in_different_places(name):
    # One batch over three plans equals each plan alone.
    plans = [PLANS[plan]() for plan in ("room", "l-shape", "rounded")]
    which = np.array([2, 0, 1, 0])
    crowds = [crowd_in(np.random.default_rng(20 + e), plans[g], 30) for e, g in enumerate(which)]
    bodies, state = joined([copied(b, s) for b, s, _ in crowds])
    asked = dict(command=np.concatenate([c for *_, c in crowds]), relative=np.zeros(120, bool), n_substeps=60)
    Simulation(plans, bodies, state, scheme=name, geometry_of_env=which).advance(**asked)
    for e, (own_bodies, own, command) in enumerate(crowds):
        alone = Simulation(plans[which[e]], own_bodies, own, scheme=name)
        alone.advance(command, relative=np.zeros(30, bool), n_substeps=60)
        np.testing.assert_array_equal(state.position[30 * e : 30 * e + 30], own.position)
        assert plans[which[e]].contains(own.position).all()


# ------------------------------------------------------------------------------------------------------- wrong input


def people_at(*positions, **options):
    return make_bodies(np.full(len(positions), 0.2), 80.0, **options), make_state(positions)


@pytest.mark.parametrize("dt", [0.0, -0.01, float("nan"), float("inf")])
def test_a_step_must_be_positive_and_finite(dt):
    with pytest.raises(ValueError, match=r"dt is .* s; it must be finite and > 0"):
        Simulation(plain(), *people_at([0, 0]), dt=dt)


@every_scheme
def test_a_step_above_the_stable_one_is_refused_with_both_numbers(name):
    bodies, state = people_at([0, 0], relaxation_time=0.05)
    limit = SCHEMES[name].stable_dt(bodies)
    if np.isinf(limit):
        Simulation(plain(), bodies, state, scheme=name, dt=10.0)
        return
    with pytest.raises(ValueError, match=rf"dt = 1 s is above the stable step of \S+, {limit:.4g} s"):
        Simulation(plain(), bodies, state, scheme=name, dt=1.0)
    Simulation(plain(), bodies, state, scheme=name, dt=1.0, allow_unstable=True)
    Simulation(plain(), bodies, state, scheme=name, dt=0.999 * limit)


@every_scheme
def test_the_stable_step_is_stable(name):
    # At the step the scheme calls stable (or 0.5 s), bouncing pairs and relaxing velocities stay bounded.
    scheme = SCHEMES[name]
    bodies = make_bodies([0.2, 0.25], [60.0, 62.0], desired_speed=1.5, relaxation_time=0.01)
    state = make_state([[0.0, 0.0], [0.44, 0.0]], [[0.5, 0.0], [-0.5, 0.1]])
    dt = min(0.97 * scheme.stable_dt(bodies), 0.5)
    simulation = Simulation(plain(), bodies, state, scheme=name, dt=dt, allow_unstable=True)  # however far they go
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
    with pytest.raises(ValueError, match="2 bodies but 1 positions"):
        Simulation(plain(), bodies, make_state([[0, 0]]))
    with pytest.raises(ValueError, match="env_start must run from 0 to the number of people"):
        Simulation(plain(), bodies._replace(env_start=np.array([0, 1])), state)
    with pytest.raises(ValueError, match=r"one entry more than state\.time"):
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


def test_unknown_scheme_lists_the_known():
    with pytest.raises(ValueError, match=r"unknown contact scheme 'hertz3'; known: .*nsm2"):
        Simulation(plain(), *people_at([0, 0]), scheme="hertz3")


def test_grains_have_no_spontaneous_velocity():
    with pytest.raises(ValueError, match=r"nsm1: passive grains have no spontaneous velocity; use NSM1\(trial="):
        Simulation(plain(), *people_at([0, 0]), scheme=NSM1(), driving=False)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (dict(radius=[0.0]), "radius of pedestrian 0 is 0; it must be finite and > 0"),
        (dict(mass=[-1.0]), "mass of pedestrian 0 is -1"),
        (dict(mass=[float("nan")]), "mass of pedestrian 0 is nan"),
        (dict(relaxation_time=0.0), "relaxation_time of pedestrian 0 is 0"),
        (dict(desired_speed=-0.1), "desired_speed of pedestrian 0 is -0.1; it must be finite and >= 0"),
        (dict(response_time=float("inf")), "response_time of pedestrian 0 is inf"),
    ],
)
def test_bodies_must_make_sense(wrong, message):
    values = {"radius": [0.2], "mass": [80.0], **wrong}
    with pytest.raises(ValueError, match=message):
        make_bodies(**values)


# ------------------------------------------------------------------------------------------------------ what diverges


def test_a_step_far_too_large_ends_in_a_sentence_not_in_a_crash():
    geometry = Geometry.from_polygon(box(0, 0, 3, 3))
    rng = np.random.default_rng(14)
    bodies = people(rng, 20)
    state = make_state(scatter(rng, geometry, bodies.radius), rng.normal(0, 1, (20, 2)))
    simulation = Simulation(geometry, bodies, state, scheme=DEM(stiffness=1e12), dt=0.5, allow_unstable=True)
    with pytest.raises(FloatingPointError, match=r"dem: positions of environment 0 .*dt = 0.5 s; take a smaller dt"):
        for _ in range(400):
            simulation.advance(n_substeps=5)


@every_scheme
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("who", [0, 3, 6])
def test_a_position_that_is_not_finite_is_reported(name, value, who):
    positions = [[k, 0.5 * k] for k in range(7)]
    bodies, state = people_at(*positions)
    simulation = Simulation(plain(), bodies, state, scheme=name)
    simulation.advance()
    state.position[who, 1] = value
    with pytest.raises(FloatingPointError, match="environment 0"):
        simulation.advance()


@every_scheme
def test_an_unheard_of_force_is_reported_within_the_call_or_the_next(name):
    bodies, state = people_at([0, 0], [1, 1])
    simulation = Simulation(plain(), bodies, state, scheme=name)
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
simulation = Simulation(geometry, bodies, make_state(position), scheme=SCHEMES["nsm1-inertial"])
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
simulation = Simulation(plan, bodies, state, scheme=SCHEMES["dem"], driving=False)
for _ in range(100):
    simulation.advance(n_substeps=1000)
"""


@pytest.mark.parametrize("program", [NAN_IN_A_JAM, FLYING_APART], ids=["nan in a jam", "flying apart"])
def test_a_hopeless_run_neither_crashes_nor_hangs(program):
    head = "import numpy as np\nfrom shapely.geometry import box\nfrom crowd_env import *\n"
    command = [sys.executable, "-c", head + program]
    root = Path(__file__).resolve().parent.parent
    result = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=90, check=False)
    assert result.returncode in (0, 1), result.stderr  # not a signal
    if result.returncode:
        assert result.stderr.strip().splitlines()[-1].startswith(("FloatingPointError", "ValueError")), result.stderr


@every_scheme
def test_every_step_says_what_went_on_in_it(name):
    geometry = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)])
    bodies, position = Population(40).draw(np.random.default_rng(3), geometry)
    simulation = Simulation(geometry, bodies, make_state(position), scheme=name, dt=0.01)
    east = dict(command=np.tile([1.0, 0.0], (40, 1)), relative=np.zeros(40, bool))
    deepest, iterations = [], []
    for _ in range(200):
        simulation.advance(**east)
        step = simulation.last_diagnostics
        deepest.append(float(step.max_overlap[0]))
        iterations.append(int(step.iterations[0]))
        gap = simulation.contacts().gap
        assert step.max_overlap[0] == max(-gap.min(initial=0.0), 0.0)
    total = simulation.diagnostics
    assert total.max_overlap[0] == max(deepest) > min(deepest)
    assert total.iterations[0] == sum(iterations)


@pytest.mark.parametrize("threads", [0, -1])
def test_there_is_at_least_one_thread(threads):
    with pytest.raises(ValueError, match=rf"^threads is {threads}; it must be at least 1$"):
        Simulation(plain(), *people_at([0, 0]), threads=threads)


def test_more_memory_keeps_all_that_others_hold_on_to():
    """Environments refer to the impulses once: they must stay the same arrays when lists of neighbours grow."""
    geometry = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2), (5, 3)]])
    bodies = make_bodies(np.full(3, 0.2), np.full(3, 70.0))
    memory = Simulation(geometry, bodies, make_state(np.array([[1.0, 1], [2, 2], [3, 3]])), scheme="hertz").memory
    grown = grow_memory(memory, bodies)
    assert len(grown.near.owner) > len(memory.near.owner)
    assert len(grown.noticed.size) == len(grown.near.owner) == len(grown.contacts.hit)
    replaced = {name for name in memory._fields if getattr(grown, name) is not getattr(memory, name)}
    assert replaced == {"near", "contacts", "problem", "noticed"}


def test_a_replaced_state_is_the_one_that_moves():
    geometry = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2), (5, 3)]])
    bodies = make_bodies(np.full(1, 0.2), np.full(1, 70.0), desired_speed=1.0)
    simulation = Simulation(geometry, bodies, make_state(np.array([[1.0, 2.5]])), scheme="dem", dt=0.01)
    simulation.advance(n_substeps=10)
    checkpoint = simulation.state.copy()
    first, simulation.state = simulation.state, checkpoint
    before = first.position.copy()
    simulation.advance(n_substeps=10)
    np.testing.assert_array_equal(first.position, before)
    assert checkpoint.position[0, 0] > before[0, 0]
