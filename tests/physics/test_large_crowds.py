"""Large crowds: the order of space, slabs and threads change how a step is done, never what comes out."""

import hashlib
from functools import partial

import numpy as np
import pytest
from cases import looped
from crowds import every_scheme
from late import late
from shapely.geometry import box
from simulations import simulate

import crowd_env.physics.spatial_order
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import SCHEMES
from crowd_env.physics.dem_lanes.partition import SLABS, count_slabs
from crowd_env.physics.neighbors.lists import invalidate_lists
from crowd_env.physics.scheme import IterativeScheme
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.workspace import allocate_workspace
from crowd_env.routing.fields.lookup import direction_at
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import Route

cKDTree = late("scipy.spatial", "cKDTree")


def crowd(name, count, *, density=None, environments=1, seed=0, **options):
    """Return a simulation of ``count`` people on a jittered lattice before a wide door, slots in random order."""
    rng = np.random.default_rng(seed)
    density = density or (3.5 if name.startswith("nsm") else 5.0)  # the solver takes its time where nobody can move
    side = np.sqrt(count / density)
    columns = int(np.ceil(np.sqrt(count)))
    place = Geometry.from_polygon(box(0, 0, side, side), exits=[[(side, 0.4 * side), (side, 0.6 * side)]])
    lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(columns)), -1).reshape(-1, 2)[:count]
    position = rng.permutation((lattice + 0.5 + rng.uniform(-0.1, 0.1, (count, 2))) * side / columns)
    radius, mass = rng.uniform(0.19, 0.23, count), rng.uniform(60, 80, count)
    copies = np.tile(position, (environments, 1))
    bodies = make_bodies(
        np.tile(radius, environments),
        np.tile(mass, environments),
        desired_speed=1.4,
        response_time=np.tile(rng.uniform(0, 0.1, count), environments),
        env_start=count * np.arange(environments + 1),
    )
    state = make_state(copies, environments=environments)
    return simulate(place, bodies, state, scheme=SCHEMES[name], **options)


def state_hash(simulation, people=slice(None)):
    """Return a hash of all that moves, of what people got, and of when they left."""
    state = simulation.state
    digest = hashlib.sha256()
    for array in (
        state.position,
        state.velocity,
        state.spin,
        state.exit_time,
        simulation.results.impulse,
        simulation.results.impulse_magnitude,
    ):
        digest.update(np.ascontiguousarray(array[people]).tobytes())
    return digest.hexdigest()


def steps(simulation, seconds):
    return round(seconds / simulation.dt)


@every_scheme
@looped("threads", [2, 8], quick=1)
def test_state_hash_for_any_number_of_threads_and_any_place_in_the_batch(name, threads):
    alone = crowd(name, 130)
    many = crowd(name, 130, environments=5, threads=threads)
    for _ in range(3):
        alone.advance(n_substeps=steps(alone, 0.2))
        many.advance(n_substeps=steps(many, 0.2))
    assert not alone.state.active.all()
    expected = state_hash(alone)
    for e in range(5):
        assert state_hash(many, slice(130 * e, 130 * (e + 1))) == expected


def test_one_large_crowd_is_the_same_for_any_number_of_threads():
    hashes, sums = set(), set()
    for threads in (1, 2, 8):
        simulation = crowd("dem", 4200, threads=threads)
        assert simulation.scheme.slabs(4200, reach=0.0) == SLABS > 1 == count_slabs(2000)
        for _ in range(2):
            simulation.advance(n_substeps=35)
        assert len(simulation.contacts().gap) > 1000
        assert not simulation.state.active.all()
        hashes.add(state_hash(simulation))
        sums.add((simulation.diagnostics.overlap_sum[0], simulation.diagnostics.overlap_count[0]))
    assert len(hashes) == len(sums) == 1


@looped("threads", [3, 1], quick=1)
def test_what_everyone_gets_is_what_the_contacts_say_across_slabs_too(threads):
    simulation = crowd("dem", 4200, threads=threads)
    simulation.advance(n_substeps=60)
    simulation.advance()
    found, expected, crush = simulation.contacts(), np.zeros((4200, 2)), np.zeros(4200)
    assert len(found.gap) > 1000
    pushed = found.impulse[:, :1] * found.normal
    people = found.j >= 0
    np.add.at(expected, found.i, pushed)
    np.add.at(expected, found.j[people], -pushed[people])
    np.add.at(crush, found.i, found.impulse[:, 0])
    np.add.at(crush, found.j[people], found.impulse[people, 0])
    np.testing.assert_allclose(simulation.results.impulse, expected, atol=1e-9)
    np.testing.assert_allclose(simulation.results.impulse_magnitude, crush, atol=1e-9)


