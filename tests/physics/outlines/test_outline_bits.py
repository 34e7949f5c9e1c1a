"""People with shoulders come out alike, bit by bit, however and beside whomever they are computed; and nobody gets outside."""

import hashlib
import pickle
from functools import partial

import numpy as np
import pytest
from cases import looped
from outlined_crowds import TORSO, before_a_door, grains
from shapely.geometry import box

import crowd_env.physics.simulation.simulation
import crowd_env.physics.spatial_order
from crowd_env import Geometry, Hertz, Outline, Physics, Simulation, make_bodies, make_state
from crowd_env.physics.workspace import allocate_workspace

PRESSED = 6.0  # /m2: all of them touch


def moves(simulation, people=slice(None)):
    """Return a digest of all that people do."""
    state, digest = simulation.state, hashlib.sha256()
    for array in (state.position, state.velocity, state.angle, state.spin, state.exit_time, simulation.results.impulse):
        digest.update(np.ascontiguousarray(array[people]).tobytes())
    return digest.hexdigest()


def has_friction(simulation):
    """Return whether the springs of some contacts are stretched: there is a history to be carried along."""
    contacts, near = simulation.history.contacts, simulation.workspace.neighbors
    rows = slice(int(near.entry_start[0]), int(near.entry_start[0] + contacts.number[0]))
    return (contacts.history[rows, 0] != 0.0).sum() > 50


@looped("threads", [2, 1, 3], quick=1)
@looped("manner", [None, "hurried"])
def test_alone_and_anywhere_in_a_batch_on_any_number_of_threads(threads, manner):
    options = {"density": PRESSED, "manner": manner}
    alone, many = before_a_door(90, **options), before_a_door(90, environments=4, threads=threads, **options)
    for _ in range(3):
        alone.advance(n_substeps=100)
        many.advance(n_substeps=100)
    assert manner or has_friction(alone)
    assert {moves(many, slice(90 * e, 90 * (e + 1))) for e in range(4)} == {moves(alone)}


@looped("count", [90, 1100], quick=1)
def test_one_call_or_many(count):
    at_once, in_parts = (before_a_door(count, density=PRESSED) for _ in range(2))
    at_once.advance(n_substeps=200)
    for _ in range(20):
        in_parts.advance(n_substeps=10)
    for name in ("position", "velocity", "angle", "spin"):
        np.testing.assert_array_equal(getattr(in_parts.state, name), getattr(at_once.state, name))


@looped("count", [90, 1100])
def test_a_run_that_goes_on_from_a_checkpoint(count):
    simulation = before_a_door(count, density=PRESSED)
    simulation.advance(n_substeps=130)
    assert has_friction(simulation)
    checkpoint = pickle.loads(pickle.dumps(simulation.checkpoint()))
    simulation.advance(n_substeps=150)
    expected = moves(simulation)
    other = before_a_door(count, density=PRESSED)
    other.advance(n_substeps=3)
    for again in (simulation, other):
        again.restore(checkpoint)
        again.advance(n_substeps=150)
        assert moves(again) == expected


def test_a_checkpoint_of_another_outline_is_refused():
    checkpoint = before_a_door(30).checkpoint()
    for outline in (None, Outline(TORSO.discs, turning_time=1.0)):
        with pytest.raises(ValueError, match="its outline differs"):
            before_a_door(30, outline=outline).restore(checkpoint)


@looped("count", [90, 1100], quick=1)
def test_a_step_that_is_done_again_with_more_room_comes_out_alike(count, monkeypatch):
    # From few entries a person, so that neither the lists nor, at some step, the contacts of all discs fit.
    expected = before_a_door(count, density=9.0)
    rooms = set()
    for per_person in (1, 3, 5, 7):
        few = partial(allocate_workspace, per_person=per_person)
        monkeypatch.setattr(crowd_env.physics.simulation.simulation, "allocate_workspace", few)
        grown = before_a_door(count, density=9.0)
        rooms.add(len(grown.workspace.neighbors.contact_distance))
        grown.advance(n_substeps=150)
        rooms.add(len(grown.workspace.neighbors.contact_distance))
        if per_person == 1:
            expected.advance(n_substeps=150)
        assert moves(grown) == moves(expected)
    assert len(rooms) > 4


