"""Exits that people choose: choices are followed, cost nothing when unused, pay nothing to and fro, and see what they say."""

import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from crowds import every_scheme
from gymnasium.vector.utils import batch_space
from pettingzoo.test import parallel_api_test
from refusals import refuses, table
from shapely.geometry import box

from crowd_env import (
    FULL_SPEED,
    ActionKind,
    CrowdEnv,
    CrowdGymEnv,
    Geometry,
    ObservationLayout,
    Physics,
    Population,
    Scenario,
    Uniform,
    make_vec,
    parallel_env,
)
from crowd_env.envs.action import SpeedExitTable

SPEEDS = 5  # of "speeds-exits"
KEEP, WEST, EAST = 4, 9, 14  # full speed along the own way, and along that to one of the exits
STAND = 1
SEES = {"terms": ("routes", "queues_seen", "queues_shown", "direction")}


def place(people=8, length=8.0, depth=5.0):
    """Return a hall with an exit of 1 m at each end, and everyone in its western half."""
    ends = {"west": 0.0, "east": length}
    geometry = Geometry.from_polygon(
        box(0, 0, length, depth),
        exits={name: [(x, 0.5 * depth - 0.5), (x, 0.5 * depth + 0.5)] for name, x in ends.items()},
        regions={"start": box(0, 0, 0.5 * length, depth)},
    )
    crowd = Population(people, radius=Uniform(0.2, 0.25), desired_speed=Uniform(1.2, 2.0), start_region="start")
    return Scenario(f"hall of {length:g} m", geometry, crowd, 60.0, **FULL_SPEED)


def hall(people=8, length=8.0, depth=5.0, **options):
    return CrowdEnv(place(people, length, depth), **{"action": "speeds-exits", "observation": SEES, **options})


def step_of(name):
    return 0.01 if name != "hertz-literal" else None


def steps(env, actions, seed=0):
    """Return all that the environment says after each of some actions."""
    observation, _ = env.reset(seed)
    said = [observation]
    for action in actions:
        step = env.step(action)
        said += [step.observation, step.reward, step.terminated, env.simulation.state.route.copy()]
    return said


@every_scheme
def test_everyone_leaves_by_the_chosen_exit(name):
    env = hall(physics=Physics(name, dt=step_of(name)), routing="nearest")
    env.reset(seed=0)
    east = np.arange(8) % 2 == 1
    while not env.finished.all():
        env.step(np.where(east, EAST, WEST))
    state, names = env.simulation.state, env.scenarios[0].geometry.exit_names
    assert np.isfinite(state.exit_time).all()
    np.testing.assert_array_equal(np.array(names)[state.exit_index], np.where(east, "east", "west"))


@every_scheme
def test_the_same_bits_in_any_place_of_any_batch_and_on_any_number_of_threads(name):
    rng = np.random.default_rng(1)
    choices = rng.integers(0, 15, (12, 3, 30))
    physics = Physics(name, dt=step_of(name))
    together, too = (hall(30, num_envs=3, physics=replace(physics, threads=threads)) for threads in (1, 3))
    one = steps(together, choices.reshape(12, -1), [4, 5, 6])
    other = steps(too, choices.reshape(12, -1), [4, 5, 6])
    alone = steps(hall(30, physics=physics), choices[:, 2], [6])
    for a, b, c in zip(one, other, alone, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a[60:], c)


@pytest.mark.parametrize("strategy", ["shortest", "fastest", "nearest", "east"])
def test_who_keeps_to_the_own_way_follows_the_rule_to_the_last_bit(strategy):
    env, ruled = hall(people=20, routing=strategy), hall(people=20, routing=strategy, action="speeds")
    keep = np.full(20, KEEP)
    assert env.action_kind.neutral == ruled.action_kind.neutral == KEEP
    for a, b in zip(steps(env, [keep] * 15), steps(ruled, [None] * 15), strict=True):
        np.testing.assert_array_equal(a, b)


def test_whoever_has_turned_keeps_to_it_for_a_second():
    env = hall()
    env.reset(seed=0)
    routes = []
    for k in range(31):
        env.step(np.full(8, (WEST, EAST)[k % 2]))
        routes.append(env.simulation.state.route[0])
    turned = np.flatnonzero(np.diff(routes)) + 1
    assert routes[0] == env.route_set[0].number("west")  # the first choice counts at once
    assert turned.tolist() == [11, 21] or turned.tolist() == [11, 22]


