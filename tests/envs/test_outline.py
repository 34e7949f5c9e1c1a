"""The outline of a run, behind every door of the simulator."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from cases import looped
from refusals import refuses
from shapely.geometry import box

import crowd_env
from crowd_env import (
    FULL_SPEED,
    OUTLINES,
    TABLE_4,
    Cohorts,
    CrowdEnv,
    Geometry,
    Outline,
    Physics,
    Population,
    Scenario,
    make_scenario,
)
from crowd_env.analysis.figures import report
from crowd_env.envs.parallel import env as aec_env
from crowd_env.envs.rollout import run_episodes
from crowd_env.geometry.placement import closest_pair

TORSO = OUTLINES["torso"]


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


@pytest.mark.more
@looped("make", DOORS.values(), ids=DOORS)
def test_every_door_takes_an_outline(make):
    assert make(physics="hertz").simulation.outline is None
    assert make(physics=Physics("hertz", outline="torso")).simulation.outline == TORSO
    two = {"discs": [[0, 0.1, 0.1], [0, -0.1, 0.1]]}
    assert make(physics=Physics("hertz", outline=two)).simulation.outline == Outline(two["discs"])
    refuses(lambda: make(physics=Physics(outline="square")), ("unknown outline 'square'", *OUTLINES))
    refuses(lambda: make(physics=Physics("nsm2", outline="torso")), ("nsm2 does not turn bodies", "'torso'", "hertz"))


def walked(env, steps=10):
    env.reset(seed=0)
    for _ in range(steps):
        env.step(None)
    return env.simulation.state.position.copy()


def test_the_outline_is_that_of_the_scenario_unless_the_run_says_another():
    room = make_scenario("room-v0", side=6.0)
    torsos = replace(room, outline="torso")
    named = walked(CrowdEnv(room, physics=Physics("hertz", outline="torso")))
    assert np.array_equal(walked(CrowdEnv(torsos, physics="hertz")), named)
    usual = walked(CrowdEnv(room, physics="hertz"))
    assert np.array_equal(walked(CrowdEnv(torsos, physics=Physics("hertz", outline="disc"))), usual)
    assert not np.array_equal(usual, named)
    refuses(lambda: CrowdEnv(torsos), ("nsm2 does not turn bodies", "'torso'"))
    refuses(
        lambda: CrowdEnv([torsos, room], num_envs=2, physics="hertz"), ("one batch", "torso in room", "disc in room")
    )


def test_a_rollout_and_its_report_know_the_outline():
    place = make_scenario("room-v0", people=8, side=5.0)
    episodes = run_episodes(place, 2, scheme="hertz", outline="torso")
    assert report(place, "hertz", episodes)["outline"] == "disc"
    assert report(replace(place, outline="torso"), "hertz", episodes)["outline"] == "torso"
    assert all(one.metrics.unfinished == 0 and one.metrics.escaped == 0 for one in episodes)


def test_people_are_placed_with_room_to_turn():
    cohorts = Cohorts(
        (
            Population(15, start_region="left", **TABLE_4),
            Population(15, **TABLE_4),
            Population(5, starts=[[5, k] for k in range(1, 6)], **TABLE_4),
        )
    )
    place = Geometry.from_polygon(box(0, 0, 8, 6), exits=[[(8, 2), (8, 4)]], regions={"left": box(0, 0, 4, 6)})
    for people in (Population(35, **TABLE_4), cohorts):
        scenario = Scenario("hall", place, people, 60.0, outline="torso", **FULL_SPEED)
        env = CrowdEnv(scenario, physics="hertz")
        env.reset(seed=1)
        position = env.simulation.state.position
        wide = TORSO.shape.reach * env.simulation.bodies.radius
        assert closest_pair(position, wide)[2] > -1e-9
        assert (place.clearance(position) > wide - 1e-9).all()
        env.step(None)
        assert env.simulation.diagnostics.max_overlap[0] < 0.02


def test_too_many_people_with_shoulders_are_refused_before_any_is_drawn():
    place = Geometry.from_polygon(box(0, 0, 4, 4), exits=[[(4, 1), (4, 3)]])
    Scenario("hall", place, Population(80, **TABLE_4), 60.0, **FULL_SPEED)
    refuses(
        lambda: Scenario("hall", place, Population(80, **TABLE_4), 60.0, outline="torso", **FULL_SPEED),
        ("80 people do not fit", "at most"),
    )


def test_a_new_episode_has_the_inertia_of_the_outline_and_faces_the_way():
    env = CrowdEnv(make_scenario("room-v0", side=6.0), num_envs=2, physics=Physics("hertz", outline="torso"))
    for seed in (0, 1):
        env.reset(seed=seed)
        bodies = env.simulation.bodies
        np.testing.assert_array_equal(bodies.inertia, TORSO.inertia(bodies.mass, bodies.radius))
        assert not env.simulation.state.angle.any()
        env.step(None)
        way = np.arctan2(*env.simulation.history.direction.T[::-1])
        off = np.angle(np.exp(1j * (env.simulation.state.angle - way)))
        assert np.median(np.abs(off)) < 0.1
