"""One agent per pedestrian: the PettingZoo interface and its protocol of leaving."""

import copy
import gc
import hashlib
import json
import pickle
import weakref

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import crowd_env
from crowd_env import SCHEMES, CrowdEnv, RewardWeights, parallel_env
from crowd_env.parallel_env import Infos, UnreadInfos

SMALL = {"count": 8, "time_limit": 6.0}


def random_actions(env, rng):
    return {agent: rng.uniform((-0.2, -0.6), (1.0, 0.6)).astype(np.float32) for agent in env.agents}


def fingerprint(env, seed):
    """Return a hash of everything that one whole episode shows."""
    total = hashlib.sha256()
    rng = np.random.default_rng([seed, 1])
    observations, _ = env.reset(seed=seed)
    shown = (observations, {}, {}, {}, {})
    while True:
        for agent, observation in shown[0].items():
            total.update(agent.encode() + observation.tobytes())
            total.update(repr([part.get(agent) for part in shown[1:]]).encode())
        total.update(env.state().tobytes())
        if not env.agents:
            return total.hexdigest()
        shown = env.step(random_actions(env, rng))


# ---------------------------------------------------------------------------------------------------------- protocol


@pytest.mark.parametrize("options", [{}, {"action": "discrete"}, {"frame": "world"}, {"scheme": "dem"}])
def test_pettingzoo_accepts_it(options):
    parallel_api_test(parallel_env(**SMALL, **options), num_cycles=200)


def test_pettingzoo_accepts_its_seeding():
    parallel_seed_test(lambda: parallel_env(**SMALL))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_whole_episode_is_the_same_for_the_same_seed_and_another_for_another(scheme):
    env = parallel_env(scheme=scheme, **SMALL)
    first = fingerprint(env, 3)
    assert fingerprint(env, 4) != first
    assert fingerprint(env, 3) == first == fingerprint(parallel_env(scheme=scheme, **SMALL), 3)


def test_it_is_the_batch_environment_of_one_room():
    """The rows of `CrowdEnv` in the dictionaries of everybody."""
    env, batch = parallel_env(**SMALL), CrowdEnv("room-v0", **SMALL)
    observations, _ = env.reset(seed=5)
    rows, _ = batch.reset([5])
    rng = np.random.default_rng(0)
    while env.agents:
        slots = [env.possible_agents.index(agent) for agent in env.agents]
        np.testing.assert_array_equal(np.array([observations[agent] for agent in env.agents]), rows[slots])
        actions, agents = random_actions(env, rng), env.agents
        gathered = np.zeros((8, 2), dtype=np.float32)
        gathered[slots] = [actions[agent] for agent in agents]
        observations, rewards, terminations, truncations, _ = env.step(actions)
        step = batch.step(gathered)
        rows = step.observation
        assert [rewards[agent] for agent in agents] == step.reward[slots].tolist()
        assert [terminations[agent] for agent in agents] == step.terminated[slots].tolist()
        assert [truncations[agent] for agent in agents] == step.truncated[slots].tolist()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_who_gets_out_leaves_in_that_step_and_who_is_late_is_truncated(scheme):
    env = parallel_env(scheme=scheme, count=12, time_limit=5.0)
    observations, infos = env.reset(seed=1)
    assert set(observations) == set(infos) == set(env.agents) == set(env.possible_agents)
    rng = np.random.default_rng(2)
    terminated, truncated, cycles = [], [], 0
    while env.agents:
        before = env.agents
        answers = env.step(random_actions(env, rng))
        cycles += 1
        assert all(list(answer) == before for answer in answers)
        observations, rewards, terminations, truncations, infos = answers
        assert all(env.observation_space(agent).contains(observations[agent]) for agent in before)
        assert all(observations[agent].any() and np.isfinite(rewards[agent]) for agent in before)
        gone = [agent for agent in before if terminations[agent] or truncations[agent]]
        assert env.agents == [agent for agent in before if agent not in gone]
        terminated += [agent for agent in before if terminations[agent]]
        truncated += [agent for agent in before if truncations[agent]]
        assert all(infos[agent]["reward/exit"] == terminations[agent] for agent in before)
    assert sorted(terminated + truncated) == sorted(env.possible_agents)
    assert terminated and truncated
    assert cycles == 50 == env.max_cycles
    assert infos[truncated[0]]["metrics"]["unfinished"] == len(truncated)