@looped("threads", [3, 1], quick=1)
def test_slabs_list_every_pair_that_may_touch_once_and_in_order(threads):
    simulation = crowd("dem", 4200, threads=threads)
    simulation.advance(n_substeps=20)
    invalidate_lists(simulation.workspace.neighbors)
    slot, near = simulation._sorted.slot, simulation.workspace.neighbors
    at, inside, radius = (
        array[slot] for array in (simulation.state.position, simulation.state.active, simulation.bodies.radius)
    )
    simulation.advance()
    pairs = slice(near.entry_start[0], near.pair_end[0])
    listed = np.column_stack([near.owner[pairs], near.partner[pairs]]).astype(np.int64)
    i, j = np.sort(cKDTree(at).query_pairs(0.5, output_type="ndarray"), axis=1).T
    touch = inside[i] & inside[j] & (np.hypot(*(at[i] - at[j]).T) < radius[i] + radius[j] + 2 * 0.02)
    assert (np.diff(listed @ [4200, 1]) > 0).all()
    assert set(map(tuple, np.column_stack([i, j])[touch])) <= set(map(tuple, listed))
    np.testing.assert_array_equal(near.contact_distance[pairs], radius[listed].sum(axis=1))


def test_threads_that_share_a_crowd_stop_together_when_memory_runs_full_or_everyone_is_out(monkeypatch):
    # Two large crowds and a small place for the list of neighbors: kernels return in the middle of the call.
    expected = crowd("dem", 4200, environments=2)
    monkeypatch.setattr(
        crowd_env.physics.simulation.simulation, "allocate_workspace", partial(allocate_workspace, per_person=1)
    )
    shared = crowd("dem", 4200, environments=2, threads=3)
    for simulation in (expected, shared):
        simulation.advance(n_substeps=30)
    assert state_hash(shared) == state_hash(expected)
    assert len(shared.workspace.neighbors.contact_distance) > 2 * 4200 + 32
    shared.state.active[:] = False
    shared.advance(n_substeps=5)
    np.testing.assert_array_equal(shared.state.time, expected.state.time)  # the clock of an empty place stands still


@every_scheme
def test_a_crowd_in_the_order_of_space_moves_as_one_in_the_order_of_its_slots(name, monkeypatch):
    # Long enough to be sorted twice: friction and warm starts have to follow people to their new places.
    here = crowd(name, 1200)
    monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", 10**9)
    there = crowd(name, 1200)
    # A percussion that falls into this step or the next makes two histories of a rounding error: there most people count.
    smooth = not isinstance(SCHEMES[name], IterativeScheme)
    for _ in range(3):
        for simulation in (here, there):
            simulation.advance(n_substeps=steps(here, 0.2))
        apart = np.abs(here.state.position - there.state.position).max(axis=1)
        assert (apart.max() if smooth else np.quantile(apart, 0.9)) < (1e-6 if smooth else 2e-3)
        ours, theirs = here.contacts(), there.contacts()
        if smooth:
            deep = [set(zip(c.i[c.gap < -1e-5], c.j[c.gap < -1e-5], strict=True)) for c in (ours, theirs)]
            assert len(deep[0]) > 50
            assert deep[0] - set(zip(theirs.i, theirs.j, strict=True)) == set()
            assert deep[1] - set(zip(ours.i, ours.j, strict=True)) == set()
    np.testing.assert_allclose(
        here.results.impulse_magnitude.sum(), there.results.impulse_magnitude.sum(), rtol=1e-6 if smooth else 0.1
    )


@every_scheme
def test_sorting_does_not_depend_on_how_steps_are_called(name):
    at_once, in_parts = crowd(name, 1100, density=3.0), crowd(name, 1100, density=3.0)
    at_once.advance(n_substeps=steps(at_once, 0.6))
    for _ in range(12):
        in_parts.advance(n_substeps=steps(in_parts, 0.05))
    np.testing.assert_array_equal(at_once.state.position, in_parts.state.position)
    np.testing.assert_array_equal(at_once.state.velocity, in_parts.state.velocity)


