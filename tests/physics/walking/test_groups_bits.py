"""Companions change no bit of others, and walk alike, bit by bit, however and beside whomever they are computed."""

import pickle

import numpy as np
import pytest
from cases import looped
from crowds import every_scheme
from walking_crowds import before_a_door, manner, steps

from crowd_env import Attraction, Pulls
from crowd_env.physics.dem_lanes.partition import SLABS

KEEPS = manner(patience=0.1, impatience=0.5, interval=0.04)
PULLS = Pulls(attractions=(Attraction(2.0, 2.0, 2.0, lifetime=0.5),))


def in_threes(count, environments=1):
    """Return the group of each: threes and a few alone."""
    group = np.arange(count) // 3
    group[-4:] = -1
    return np.tile(group, environments)


def moves(simulation, people=slice(None)):
    """Return all that people do."""
    state = simulation.state
    arrays = (state.position, state.velocity, state.exit_time, simulation.results.impulse)
    return b"".join(np.ascontiguousarray(array[people]).tobytes() for array in arrays)


@every_scheme
def test_groups_of_one_change_no_bit(name):
    for keeps in (KEEPS, None):
        alone = before_a_door(60, keeps, scheme=name)
        ones = before_a_door(60, keeps, scheme=name, group=np.arange(60))
        for simulation in (alone, ones):
            simulation.advance(n_substeps=steps(simulation, 0.3))
        assert moves(ones) == moves(alone) and not len(ones.history.memory.pulls.held_since)


@every_scheme
@looped("keeps", [KEEPS, None], ids=["keeps a distance", "full speed"])
@looped("threads", [2, 1, 3], quick=1)
def test_alone_and_anywhere_in_a_batch_beside_people_without_groups(name, threads, keeps):
    without = before_a_door(60, keeps, scheme=name)
    together = before_a_door(60, keeps, scheme=name, group=in_threes(60))
    group = np.concatenate([in_threes(60), np.full(60, -1), in_threes(60), np.full(60, -1)])
    many = before_a_door(60, keeps, scheme=name, environments=4, threads=threads, group=group)
    for simulation in (without, together, many):
        for _ in range(2):
            simulation.advance(n_substeps=steps(simulation, 0.15))
    found = [moves(many, slice(60 * e, 60 * (e + 1))) for e in range(4)]
    assert found == [moves(together), moves(without)] * 2
    assert found[0] != found[1]


def test_a_large_crowd_of_groups_that_threads_share():
    found = set()
    for threads in (1, 2, 3):
        group = in_threes(4200)
        simulation = before_a_door(4200, KEEPS, scheme="dem", threads=threads, group=group, pulls=PULLS)
        assert simulation.scheme.slabs(4200, reach=0.0) == SLABS
        simulation.advance(n_substeps=60)
        found.add(moves(simulation))
    assert len(found) == 1


@every_scheme
@looped("count", [60, 1100], quick=1)
def test_a_run_of_groups_that_goes_on_from_a_checkpoint(name, count):
    for keeps in (KEEPS, None):
        simulation = before_a_door(count, keeps, scheme=name, group=in_threes(count), pulls=PULLS)
        simulation.advance(n_substeps=steps(simulation, 0.27))
        checkpoint = pickle.loads(pickle.dumps(simulation.checkpoint()))
        simulation.advance(n_substeps=steps(simulation, 0.2))
        expected = moves(simulation)
        other = before_a_door(count, keeps, scheme=name, group=in_threes(count), pulls=PULLS)
        other.restore(checkpoint)
        other.advance(n_substeps=steps(other, 0.2))
        assert moves(other) == expected


def test_a_checkpoint_of_other_pulls_is_refused():
    checkpoint = before_a_door(20, None, scheme="dem", pulls=PULLS).checkpoint()
    with pytest.raises(ValueError, match="its pulls differs"):
        before_a_door(20, None, scheme="dem").restore(checkpoint)
