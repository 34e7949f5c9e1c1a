"""Kinds of action: a space, how it is decoded, and the action that follows the rule; one more is one object."""

import json
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector.utils import batch_space
from pettingzoo.test import parallel_api_test
from refusals import refuses, table

from crowd_env import ActionKind, CrowdEnv, CrowdGymEnv, make_vec, parallel_env
from crowd_env.envs.action import ACTIONS, SpeedTable, make_action, plain_action

ONE = gymnasium.spaces.Box(-1.0, 1.0, (), np.float32)


def turned(angle):
    """Return the command to go at full speed, turned to the left by a share of half a turn."""
    return np.column_stack([np.cos(np.pi * angle), np.sin(np.pi * angle)])


TURN = ActionKind("turn", ONE, turned, 0.0)


def walked(action, given, steps=20):
    env = CrowdEnv("room-v0", people=8, action=action)
    env.reset(seed=0)
    for _ in range(steps):
        env.step(given)
    return env.simulation.state.position


@pytest.mark.parametrize("kind", [*ACTIONS.values(), TURN], ids=lambda kind: kind.name)
def test_the_neutral_action_is_the_rule_to_the_last_bit(kind):
    everyone = np.broadcast_to(kind.neutral, (8, *kind.space.shape))
    np.testing.assert_array_equal(walked(kind, everyone), walked("continuous", None))


def test_another_kind_of_action_is_one_object():
    angle = np.linspace(-0.3, 0.3, 8)
    np.testing.assert_array_equal(walked(TURN, angle), walked("continuous", turned(angle)))
    assert (walked(TURN, angle) != walked(TURN, -angle)).any()


FEW = {"name": "speeds", "speeds": [1, 0.5, 0, -1]}


@pytest.mark.parametrize("kind", [TURN, "speeds", "speeds-directions", FEW], ids=["turn", "speeds", "both", "few"])
def test_it_is_taken_by_every_interface(kind):
    space = make_action(kind).space
    alone = CrowdGymEnv("room-v0", people=3, action=kind)
    assert alone.action_space == batch_space(space, 3)
    alone.reset(seed=0)
    alone.step(alone.action_space.sample())
    batch = make_vec("room-v0", num_envs=2, people=3, action=kind)
    assert batch.action_space.shape == (2, 3)
    batch.reset(seed=0)
    batch.step(batch.action_space.sample())
    agents = parallel_env("room-v0", people=3, action=kind, time_limit=0.5)
    assert agents.action_space("pedestrian_0") == space
    parallel_api_test(agents, num_cycles=10)


@pytest.mark.parametrize("name", ["speeds", "speeds-directions"])
def test_each_choice_is_a_speed_in_a_heading(name):
    """Against the velocities written down: half back, standing, a third, two thirds, full speed; straight or half aside."""
    headings = [0.0] if name == "speeds" else [-np.pi / 4, 0.0, np.pi / 4]
    wanted = [(v * np.cos(turn), v * np.sin(turn)) for v in (-0.5, 0.0, 0.35, 0.7, 1.0) for turn in headings]
    kind = ACTIONS[name]
    assert kind.space == gymnasium.spaces.Discrete(len(wanted))
    choices = np.arange(len(wanted))
    np.testing.assert_allclose(kind.decode(choices), wanted, atol=1e-15)
    assert wanted[kind.neutral] == (1.0, 0.0)  # where learning may start
    for first in range(0, len(wanted), 8):
        some = np.resize(choices[first : first + 8], 8)
        np.testing.assert_array_equal(walked(name, some), walked("continuous", kind.decode(some)))


def test_a_step_back_is_one():
    env = CrowdEnv("room-v0", people=1, action="speeds")
    env.reset(seed=0)
    length = []
    for _ in range(6):
        env.step(np.zeros(1))  # the first choice
        length.append(env.observer.view.travel_time[0])
    assert (np.diff(length) > 0).all()


def test_a_table_of_speeds_is_plain_data_and_comes_back_the_same():
    kind = make_action(json.loads(json.dumps(FEW)))
    np.testing.assert_array_equal(kind.decode(np.arange(4)), [(1, 0), (0.5, 0), (0, 0), (-1, 0)])
    assert kind.neutral == 0 and kind.space.n == 4
    both = make_action({"name": "speeds-directions", "speeds": (0.0, 1.0)})
    assert both.space.n == 6 and both.neutral == 4  # the headings are those of the name
    for each in (kind, both, *ACTIONS.values()):
        again = make_action(json.loads(json.dumps(plain_action(each))))
        assert again == each == pickle.loads(pickle.dumps(each))
    assert plain_action({"name": "speeds", "speeds": list(SpeedTable().speeds)}) == "speeds"
    assert make_action({"name": "discrete"}) is ACTIONS["discrete"]
    aside = SpeedTable((1.0,), (0.0, 1.0)).kind("mine")
    assert aside.space.n == 2
    refuses(lambda: plain_action(aside), ("'mine'", "plain data"))