@every_scheme
def test_contacts_of_a_large_crowd_are_those_of_brute_force(name):
    simulation = crowd(name, 1500)
    simulation.advance(n_substeps=steps(simulation, 0.3))
    before = simulation.state.copy()
    simulation.advance()
    at = before if simulation.scheme.info.contacts_at == "start" else simulation.state
    radius, found = simulation.bodies.radius, simulation.contacts()
    i, j = np.sort(cKDTree(at.position).query_pairs(0.5, output_type="ndarray"), axis=1).T
    gap = np.hypot(*(at.position[i] - at.position[j]).T) - radius[i] - radius[j]
    inside = at.active[i] & at.active[j]
    deep = (gap < -1e-12) & inside
    expected = dict(zip(zip(i[deep].tolist(), j[deep].tolist(), strict=True), gap[deep], strict=True))
    listed = {
        (a, b): g for a, b, g in zip(found.i.tolist(), found.j.tolist(), found.gap, strict=True) if b >= 0 > g + 1e-12
    }
    assert len(expected) > (200 if not name.startswith("nsm") else -1)  # these let nobody in
    assert listed == pytest.approx(expected, abs=1e-12)
    people = found.j >= 0
    apart = at.position[found.i[people]] - at.position[found.j[people]]
    assert (np.einsum("ij,ij->i", apart, found.normal[people]) > 0).all()  # from j to i
    order = [(a, b < 0, b if b >= 0 else -b) for a, b in zip(found.i.tolist(), found.j.tolist(), strict=True)]
    assert order == sorted(order)


@every_scheme
def test_how_long_a_list_is_meant_to_last_changes_nothing(name):
    hashes = set()
    for horizon in (0.0, 0.3):
        simulation = crowd(name, 60, density=4.0)
        for _ in range(6):
            simulation.workspace.neighbors.horizon[:] = horizon
            invalidate_lists(simulation.workspace.neighbors)
            simulation.advance(n_substeps=steps(simulation, 0.1))
        hashes.add(state_hash(simulation))
    assert len(hashes) == 1


@every_scheme
def test_two_who_leave_side_by_side_leave_nothing_behind(name):
    # Whoever is out touches nobody, not even the other one who is out.
    place = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 1), (5, 4)]])
    position = np.array([[4.97, 2.3], [4.97, 2.7], [1.0, 1.0]])
    bodies = make_bodies(np.full(3, 0.2), 80.0, desired_speed=1.5)
    simulation = Simulation(place, bodies, make_state(position, np.tile([1.5, 0.0], (3, 1))), physics=name)
    simulation.advance(n_substeps=steps(simulation, 0.1))
    assert simulation.state.active.tolist() == [False, False, True]
    simulation.advance(n_substeps=steps(simulation, 0.1))
    np.testing.assert_array_equal(simulation.results.impulse_magnitude, 0.0)
    assert simulation.diagnostics.max_overlap[0] < 0.01
    assert (simulation.state.position[:2, 0] < 5.1).all()


@pytest.mark.parametrize("name", ["dem", "nsm2"])
def test_who_looks_only_now_and_then_still_goes_the_way_out(name):
    """In a large crowd the way may be 0.04 s old where it hardly turns: never by more than a few degrees."""
    simulation = crowd(name, 1100, density=1.5)
    field, boundary, state = struct_ref(simulation.world.field), struct_ref(simulation.world.boundary), simulation.state
    worst = 0.0
    for _ in range(30):
        simulation.advance(n_substeps=7)
        sorted_crowd = simulation._sorted
        way, steady = np.empty((1100, 2)), np.empty(1100, dtype=bool)
        way[sorted_crowd.slot], steady[sorted_crowd.slot] = simulation.history.direction, simulation.history.is_uniform
        who = np.flatnonzero(state.active & steady)
        assert len(who) > 0.5 * state.active.sum()  # most of the hall
        now = [direction_at(field, boundary, 0, *state.position[i], simulation.bodies.radius[i]) for i in who]
        worst = max(worst, np.linalg.norm(way[who] - np.array(now), axis=1).max())
    assert 1e-4 < worst < 0.15


@pytest.mark.parametrize("name", ["dem", "nsm2"])
def test_whoever_is_given_another_route_turns_at_once(name):
    side, count = 28.0, 1100
    rng = np.random.default_rng(0)
    exits = {"east": [(side, 12), (side, 16)], "west": [(0, 16), (0, 12)]}
    place = Geometry.from_polygon(box(0, 0, side, side), exits=exits)
    route_set = RoutePlan(place, 0.2, routes=[Route("right", ("east",)), Route("left", ("west",))]).build()
    lattice = np.stack(np.meshgrid(np.arange(34), np.arange(34)), -1).reshape(-1, 2)[:count]
    bodies = make_bodies(np.full(count, 0.2), np.full(count, 70.0), desired_speed=1.0)
    state = make_state(2.0 + 0.7 * lattice + rng.uniform(-0.05, 0.05, (count, 2)))
    state.route[:] = route_set.number("right")
    simulation = Simulation(place, bodies, state, physics=Physics(name, dt=0.01), fields=[route_set])
    simulation.advance(n_substeps=13)
    far = np.abs(state.position - side / 2).max(axis=1) < 9.0
    assert (state.velocity[far, 0] > 0.05).all()
    before = state.velocity[:, 0].copy()
    state.route[:] = route_set.number("left")
    simulation.advance(n_substeps=1)
    assert (state.velocity[far, 0] < before[far]).all()
