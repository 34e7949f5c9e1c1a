"""The manner of a run, behind every door of the simulator."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from refusals import refuses

import crowd_env
from crowd_env import MANNERS, TABLE_4, CrowdEnv, Headway, Walking, make_scenario
from crowd_env.analysis.figures import report
from crowd_env.envs.parallel import env as aec_env
from crowd_env.envs.rollout import run_episodes


def sb3(**options):
    from crowd_env.envs.adapters.sb3 import CrowdVecEnv

    return CrowdVecEnv(CrowdEnv("room-v0", autoreset=True, **options))


DOORS = {
    "arrays": lambda **options: CrowdEnv("room-v0", **options),
    "PettingZoo": lambda **options: crowd_env.parallel_env("room-v0", **options).env,
    "AEC": lambda **options: aec_env("room-v0", **options).unwrapped.env,
    "Gymnasium": lambda **options: gymnasium.make("crowd_env/room-v0", **options).unwrapped.env,
    "vector": lambda **options: gymnasium.make_vec("crowd_env/room-v0", num_envs=2, **options).env,
    "make_vec": lambda **options: crowd_env.make_vec("room-v0", num_envs=2, **options).env,
    "routing": lambda **options: gymnasium.make("crowd_env/routing-v0", people=20, **options).unwrapped.env,
    "routing vector": lambda **options: gymnasium.make_vec("crowd_env/routing-v0", people=20, **options).env,
    "stable-baselines3": lambda **options: sb3(**options).env,
}
through_every_door = pytest.mark.parametrize("make", DOORS.values(), ids=DOORS)


def walked(env, steps=30, **reset):
    env.reset(**{"seed": 0, **reset})
    for _ in range(steps):
        env.step(None)
    return env.simulation.state.position.copy()


@pytest.mark.more
@through_every_door
def test_every_door_takes_a_manner(make):
    assert make().simulation.behaviors["manner"] is None
    assert make(walking="calm").simulation.behaviors["manner"] == MANNERS["calm"]
    assert make(walking={"time_gap": 0.7}).simulation.behaviors["manner"] == Headway(time_gap=0.7)
    assert make(walking=Headway(push=0.5)).simulation.behaviors["manner"].push == 0.5
    refuses(lambda: make(walking="slow"), ("unknown manner 'slow'", *MANNERS))


def test_without_a_manner_nothing_changes_whatever_people_are_driven_by():
    usual = walked(CrowdEnv("room-v0"))
    assert np.array_equal(usual, walked(CrowdEnv("room-v0", walking="competitive")))
    assert np.array_equal(
        usual,
        walked(CrowdEnv(make_scenario("room-v0", population={"people": 20, "push": (0, 1), "time_gap": 2, **TABLE_4}))),
    )
    assert not np.array_equal(usual, walked(CrowdEnv("room-v0", walking="calm")))


def test_the_manner_is_that_of_the_scenario_unless_the_run_says_another():
    calm = replace(make_scenario("room-v0"), manner="calm")
    assert np.array_equal(walked(CrowdEnv(calm)), walked(CrowdEnv("room-v0", walking="calm")))
    assert np.array_equal(walked(CrowdEnv(calm, walking="competitive")), walked(CrowdEnv("room-v0")))
    refuses(
        lambda: CrowdEnv([calm, "room-v0"], num_envs=2),
        ("one batch", "calm in room", "competitive in room", "walking="),
    )
    assert (
        CrowdEnv([calm, "room-v0"], num_envs=2, walking="hurried").simulation.behaviors["manner"] == MANNERS["hurried"]
    )


def test_a_rollout_and_its_report_know_the_manner():
    place = make_scenario("room-v0", people=8)
    usual, calm = (run_episodes(place, 2, manner=manner) for manner in (None, "calm"))
    assert min(one.end for one in calm) > max(one.end for one in usual)
    assert report(place, "nsm2", usual)["manner"] == "competitive"
    assert report(replace(place, manner="calm"), "nsm2", calm)["manner"] == "calm"
    assert report(replace(place, manner={"time_gap": 0.7}), "nsm2", calm)["manner"]["time_gap"] == 0.7


@pytest.mark.parametrize("frame", ["path", "world"])
def test_a_manner_that_acts_on_the_scripted_leaves_those_who_act_alone(frame):
    ruled = np.arange(20) < 10
    for acts_on in ("everyone", "scripted"):
        env = CrowdEnv(
            "room-v0", walking=Walking("calm", acts_on=acts_on), action={"name": "continuous", "frame": frame}
        )
        env.reset(seed=0)
        most, least = np.zeros(20), np.full(20, np.inf)
        for _ in range(20):
            env.step(np.tile([1.0, 0.0], (20, 1)), scripted=ruled)
            wanted = np.hypot(*env.simulation.history.walking_velocity.T) / env.simulation.bodies.desired_speed
            most, least = np.maximum(most, wanted), np.minimum(least, np.where(env.active, wanted, np.inf))
        assert (least[ruled] < 0.9).any() and (most <= 1.0 + 1e-12).all()
        if acts_on == "scripted":
            np.testing.assert_allclose(least[~ruled], 1.0)
        else:
            assert (least[~ruled] < 0.9).any()


def test_a_manner_that_acts_on_nobody_known_is_refused():
    refuses(
        lambda: CrowdEnv("room-v0", walking=Walking(acts_on="learned")),
        ("unknown acts_on 'learned'", "everyone, scripted"),
    )


def test_every_restart_draws_pushes_anew():
    env = CrowdEnv(
        make_scenario("room-v0", population={"people": 20, "push": (0.0, 0.5)}),
        num_envs=2,
        walking="calm",
        autoreset=True,
    )
    env.reset(seed=0)
    first = env.simulation.bodies.push.copy()
    env.reset(mask=np.array([True, False]))
    assert (env.simulation.bodies.push[:20] != first[:20]).all()
    assert np.array_equal(env.simulation.bodies.push[20:], first[20:])
    alone = CrowdEnv(make_scenario("room-v0", population={"people": 20, "push": (0.0, 0.5)}), walking="calm")
    alone.reset(seed=0)
    assert np.array_equal(alone.simulation.bodies.push, first[:20])