def test_whatever_stands_in_the_rows_of_those_who_follow_the_rule_is_ignored():
    rule = np.arange(8) % 2 == 0
    for kind, wrong in (
        (ACTIONS["continuous"], (np.nan, 9.0)),
        (ACTIONS["discrete"], 99),
        (ACTIONS["speeds"], 5),
        (TURN, np.inf),
    ):
        env, same = (CrowdEnv("room-v0", people=8, action=kind) for _ in range(2))
        given = np.array(np.broadcast_to(kind.neutral, (8, *kind.space.shape)))
        bad = given.copy()
        bad[rule] = wrong
        env.reset(seed=0)
        same.reset(seed=0)
        np.testing.assert_array_equal(env.step(bad, rule).observation, same.step(given).observation)


def test_an_action_that_is_given_is_not_written_into():
    given = np.full((8, 2), 3.0)
    walked("continuous", given, steps=1)
    assert (given == 3.0).all()


def test_spaces_of_environments_are_their_own():
    one, other = CrowdEnv("room-v0", people=2), CrowdEnv("room-v0", people=2)
    one.single_action_space.seed(1)
    assert one.single_action_space is not other.single_action_space
    assert one.single_action_space is not ACTIONS["continuous"].space


def test_only_the_names_of_the_table_are_plain_data():
    assert [plain_action(make_action(name)) for name in ACTIONS] == list(ACTIONS)
    refuses(lambda: plain_action(TURN), ("'turn'", "plain data"))


def one_row(action):
    return np.array([[1.0, 0.0]])


def acted(kind, given):
    env = CrowdEnv("room-v0", people=2, action=kind)
    env.reset(seed=0)
    return env.step(given)


WRONG = [
    ("unknown", lambda: make_action("turn"), ("'turn'", "known: continuous, discrete")),
    ("no kind", lambda: make_action(ONE), ("action kind", "known: continuous, discrete")),
    ("space", lambda: ActionKind("turn", 2, turned, 0.0), ("'turn'", "space", "Gymnasium")),
    ("space without shape", lambda: ActionKind("turn", gymnasium.spaces.Text(3), turned, 0.0), ("'turn'", "shape")),
    ("decode", lambda: ActionKind("turn", ONE, 3, 0.0), ("'turn'", "decode", "function")),
    ("neutral", lambda: ActionKind("turn", ONE, turned, 1.0), ("'turn'", "1.0", "rule")),
    ("neutral shape", lambda: ActionKind("turn", ONE, turned, (0.0, 0.0)), ("'turn'", "neutral", "()")),
    ("shape", lambda: acted(TURN, np.zeros((2, 2))), ("turn actions", "(2,)", "(2, 2)")),
    ("not finite", lambda: acted(TURN, [0.0, np.nan]), ("action of pedestrian 1", "nan", "finite")),
    ("choice", lambda: acted("speeds", [0, 5]), ("action of pedestrian 1 is 5", "0 to 4")),
    ("choice below", lambda: acted("speeds", [-1, 0]), ("action of pedestrian 0 is -1", "0 to 4")),
    ("between choices", lambda: acted("speeds-directions", [0.5, 0]), ("action of pedestrian 0 is 0.5", "0 to 14")),
    ("vectors", lambda: acted("speeds", np.zeros((2, 2))), ("speeds actions", "(2,)", "(2, 2)")),
    ("no name", lambda: make_action({"speeds": [0, 1]}), ("action", "'name' is missing", "speeds-directions")),
    ("unknown name", lambda: make_action({"name": "turn"}), ("'turn'", "known: continuous, discrete")),
    ("no parameters", lambda: make_action({"name": "discrete", "speeds": [1]}), ("'speeds'", "known: name")),
    ("unknown parameter", lambda: make_action({"name": "speeds", "speed": [1]}), ("'speed'", "speeds, headings")),
    ("no rule", lambda: make_action({"name": "speeds", "speeds": [0, 0.5]}), ("speeds", "[0, 0.5]", "1", "rule")),
    ("no way", lambda: SpeedTable(headings=(0.5, -0.5)), ("headings", "(0.5, -0.5)", "0", "rule")),
    ("twice", lambda: SpeedTable((0.0, 1.0, 1)), ("speeds", "different")),
    ("too fast", lambda: SpeedTable((1.0, 1.5)), ("speeds[1]", "1.5", "[-1, 1]")),
    ("no finite speed", lambda: SpeedTable((1.0, np.nan)), ("speeds[1]", "nan", "[-1, 1]")),
    ("no speeds", lambda: SpeedTable(()), ("speeds", "()", "rule")),
    ("one number", lambda: SpeedTable(1.0), ("speeds", "1.0", "array of real numbers")),
    ("texts", lambda: SpeedTable(("1", "0")), ("speeds", "'1'", "real numbers")),
    ("heading", lambda: SpeedTable(headings=(0.0, 45.0)), ("headings[1]", "45", "3.14")),
    ("decoded shape", lambda: acted(ActionKind("one", ONE, one_row, 0.0), [0, 0]), ("'one'", "(1, 2)", "(2, 2)")),
]  # fmt: skip


@table(WRONG)
def test_a_kind_of_action_that_cannot_be_is_refused_in_one_sentence(call, words):
    refuses(call, words)