def test_observations_stay_as_they_were():
    """Rows handed out look at memory that later steps do not write."""
    env = parallel_env(**SMALL)
    observations, _ = env.reset(seed=3)
    kept, copies = [], []
    while env.agents:
        kept.append(observations)
        copies.append({agent: row.copy() for agent, row in observations.items()})
        observations, *_ = env.step({})
    assert len(kept) > 20
    for seen, copied in zip(kept, copies, strict=True):
        for agent, row in seen.items():
            np.testing.assert_array_equal(row, copied[agent])
    rows = [row for seen in kept[:3] for row in seen.values()]
    assert not any(np.shares_memory(a, b) for i, a in enumerate(rows) for b in rows[:i])


def test_after_the_end_a_step_gives_five_empty_dictionaries():
    env = parallel_env(count=2, time_limit=0.3)
    assert env.step({}) == ({}, {}, {}, {}, {})  # nor before the beginning
    env.reset(seed=0)
    while env.agents:
        env.step({})
    assert env.step({}) == ({}, {}, {}, {}, {})
    assert len(env.reset(seed=0)[0]) == 2


def test_what_a_step_returned_can_be_changed():
    answers = []
    for change in (False, True):
        env = parallel_env(**SMALL)
        env.reset(seed=2)
        for _ in range(3):
            answer = env.step({})[1:]
            answers.append(answer)
            assert len({id(part) for part in answer}) == 4
            if change:
                for part in answer:
                    part.update(dict.fromkeys(part, True))
        answers.append(env.step({})[1:])
    assert answers[3] == answers[7]
    assert not any(answers[7][1].values()) and not any(answers[7][2].values())


def test_reset_ignores_options_it_does_not_know():
    env = parallel_env(**SMALL)
    plain, _ = env.reset(seed=1)
    with_options, _ = env.reset(seed=1, options={"options": 1})
    for agent in plain:
        np.testing.assert_array_equal(plain[agent], with_options[agent])


def test_spaces_are_the_same_objects_every_time_and_each_agents_own():
    env = parallel_env()
    for agent in env.possible_agents:
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) is env.action_space(agent)
    assert env.action_space("pedestrian_0") is not env.action_space("pedestrian_1")
    assert env.action_space("pedestrian_0") == env.action_space("pedestrian_1")


def test_an_environment_nobody_holds_is_forgotten():
    env = parallel_env(count=2)
    env.observation_space("pedestrian_0"), env.action_space("pedestrian_0")
    gone = weakref.ref(env)
    del env
    gc.collect()
    assert gone() is None


def test_max_cycles_is_the_time_limit_in_decisions():
    env = parallel_env(max_cycles=7, count=3)
    env.reset(seed=0)
    cycles = 0
    while env.agents:
        env.step({agent: np.zeros(2) for agent in env.agents})
        cycles += 1
    assert cycles == 7
    with pytest.raises(ValueError, match="at least 1"):
        parallel_env(max_cycles=0)


# ------------------------------------------------------------------------------------------------------------- infos


def unread_infos():
    """Return infos that nobody has looked at, of some steps ago, and what they are."""
    env, batch = parallel_env(**SMALL), CrowdEnv("room-v0", **SMALL)
    env.reset(seed=1)
    batch.reset([1])
    infos, terms = env.step({})[4], batch.step(None).info
    while env.agents:
        env.step({})
    assert type(infos) is UnreadInfos
    names = [name for name in terms if name.startswith("reward/")]
    assert len(names) == 4
    return infos, {f"pedestrian_{i}": {name: terms[name][i] for name in names} for i in range(8)}


def merged(first, second):
    first |= second
    return first


