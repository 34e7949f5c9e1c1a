"""One agent per pedestrian: the PettingZoo interface and its protocol of leaving."""

import gc
import weakref

import numpy as np
import pettingzoo
import pytest
from cases import looped
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test

import crowd_env
from crowd_env import SCENARIOS, SCHEMES, CrowdEnv, parallel_env

WORLD = {"name": "continuous", "frame": "world"}
SMALL = {"people": 8, "time_limit": 6.0}


def random_actions(env, rng):
    return {agent: rng.uniform((-0.2, -0.6), (1.0, 0.6)).astype(np.float32) for agent in env.agents}


# ---------------------------------------------------------------------------------------------------------- protocol


@pytest.mark.parametrize("options", [{}, {"action": "discrete"}, {"action": WORLD}, {"physics": "dem"}])
def test_pettingzoo_accepts_it(options):
    parallel_api_test(parallel_env(**SMALL, **options), num_cycles=80)


def test_pettingzoo_accepts_its_seeding():
    parallel_seed_test(lambda: parallel_env(**SMALL))


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
    env = parallel_env(physics=scheme, people=12, time_limit=5.0)
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
    env = parallel_env(people=2, time_limit=0.3)
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


@looped(
    "options,words",
    [
        ({"people": 5}, r"unknown reset option 'people'; known: scenario; .* given when the environment is made"),
        ({"options": 1, "seed": 3}, "unknown reset option 'seed'"),
        ([("count", 5)], r"options is \[\('count', 5\)\].*dictionary"),
    ],
)
def test_reset_refuses_options_it_does_not_know(options, words):
    env = parallel_env(**SMALL)
    with pytest.raises(ValueError, match=words):
        env.reset(seed=1, options=options)
    assert env.agents == []
    plain, _ = env.reset(seed=1)
    for nothing in ({}, {"options": 1}):  # the latter is what PettingZoo's own checkers give
        same, _ = env.reset(seed=1, options=nothing)
        for agent in plain:
            np.testing.assert_array_equal(plain[agent], same[agent])


def test_before_the_first_reset_there_is_nothing_to_step_or_look_at():
    env = parallel_env(people=2, time_limit=0.3, render_mode="rgb_array")
    for use in (lambda: env.step({}), env.state, env.render):
        with pytest.raises(ValueError, match="call reset before"):
            use()


def test_spaces_are_the_same_objects_every_time_and_each_agents_own():
    env = parallel_env()
    for agent in env.possible_agents:
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) is env.action_space(agent)
    assert env.action_space("pedestrian_0") is not env.action_space("pedestrian_1")
    assert env.action_space("pedestrian_0") == env.action_space("pedestrian_1")


def test_an_environment_nobody_holds_is_forgotten():
    env = parallel_env(people=2)
    env.observation_space("pedestrian_0"), env.action_space("pedestrian_0")
    gone = weakref.ref(env)
    del env
    gc.collect()
    assert gone() is None


def test_max_cycles_is_the_time_limit_in_decisions():
    env = parallel_env(max_cycles=7, people=3)
    env.reset(seed=0)
    cycles = 0
    while env.agents:
        env.step({agent: np.zeros(2) for agent in env.agents})
        cycles += 1
    assert cycles == 7


@looped("cycles", [0, -1, float("nan"), float("inf"), 2.5, True, "7", [7]])
def test_a_number_of_cycles_that_is_none_is_refused(cycles):
    with pytest.raises(ValueError, match=r"max_cycles is .*at least 1"):
        parallel_env(max_cycles=cycles, people=1)
    env = parallel_env(people=1)
    with pytest.raises(ValueError, match=r"max_cycles is .*at least 1"):
        env.max_cycles = cycles
    assert env.max_cycles == 600


@looped(
    "options,words",
    [
        ({"render_mode": "ansi"}, "ansi.*rgb_array, human"),
    ],
)
def test_what_cannot_be_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        parallel_env(**options)


# ------------------------------------------------------------------------------------------------- ways of making one


def test_it_is_registered_with_pettingzoo():
    env = pettingzoo.make("parallel", "crowd_env/room-v0", people=4)
    assert len(env.possible_agents) == 4
    observations, _ = env.reset(seed=0)
    expected, _ = parallel_env("room-v0", people=4).reset(seed=0)
    for agent, observation in observations.items():
        np.testing.assert_array_equal(observation, expected[agent])


@pytest.mark.filterwarnings("ignore::UserWarning:pettingzoo.*")
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_it_is_registered_for_agents_that_act_in_turn(kind):
    turns = pettingzoo.make("aec", "crowd_env/room-v0", people=3, time_limit=2.0, action=kind)
    assert isinstance(turns, pettingzoo.AECEnv)
    api_test(turns, num_cycles=100)
    turns.reset(seed=0)
    env = pettingzoo.make("parallel", "crowd_env/room-v0", people=3, time_limit=2.0, action=kind)
    observations, _ = env.reset(seed=0)
    for agent in env.agents:
        np.testing.assert_array_equal(turns.observe(agent), observations[agent])
    np.testing.assert_array_equal(turns.state(), env.state())


def test_every_scenario_is_registered_both_ways():
    for name in SCENARIOS:
        assert f"crowd_env/{name}" in pettingzoo.aec_registry and f"crowd_env/{name}" in pettingzoo.parallel_registry


def test_the_module_offers_what_pettingzoo_modules_do():
    from crowd_env import parallel_env as module_or_function
    from crowd_env.envs.parallel import env, raw_env

    assert module_or_function is crowd_env.parallel_env
    turns = env(people=2, time_limit=0.5)
    turns.reset(seed=0)
    count = 0
    for _ in turns.agent_iter():
        _, _, termination, truncation, _ = turns.last()
        turns.step(None if termination or truncation else np.array([1.0, 0.0]))
        count += 1
    assert count > 5
    assert raw_env(people=2).possible_agents == ["pedestrian_0", "pedestrian_1"]


# --------------------------------------------------------------------------------------------------------- rendering


def test_a_frame_shows_the_room():
    env = parallel_env(people=3, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.ndim == 3 and frame.shape[2] == 3 and frame.dtype == np.uint8
    for _ in range(10):
        env.step({})
    assert not np.array_equal(env.render(), frame)
    assert parallel_env(people=1).render() is None


def test_a_window_opens_and_closes():
    pytest.importorskip("pygame")
    env = parallel_env(people=3, render_mode="human")
    env.reset(seed=0)
    env.step({})
    assert env.render() is None
    env.close()
    env.close()
