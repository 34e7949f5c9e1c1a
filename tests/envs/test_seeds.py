"""A seed fixes an episode, bit by bit: alone or beside others, in a large crowd, in any episode, for any number of threads."""

from functools import partial

import numpy as np
import pytest
from shapely.geometry import box

import crowd_env.physics.simulation.simulation
import crowd_env.physics.spatial_order
from crowd_env import FULL_SPEED, TABLE_4, CrowdEnv, Geometry, Physics, Population, Scenario, make_scenario
from crowd_env.physics import SCHEMES
from crowd_env.physics.workspace import allocate_workspace
from crowd_env.routing.spec import DoorEvent

every_scheme = pytest.mark.parametrize("scheme", SCHEMES)


@pytest.fixture
def forty_are_many(monkeypatch):
    """Let crowds of forty be sorted as large ones are."""
    monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", 40)


def shown(env, e, step):
    """Return the bytes of all that a step shows of environment ``e``."""
    state = env.simulation.state
    seen = (step.observation, step.reward, step.terminated, step.truncated, state.position, state.velocity, state.angle)
    others = (
        state.exit_time,
        state.route,
        env.simulation.results.impulse,
        env.simulation.results.impulse_magnitude,
        env.simulation.bodies.radius,
    )
    return [array[env.people(e)].tobytes() for array in (*seen, *others)]


def play(env, seeds, steps):
    """Return for each environment what an episode shows, step by step; one person of three acts at random."""
    observation, _ = env.reset(seeds)
    found = [[observation[env.people(e)].tobytes()] for e in range(env.num_envs)]
    drawn = [np.random.default_rng([seed, 99]) for seed in seeds]
    sizes = np.diff(env.env_start)
    rule = np.concatenate([np.arange(size) % 3 > 0 for size in sizes])
    for _ in range(steps):
        action = np.concatenate([rng.uniform(-1, 1, (size, 2)) for rng, size in zip(drawn, sizes, strict=True)])
        step = env.step(action, rule)
        for e in range(env.num_envs):
            found[e] += shown(env, e, step)
    return found


def room(count, side=6.0, **options):
    return make_scenario("room-v0", people=count, side=side, time_limit=1e3, **options)


@every_scheme
@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.more), 2])
def test_small_and_large_crowds_beside_each_other_are_what_each_is_alone_and_fresh(scheme, threads, forty_are_many):
    make = partial(CrowdEnv, physics=scheme, action={"name": "continuous", "frame": "world"})
    places = [room(60), room(12), room(45), room(60)]
    batch = make(places, num_envs=4, physics=Physics(scheme, threads=threads))
    steps = 7  # beyond the second time that people are sorted
    expected = [play(make(place), [k + 1], steps)[0] for k, place in enumerate(places)]
    assert play(batch, [1, 2, 3, 4], steps) == expected
    for episode in range(8):
        play(batch, [10 * episode + e for e in range(4)], 1)
    assert play(batch, [1, 2, 3, 4], steps) == expected


@pytest.mark.parametrize("scheme", ["dem", "nsm2"])
def test_the_tenth_episode_of_a_batch_that_restarts_by_itself_is_that_of_a_fresh_environment(scheme, forty_are_many):
    places = [room(60), room(12), make_scenario("two-exit-hall-v0", people=50)]
    options = {"physics": scheme, "time_limit": 0.2, "routing": "fastest"}
    batch = CrowdEnv(places, num_envs=3, autoreset=True, **options)
    batch.reset([1, 2, 3])
    for _ in range(18):
        step = batch.step(None)
    seen = [[step.observation]]
    for _ in range(2):
        step = batch.step(None)
        seen.append([step.info.get("final_observation", step.observation), step.reward])
    assert step.info["finished"].all()
    for e, place in enumerate(places):
        alone = CrowdEnv(place, **options)
        alone.reset([e + 1])
        for _ in range(9):
            observation, _ = alone.reset()  # the next draw of the same generator
        expected = [[observation], *(alone.step(None)[:2] for _ in range(2))]
        for ours, theirs in zip(seen, expected, strict=True):
            for array, values in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(array[batch.people(e)], values)


@pytest.mark.parametrize("scheme", ["dem", "nsm2"])
def test_a_crowd_of_more_than_a_thousand_is_the_same_in_its_second_episode_and_beside_a_small_room(scheme):
    make = partial(CrowdEnv, physics=scheme)
    big, small = room(1050, side=26.0), room(20)
    used, steps = make([big, small], num_envs=2), 6
    play(used, [8, 9], steps)
    again = play(used, [1, 2], steps)
    assert again[0] == play(make(big), [1], steps)[0]
    assert again[1] == play(make(small), [2], steps)[0]


