"""PPO in one file: the mask, the ends of episodes and the advantages are right, and it learns."""

import numpy as np
import pytest
from client_examples import client_example
from late import Late, late

from crowd_env import CrowdEnv

torch = late("torch")
example = Late(lambda: client_example("cleanrl", "torch"))


def settings():
    return example.Settings(rooms=3, rollout=64)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(example.ROOM, "people", 6)
    monkeypatch.setitem(example.ROOM, "time_limit", 4.0)


def rollout(value=None):
    """Return a new agent and its first rollout; with a ``value`` its critic says that number of every state."""
    torch.manual_seed(0)
    env = CrowdEnv(**example.ROOM, num_envs=settings().rooms, autoreset=True)
    agent = example.Agent(env)
    if value is not None:
        with torch.no_grad():
            agent.critic[-1].weight.zero_()
            agent.critic[-1].bias.fill_(value)
    observation, _ = env.reset(seed=0)
    return agent, example.collect(env, agent, observation, settings())[0]


def parameters(agent):
    return np.concatenate([value.detach().numpy().ravel() for value in agent.parameters()])


def test_it_holds_everyone_until_the_end_and_nobody_after():
    """Once out, out until the room starts anew; each life ends once; all are inside at first and fewer and fewer after."""
    _, walked = rollout()
    assert walked.observation[walked.acted].any(axis=1).all()
    assert not (walked.done & ~walked.acted).any()
    alive = walked.acted.reshape(64, 3, 6).sum(axis=2)
    assert (alive[0] == 6).all() and alive.min() < 3
    for e in range(3):
        starts = np.flatnonzero(np.diff(alive[:, e]) > 0) + 1
        assert len(starts) >= 1 and (alive[starts, e] == 6).all()
        first = slice(0, starts[0])
        assert (np.diff(alive[first, e]) <= 0).all()
        assert (walked.done[first].reshape(-1, 3, 6)[:, e].sum(axis=0) == 1).all()


def test_advantages_are_returns_of_the_own_life():
    """With lambda 1 and a critic that expects nothing: the discounted rewards up to the own end."""
    _, walked = rollout(value=0.0)
    advantage = example.advantages(walked, gamma=0.9, gae_lambda=1.0)
    for slot in range(0, 18, 5):
        end = int(np.argmax(walked.done[:, slot]))
        for t in (0, end // 2, end):
            rewards = walked.reward[t : end + 1, slot]
            assert advantage[t, slot] == pytest.approx((rewards * 0.9 ** np.arange(len(rewards))).sum(), rel=1e-6)


def test_whoever_the_time_limit_cuts_off_is_paid_what_the_critic_expects(monkeypatch):
    monkeypatch.setitem(example.ROOM, "time_limit", 1.0)
    (_, poor), (_, rich) = rollout(value=0.0), rollout(value=100.0)
    more = (rich.reward - poor.reward)[:10]
    assert (poor.done[9] == poor.acted[9]).all() and poor.done[9].sum() > 10
    np.testing.assert_allclose(more[9], np.where(poor.done[9], 98.0, 0.0), rtol=1e-6)
    assert not more[:9].any()


def test_an_update_takes_the_samples_of_those_inside():
    agent, walked = rollout()
    before = parameters(agent)
    optimizer = torch.optim.Adam(agent.parameters(), lr=1e-3)
    assert example.update(agent, optimizer, walked, settings()) == walked.acted.sum() < walked.acted.size
    assert np.isfinite(parameters(agent)).all() and not np.array_equal(parameters(agent), before)


def test_what_those_who_are_out_would_have_said_changes_nothing():
    results = []
    for noise in (0.0, 1e3):
        agent, walked = rollout()
        out = ~walked.acted
        walked.observation[out] += noise
        walked.log_prob[out] -= noise
        torch.manual_seed(1)
        example.update(agent, torch.optim.Adam(agent.parameters(), lr=1e-3), walked, settings())
        results.append(parameters(agent))
    np.testing.assert_array_equal(*results)


@pytest.mark.more
def test_the_same_seed_learns_the_same(capsys):
    first, same, other = (parameters(example.main(steps=1, seed=seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert not np.array_equal(first, other)
    assert capsys.readouterr().out.count("of 120 people still inside at the end") == 6


@pytest.mark.nightly
def test_it_learns_to_let_others_go_first(monkeypatch, capsys):
    for name, value in (("people", 30), ("time_limit", 40.0)):
        monkeypatch.setitem(example.ROOM, name, value)
    example.main(seed=0)
    rule, learned = capsys.readouterr().out.splitlines()[-2:]
    stuck = [int(line.split(", ")[1].split()[0]) for line in (rule, learned)]
    assert stuck[0] > 50 and stuck[1] < 0.5 * stuck[0]
