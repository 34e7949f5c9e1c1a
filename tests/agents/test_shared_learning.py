"""Actors, critics and the replay over scenes of people: what they must not depend on, and that they learn."""

from itertools import count, pairwise

import numpy as np
import pytest
import torch

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.agents.learned.actor_critic import attention, central, collect, losses, train_actor_critic
from crowd_env.agents.learned.batch import Decided, SceneBatch
from crowd_env.agents.learned.dqn import DQNSettings, Replay, Returns, Transitions, train_dqn
from crowd_env.agents.learned.networks import CentralCritic, NeighborAttention
from crowd_env.agents.learned.ppo import PPOSettings
from crowd_env.agents.learned.watch import Watch
from crowd_env.envs.observation.terms import USUAL

TERMS = (*USUAL, "ahead", "lead")
SETTINGS = PPOSettings(n_steps=16, batch_size=256, n_epochs=1, hidden=16)


def room(**options):
    layout = ObservationLayout(terms=TERMS)
    return CrowdEnv("room-v0", num_envs=2, autoreset=True, action="speeds", observation=layout, **options)


class Counted:
    """A watch that ends a training after so many questions and keeps the policies."""

    share, decision_dt = 0.5, 0.1

    def __init__(self, questions):
        self.left, self.policies, self.steps = questions, [], []

    def goes_on(self, steps, policy):
        self.policies.append(policy())
        self.steps.append(steps)
        self.left -= 1
        return self.left > 0


# ------------------------------------------------------------------------------------------------------------- networks


def test_the_critic_of_everyone_knows_no_order_and_no_slot_of_who_has_left():
    torch.manual_seed(0)
    critic, rng = CentralCritic(4, 6, 8), np.random.default_rng(0)
    observation, state = torch.randn(2, 5, 4), torch.randn(2, 5, 6)
    state[..., -1] = 1.0
    state[:, 3:] = 0.0  # two have left
    order = torch.from_numpy(rng.permutation(5))
    value = critic(observation, state)
    torch.testing.assert_close(critic(observation[:, order], state[:, order]), value[:, order])
    twice = torch.cat([state, torch.zeros_like(state)], dim=1)
    pooled = critic.person(state)  # of equally full rooms the mean is the same however many slots are empty
    assert pooled.shape == (2, 5, 8) and critic(torch.cat([observation] * 2, dim=1), twice).shape == (2, 10)
    changed = state.clone()
    changed[:, 0, 0] += 1.0
    assert (critic(observation, changed)[:, 1] != value[:, 1]).all()  # it sees the others


def test_attention_knows_no_order_of_neighbors_and_nobody_where_there_are_zeros():
    torch.manual_seed(0)
    layout = ObservationLayout(terms=TERMS)
    network, seen = NeighborAttention(layout, 5, 16), torch.rand(3, layout.size)
    neighbors, lead = seen[:, layout["neighbors"]].reshape(3, 6, 5), seen[:, layout["lead"]]
    neighbors[:, 4:], lead[:, 4:] = 0.0, 0.0  # views: four are there
    before = network(seen)
    order = torch.tensor([2, 0, 5, 3, 1, 4])
    turned = seen.clone()
    turned[:, layout["neighbors"]] = neighbors[:, order].reshape(3, -1)
    turned[:, layout["lead"]] = lead[:, order]
    torch.testing.assert_close(network(turned), before)
    alone = seen.clone()
    alone[:, layout["neighbors"]] = 0.0
    assert torch.isfinite(network(alone)).all()
    assert not torch.allclose(network(alone), before)


def test_attention_without_neighbors_is_refused():
    with pytest.raises(ValueError, match="needs the term 'neighbors'"):
        NeighborAttention(ObservationLayout(terms=("velocity",)), 5, 16)


# ------------------------------------------------------------------------------------------------------------ rollouts


def test_returns_of_a_rollout_are_those_of_each_person_alone():
    """With lambda 1 and a critic that says 0 the target is the discounted reward until one is out."""
    settings = PPOSettings(n_steps=60, gae_lambda=1.0, gamma=0.9, hidden=8)
    batch = SceneBatch(room(time_limit=4.0), 0)
    networks = central(SceneBatch(room(), 0, with_state=True), settings)
    networks = networks._replace(critic=lambda observation, state: torch.zeros(observation.shape[:-1]))
    kept = []
    step = batch.step
    batch.step = lambda action: kept.append(step(action)) or kept[-1]
    rollout = collect(batch, networks, settings)
    for person in np.ndindex(2, 20):
        later = 0.0
        for t in range(59, -1, -1):
            inside, after = rollout.inside[t][person], kept[t]
            going = inside and not after.left[person] and not after.cut[person]
            later = float(after.reward[person]) + 0.9 * (later if going else 0.0) if inside else 0.0
            assert float(rollout.target[t][person]) == pytest.approx(later, abs=1e-5)
    assert sum(int(one.left.sum()) for one in kept) > 5 and sum(int(one.cut.sum()) for one in kept) > 0