def test_bodies_that_are_changed_by_hand_count_at_once_beside_a_large_crowd_too(forty_are_many):
    alone, batch = CrowdEnv(room(12)), CrowdEnv([room(60), room(12)], num_envs=2)
    alone.reset([2])
    batch.reset([1, 2])
    people = batch.people(1)
    for _ in range(3):
        alone.simulation.bodies.desired_speed[:] *= 0.8
        batch.simulation.bodies.desired_speed[:] *= 0.8
        np.testing.assert_array_equal(batch.step(None).observation[people], alone.step(None).observation)


def test_a_crowd_that_threads_share_is_the_same_in_its_second_episode():
    make = partial(CrowdEnv, make_scenario("room-v0", side=48.0), people=4050, physics="dem")
    used = make(physics=Physics("dem", threads=2))
    play(used, [8], 2)
    assert play(used, [1], 3) == play(make(), [1], 3)


@pytest.mark.filterwarnings("ignore:with .* closed people wait there")
def test_doors_that_lock_everyone_in_at_the_start_leave_no_ways_of_the_episode_before():
    place = Geometry.from_polygon(
        box(0, 0, 8, 6),
        exits={"west": [(0, 3.6), (0, 2.4)], "east": [(8, 2.4), (8, 3.6)]},
        doors={"west": "west", "east": "east"},
    )
    events = (DoorEvent("west", True, at=0.3),)
    scene = Scenario(
        "locked",
        place,
        Population(20, **TABLE_4),
        100.0,
        closed_doors=("west", "east"),
        door_events=events,
        **FULL_SPEED,
    )
    fresh, used = (CrowdEnv(scene, physics="dem") for _ in range(2))
    play(used, [1], 6)
    assert play(used, [3], 6) == play(fresh, [3], 6)


# ---------------------------------------------------------------------------------------------------- fastest ways


@pytest.mark.parametrize("place", ["two-exit-hall-v0", pytest.param("supermarket-v0", marks=pytest.mark.more)])
def test_the_first_observation_and_reward_are_by_the_ways_of_the_crowd_that_is_there(place):
    fresh, used = (CrowdEnv(place, routing="fastest", physics="dem") for _ in range(2))
    play(used, [1], 15)
    assert play(used, [5], 3) == play(fresh, [5], 3)


def test_the_first_observation_after_a_restart_by_itself_is_by_the_ways_of_the_new_crowd():
    options = {"routing": "fastest", "physics": "dem", "time_limit": 0.9}
    by_itself = CrowdEnv("two-exit-hall-v0", num_envs=2, autoreset=True, **options)
    fresh = CrowdEnv("two-exit-hall-v0", num_envs=2, **options)
    by_itself.reset([1, 2])
    for _ in range(9):
        step = by_itself.step(None)
    assert step.info["finished"].all()
    fresh.reset([1, 2])
    expected, _ = fresh.reset()  # the next draw of the same generators
    np.testing.assert_array_equal(by_itself.simulation.state.position, fresh.simulation.state.position)
    np.testing.assert_array_equal(step.observation, expected)
    np.testing.assert_array_equal(by_itself.step(None).reward, fresh.step(None).reward)


def test_others_go_on_with_the_ways_they_have_where_one_begins_anew():
    batch = CrowdEnv("two-exit-hall-v0", num_envs=2, routing="fastest", physics="dem")
    alone = CrowdEnv("two-exit-hall-v0", routing="fastest", physics="dem")
    batch.reset([1, 2])
    alone.reset([2])
    for k in range(14):
        if k == 6:  # between two times that ways are found
            batch.reset([3, 3], mask=[True, False])
        ours, expected = batch.step(None), alone.step(None)
        np.testing.assert_array_equal(ours.observation[batch.people(1)], expected.observation)


# ------------------------------------------------------------------------------------------------- growing memory


@every_scheme
@pytest.mark.parametrize("dt", [0.01, pytest.param(0.002, marks=pytest.mark.more)])
def test_memory_that_runs_full_in_the_midst_of_a_step_changes_nothing(scheme, dt, monkeypatch):
    # Near a round wall of many edges the lists hold more than they have room for at first.
    corners = 2.0 * np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 2400, endpoint=False)])
    place = Geometry.from_polygon(corners, exits=[box(1.7, -0.6, 3, 0.6)])
    scene = Scenario("round", place, Population(12, **TABLE_4), 100.0, **FULL_SPEED)
    grown = []

    def found(per_person):
        monkeypatch.setattr(
            crowd_env.physics.simulation.simulation,
            "allocate_workspace",
            partial(allocate_workspace, per_person=per_person),
        )
        env = CrowdEnv(
            scene,
            physics=Physics(scheme, dt=min(dt, SCHEMES[scheme].info.default_dt)),
            action={"name": "continuous", "frame": "world"},
        )
        before = len(env.simulation.workspace.neighbors.contact_distance)
        seen = play(env, [3], 12)
        grown.append(len(env.simulation.workspace.neighbors.contact_distance) > before)
        return seen

    assert found(12) == found(1000)
    assert grown == [True, False]
