"""Plain data of settings, and what is said of a misspelled or an impossible one."""

import gymnasium
import numpy as np
import pytest

from crowd_env import Attraction, CrowdEnv, GroupCohesion, Physics, Population, Pulls, Walking, make_vec
from crowd_env.agents.drivers import Hindrance
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.core.behaviors.pulls import MOST

PULLS = {"groups": {"patience": 5.0}, "attractions": [{"x": 1.0, "y": 2.0, "strength": 3.0}]}
MEANT = Pulls(GroupCohesion(patience=5.0), (Attraction(1.0, 2.0, 3.0),))


def test_pulls_may_be_plain_data():
    assert Walking.of({"pulls": PULLS}) == Walking(pulls=MEANT) == Walking(pulls=PULLS)
    assert Walking(pulls=[PULLS, Pulls()]).pulls == [MEANT, Pulls()]
    env = CrowdEnv("room-v0", people=3, walking={"manner": "calm", "pulls": PULLS})
    assert env.simulation.behaviors["pulls"] == (MEANT,)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Walking(pulls={"group": {}}), "pulls: unknown key 'group'"),
        (
            lambda: Walking(pulls={"groups": [{"patience": 5.0}]}),
            "pulls: groups is .*must be a GroupCohesion, and not a list",
        ),
        (lambda: Pulls(attractions=MEANT.attractions * (MOST + 1)), f"{MOST + 1} attractions; at most {MOST}"),
        (lambda: Walking.of({"maner": "calm"}), "walking: unknown key 'maner'.*manner, acts_on, pulls"),
        (lambda: Walking.of({"act_on": "scripted"}), "walking: unknown key 'act_on'"),
        (lambda: Physics.of({"sceme": "dem"}), "physics: unknown key 'sceme'"),
        (lambda: Walking.of({"time_gp": 1.0}), "manner: unknown key 'time_gp'"),
        (lambda: Population(3, group_size=4), "group_size must be at most the 3 people, but is at least 4"),
        (lambda: evaluate("shortest", people=3, learned_share=2), "learned_share is 2"),
        (lambda: evaluate("shortest", people=3, learned_share=0.0), "learned_share is 0"),
        (lambda: evaluate("shortest", people=3, hindrance=3), "hindrance is 3; it must be a Hindrance"),
        (lambda: evaluate("shortest", people=3, hindrance=Hindrance(noise=-1.0)), "hindrance: noise is -1"),
    ],
)
def test_a_mistake_is_answered_in_a_sentence(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_people_in_small_crowds_may_walk_in_smaller_groups():
    Population(3, group_size=(2, 5))
    Population(1, group_size=4)


def test_the_reward_of_each_is_in_the_info():
    env = make_vec("room-v0", 2, people=3, reward={"time": 1.0})
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros((2, 3, 2)))
    np.testing.assert_allclose(info["reward"], info["reward/time"])
    np.testing.assert_allclose(info["reward"].mean(axis=1), reward)
    one = gymnasium.make("crowd_env/room-v0", people=3)
    one.reset(seed=0)
    _, reward, _, _, info = one.step(np.zeros((3, 2)))
    assert info["reward"].shape == (3,) and reward == pytest.approx(info["reward"].mean())


def test_a_footbridge_takes_a_physics():
    env = gymnasium.make("crowd_env/footbridge-gate-v0", people=4, physics=Physics("nsm2", dt=0.02)).unwrapped
    env.reset(seed=0)
    simulation = env.bridge.simulation
    assert (simulation.scheme.info.name, simulation.dt) == ("nsm2", 0.02)
    assert simulation.behaviors["max_drive"].force == 300.0
    with pytest.raises(TypeError, match=r"say physics=Physics\(dt=\.\.\.\)"):
        gymnasium.make("crowd_env/footbridge-gate-v0", dt=0.02)
