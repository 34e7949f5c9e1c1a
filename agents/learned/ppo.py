"""PPO with parameter sharing: one network for everybody, started as the rule it has to beat."""

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO

from agents.learned.rate import FallingRate
from crowd_env import CrowdEnv
from crowd_env.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer


@dataclass(frozen=True)
class PPOSettings:
    """Hyperparameters, a line each; the defaults are tuned for room-v0."""

    learning_rate: float = 7e-4  # falls linearly to zero over steps and time, whichever is further
    n_steps: int = 128  # decision steps per rollout
    batch_size: int = 16384  # samples of people who were inside
    n_epochs: int = 6
    gamma: float = 0.97  # per decision step of 0.1 s
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.003
    hidden: int = 64  # units in each of two layers
    log_std_init: float = -0.7
    target_kl: float = 0.05


def make_ppo(env: CrowdEnv, settings: PPOSettings, seed: int, log_folder: Path | None = None) -> PPO:
    """Return an untrained PPO model on ``env`` (made with ``autoreset=True``).

    The mean action starts at (1, 0), walk the shortest path: learning begins at the rule, not at a random walk through the
    room, and looks for what is better.
    """
    venv = CrowdVecEnv(env)
    model = PPO(
        "MlpPolicy",
        venv,
        learning_rate=FallingRate(settings.learning_rate),
        n_steps=settings.n_steps,
        batch_size=min(settings.batch_size, settings.n_steps * venv.num_envs),
        n_epochs=settings.n_epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range,
        ent_coef=settings.ent_coef,
        target_kl=settings.target_kl,
        rollout_buffer_class=MaskedRolloutBuffer,
        policy_kwargs={"net_arch": [settings.hidden] * 2, "log_std_init": settings.log_std_init},
        tensorboard_log=None if log_folder is None else str(log_folder),
        seed=seed,
        device="cpu",
    )
    if isinstance(env.single_action_space, gymnasium.spaces.Box) and env.frame == "path":
        with torch.no_grad():
            mean = cast(torch.nn.Linear, model.policy.action_net)
            mean.bias.copy_(torch.tensor(np.ravel(env.action_kind.neutral)))
    return model
