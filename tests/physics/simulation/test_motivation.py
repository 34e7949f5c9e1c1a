"""Motivation in time: a crowd that begins to push, or to keep its distance, in the middle of an evacuation."""

import numpy as np
import pytest
from cases import looped
from refusals import refuses

from crowd_env import CrowdEnv, make_scenario

SIZES = pytest.mark.parametrize(("count", "side"), [(20, 5.0), (1000, 24.0)], ids=["small", "sorted"])


def crowd(count, side, **people):
    room = make_scenario("room-v0", side=side, population={"people": count, **people})
    env = CrowdEnv(room, physics="dem", walking="calm")
    env.reset(seed=4)
    return env.simulation


def after(simulation, steps):
    simulation.advance(n_substeps=steps)
    return simulation.state.position.copy()


@SIZES
def test_a_motivation_that_is_set_is_the_one_that_people_could_have_had_from_the_start(count, side):
    drawn = crowd(count, side, push=0.6, time_gap=0.5)
    as_usual, told = crowd(count, side), crowd(count, side)
    told.set_motivation(0, push=0.6, time_gap=np.full(count, 0.5))
    usual, pushed = after(as_usual, 30), after(told, 30)
    assert np.array_equal(pushed, after(drawn, 30)) and not np.array_equal(pushed, usual)


@SIZES
def test_it_counts_at_once_and_a_checkpoint_holds_it(count, side):
    first, second = crowd(count, side), crowd(count, side)
    after(first, 7)  # a large crowd is sorted anew every half second: here it is not
    first.set_motivation(0, push=1.0)
    moment = first.checkpoint()
    first.set_motivation(0, push=np.nan)  # as the manner says
    calm = after(first, 20)
    first.restore(moment)
    second.restore(moment)
    assert (second.bodies.push == 1.0).all() and np.isnan(second.bodies.time_gap).all()
    restored = after(second, 20)
    assert np.array_equal(after(first, 20), restored) and not np.array_equal(calm, restored)
    third = crowd(count, side)
    after(third, 7)
    third.set_motivation(0, push=1.0)
    assert np.array_equal(after(third, 20), restored)


def test_only_that_environment_and_only_what_is_given_until_it_restarts():
    env = CrowdEnv(
        make_scenario("room-v0", population={"people": 6, "push": (0.2, 0.4)}), num_envs=2, walking="hurried"
    )
    env.reset(seed=1)
    bodies, simulation = env.simulation.bodies, env.simulation
    before = bodies.push.copy()
    simulation.set_motivation(1, push=[0.0, 0.1, 0.2, 0.3, 0.4, 1.0])
    simulation.set_motivation(1, time_gap=1.5)
    assert np.array_equal(bodies.push[:6], before[:6]) and np.isnan(bodies.time_gap[:6]).all()
    assert bodies.push[6:].tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 1.0] and (bodies.time_gap[6:] == 1.5).all()
    env.reset()
    assert np.isnan(bodies.time_gap).all() and ((bodies.push >= 0.2) & (bodies.push <= 0.4)).all()
    assert (bodies.push != before).all()  # drawn anew


@looped(
    ("environment", "options", "words"),
    [
        (0, {"push": 1.5}, ("push of pedestrian 0 is 1.5", "[0, 1]")),
        (0, {"push": [0.5] * 19 + [-1.0]}, ("push of pedestrian 19 is -1", "[0, 1]")),
        (0, {"push": [0.5] * 3}, ("push has the shape (3,)", "(20,)")),
        (0, {"push": "much"}, ("push is 'much'", "a real number")),
        (0, {"time_gap": 0.0}, ("time_gap of pedestrian 0 is 0", "> 0")),
        (0, {"push": 0.5, "time_gap": np.inf}, ("time_gap of pedestrian 0 is inf", "finite")),
        (3, {"push": 0.5}, ("no environment 3",)),
    ],
)
def test_a_bad_motivation_is_refused_and_changes_nothing(environment, options, words):
    simulation = crowd(20, 5.0)
    refuses(lambda: simulation.set_motivation(environment, **options), words)
    assert np.isnan(simulation.bodies.push).all()


def test_people_who_keep_no_distance_have_no_motivation():
    env = CrowdEnv("room-v0")
    refuses(lambda: env.simulation.set_motivation(0, push=0.5), ("full speed", "manner"))