@pytest.mark.parametrize(
    "look",
    [
        copy.copy,
        copy.deepcopy,
        lambda infos: pickle.loads(pickle.dumps(infos)),
        lambda infos: json.loads(json.dumps(infos)),
        lambda infos: eval(repr(infos)),
        dict.copy,
        lambda infos: infos.copy(),
        dict,
        lambda infos: {**infos},
        lambda infos: dict(**infos),
        lambda infos: infos | {},
        lambda infos: {} | infos,
        lambda infos: merged({}, infos),
    ],
)
def test_whoever_copies_the_infos_gets_a_dictionary(look):
    infos, expected = unread_infos()
    for _ in range(2):  # the second time they have been read
        seen = look(infos)
        assert type(seen) is dict
        assert seen == expected == infos


@pytest.mark.parametrize(
    "look",
    [
        lambda infos: infos,
        lambda infos: merged(infos, {}),
        lambda infos: infos.items(),
        lambda infos: zip(infos, infos.values(), strict=True),
        lambda infos: {agent: infos[agent] for agent in infos},
        lambda infos: {agent: infos[agent] for agent in infos.keys()},  # noqa: SIM118
        lambda infos: {agent: infos[agent] for agent in list(reversed(infos))[::-1]},
        lambda infos: {agent: infos.get(agent) for agent in infos},
        lambda infos: {agent: infos.setdefault(agent, 0) for agent in list(infos)},
        lambda infos: {agent: infos.pop(agent) for agent in list(infos)},
        lambda infos: [infos.popitem() for _ in range(8)][::-1],
        lambda infos: type(infos)(infos),
        lambda infos: type(infos)([(agent, infos[agent]) for agent in infos]),
    ],
)
def test_whoever_looks_at_the_infos_sees_them(look):
    infos, expected = unread_infos()
    seen = dict(look(infos))
    assert seen == expected and list(seen) == list(expected)


def test_infos_are_what_they_are_to_everybody_who_compares():
    for equal in (lambda a, b: a == b, lambda a, b: b == a, lambda a, b: not a != b, lambda a, b: not b != a):  # noqa: SIM202
        infos, expected = unread_infos()
        assert equal(infos, expected)
        infos, expected = unread_infos()
        expected["pedestrian_3"]["reward/time"] += 0.5
        assert not equal(infos, expected)
    assert unread_infos()[0] == unread_infos()[0]
    assert not unread_infos()[0] != unread_infos()[0]  # noqa: SIM202


def test_the_keys_of_infos_are_there_unread():
    infos, expected = unread_infos()
    assert len(infos) == 8 and infos and "pedestrian_7" in infos and "pedestrian_8" not in infos
    assert isinstance(infos, dict) and type(infos) is UnreadInfos
    take = infos.get  # before they are read, called when they are
    assert infos["pedestrian_2"] == expected["pedestrian_2"]
    assert type(infos) is Infos and not vars(infos)
    assert take("pedestrian_2") is infos["pedestrian_2"]


def test_a_change_of_infos_that_were_unread_lasts():
    for change in (
        lambda infos: infos.__setitem__("pedestrian_1", 7),
        lambda infos: infos.update(pedestrian_1=7),
        lambda infos: infos.update({"pedestrian_1": 7}),
        lambda infos: merged(infos, {"pedestrian_1": 7}),
    ):
        infos, expected = unread_infos()
        change(infos)
        assert infos == {**expected, "pedestrian_1": 7}
    infos, expected = unread_infos()
    del infos["pedestrian_1"]
    assert infos == {agent: info for agent, info in expected.items() if agent != "pedestrian_1"}
    infos, _ = unread_infos()
    infos.clear()
    assert infos == {}


def test_no_method_of_a_dictionary_is_forgotten():
    """One that a later Python adds fails here until someone has thought about it."""
    of_keys = {"__contains__", "__len__", "__sizeof__"}
    of_objects = {"__init__", "__new__", "__getattribute__", "__class_getitem__", "fromkeys", "__doc__", "__hash__"}
    never = {"__lt__", "__le__", "__gt__", "__ge__"}  # dictionaries have no order
    read_first = set(vars(UnreadInfos)) - set(vars(Infos)) | {"__init__"}
    assert set(vars(dict)) - of_keys - of_objects - never <= read_first


