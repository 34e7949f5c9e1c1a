"""People who keep a distance walk alike, bit by bit, however and beside whomever they are computed."""

import copy
import hashlib
import pickle
from functools import partial

import numpy as np
import pytest
from cases import looped
from crowds import every_scheme
from walking_crowds import before_a_door, manner, steps

import crowd_env.physics.simulation.simulation
import crowd_env.physics.spatial_order
from crowd_env import CrowdEnv
from crowd_env.core.arrays.state import Bodies
from crowd_env.physics.dem_lanes.partition import SLABS, count_slabs
from crowd_env.physics.workspace import allocate_workspace

# A short patience: pushes differ within the time that is simulated.  The interval is no multiple of the times of the calls.
KEEPS = manner(patience=0.1, impatience=0.5, interval=0.04)


def moves(simulation, people=slice(None)):
    """Return a digest of all that people do; of what they have decided too, where they lie in the order of their slots."""
    state, digest = simulation.state, hashlib.sha256()
    arrays = [state.position, state.velocity, state.exit_time, simulation.results.impulse]
    if simulation._sorted is None:
        arrays += [simulation.history.walking_velocity, simulation.history.memory.manner.waited]
    for array in arrays:
        digest.update(np.ascontiguousarray(array[people]).tobytes())
    return digest.hexdigest()


@every_scheme
@looped("threads", [2, 1, 3], quick=1)
def test_alone_and_anywhere_in_a_batch_on_any_number_of_threads(name, threads):
    alone = before_a_door(90, KEEPS, scheme=name, waited=2.0)
    many = before_a_door(90, KEEPS, scheme=name, waited=2.0, environments=4, threads=threads)
    for _ in range(3):
        alone.advance(n_substeps=steps(alone, 0.15))
        many.advance(n_substeps=steps(many, 0.15))
    assert (alone.history.memory.manner.waited > KEEPS.patience).any()
    assert {moves(many, slice(90 * e, 90 * (e + 1))) for e in range(4)} == {moves(alone)}


def test_a_large_crowd_that_threads_share():
    found = set()
    for threads in (1, 2, 3):
        simulation = before_a_door(4200, KEEPS, scheme="dem", threads=threads, waited=2.0)
        assert simulation.scheme.slabs(4200, reach=0.0) == SLABS == count_slabs(4200)
        for _ in range(2):
            simulation.advance(n_substeps=35)
        found.add(moves(simulation))
    assert len(found) == 1


@every_scheme
@looped("count", [90, 1100])
def test_one_call_or_many(name, count):
    at_once, in_parts = (before_a_door(count, KEEPS, scheme=name, waited=2.0) for _ in range(2))
    for _ in range(2):
        at_once.advance(n_substeps=steps(at_once, 0.3))
        for _ in range(10):
            in_parts.advance(n_substeps=steps(in_parts, 0.03))
        np.testing.assert_array_equal(in_parts.state.position, at_once.state.position)
        np.testing.assert_array_equal(in_parts.history.walking_velocity, at_once.history.walking_velocity)
        np.testing.assert_array_equal(in_parts.history.memory.manner.waited, at_once.history.memory.manner.waited)


@pytest.mark.parametrize("name", ["dem", "hertz"])
def test_people_in_the_order_of_space_decide_as_in_the_order_of_their_slots(name, monkeypatch):
    here = before_a_door(1200, KEEPS, scheme=name, waited=2.0)
    monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", 10**9)
    there = before_a_door(1200, KEEPS, scheme=name, waited=2.0)
    for _ in range(3):  # long enough to be sorted twice
        for simulation in (here, there):
            simulation.advance(n_substeps=steps(simulation, 0.2))
    np.testing.assert_allclose(here.state.position, there.state.position, rtol=0, atol=1e-6)
    slot = here._sorted.slot
    np.testing.assert_allclose(
        here.history.memory.manner.waited, there.history.memory.manner.waited[slot], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(here.history.walking_velocity, there.history.walking_velocity[slot], rtol=0, atol=1e-6)


@every_scheme
@looped("count", [90, 1100])
def test_a_run_that_goes_on_from_a_checkpoint_between_two_decisions(name, count):
    simulation = before_a_door(count, KEEPS, scheme=name, waited=2.0)
    simulation.advance(n_substeps=steps(simulation, 0.27))
    assert 0.01 < simulation.history.decision_age[0] < 0.04
    checkpoint = pickle.loads(pickle.dumps(simulation.checkpoint()))
    simulation.advance(n_substeps=steps(simulation, 0.3))
    expected = moves(simulation)
    other = before_a_door(count, KEEPS, scheme=name)
    other.advance(n_substeps=3)
    for again in (simulation, other):
        again.restore(checkpoint)
        again.advance(n_substeps=steps(again, 0.3))
        assert moves(again) == expected


def test_a_checkpoint_of_another_manner_is_refused():
    checkpoint = before_a_door(20, KEEPS, scheme="dem").checkpoint()
    with pytest.raises(ValueError, match="its manner differs"):
        before_a_door(20, manner(time_gap=2.0), scheme="dem").restore(checkpoint)


@every_scheme
def test_a_step_that_is_done_again_with_more_room_lets_nobody_decide_twice(name, monkeypatch):
    expected = before_a_door(90, KEEPS, scheme=name, density=6.0, waited=2.0)
    few = partial(allocate_workspace, per_person=1)
    monkeypatch.setattr(crowd_env.physics.simulation.simulation, "allocate_workspace", few)
    grown = before_a_door(90, KEEPS, scheme=name, density=6.0, waited=2.0)
    room = len(grown.workspace.neighbors.contact_distance)
    for simulation in (expected, grown):
        simulation.advance(n_substeps=steps(simulation, 0.3))
    assert len(grown.workspace.neighbors.contact_distance) > room
    assert moves(grown) == moves(expected)


@every_scheme
def test_an_environment_that_begins_anew_is_as_new_and_leaves_the_others_alone(name):
    new, batch, others = (before_a_door(60, KEEPS, scheme=name, environments=count) for count in (1, 3, 3))
    bodies = Bodies._make(array.copy() for array in new.bodies)
    start = new.state.position.copy()
    for simulation in (batch, others):
        simulation.advance(n_substeps=steps(simulation, 0.27))
    batch.restart(1, bodies, start)
    for simulation in (new, batch, others):
        simulation.advance(n_substeps=steps(simulation, 0.3))
    assert moves(batch, slice(60, 120)) == moves(new)
    for people in (slice(0, 60), slice(120, 180)):
        assert moves(batch, people) == moves(others, people)


@looped("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_a_copy_of_an_environment_goes_on_alike(copied):
    env = CrowdEnv("room-v0", num_envs=2, physics="dem", walking=KEEPS)
    env.reset([0, 1])
    for _ in range(5):
        env.step(None)
    other = copied(env)
    for one in (env, other):
        for _ in range(10):
            one.step(None)
    assert moves(other.simulation) == moves(env.simulation)
    np.testing.assert_array_equal(
        other.simulation.history.memory.manner.waited, env.simulation.history.memory.manner.waited
    )


@every_scheme
def test_without_a_manner_nothing_of_it_is_there(name):
    simulation = before_a_door(60, None, scheme=name)
    simulation.advance(n_substeps=10)
    history, walkers = simulation.history, simulation.workspace.walkers
    assert (
        len(history.walking_velocity)
        == len(history.memory.manner.waited)
        == len(walkers.slot)
        == len(walkers.ahead)
        == 0
    )
    assert not history.have_decided.any()
    assert len(simulation.world.wall_grid.wall) == 0