def test_a_new_episode_and_a_restored_one_remember_what_they_should():
    env = hall(num_envs=2)
    env.reset(seed=0)
    env.step(np.full(16, EAST))
    then = env.checkpoint()
    west, east = (env.route_set[0].number(name) for name in ("west", "east"))
    env.reset(mask=[False, True])
    env.step(np.full(16, WEST))
    assert (env.simulation.state.route == np.repeat([east, west], 8)).all()
    for again in (then, pickle.loads(pickle.dumps(then))):
        env.restore(again)
        env.step(np.full(16, WEST))
        assert (env.simulation.state.route == east).all()


def test_only_those_inside_who_have_an_action_choose():
    env = hall()
    env.reset(seed=0)
    before = env.simulation.state.route.copy()
    env.step(np.full(8, EAST), scripted=np.arange(8) < 4)
    changed = env.simulation.state.route != before
    np.testing.assert_array_equal(changed, np.arange(8) >= 4)


def test_cohorts_with_a_way_of_their_own_keep_to_it():
    env = CrowdEnv("counter-flow-v0", action="speeds-exits")
    env.reset(seed=0)
    before = env.simulation.state.route.copy()
    for choice in (WEST, EAST):
        env.step(np.full(env.num_people, choice))
        np.testing.assert_array_equal(env.simulation.state.route, before)


def test_nothing_is_made_for_those_who_choose_none():
    env = hall(action="speeds", observation=None)
    assert [route.name for route in env.route_set[0].routes] == ["out"]
    assert env.layout.routes == 0 and env.layout == ObservationLayout()
    assert env._choice.known.fields.ways.route.shape == (1, 0) and env.observer.view.length_of_way.size == 0


# -------------------------------------------------------------------------------------------------------------- reward