def test_the_infos_of_those_who_are_left_when_others_are_gone():
    """Read at the end, all of them; each belongs to whom it did when it was made."""
    env, batch = parallel_env(**SMALL), CrowdEnv("room-v0", **SMALL)
    env.reset(seed=1)
    batch.reset([1])
    made = []
    while env.agents:
        agents = env.agents
        made.append((agents, env.step({})[4], batch.step(None).info))
    assert len(made[0][0]) > len(made[-1][0]) > 0
    for agents, infos, terms in made:
        for agent in agents:
            slot = env.possible_agents.index(agent)
            assert infos[agent]["reward/progress"] == terms["reward/progress"][slot]
            assert ("metrics" in infos[agent]) == (infos is made[-1][1])
    assert {repr(info["metrics"]) for info in made[-1][1].values()} == {repr(env.env.metrics(0)._asdict())}


# ------------------------------------------------------------------------------------------------------------- state


def test_the_state_is_everybody_and_the_time_left():
    env = parallel_env(**SMALL)
    env.reset(seed=2)
    rng = np.random.default_rng(0)
    while env.agents:
        state = env.state()
        assert env.state_space.contains(state)
        crowd = env.env.simulation.state
        rows = state[:-1].reshape(8, 5)
        np.testing.assert_allclose(rows[crowd.active, :2], crowd.position[crowd.active], atol=1e-5)
        np.testing.assert_allclose(rows[crowd.active, 2:4], crowd.velocity[crowd.active], atol=1e-5)
        np.testing.assert_array_equal(rows[:, 4], crowd.active)
        assert not rows[~crowd.active].any()
        assert state[-1] == pytest.approx(6.0 - crowd.time[0], abs=1e-5)
        env.step(random_actions(env, rng))
    assert env.state_space.contains(env.state())


# ------------------------------------------------------------------------------------------------------------ actions


@pytest.mark.parametrize("frame", ["path", "world"])
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_no_action_and_none_leave_it_to_the_rule(frame, kind):
    def run(choose):
        env = parallel_env(frame=frame, action=kind, **SMALL)
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
    env = parallel_env(count=6, time_limit=20.0, side=10.0, scheme="dem")
    env.reset(seed=4)
    standing = env.possible_agents[:2]
    start = env.env.simulation.state.position.copy()
    while env.agents:
        _, _, terminations, truncations, _ = env.step({agent: np.zeros(2) for agent in env.agents if agent in standing})
    assert env.env.metrics(0).unfinished == 2
    assert all(truncations[agent] and not terminations[agent] for agent in standing)
    assert np.hypot(*(env.env.simulation.state.position - start)[:2].T).max() < 1.0


def test_an_action_along_x_is_along_x_in_the_frame_of_the_world():
    env = parallel_env(count=1, frame="world", action="discrete")
    env.reset(seed=0)
    start = env.env.simulation.state.position[0].copy()
    env.step({"pedestrian_0": 2})  # two eighths of a turn: up
    moved = env.env.simulation.state.position[0] - start
    assert moved[1] > 0.01 and moved[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "actions", "words"),
    [
        ("continuous", {"pedestrian_99": np.zeros(2)}, "pedestrian_99.*no such agent"),
        ("continuous", {"pedestrian_1": np.zeros(3)}, r"pedestrian_1 .*\(3,\).*\(2,\)"),
        ("continuous", {"pedestrian_1": np.zeros((1, 2))}, r"pedestrian_1 .*\(2,\)"),
        ("continuous", {"pedestrian_1": 0.5}, r"pedestrian_1 .*\(2,\)"),
        ("continuous", {"pedestrian_1": [0.5]}, r"pedestrian_1 .*\(2,\)"),
        ("continuous", {"pedestrian_1": np.array([np.nan, 0])}, "pedestrian 1 .*finite"),
        ("discrete", {"pedestrian_1": 9}, "pedestrian 1 .*0 to 8"),
        ("discrete", {"pedestrian_1": 1.5}, "pedestrian 1 .*0 to 8"),
        ("discrete", {"pedestrian_1": np.zeros(2)}, r"pedestrian_1 .*\(\)"),
    ],
)
def test_a_malformed_action_is_refused_by_name(kind, actions, words):
    env = parallel_env(action=kind)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=words):
        env.step(actions)
    assert env.env.simulation.state.time[0] == 0.0


