"""SuperSuit: with black death everybody stays until the end, as rows of zeros."""

import numpy as np
import pytest
from client_examples import client_example

example = client_example("supersuit", "torch", "stable_baselines3", "supersuit")

import supersuit  # noqa: E402
import torch  # noqa: E402

from crowd_env import parallel_env  # noqa: E402

COUNT = 5
FORWARD = 4  # the choice of full speed along the way out


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(example.ROOM, "people", COUNT)
    monkeypatch.setitem(example.ROOM, "time_limit", 8.0)


def test_who_is_out_is_a_row_of_zeros_until_all_are():
    venv = example.make_venv(rooms=2, seed=0)
    rows = venv.reset()
    assert rows.shape == (2 * COUNT, 46) and rows.any(axis=1).all()
    assert not np.array_equal(rows[:COUNT], rows[COUNT:])  # rooms of their own
    alive, earned, ended = [], np.zeros(2 * COUNT), np.zeros(2 * COUNT, bool)
    while not ended.any():
        inside = rows.any(axis=1)
        alive.append(inside[:COUNT].sum())
        rows, rewards, ended, infos = venv.step(np.full(2 * COUNT, FORWARD))
        assert not rewards[~inside].any()
        earned += rewards
    room = slice(0, COUNT) if ended[0] else slice(COUNT, None)
    assert ended[room].all()  # together, whenever each got out
    assert alive[0] == COUNT and (np.diff(alive) <= 0).all()
    for info, total in zip(infos[room], earned[room], strict=True):
        assert info["episode"]["l"] == len(alive) and info["episode"]["r"] == pytest.approx(total, abs=1e-4)
        assert "TimeLimit.truncated" not in info  # nothing tells stable-baselines3 who was cut off


def test_each_earns_what_it_earns_without_the_wrappers():
    venv = example.make_venv(rooms=1, seed=3)
    venv.reset()
    earned, ended = np.zeros(COUNT), np.zeros(COUNT, bool)
    while not ended.all():
        _, rewards, ended, _ = venv.step(np.full(COUNT, FORWARD))
        earned += rewards
    env = parallel_env(**example.ROOM)
    env.reset(seed=3)
    env.reset()
    paid, exits = dict.fromkeys(env.possible_agents, 0.0), []
    while env.agents:
        _, rewards, terminated, _, _ = env.step(dict.fromkeys(env.agents, FORWARD))
        paid = {agent: paid[agent] + rewards.get(agent, 0.0) for agent in paid}
        exits += [agent for agent in terminated if terminated[agent]]
    np.testing.assert_allclose(earned, list(paid.values()), atol=1e-4)
    assert sorted(exits) == env.possible_agents


def test_without_black_death_it_breaks_at_the_first_exit():
    rows = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(**example.ROOM))
    rows.reset(seed=0)
    with pytest.raises(AssertionError, match="unless black_death"):
        for _ in range(80):
            rows.step(np.full(COUNT, FORWARD))


def test_copies_that_nobody_has_seeded_are_rooms_of_their_own():
    rows = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(parallel_env(**example.ROOM)))
    observation, _ = supersuit.concat_vec_envs_v1(rows, 2).reset()
    assert not np.array_equal(observation[:COUNT], observation[COUNT:])


def test_the_same_seed_learns_the_same():
    def parameters(seed):
        model = example.main(steps=1, seed=seed)
        return torch.cat([value.detach().ravel() for value in model.policy.parameters()])

    first = parameters(1)
    assert first.isfinite().all() and torch.equal(first, parameters(1))
    assert not torch.equal(first, parameters(2))