def test_turning_to_and_fro_pays_nothing():
    """Everyone stands: each switch pays the difference of the ways, and what comes back to the first way sums to nothing."""
    env = hall(physics="nsm1", length=12.0)
    env.reset(seed=0)
    env.step(np.full(8, SPEEDS + STAND))
    position, paid = env.simulation.state.position.copy(), []
    for k in range(41):
        choice = (1 + (k // 10) % 2) * SPEEDS + STAND
        paid.append(env.step(np.full(8, choice)).info["reward/progress"])
    np.testing.assert_array_equal(env.simulation.state.position, position)
    assert (np.abs(paid).max(axis=0) > 0.2).all()  # a switch is worth something
    assert (np.count_nonzero(paid, axis=0) == 4).all()
    np.testing.assert_allclose(np.sum(paid, axis=0), 0.0, atol=1e-9)


def test_whatever_is_chosen_progress_sums_to_the_way_at_the_start():
    env = hall(people=20, routing="fastest")
    env.reset(seed=3)
    first, rng, paid = env.observer.view.potential.copy(), np.random.default_rng(0), 0.0
    while not env.finished.all():
        choices = np.where(rng.random(20) < 0.9, KEEP, rng.integers(0, 15, 20))
        paid = paid + env.step(choices).info["reward/progress"]
    out = np.isfinite(env.simulation.state.exit_time)
    assert out.sum() > 15
    np.testing.assert_allclose(paid[out], first[out], atol=1e-9)


# --------------------------------------------------------------------------------------------------------- observation


def expected(env):
    """Return what the terms must hold, from the fields of both exits and the places of all: (P, 2) of each column."""
    state, bodies = env.simulation.state, env.simulation.bodies
    routes = [env.route_set[0].number(name) for name in ("west", "east")]
    fields = [env.route_set[0].routes[k].field for k in routes]
    length = np.stack([field.travel_time_near(state.position) for field in fields], axis=1)
    time = length / bodies.desired_speed[:, None]
    heads = np.where(state.route == routes[1], 1, 0)
    inside = state.active
    seen, shown = np.zeros((2, len(heads), 2))
    for i in np.flatnonzero(inside):
        for k in (0, 1):
            nearer = inside & (heads == k) & (length[:, k] < length[i, k])
            near = np.hypot(*(state.position - state.position[i]).T) < 3.0
            seen[i, k], shown[i, k] = (nearer & near).sum(), nearer.sum()
    return [array * inside[:, None] for array in (time / (time + 5.0), np.eye(2)[heads], seen, shown)]


def test_ways_and_queues_are_those_of_the_crowd():
    env = hall(people=60, length=14.0, depth=9.0)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    chosen = rng.integers(1, 3, 60) * SPEEDS
    for _ in range(45):
        shown = env.step(chosen + rng.integers(0, SPEEDS, 60)).observation
    rows = env.active
    assert 20 < rows.sum() < 60
    shown = shown[rows].astype(float)
    time, heads, seen, signs = (array[rows] for array in expected(env))
    layout = env.layout
    np.testing.assert_allclose(
        shown[:, layout["routes"]][:, ::2], time, atol=0.03
    )  # fields are read at the nearest node
    np.testing.assert_array_equal(shown[:, layout["routes"]][:, 1::2], heads)
    near, all_of_them = shown[:, layout["queues_seen"]], shown[:, layout["queues_shown"]]
    np.testing.assert_allclose(10.0 * near / (1.0 - near), seen, atol=1.1)  # so are these, of two who are equally far
    np.testing.assert_allclose(50.0 * all_of_them / (1.0 - all_of_them), signs, atol=2.1)
    assert seen.max() > 5 and signs.max() > 20 and (seen != signs).any()
    assert np.abs(10.0 * near / (1.0 - near) - seen).mean() < 0.2


def test_who_takes_the_fastest_way_is_seen_to_head_for_an_exit():
    env = hall(people=60, routing="fastest", length=14.0)
    observation, _ = env.reset(seed=0)
    heads, direction = observation[:, env.layout["routes"]][:, 1::2], observation[:, env.layout["direction"]]
    assert (heads.sum(axis=1) == 1.0).all()
    far = np.abs(direction[:, 0]) > 0.5
    assert far.sum() > 30
    np.testing.assert_array_equal(heads[far].argmax(axis=1), (direction[far, 0] > 0.0).astype(int))


# ---------------------------------------------------------------------------------------------------------- interfaces


def test_every_interface_takes_it():
    options, scenario = {"action": "speeds-exits", "observation": SEES}, place()
    space = gymnasium.spaces.Discrete(3 * SPEEDS)
    alone = CrowdGymEnv(scenario, **options)
    assert alone.action_space == batch_space(space, 8)
    alone.reset(seed=0)
    alone.step(alone.action_space.sample())
    batch = make_vec(scenario, num_envs=2, **options)
    batch.reset(seed=0)
    batch.step(batch.action_space.sample())
    agents = parallel_env(scenario, time_limit=0.5, **options)
    assert agents.action_space("pedestrian_0") == space
    parallel_api_test(agents, num_cycles=10)


def twice(action):
    return np.stack([np.cos(0.0 * action), 0.0 * action], axis=1), np.where(action > 0.5, 1, -1)


def test_a_kind_of_ones_own_may_choose_too():
    kind = ActionKind("go east", gymnasium.spaces.Box(0.0, 1.0, (), np.float32), twice, 0.0, routes=2)
    env = hall(action=kind)
    env.reset(seed=0)
    before = env.simulation.state.route.copy()
    env.step(np.linspace(0.0, 1.0, 8))
    np.testing.assert_array_equal(env.simulation.state.route != before, np.arange(8) >= 4)


def test_places_of_one_batch_may_differ_in_all_but_the_number_of_ways():
    env = CrowdEnv([place(), place(5, length=12.0)], num_envs=2, action="speeds-exits", observation=SEES)
    env.reset(seed=0)
    assert env.step(np.full(env.num_people, EAST)).observation.shape == (13, env.layout.size)


def no_pair(action):
    return np.tile([1.0, 0.0], (len(action), 1))


def third(action):
    return no_pair(action), np.where(action > 0.0, 2, -1)


ONE = gymnasium.spaces.Box(0.0, 1.0, (), np.float32)


def acted(kind):
    env = hall(action=kind)
    env.reset(seed=0)
    env.step(np.ones(8))


WRONG = [
    ("other number", lambda: hall(action={"name": "speeds-exits", "routes": 3}), ("'speeds-exits'", "3", "2: west, east")),
    ("negative", lambda: SpeedExitTable(routes=-1), ("routes", "-1", "at least 0")),
    ("dwell", lambda: SpeedExitTable(dwell=-1.0), ("dwell", "-1", ">= 0")),
    ("no pair", lambda: ActionKind("one", ONE, no_pair, 0.0, routes=2), ("'one'", "(commands, choices)")),
    ("third way", lambda: acted(ActionKind("one", ONE, third, 0.0, routes=2)), ("'one'", "choice is 2", "below 2")),
    ("layout", lambda: hall(observation=ObservationLayout(("routes",), routes=3)), ("routes is 3", "has 2", "west, east")),
    (
        "places",
        lambda: CrowdEnv(["two-exit-hall-v0", "room-v0"], num_envs=2, action="speeds-exits"),
        ("2 in", "1 in", "to choose among"),
    ),
]  # fmt: skip


@table(WRONG)
def test_what_cannot_be_is_refused_in_one_sentence(call, words):
    refuses(call, words)
