"""PettingZoo, agents in turn: everybody inside acts, and who is out is told so once and asked no more."""

import numpy as np
import pettingzoo
import pytest
from client_examples import client_example

from crowd_env import parallel_env

example = client_example("pettingzoo")


def test_it_is_the_evacuation_of_agents_that_act_at_once():
    env = parallel_env(**example.ROOM)
    observations, _ = env.reset(seed=3)
    out_after, steps = {}, 0
    while env.agents:
        actions = {
            agent: example.speed(observation) for agent, observation in observations.items() if agent in env.agents
        }
        observations, _, terminated, truncated, _ = env.step(actions)
        steps += 1
        out_after |= {agent: steps for agent in terminated if terminated[agent]}
        assert not any(truncated.values())
    assert example.evacuate(seed=3) == (out_after, [])
    assert len(out_after) == 30 and len(set(out_after.values())) > 20
    assert example.evacuate(seed=4)[0] != out_after


def test_who_is_out_is_told_once_and_asked_no_more():
    env = pettingzoo.make("aec", "crowd_env/room-v0", **example.ROOM | {"people": 8})
    env.reset(seed=0)
    told, inside, total, paid = [], [], dict.fromkeys(env.possible_agents, 0.0), 0.0
    for agent in env.agent_iter():
        observation, reward, terminated, truncated, _ = env.last()
        total[agent] += reward
        assert agent not in told and observation.shape == (3,)
        if terminated or truncated:
            assert terminated and not truncated
            told.append(agent)
        inside.append(len(env.agents))
        env.step(None if terminated else example.speed(observation))
    assert sorted(told) == sorted(env.possible_agents)
    assert inside[0] == 8 and inside[-1] == 1 and (np.diff(inside) <= 0).all()
    parallel = parallel_env(**example.ROOM | {"people": 8})
    observations, _ = parallel.reset(seed=0)
    while parallel.agents:
        acting = parallel.agents
        observations, rewards, *_ = parallel.step({agent: example.speed(observations[agent]) for agent in acting})
        paid += sum(rewards.values())
    assert sum(total.values()) == pytest.approx(paid)


def test_who_presses_on_is_late(monkeypatch):
    """Everybody is cut off at the time limit in a blocked door, and terminates nowhere."""
    monkeypatch.setattr(example, "speed", lambda observation: np.array([1.0, 0.0], np.float32))
    monkeypatch.setitem(example.ROOM, "time_limit", 3.0)
    out_after, late = example.evacuate(seed=0)
    assert late and len(out_after) + len(late) == 30 and not set(out_after) & set(late)
