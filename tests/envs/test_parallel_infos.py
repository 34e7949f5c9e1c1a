"""The infos of a `ParallelEnv`: dictionaries whose values are written when they are first read."""

import copy
import json
import pickle

from cases import looped

from crowd_env import CrowdEnv, parallel_env
from crowd_env.envs.lazy_infos import LazyInfos

SMALL = {"people": 8, "time_limit": 6.0}


def is_unread(infos):
    return type(infos) is LazyInfos and next(iter(dict.values(infos))) is False


def unread_infos():
    """Return infos of some steps ago that nobody has read, and what they must hold."""
    env, batch = parallel_env(**SMALL), CrowdEnv("room-v0", **SMALL)
    env.reset(seed=1)
    batch.reset([1])
    infos, terms = env.step({})[4], batch.step(None).info
    while env.agents:
        env.step({})
    assert is_unread(infos)
    names = [name for name in terms if name.startswith("reward/")]
    assert len(names) == 5
    return infos, {f"pedestrian_{i}": {name: terms[name][i] for name in names} for i in range(8)}


def merged(first, second):
    first |= second
    return first


@looped(
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
def test_a_copy_of_infos_is_a_plain_dictionary(look):
    infos, expected = unread_infos()
    for _ in range(2):  # the second time they have been read
        seen = look(infos)
        assert type(seen) is dict
        assert seen == expected == infos


@looped(
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
def test_every_way_to_read_infos_shows_their_values(look):
    infos, expected = unread_infos()
    seen = dict(look(infos))
    assert seen == expected and list(seen) == list(expected)


def test_unread_infos_compare_as_dictionaries_do():
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
    assert isinstance(infos, dict) and is_unread(infos)
    take = infos.get  # before they are read, called when they are
    assert infos["pedestrian_2"] == expected["pedestrian_2"]
    assert not is_unread(infos)
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


def test_infos_read_at_the_end_are_those_of_the_step_that_made_them():
    """Each belongs to the agent that it was made for, though others have left since."""
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
