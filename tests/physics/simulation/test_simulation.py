"""Simulation: exits and clocks, the same bits however a crowd is run, and one clear sentence for wrong input."""

from functools import cache, partial

import numpy as np
import pytest
from crowds import PLANS, copied, crowd_in, every_scheme, joined, part, people, plain, scatter
from shapely.geometry import box
from simulations import simulate

import crowd_env.physics.simulation.simulation
import crowd_env.physics.spatial_order
from crowd_env.core.arrays.state import join_bodies, make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import make_scheme
from crowd_env.physics.neighbors.lists import invalidate_lists
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.workspace import allocate_workspace
from crowd_env.routing.fields.field import travel_time_field

ROOM = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2.09), (5, 2.91)]])
TWO_DOORS = Geometry.from_polygon(box(0, 0, 6, 4), exits={"east": [(6, 1), (6, 3)], "south": [(1, 0), (3, 0)]})


def march(geometry, position, velocity, *, scheme, radius=0.2, dt=0.01, **options):
    """Return a simulation of people who already walk at their desired velocity, and what to ask for."""
    velocity = np.atleast_2d(np.asarray(velocity, dtype=float))
    count = len(velocity)
    speed = np.hypot(*velocity.T)
    bodies = make_bodies(np.full(count, radius), 80.0, desired_speed=speed, relaxation_time=0.3)
    state = make_state(position, velocity)
    simulation = simulate(geometry, bodies, state, scheme=scheme, dt=dt, fields=[None], **options)
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
def test_people_who_are_out_stay_as_they_left_and_are_counted_once(name):
    simulation, asked = march(ROOM, [[4.95, 2.5], [1.0, 1.0]], [[1.2, 0], [0, 0]], scheme=name)
    simulation.advance(n_substeps=5, **asked)
    left = simulation.state.copy()
    assert left.active.tolist() == [False, True]
    turned_back = dict(asked, command=np.array([[-1.0, 0.0], [1.0, 0.0]]))
    simulation.advance(n_substeps=50, external_force=np.array([[-500.0, 0.0], [0.0, 0.0]]), **turned_back)
    for before, after in zip(left[:-1], simulation.state[:-1], strict=True):
        np.testing.assert_array_equal(before[0], after[0])
    assert simulation.results.impulse_magnitude.tolist() == [0.0, 0.0]


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
    simulation = Simulation(geometry, bodies, state, physics=Physics(name, dt=0.01), fields=[None])
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
    simulation = Simulation(plain(), bodies, state, physics=Physics(name, dt=0.01))
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


def run(name, crowds, *, calls=15, n_substeps=10, before_each=None, **options):
    bodies, state = joined([copied(*crowd) for crowd in crowds])
    simulation = simulate(ROOM, bodies, state, scheme=name, dt=0.01, fields=[room_field()], **options)
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
            np.testing.assert_array_equal(together.results.impulse[rows], alone[e].results.impulse)
            np.testing.assert_array_equal(together.results.impulse_magnitude[rows], alone[e].results.impulse_magnitude)
            for total, expected in zip(together.diagnostics, alone[e].diagnostics, strict=True):
                assert total[place] == expected[0]
            for listed, expected in zip(together.contacts(place), alone[e].contacts(), strict=True):
                np.testing.assert_array_equal(listed, expected)


@every_scheme
def test_ten_steps_at_once_or_one_by_one(name):
    same_bits(run(name, evacuations()), run(name, evacuations(), calls=150, n_substeps=1))


@every_scheme
def test_neighbor_list_built_at_every_step_or_on_demand(name):
    def forget(simulation):
        invalidate_lists(simulation.workspace.neighbors)

    on_demand = run(name, evacuations(), calls=150, n_substeps=1)
    every_step = run(name, evacuations(), calls=150, n_substeps=1, before_each=forget)
    same_bits(on_demand, every_step)
    np.testing.assert_array_equal(on_demand.diagnostics.max_overlap, every_step.diagnostics.max_overlap)