@looped("entries", range(2, 40, 3))
def test_contacts_that_do_not_fit_lose_no_history(entries, monkeypatch):
    # A heap of people with a soft skin: far more pairs of discs than of bodies.
    def heap(per_person):
        few = partial(allocate_workspace, per_person=per_person)
        monkeypatch.setattr(crowd_env.physics.simulation.simulation, "allocate_workspace", few)
        rng = np.random.default_rng(0)
        position, angle = rng.uniform(0, 1.0, (12, 2)), rng.uniform(0, 9, 12)
        scheme = Hertz(youngs_modulus=1e4, social=None)
        velocity = 2.0 * (0.5 - position)
        return grains(position, angle, TORSO, velocity=velocity, spin=3.0, scheme=scheme, dt=1e-3)

    expected, grown = heap(100), heap(entries)
    for simulation in (expected, grown):
        simulation.advance(n_substeps=120)
    assert len(expected.contacts().gap) > 20
    assert moves(grown) == moves(expected)


def test_people_in_the_order_of_space_walk_as_in_the_order_of_their_slots(monkeypatch):
    here = before_a_door(1200, density=4.0)
    monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", 10**9)
    there = before_a_door(1200, density=4.0)
    for simulation in (here, there):
        simulation.advance(n_substeps=600)  # sorted twice
    assert here._sorted is not None
    assert there._sorted is None
    np.testing.assert_allclose(here.state.position, there.state.position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(here.state.angle, there.state.angle, rtol=0, atol=1e-5)
    one, other = here.contacts(), there.contacts()
    assert len(one.gap) > 60
    for name in ("i", "j", "disc_i", "disc_j"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_allclose(one.normal, other.normal, atol=1e-3)


# ------------------------------------------------------------------------------------------------------------ symmetry


def test_a_mirrored_crowd_mirrors_all_it_does():
    rng = np.random.default_rng(5)
    lattice = np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) * 0.5 + 0.5
    position = lattice + rng.uniform(-0.02, 0.02, lattice.shape)
    place = Geometry.from_polygon(box(0, 0, 3, 3), obstacles=[box(2.8, 1.2, 2.9, 1.8)])
    ways, angle, spin = np.array([1.0, 0.6]), rng.uniform(-3, 3, 25), rng.normal(0, 2, 25)
    runs = []
    for sign in (1.0, -1.0):
        bodies = make_bodies(np.full(25, 0.17), 70.0, desired_speed=1.5)
        state = make_state(np.column_stack([position[:, 0], 1.5 + sign * (position[:, 1] - 1.5)]))
        state.angle[:], state.spin[:] = sign * angle, sign * spin
        simulation = Simulation(place, bodies, state, physics=Physics(Hertz(social=None), outline=TORSO), fields=[None])
        for _ in range(12):
            command = np.tile(ways * (1.0, sign), (25, 1))
            simulation.advance(command, relative=np.zeros(25, dtype=bool), n_substeps=50)
        runs.append(simulation)
    one, other = (run.state for run in runs)
    assert runs[0].diagnostics.overlap_count[0] > 300
    np.testing.assert_allclose(other.position[:, 0], one.position[:, 0], atol=1e-8)
    np.testing.assert_allclose(other.position[:, 1] - 1.5, 1.5 - one.position[:, 1], atol=1e-8)
    np.testing.assert_allclose(other.angle, -one.angle, atol=1e-7)
    np.testing.assert_allclose(other.spin, -one.spin, atol=1e-6)


# ---------------------------------------------------------------------------------------------------------- inside


@looped("force", [0.0, 3e3, 1e5])
def test_nobody_gets_outside_however_hard_they_are_pressed(force):
    place = Geometry.from_polygon(
        box(0, 0, 6, 4),
        exits={"out": [(6, 1.6), (6, 2.4)]},
        obstacles=[box(3, 1, 3.2, 3)],
        thin_walls=[[(1.5, 0), (1.5, 1.5)], [(4.5, 4), (4.5, 2.6), (5.0, 2.6)]],
    )
    rng = np.random.default_rng(1)
    inside = rng.uniform((0, 0), (6, 4), (3000, 2))
    inside = inside[place.contains(inside) & (place.clearance(inside) > 0.24)]
    position = [inside[0]]
    for point in inside:
        if np.hypot(*(np.array(position) - point).T).min() > 0.48 and len(position) < 40:
            position.append(point)
    bodies = make_bodies(rng.uniform(0.16, 0.18, 40), rng.uniform(60, 90, 40), desired_speed=2.0, relaxation_time=0.2)
    simulation = Simulation(
        place, bodies, make_state(np.array(position)), physics=Physics("hertz", outline=TORSO), walking=None
    )
    for k in range(60):
        push = force * np.array([np.cos(0.7 * k), np.sin(0.7 * k)])
        simulation.advance(n_substeps=50, external_force=np.tile(push, (40, 1)))
        active = simulation.state.active
        assert np.isfinite(simulation.state.position).all()
        assert place.contains(simulation.state.position[active]).all()
    assert not simulation.escaped.any()
    assert (~simulation.state.active).sum() > 5
