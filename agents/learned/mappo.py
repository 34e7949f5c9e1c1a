"""MAPPO (Yu et al. 2022, "The surprising effectiveness of PPO in cooperative multi-agent games"): the critic sees the crowd.

The actor sees what a pedestrian sees, and is all that acts afterwards.  The critic also sees the mean of what everyone inside
the same room sees, and how many they are: a state of fixed width that knows no order of people.  The rest is PPO by
stable-baselines3, which starts at the rule.
"""

from typing import Any, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn
from torch import Tensor, nn

from crowd_env import CrowdEnv
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer

from ..networks import MLP
from ..trained import LearnedPolicy
from .ppo import PPOSettings
from .rate import FallingRate
from .training import env_options_of
from .watch import Watch, watch_ppo

CROWD_SCALE = 50.0  # people inside of whom the critic is told 1/2


class CentralVecEnv(CrowdVecEnv):
    """A `CrowdVecEnv` whose rows (P, 2 D + 1) also hold what the crowd of the room sees in the mean, and its size."""

    def __init__(self, env: CrowdEnv) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2 * env.layout.size + 1,), np.float32)

    def _begin(self, seed: int | None) -> np.ndarray:
        return self.widened(super()._begin(seed), self.env.active)

    def step_wait(self) -> VecEnvStepReturn:
        """Advance by one decision step."""
        observation, reward, done, infos = super().step_wait()
        return self.widened(np.asarray(observation), self.env.active), reward, done, infos

    def _close_episodes(
        self, reward: Floats, done: Bools, truncated: Bools, last_observation: np.ndarray
    ) -> list[dict[str, object]]:
        if done.any():  # what is bootstrapped is the value of those who were cut off, of the crowd that they are
            last_observation = self.widened(last_observation, truncated)
        return super()._close_episodes(reward, done, truncated, last_observation)

    def widened(self, observation: np.ndarray, inside: Bools) -> np.ndarray:
        """Return the rows (P, 2 D + 1) of those whose crowd are the people ``inside``."""
        start = self.env.env_start[:-1]
        count = np.add.reduceat(inside.astype(np.float32), start)[:, None]
        total = np.add.reduceat(np.where(inside[:, None], observation, np.float32(0.0)), start)
        crowd = np.hstack([total / np.maximum(count, 1.0), count / (count + CROWD_SCALE)])
        return np.hstack([observation, crowd[self.env.env_of_person]], dtype=np.float32)


class _Central(nn.Module):
    """Two layers for the actor, of the first columns alone, and two for the critic, of all."""

    def __init__(self, own: int, hidden: int) -> None:
        super().__init__()
        self.own, self.latent_dim_pi, self.latent_dim_vf = own, hidden, hidden
        self.policy_net = nn.Sequential(nn.Linear(own, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())
        self.value_net = nn.Sequential(nn.Linear(2 * own + 1, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        return torch.as_tensor(self.policy_net(features[:, : self.own]))

    def forward_critic(self, features: Tensor) -> Tensor:
        return torch.as_tensor(self.value_net(features))


class CentralPolicy(ActorCriticPolicy):
    """Actor and critic of a `CentralVecEnv`."""

    def __init__(self, *args: Any, hidden: int, **kwargs: Any) -> None:
        self.hidden = hidden
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Central((self.features_dim - 1) // 2, self.hidden)  # type: ignore[assignment]

    def network(self) -> MLP:
        """Return the actor as plain numbers."""
        layers = [self.mlp_extractor.policy_net[0], self.mlp_extractor.policy_net[2], self.action_net]
        arrays = [[getattr(one, name).detach().numpy().copy() for one in layers] for name in ("weight", "bias")]
        return MLP(tuple(arrays[0]), tuple(arrays[1]))


def train_mappo(env: CrowdEnv, settings: PPOSettings, seed: int, watch: Watch) -> None:
    """Train by MAPPO from the rule until ``watch`` says that it is enough.

    Parameters
    ----------
    env : made with ``autoreset=True`` and a discrete action.

    Raises
    ------
    ValueError
        If actions are not discrete.
    """
    if not isinstance(env.single_action_space, gymnasium.spaces.Discrete):
        raise ValueError(f"action {env.action_kind.name!r} is not discrete; take one such as 'speeds'")
    torch.set_num_threads(1)
    taken = ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "clip_range", "ent_coef", "target_kl")
    model = PPO(
        CentralPolicy,
        CentralVecEnv(env),
        learning_rate=FallingRate(settings.learning_rate),
        policy_kwargs={"hidden": settings.hidden},
        seed=seed,
        device="cpu",
        rollout_buffer_class=MaskedRolloutBuffer,
        **{name: getattr(settings, name) for name in taken},
    )
    policy = cast(CentralPolicy, model.policy)
    with torch.no_grad():
        bias = cast(nn.Linear, policy.action_net).bias
        bias[int(np.asarray(env.action_kind.neutral))] += settings.rule_logit
    watch_ppo(model, watch, lambda: LearnedPolicy(policy.network(), env_options_of(env)))
