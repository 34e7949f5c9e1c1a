"""What the agents of a `ParallelEnv` may hand in, and what is refused."""

import numpy as np
import pytest
from cases import looped

from crowd_env import make_scenario, parallel_env

SMALL = {"people": 8, "time_limit": 6.0}


@pytest.mark.parametrize("frame", ["path", "world"])
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_no_action_and_none_leave_it_to_the_rule(frame, kind):
    def run(choose):
        env = parallel_env(action={"name": kind, "frame": frame}, **SMALL)
        env.reset(seed=1)
        while env.agents:
            env.step(choose(env))
        return env.env.simulation.state

    silent = run(lambda env: {})
    none = run(lambda env: dict.fromkeys(env.agents))
    np.testing.assert_array_equal(silent.position, none.position)
    assert np.isfinite(silent.exit_time).all()
    if frame == "path":  # the rule is an action here
        ahead = 0 if kind == "discrete" else np.array([1.0, 0.0])
        asked = run(lambda env: dict.fromkeys(env.agents, ahead))
        np.testing.assert_array_equal(silent.position, asked.position)


@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_actions_are_read_alike_however_they_are_given(kind):
    """All at once if everyone has one, in order; else one by one."""

    def run(dress):
        env = parallel_env(action=kind, **SMALL)
        env.reset(seed=1)
        rng = np.random.default_rng(0)
        while env.agents:
            count = len(env.agents)
            ahead = rng.uniform((-0.2, -0.6), (1.0, 0.6), (count, 2))
            rows = rng.integers(2, size=count) if kind == "discrete" else ahead
            env.step(dress(dict(zip(env.agents, rows, strict=True))))
        return env.env.simulation.state

    def each(change):
        return lambda actions: {agent: change(action) for agent, action in actions.items()}

    expected = run(lambda actions: dict(reversed(actions.items())))
    assert np.isfinite(expected.exit_time).any()  # from when on some have no slot among the actions
    dresses = [lambda actions: actions, each(np.copy), each(np.ndarray.tolist if kind == "continuous" else int)]
    dresses.append(each(lambda action: np.asarray(action, dtype=object)))
    for dress in dresses:
        np.testing.assert_array_equal(run(dress).position, expected.position)


def test_none_among_the_actions_of_everybody_is_the_rule():
    for kind, ahead in (("continuous", np.array([1.0, 0.0], dtype=np.float32)), ("discrete", 0)):
        positions = []
        for first in (ahead, None):
            env = parallel_env(action=kind, **SMALL)
            env.reset(seed=1)
            env.step({agent: first if i == 0 else ahead for i, agent in enumerate(env.agents)})
            positions.append(env.env.simulation.state.position.copy())
        np.testing.assert_array_equal(*positions)


def test_learned_and_ruled_pedestrians_share_a_room():
    """Those who want to stand do, though they are pushed; those who follow the rule get out."""
    env = parallel_env(make_scenario("room-v0", side=10.0), people=6, time_limit=20.0, physics="dem")
    env.reset(seed=4)
    standing = env.possible_agents[:2]
    start = env.env.simulation.state.position.copy()
    while env.agents:
        _, _, terminations, truncations, _ = env.step({agent: np.zeros(2) for agent in env.agents if agent in standing})
    assert env.env.metrics(0).unfinished == 2
    assert all(truncations[agent] and not terminations[agent] for agent in standing)
    assert np.hypot(*(env.env.simulation.state.position - start)[:2].T).max() < 1.0


def test_an_action_along_x_is_along_x_in_the_frame_of_the_world():
    env = parallel_env(people=1, action={"name": "discrete", "frame": "world"})
    env.reset(seed=0)
    start = env.env.simulation.state.position[0].copy()
    env.step({"pedestrian_0": 2})  # two eighths of a turn: up
    moved = env.env.simulation.state.position[0] - start
    assert moved[1] > 0.01 and moved[0] == pytest.approx(0.0, abs=1e-12)


@looped("everyone", [False, True])
@looped(
    ("kind", "action", "words"),
    [
        ("continuous", np.zeros(3), r"_1 .*\(3,\).*\(2,\)"),
        ("continuous", np.zeros((1, 2)), r"_1 .*\(2,\)"),
        ("continuous", np.zeros((2, 1), dtype=np.float32), r"_1 .*\(2, 1\).*\(2,\)"),
        ("continuous", np.zeros(1, dtype=np.float32), r"_1 .*\(1,\).*\(2,\)"),
        ("continuous", 0.5, r"_1 .*\(2,\)"),
        ("continuous", [0.5], r"_1 .*\(2,\)"),
        ("continuous", np.array([np.nan, 0]), " 1 .*finite"),
        ("continuous", np.array([0, np.inf], dtype=np.float32), " 1 .*finite"),
        ("discrete", 9, r" 1 is 9\.0; .*0 to 8"),
        ("discrete", 1.5, " 1 .*0 to 8"),
        ("discrete", np.zeros(2), r"_1 .*\(\)"),
        ("discrete", np.zeros(1, dtype=np.int64), r"_1 .*\(1,\).*\(\)"),
        *[
            ("continuous", action, "_1 is .*real number")
            for action in (np.array([1j, 0.0]), ["1", "0"], "ahead", [0.0, None], [[0.0], 1.0], {"x": 1.0})
        ],
        *[("discrete", action, "_1 is .*real number") for action in (1j, "1", np.array("1", dtype=object))],
    ],
)
def test_a_malformed_action_is_refused_by_name(kind, action, words, everyone):
    env = parallel_env(action=kind, **SMALL)
    env.reset(seed=0)
    good = np.zeros(2, dtype=np.float32) if kind == "continuous" else 0
    actions = {agent: action if agent == "pedestrian_1" else good for agent in env.agents}
    with pytest.raises(ValueError, match=f"pedestrian{words}") as caught:
        env.step(actions if everyone else {"pedestrian_1": action})
    assert "\n" not in str(caught.value)
    assert env.env.simulation.state.time[0] == 0.0