@pytest.mark.parametrize(
    ("kind", "action", "words"),
    [
        ("continuous", np.zeros((2, 1), dtype=np.float32), r"pedestrian_1 .*\(2, 1\).*\(2,\)"),
        ("continuous", np.zeros(1, dtype=np.float32), r"pedestrian_1 .*\(1,\).*\(2,\)"),
        ("continuous", np.array([0, np.inf], dtype=np.float32), "pedestrian 1 .*finite"),
        ("discrete", 9, r"pedestrian 1 is 9\.0; .*0 to 8"),
        ("discrete", np.zeros(1, dtype=np.int64), r"pedestrian_1 .*\(1,\).*\(\)"),
    ],
)
def test_a_malformed_action_among_good_ones_is_refused_by_name(kind, action, words):
    env = parallel_env(action=kind, **SMALL)
    env.reset(seed=0)
    good = np.zeros(2, dtype=np.float32) if kind == "continuous" else 0
    with pytest.raises(ValueError, match=words):
        env.step({agent: action if agent == "pedestrian_1" else good for agent in env.agents})
    with pytest.raises(ValueError, match=r"pedestrian_0 .*has the shape \(1,"):  # as many numbers, and all alike
        env.step(dict.fromkeys(env.agents, np.reshape(good, (1, *np.shape(good)))))


def test_someone_who_is_out_cannot_act():
    env = parallel_env(count=3)
    env.reset(seed=0)
    while len(env.agents) == 3:
        env.step({})
    gone = (set(env.possible_agents) - set(env.agents)).pop()
    with pytest.raises(ValueError, match=f"{gone}.*not inside"):
        env.step({gone: np.zeros(2)})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"render_mode": "ansi"}, "ansi.*rgb_array, human"),
        ({"num_envs": 2}, "num_envs"),
        ({"autoreset": True}, "autoreset"),
        ({"scheme": "glue"}, "glue.*nsm2"),
        ({"scenario": "hall"}, "hall.*room-v0"),
    ],
)
def test_what_cannot_be_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        parallel_env(**options)


# ------------------------------------------------------------------------------------------------- ways of making one


def test_it_is_registered_with_pettingzoo():
    env = pettingzoo.make("parallel", "crowd_env/room-v0", count=4)
    assert len(env.possible_agents) == 4
    observations, _ = env.reset(seed=0)
    expected, _ = parallel_env("room-v0", count=4).reset(seed=0)
    for agent, observation in observations.items():
        np.testing.assert_array_equal(observation, expected[agent])


def test_the_module_offers_what_pettingzoo_modules_do():
    from crowd_env import parallel_env as module_or_function
    from crowd_env.parallel_env import env, raw_env

    assert module_or_function is crowd_env.parallel_env
    turns = env(count=2, time_limit=0.5)
    turns.reset(seed=0)
    count = 0
    for _ in turns.agent_iter():
        _, _, termination, truncation, _ = turns.last()
        turns.step(None if termination or truncation else np.array([1.0, 0.0]))
        count += 1
    assert count > 5
    assert raw_env(count=2).possible_agents == ["pedestrian_0", "pedestrian_1"]


def test_options_reach_the_batch_environment():
    env = parallel_env(scheme="dem", reward=RewardWeights({"time": 2.0}), decision_dt=0.2, count=2)
    env.reset(seed=0)
    _, rewards, *_ = env.step({})
    assert list(rewards.values()) == pytest.approx([-0.4, -0.4])
    assert env.env.simulation.scheme.info.name == "dem"


# --------------------------------------------------------------------------------------------------------- rendering


def test_a_frame_shows_the_room():
    env = parallel_env(count=3, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.ndim == 3 and frame.shape[2] == 3 and frame.dtype == np.uint8
    for _ in range(10):
        env.step({})
    assert not np.array_equal(env.render(), frame)
    assert parallel_env(count=1).render() is None


def test_a_window_opens_and_closes():
    pytest.importorskip("pygame")
    env = parallel_env(count=3, render_mode="human")
    env.reset(seed=0)
    env.step({})
    assert env.render() is None
    env.close()
    env.close()