@every_scheme
def test_memory_that_grows_or_is_large_from_the_start(name, monkeypatch):
    rng = np.random.default_rng(12)
    bodies = people(rng, 55)
    crowd = bodies, make_state(scatter(rng, ROOM, bodies.radius))
    expected = run(name, [crowd])
    monkeypatch.setattr(
        crowd_env.physics.simulation.simulation, "allocate_workspace", partial(allocate_workspace, per_person=1)
    )
    grown = run(name, [crowd])
    assert len(grown.history.contacts.gap) > 55 + 16
    same_bits(grown, expected)
    np.testing.assert_array_equal(grown.diagnostics.iterations, expected.diagnostics.iterations)


@every_scheme
def test_growth_forgets_no_impulse(name):
    def grow(simulation):
        if simulation.state.time[0] > 0.75:
            simulation._stepper.grow()

    crowds = evacuations()
    grown, expected = run(name, crowds, calls=9, before_each=grow), run(name, crowds, calls=9)
    same_bits(grown, expected)
    np.testing.assert_array_equal(grown.diagnostics.iterations, expected.diagnostics.iterations)


@every_scheme
def test_growth_in_the_middle_of_a_call_goes_on_where_it_was(name, monkeypatch):
    # One environment of the batch runs full; the others must not be advanced twice.
    crowds = evacuations()
    expected = run(name, crowds, calls=1, n_substeps=150)
    monkeypatch.setattr(
        crowd_env.physics.simulation.simulation, "allocate_workspace", partial(allocate_workspace, per_person=1)
    )
    grown = run(name, crowds, calls=1, n_substeps=150)
    same_bits(grown, expected)
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
def test_environments_that_restart_together_are_those_that_restart_one_after_the_other(name):
    one_by_one, together = (run(name, evacuations(), calls=8) for _ in range(2))
    start, fresh = one_by_one.bodies.env_start, []
    for e in (3, 0, 2):
        rng, stand = np.random.default_rng(30 + e), one_by_one.state.position[start[e] : start[e + 1]].copy()
        fresh.append((people(rng, len(stand)), stand, rng.normal(size=stand.shape)))
        one_by_one.restart(e, *fresh[-1])
    bodies, *moving = zip(*fresh, strict=True)
    together.restart([3, 0, 2], join_bodies(bodies), *map(np.concatenate, moving))
    for simulation in (one_by_one, together):
        simulation.advance(n_substeps=30)
    same_bits(together, one_by_one)
    for total, expected in zip(together.diagnostics, one_by_one.diagnostics, strict=True):
        np.testing.assert_array_equal(total, expected)


@pytest.mark.parametrize("many", [10**9, 20], ids=["as they are", "sorted"])
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_who_looks_after_a_call_sees_every_environment_once_where_it_comes_to_stand(threads, many, monkeypatch):
    monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", many)
    bodies, state = joined([copied(b, s) for b, s in evacuations()])
    simulation, seen, start = (
        Simulation(ROOM, bodies, state, physics=Physics("dem", threads=threads)),
        [],
        bodies.env_start,
    )

    def look(first, stop):
        seen.append((first, stop, state.position[start[first] : start[stop]].copy()))

    simulation.advance(n_substeps=7, then=look)
    firsts, stops, positions = zip(*sorted(seen, key=lambda each: each[0]), strict=True)
    assert (*firsts, len(start) - 1) == (0, *stops)
    assert len(seen) == len(simulation.ranges) == threads
    np.testing.assert_array_equal(np.concatenate(positions), state.position)


@every_scheme
def test_environments_in_different_places(name):
    # One batch over three plans equals each plan alone.
    plans = [PLANS[plan]() for plan in ("room", "l-shape", "rounded")]
    which = np.array([2, 0, 1, 0])
    crowds = [crowd_in(np.random.default_rng(20 + e), plans[g], 30) for e, g in enumerate(which)]
    bodies, state = joined([copied(b, s) for b, s, _ in crowds])
    asked = dict(command=np.concatenate([c for *_, c in crowds]), relative=np.zeros(120, bool), n_substeps=60)
    Simulation(plans, bodies, state, physics=name, geometry_of_env=which).advance(**asked)
    for e, (own_bodies, own, command) in enumerate(crowds):
        alone = Simulation(plans[which[e]], own_bodies, own, physics=name)
        alone.advance(command, relative=np.zeros(30, bool), n_substeps=60)
        np.testing.assert_array_equal(state.position[30 * e : 30 * e + 30], own.position)
        assert plans[which[e]].contains(own.position).all()