def test_those_who_have_left_are_in_no_loss():
    batch = SceneBatch(room(), 0, with_state=True)
    networks = central(batch, SETTINGS)
    for _ in range(40):
        batch.step(torch.full(batch.shape, batch.rule))
    rollout = collect(batch, networks, SETTINGS)
    flat = type(rollout)(*(part.flatten(0, 1) for part in rollout))
    assert not flat.inside.all()
    loss, _ = losses(flat, networks, SETTINGS)
    flat.target[~flat.inside], flat.advantage[~flat.inside], flat.log_prob[~flat.inside] = 1e6, 1e6, -50.0
    torch.testing.assert_close(losses(flat, networks, SETTINGS)[0], loss)


@pytest.mark.parametrize("make", [central, attention])
def test_training_begins_at_the_rule_and_moves_from_it(make):
    watch = Counted(3)
    train_actor_critic(room(), SETTINGS, 0, watch, make)
    env = room()
    observation, _ = env.reset(seed=1)
    first, last = watch.policies[0], watch.policies[-1]
    assert (first.act(observation, env.layout, None) == 4).all()
    assert not np.array_equal(first.network(observation), last.network(observation))
    assert watch.steps[0] == 0 < watch.steps[1] < watch.steps[2]


def test_actions_that_are_not_discrete_are_refused():
    with pytest.raises(ValueError, match="action 'continuous' is not discrete; take one such as 'speeds'"):
        SceneBatch(CrowdEnv("room-v0", autoreset=True), 0)


# ----------------------------------------------------------------------------------------------------------------- DQN


def decided(reward, inside, left, cut, episode=0, mark=0.0):
    return Decided(
        torch.full((1, len(inside), 1), mark),
        torch.tensor([inside]),
        torch.zeros(1, len(inside), 0),
        torch.tensor([reward]),
        torch.tensor([left]),
        torch.tensor([cut]),
        torch.tensor([[episode]]),
    )


def test_rewards_are_summed_until_a_person_is_out_and_nobody_who_has_left_is_remembered():
    returns, no, nothing = (
        Returns(DQNSettings(n_steps=3, gamma=0.5)),
        [False, False],
        torch.zeros(1, 2, dtype=torch.int64),
    )
    states = [decided([0.0, 0.0], [True, True], no, no, mark=0.0)]
    states.append(decided([1.0, 1.0], [True, True], no, no, mark=1.0))
    states.append(decided([1.0, 1.0], [True, False], [False, True], no, mark=2.0))  # the second is out
    states.append(decided([1.0, 9.0], [True, False], no, no, mark=3.0))
    found = [returns.add(before, nothing, after) for before, after in pairwise(states)]
    rows = [
        (float(before), float(reward), float(rest))
        for step in found
        for part in step
        for before, reward, rest in zip(part.observation, part.reward, part.discount, strict=True)
    ]
    # The second person's two decisions end with the exit; the first one's first decision is complete after three steps.
    assert sorted(rows) == [(0.0, 1.5, 0.0), (0.0, 1.75, 0.125), (1.0, 1.0, 0.0)]


def test_no_decision_reaches_into_the_next_episode():
    returns, no, nothing = Returns(DQNSettings(n_steps=2)), [False], torch.zeros(1, 1, dtype=torch.int64)
    first = decided([0.0], [True], no, no)
    cut = decided([1.0], [True], no, [True], episode=1)  # restarted: inside again
    then = decided([1.0], [True], no, no, episode=1)
    complete = [*returns.add(first, nothing, cut), *returns.add(cut, nothing, then)]
    assert sum(len(part.action) for part in complete) == 0


def test_the_replay_keeps_the_latest():
    replay = Replay(4, 1)
    for k in range(6):
        one = torch.tensor([float(k)])
        replay.add(Transitions(one[:, None], torch.tensor([0]), one, one[:, None], one))
    assert len(replay) == 4 and sorted(replay.content.reward.tolist()) == [2.0, 3.0, 4.0, 5.0]
    assert set(replay.sample(100).reward.tolist()) == {2.0, 3.0, 4.0, 5.0}


def test_double_dqn_begins_at_the_rule_and_learns():
    watch = Counted(30)
    train_dqn(room(), DQNSettings(warm_up=100, batch_size=64, hidden=16), 0, watch)
    env = room()
    observation, _ = env.reset(seed=1)
    assert (watch.policies[0].act(observation, env.layout, None) == 4).all()
    assert not np.array_equal(watch.policies[0].network(observation), watch.policies[-1].network(observation))
    assert watch.steps[:2] == [0, 40]


# --------------------------------------------------------------------------------------------------------------- watch


def test_a_watch_judges_at_the_start_and_the_end_and_keeps_the_best(monkeypatch):
    now = iter(np.arange(0.0, 1000.0, 0.5))
    monkeypatch.setattr("crowd_env.agents.learned.watch.time.process_time", lambda: float(next(now)))
    judged = []

    def judge(policy):
        judged.append(policy)
        return {"order": [0, abs(policy - 3)]}

    watch, steps = Watch(20.0, judge, 4), count()
    while watch.goes_on(0, lambda: next(steps)):
        pass
    assert judged[0] == 0 and len(judged) == len(watch.curve) == 5 and watch.curve[-1]["seconds"] >= 20.0
    assert watch.best[0] == min(judged, key=lambda policy: abs(policy - 3))
