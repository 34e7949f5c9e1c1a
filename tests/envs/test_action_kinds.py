"""Kinds of action: a space, how it is decoded, and the action that follows the rule; one more is one object."""

import gymnasium
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test
from refusals import refuses, table

from crowd_env import ActionKind, CrowdEnv, CrowdGymEnv, make_vec, parallel_env
from crowd_env.envs.action import ACTIONS, make_action, plain_name

ONE = gymnasium.spaces.Box(-1.0, 1.0, (), np.float32)


def turned(angle):
    """Return the command to go at full speed, turned to the left by a share of half a turn."""
    return np.column_stack([np.cos(np.pi * angle), np.sin(np.pi * angle)])


TURN = ActionKind("turn", ONE, turned, 0.0)


def walked(action, given, steps=20):
    env = CrowdEnv("room-v0", count=8, action=action)
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


def test_it_is_taken_by_every_interface():
    alone = CrowdGymEnv("room-v0", count=3, action=TURN)
    assert alone.action_space == gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
    alone.reset(seed=0)
    alone.step(alone.action_space.sample())
    batch = make_vec("room-v0", num_envs=2, count=3, action=TURN)
    assert batch.action_space.shape == (2, 3)
    batch.reset(seed=0)
    batch.step(batch.action_space.sample())
    agents = parallel_env("room-v0", count=3, action=TURN, time_limit=0.5)
    assert agents.action_space("pedestrian_0") == ONE
    parallel_api_test(agents, num_cycles=10)


def test_whatever_stands_in_the_rows_of_those_who_follow_the_rule_is_ignored():
    rule = np.arange(8) % 2 == 0
    for kind, wrong in ((ACTIONS["continuous"], (np.nan, 9.0)), (ACTIONS["discrete"], 99), (TURN, np.inf)):
        env, same = (CrowdEnv("room-v0", count=8, action=kind) for _ in range(2))
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
    one, other = CrowdEnv("room-v0", count=2), CrowdEnv("room-v0", count=2)
    one.single_action_space.seed(1)
    assert one.single_action_space is not other.single_action_space
    assert one.single_action_space is not ACTIONS["continuous"].space


def test_the_table_cannot_be_changed_and_only_its_names_are_plain_data():
    with pytest.raises(TypeError):
        ACTIONS["turn"] = TURN
    assert [plain_name(make_action(name)) for name in ACTIONS] == list(ACTIONS)
    refuses(lambda: plain_name(TURN), ("'turn'", "plain data"))


def one_row(action):
    return np.array([[1.0, 0.0]])


def acted(kind, given):
    env = CrowdEnv("room-v0", count=2, action=kind)
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
    ("decoded shape", lambda: acted(ActionKind("one", ONE, one_row, 0.0), [0, 0]), ("'one'", "(1, 2)", "(2, 2)")),
]  # fmt: skip


@table(WRONG)
def test_a_kind_of_action_that_cannot_be_is_refused_in_one_sentence(call, words):
    refuses(call, words)
