"""What comes of the headway rule over time: queues, encounters, lone walkers, and full push."""

import numpy as np
import pytest
from cases import looped
from shapely.geometry import LineString, box
from walking_crowds import manner, standing, steps

from crowd_env import FULL_SPEED, Geometry, Scenario, Simulation, make_scenario
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.core.behaviors.headway import MANNERS

TURNS = 64  # environments in which the same room is drawn anew


def test_a_queue_walks_as_fast_as_its_head_and_everyone_keeps_the_gap_of_that_speed():
    # The stationary state of a single file: gap = s + T V.
    bodies = make_bodies([0.2] * 4, [70.0] * 4, desired_speed=[1.3, 1.3, 1.3, 0.5], relaxation_time=0.3)
    line = np.column_stack([[0.0, 1.5, 2.1, 3.0], np.zeros(4)])
    simulation, asked = standing(line, [[1, 0]] * 4, manner(strength=0.0, time_gap=0.8, standing=0.1), bodies=bodies)
    simulation.advance(**asked, n_substeps=steps(simulation, 60.0))
    assert np.diff(simulation.state.position[:, 0]) - 0.4 == pytest.approx([0.1 + 0.8 * 0.5] * 3, abs=1e-4)
    assert simulation.state.velocity[:, 0] == pytest.approx([0.5] * 4, abs=1e-4)
    assert simulation.diagnostics.max_overlap[0] == 0.0


@looped("time_gap", [0.6, 1.0])
def test_on_a_ring_everyone_walks_as_fast_as_the_gap_allows(time_gap):
    count, circumference = 20, 16.0
    radius, angle = circumference / (2 * np.pi), 2 * np.pi * np.arange(count) / count
    place = np.column_stack([np.cos(angle), np.sin(angle)])
    tangent = np.column_stack([-place[:, 1], place[:, 0]])
    bodies = make_bodies([0.2] * count, [70.0] * count, desired_speed=1.3, relaxation_time=0.1)
    keeps = manner(strength=0.0, time_gap=time_gap, oncoming=0.0, anticipation=0.5, standing=0.1)
    simulation, asked = standing(radius * place, tangent, keeps, velocity=0.3 * tangent, bodies=bodies)
    for _ in range(400):  # each looks 0.4 m along the ring, so that the circle is held
        position = simulation.state.position
        ahead = np.arctan2(*position.T[::-1]) + 0.4 / radius
        aim = radius * np.column_stack([np.cos(ahead), np.sin(ahead)]) - position
        simulation.advance(aim / np.hypot(*aim.T)[:, None], relative=asked["relative"], n_substeps=5)
    turn = np.cos(2 * np.pi / count)  # of the way and of the velocity of the one in front to the own way
    x = simulation.state.position
    gap = np.hypot(*(np.roll(x, -1, axis=0) - x).T) - 0.4
    assert np.hypot(*x.T) == pytest.approx(np.full(count, radius), rel=0.03)
    assert np.hypot(*simulation.state.velocity.T) == pytest.approx(
        (gap - 0.1 * turn) / (time_gap + 0.5 * turn * (1.0 - turn)), rel=0.02
    )


@looped("offset", [0.0, 0.1, -0.15])
@pytest.mark.parametrize("name", ["dem", "nsm2", "hertz"])
def test_two_who_come_towards_each_other_in_a_corridor_pass(name, offset):
    corridor = Geometry.from_polygon(box(-10, -0.9, 10, 0.9))
    start = [[-5, 0], [5, offset]]
    simulation, asked = standing(start, [[1, 0], [-1, 0]], manner(), place=corridor, scheme=name)
    simulation.advance(**asked, n_substeps=steps(simulation, 9.0))
    x = simulation.state.position[:, 0]
    assert x[0] > 4.0
    assert x[1] < -4.0
    assert simulation.diagnostics.max_overlap[0] < 0.002  # m: they brush each other at most


def corner() -> tuple[Geometry, object]:
    """Return a place with a way round a corner, and its field."""
    place = Geometry.from_polygon([(0, 0), (6, 0), (6, 6), (3, 6), (3, 3), (0, 3)], exits=[[(6, 6), (3, 6)]])
    return place, Scenario("corner", place, make_scenario("room-v0").population, 60.0, **FULL_SPEED).field()


@pytest.mark.parametrize("name", [name for name, keeps in MANNERS.items() if keeps is not None])
def test_a_lone_pedestrian_walks_as_without_a_manner(name):
    place, field = corner()
    times = []
    for keeps in (None, name):
        bodies = make_bodies([0.2], [70.0], desired_speed=1.3, response_time=1.02)
        simulation = Simulation(place, bodies, make_state([[0.5, 2.0]]), physics="dem", walking=keeps, fields=[field])
        simulation.advance(n_substeps=steps(simulation, 1.0))
        assert not simulation.state.velocity.any()
        simulation.advance(n_substeps=steps(simulation, 11.0))
        times.append(simulation.state.exit_time[0])
    assert times[1] == pytest.approx(times[0], abs=0.05)
    assert times[0] > 1.0 + LineString([(0.5, 2.0), (3.0, 3.0), (3.0, 6.0)]).length / 1.3


def test_along_a_straight_way_not_even_the_interval_shows():
    ends = []
    for keeps in (None, manner(interval=0.3)):
        simulation, asked = standing([[0, 0]], [[0.6, 0.8]], keeps)
        simulation.advance(**asked, n_substeps=200)
        ends.append(simulation.state.position.copy())
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12)


def rooms(keeps, people: int = 20) -> np.ndarray:
    """Return how long [s] each of many draws of the room takes to empty."""
    scenario = make_scenario("room-v0", people=people)
    drawn = [scenario.population.draw(np.random.default_rng(seed), scenario.geometry) for seed in range(TURNS)]
    columns = {
        name: np.concatenate([getattr(bodies, name) for bodies, _ in drawn])
        for name in ("radius", "mass", "desired_speed", "relaxation_time", "response_time")
    }
    bodies = make_bodies(**columns, env_start=people * np.arange(TURNS + 1))
    state = make_state(np.concatenate([position for _, position in drawn]), environments=TURNS)
    simulation = Simulation(scenario.geometry, bodies, state, physics="dem", walking=keeps, fields=[scenario.field()])
    simulation.advance(n_substeps=steps(simulation, 40.0))
    return state.exit_time.reshape(TURNS, people).max(axis=1)


def test_who_pushes_fully_gets_out_as_soon_as_without_a_manner_and_who_does_not_later():
    without, pushing, giving = (rooms(keeps) for keeps in (None, manner(push=1.0), manner(push=0.0)))
    assert np.isfinite([without, pushing]).all()
    later = pushing - without
    assert abs(later.mean()) < 0.05 + 2.0 * later.std() / np.sqrt(TURNS)
    assert later.std() / np.sqrt(TURNS) < 0.2  # else the bound says nothing
    assert np.nanmean(giving) > without.mean() + 1.0
