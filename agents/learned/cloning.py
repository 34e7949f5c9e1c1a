"""Behavior cloning of an expert policy: learning from rewards then starts at something better than the shortest path.

A reward that each pedestrian earns alone has several equilibria.  PPO that starts at full speed finds one in which people wait
in a cluster and dash through the door one by one.  The same reward pays more where they follow each other closely, and PPO
that starts there stays there.
"""

from typing import Protocol, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.distributions import CategoricalDistribution, DiagGaussianDistribution
from stable_baselines3.common.vec_env import VecEnvWrapper
from torch import Tensor
from torch.nn import functional

from crowd_env import ObservationLayout
from crowd_env.core.arrays.state import Floats
from crowd_env.envs.action import SpeedTable
from crowd_env.envs.adapters.sb3 import CrowdVecEnv
from crowd_env.envs.protocol import WalkingBatch

from .actor_critic import CrowdPolicy

ROUNDS, DECISIONS, EPOCHS = 8, 300, 4  # of DAgger: decision steps of each, and passes over all that is kept
KEPT = 0.25  # of the samples: neighboring decisions are much alike
_LEARNING_RATE, _BATCH = 1e-3, 4096
_EXPERT_ROUNDS = 3  # until the policy acts for itself


class Expert(Protocol):
    """What can be cloned: a `WalkingRule`, or the best policy of each place."""

    @property
    def name(self) -> str:
        """What tables call it."""

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
    """Let the policy of a model do as an expert does; return the loss of the last pass.

    DAgger (Ross, Gordon, Bagnell 2011): who acts changes from the expert to the policy within three rounds.  Each situation
    that this leads to is labelled with what the expert would have done.  Of discrete actions two share the label: the nearest
    to what the expert wants and the one beyond it.

    Parameters
    ----------
    model : on a `CrowdVecEnv` whose observations hold the terms of the expert.
    expert : what is cloned; it acts along and to the left of the path.
    seed : of the draws and of who acts.
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
        frame = env.action_kind.frame
        raise ValueError(f"policy {expert.name!r} cannot be cloned: it acts in the frame 'path', not in {frame!r}")
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
        optimizer.param_groups[0]["lr"] = _LEARNING_RATE * _cooling((round_ + 1) / rounds, cooled)
        inputs = torch.as_tensor(np.concatenate(seen))
        labels = torch.as_tensor(_labels(env, np.concatenate(wanted)), dtype=torch.float32)
        for _ in range(EPOCHS):
            for part in torch.randperm(len(inputs), generator=_generator(rng)).split(_BATCH):
                loss = _loss(policy, env, inputs[part], labels[part])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
    return loss.item()


def _cooling(share: float, cooled: float) -> float:
    """Return the factor of the learning rate when this share of the rounds is over."""
    return 1.0 - 0.9 * max(0.0, share - (1.0 - cooled)) / cooled if cooled > 0.0 else 1.0


def batch_of(model: PPO) -> WalkingBatch:
    """Return the batch that a model learns in."""
    venv = model.get_env()
    while isinstance(venv, VecEnvWrapper):
        venv = venv.venv
    return cast(CrowdVecEnv, venv).env


def _generator(rng: np.random.Generator) -> torch.Generator:
    return torch.Generator().manual_seed(int(rng.integers(2**31)))


def _head(policy: CrowdPolicy, observation: Tensor) -> Tensor:
    """Return logits, or the mean of a continuous action."""
    return cast(Tensor, policy.action_net(policy.mlp_extractor.forward_actor(observation)))


def _loss(policy: CrowdPolicy, env: WalkingBatch, inputs: Tensor, labels: Tensor) -> Tensor:
    out = _head(policy, inputs)
    if isinstance(env.single_action_space, gymnasium.spaces.Discrete):
        return functional.cross_entropy(out, labels)
    return functional.mse_loss(out, labels)


def _labels(env: WalkingBatch, command: Floats) -> Floats:
    """Return the labels of commands (K, 2): themselves, or the shares (K, A) of two choices whose mean they nearly are.

    An expert keeps to the present route: actions that choose another one have a share of 0.
    """
    space = env.single_action_space
    if not isinstance(space, gymnasium.spaces.Discrete):
        return command
    choices = cast(SpeedTable, env.action_kind.decode).commands
    rows = np.arange(len(command))
    first = np.linalg.norm(command[:, None] - choices, axis=2).argmin(axis=1)
    way = choices - choices[first][:, None]  # (K, A, 2) from the nearest choice to each other one
    rest = command - choices[first]
    length = (way * way).sum(axis=2)
    part = np.clip((way * rest[:, None]).sum(axis=2) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    missed = np.linalg.norm(rest[:, None] - part[:, :, None] * way, axis=2)
    second = (missed + 1e-6 * length).argmin(axis=1)  # of equally good ones the one that is less far
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
    """Return the actions of all: a random ``share`` of pedestrians does as the expert wants, the others as the policy does."""
    out = _head(policy, torch.as_tensor(observation)).numpy()
    by_expert = rng.random(env.num_people) < share
    if isinstance(env.single_action_space, gymnasium.spaces.Discrete):
        drawn = (out + rng.gumbel(size=out.shape)).argmax(axis=1)
        return np.where(by_expert, _labels(env, command).argmax(axis=1), drawn)
    return np.clip(np.where(by_expert[:, None], command, out), -1.0, 1.0)
