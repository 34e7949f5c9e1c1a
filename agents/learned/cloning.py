"""Behavior cloning of an expert policy, so that learning from rewards starts at a better policy than full speed.

A reward for each pedestrian alone has several equilibria.  PPO from full speed finds one in which pedestrians wait in a cluster
and dash through the door one by one.  The same reward is larger if they follow each other closely, and PPO that starts there
stays there.
"""

from typing import Protocol, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.distributions import CategoricalDistribution, DiagGaussianDistribution
from torch import Tensor
from torch.nn import functional

from crowd_env import ObservationLayout
from crowd_env.core.arrays.state import Floats
from crowd_env.envs.action import SpeedTable
from crowd_env.envs.adapters.sb3 import CrowdVecEnv
from crowd_env.envs.protocol import WalkingBatch

from .actor_critic import CrowdPolicy

ROUNDS, DECISIONS, EPOCHS = 8, 300, 4  # of DAgger; decision steps of each round, and passes over all samples
KEPT = 0.25  # of the samples: successive decisions are much alike
_LEARNING_RATE, _BATCH = 1e-3, 4096
_EXPERT_ROUNDS = 3  # until only the policy acts


class Expert(Protocol):
    """An expert policy: a `WalkingRule`, or the best policy of each place."""

    @property
    def name(self) -> str:
        """Name in messages."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return commands (P, 2), along and to the left of the path."""


def clone(
    model: PPO,
    expert: Expert,
    seed: int,
    *,
    rounds: int = ROUNDS,
    decisions: int = DECISIONS,
    kept: float = KEPT,
    cooled: float = 0.0,
) -> float:
    """Train the policy of a model to imitate an expert; return the loss of the last minibatch.

    DAgger (Ross, Gordon, Bagnell 2011): control passes from the expert to the policy within three rounds.  The command of the
    expert labels each situation.  Of discrete actions two share the label: the one nearest to the command, and one beyond it.

    Parameters
    ----------
    model : on a `CrowdVecEnv` whose observations hold the terms of the expert.
    expert : acts along and to the left of the path.
    seed : of the draws.
    rounds, decisions : of DAgger, and decision steps of each.
    kept : share of the samples that is kept.
    cooled : share of the rounds, the last ones, over which the learning rate falls to a tenth.

    Raises
    ------
    ValueError
        If the observation lacks a term of the expert, the actions are in another frame, or follow neither a categorical nor a
        normal distribution.
    """
    env, policy = batch_of(model), cast(CrowdPolicy, model.policy)
    if env.action_kind.frame != "path":
        frames = f"it acts in the frame 'path', not in {env.action_kind.frame!r}"
        raise ValueError(f"policy {expert.name!r} cannot be cloned: {frames}")
    if not isinstance(policy.action_dist, CategoricalDistribution | DiagGaussianDistribution):
        kind = type(policy.action_dist).__name__
        raise ValueError(f"policy {expert.name!r} cannot be cloned into a policy of {kind}")
    rng = np.random.default_rng(seed)
    optimizer = torch.optim.Adam(policy.parameters(), lr=_LEARNING_RATE)
    seen: list[np.ndarray] = []
    wanted: list[np.ndarray] = []
    loss = torch.tensor(np.nan)
    observation, _ = env.reset(seed)
    for round_ in range(rounds):
        share = max(0.0, 1.0 - round_ / _EXPERT_ROUNDS)
        for _ in range(decisions):
            command = np.asarray(expert.act(observation, env.layout, rng))
            rows = env.active & (rng.random(env.num_people) < kept)
            seen.append(observation[rows])
            wanted.append(command[rows])
            observation = env.step(_mixed(policy, env, observation, command, share, rng)).observation
        cooling = max(0.0, (round_ + 1) / rounds - (1.0 - cooled)) / cooled if cooled else 0.0
        optimizer.param_groups[0]["lr"] = _LEARNING_RATE * (1.0 - 0.9 * cooling)
        inputs = torch.as_tensor(np.concatenate(seen))
        labels = torch.as_tensor(_labels(env, np.concatenate(wanted)), dtype=torch.float32)
        for _ in range(EPOCHS):
            generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
            for part in torch.randperm(len(inputs), generator=generator).split(_BATCH):
                loss = _loss(policy, env, inputs[part], labels[part])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
    return loss.item()


def batch_of(model: PPO) -> WalkingBatch:
    """Return the batch of a model."""
    return cast(CrowdVecEnv, model.get_env()).env


def _head(policy: CrowdPolicy, observation: Tensor) -> Tensor:
    """Return logits, or the mean of a continuous action."""
    return policy.action_net(policy.mlp_extractor.forward_actor(observation))


def _loss(policy: CrowdPolicy, env: WalkingBatch, inputs: Tensor, labels: Tensor) -> Tensor:
    out = _head(policy, inputs)
    if isinstance(env.single_action_space, gymnasium.spaces.Discrete):
        return functional.cross_entropy(out, labels)
    return functional.mse_loss(out, labels)


def _labels(env: WalkingBatch, command: Floats) -> Floats:
    """Return the labels of commands (K, 2): themselves, or shares (K, A) of two choices with nearly this mean.

    An expert keeps the present route: choices of another route have a share of 0.
    """
    space = env.single_action_space
    if not isinstance(space, gymnasium.spaces.Discrete):
        return command
    choices = cast(SpeedTable, env.action_kind.decode).commands
    rows = np.arange(len(command))
    first = np.linalg.norm(command[:, None] - choices, axis=2).argmin(axis=1)
    way = choices - choices[first][:, None]  # (K, A, 2) from the nearest choice to each choice
    rest = command - choices[first]
    length = (way * way).sum(axis=2)
    part = np.clip((way * rest[:, None]).sum(axis=2) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    missed = np.linalg.norm(rest[:, None] - part[:, :, None] * way, axis=2)
    second = (missed + 1e-6 * length).argmin(axis=1)  # of equally good ones the nearer one
    found = np.zeros((len(command), int(space.n)))
    found[rows, second] = part[rows, second]
    found[rows, first] += 1.0 - part[rows, second]
    return found


@torch.no_grad()
def _mixed(
    policy: CrowdPolicy,
    env: WalkingBatch,
    observation: np.ndarray,
    command: Floats,
    share: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return actions (P, ...): those of the expert for a random ``share`` of pedestrians, else those of the policy."""
    out = _head(policy, torch.as_tensor(observation)).numpy()
    by_expert = rng.random(env.num_people) < share
    if isinstance(env.single_action_space, gymnasium.spaces.Discrete):
        drawn = (out + rng.gumbel(size=out.shape)).argmax(axis=1)
        return np.where(by_expert, _labels(env, command).argmax(axis=1), drawn)
    return np.clip(np.where(by_expert[:, None], command, out), -1.0, 1.0)