@looped(("kind", "shape"), [("continuous", (1, 2)), ("discrete", (1,))])
def test_actions_of_as_many_numbers_that_are_all_malformed_alike_are_refused(kind, shape):
    env = parallel_env(action=kind, **SMALL)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"pedestrian_0 .*has the shape \(1,"):
        env.step(dict.fromkeys(env.agents, np.zeros(shape, dtype=np.float32)))


@looped(
    ("actions", "words"),
    [
        (None, "actions is None; it must be a dictionary"),
        ([np.zeros(2)] * 8, r"actions is \[array.*; it must be a dictionary"),
        (np.zeros((8, 2)), "actions is an array.*; it must be a dictionary"),
    ],
)
def test_actions_that_are_no_dictionary_are_refused(actions, words):
    env = parallel_env(**SMALL)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=words) as caught:
        env.step(actions)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_whoever_is_out_acts_no_more_and_disturbs_nobody(kind):
    """Clients of a fixed group, as TorchRL, go on handing in actions for all of it."""

    def run(actions_of):
        env = parallel_env(action=kind, **SMALL)
        env.reset(seed=1)
        rng, shown = np.random.default_rng(0), []
        while env.agents:
            rows = rng.integers(2, size=8) if kind == "discrete" else rng.uniform((-0.2, -0.6), (1.0, 0.6), (8, 2))
            everyone = dict(zip(env.possible_agents, rows, strict=True))
            shown.append(env.step(actions_of(everyone, env.agents)))
        return shown

    expected = run(lambda everyone, inside: {agent: everyone[agent] for agent in inside})
    assert len(expected[-1][0]) < 8
    junk = [None, float("nan"), np.zeros(7), "left", 1j]
    for actions_of in (
        lambda everyone, inside: everyone,
        lambda everyone, inside: dict(reversed(everyone.items())),
        lambda everyone, inside: {
            agent: action if agent in inside else junk[k % 5] for k, (agent, action) in enumerate(everyone.items())
        },
    ):
        for seen, answers in zip(run(actions_of), expected, strict=True):
            assert list(seen[0]) == list(answers[0])
            for agent, row in seen[0].items():
                np.testing.assert_array_equal(row, answers[0][agent])
            assert repr(seen[1:]) == repr(answers[1:])  # to the last digit; nan is nan


def test_whoever_never_was_is_refused_also_when_all_are_out():
    env = parallel_env(people=3, time_limit=0.3)
    env.reset(seed=0)
    with pytest.raises(
        ValueError, match="'pedestrian_99': there is no such agent; known: pedestrian_0 to pedestrian_2"
    ):
        env.step({"pedestrian_99": np.zeros(2)})
    while env.agents:
        env.step({})
    assert env.step(dict.fromkeys(env.possible_agents, np.zeros(2))) == ({}, {}, {}, {}, {})
    with pytest.raises(ValueError, match="'pedestrian_3': there is no such agent; known: pedestrian_0 to pedestrian_2"):
        env.step({"pedestrian_3": np.zeros(2)})


class Grouped:
    """One group of agents as tensors of a fixed size, as TorchRL's ``PettingZooWrapper(use_mask=True, done_on_any=False)``."""

    def __init__(self, env):
        self.env = env
        self.agents = list(env.possible_agents)

    def reset(self, seed):
        self.env.reset(seed=seed)
        self.mask = np.ones(len(self.agents), dtype=bool)

    def step(self, actions):
        _, rewards, terminations, truncations, _ = self.env.step(
            {agent: actions[k] for k, agent in enumerate(self.agents)}
        )
        done = np.zeros(len(self.agents), dtype=bool)
        for k, agent in enumerate(self.agents):
            assert (agent in rewards) == self.mask[k]
            done[k] = agent not in self.env.agents
            assert not self.mask[k] or done[k] == (terminations[agent] or truncations[agent])
        self.mask = ~done
        return done.all()


def test_a_client_that_sends_actions_for_the_whole_group_gets_to_the_end():
    group = Grouped(parallel_env(**SMALL))
    group.reset(seed=3)
    live = []
    while not group.step(np.tile([1.0, 0.0], (8, 1))):
        live.append(int(group.mask.sum()))
    assert live[0] == 8 and 0 < live[-1] < 8 and sorted(live, reverse=True) == live
