"""PPO with parameter sharing: one network for everybody, started as the rule it has to beat."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from crowd_env import CrowdEnv, GeneratedCrowds
from crowd_env.core.checks import known
from crowd_env.envs.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer, VectorVecEnv
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.routing.env import RoutingVectorEnv

from .actor_critic import CrowdPolicy
from .beta import BetaPolicy, bias_at
from .rate import FallingRate

# Distribution of a continuous action -> policy of stable-baselines3.
DISTRIBUTIONS = {"gaussian": CrowdPolicy, "beta": BetaPolicy}


@dataclass(frozen=True)
class PPOSettings:
    """Hyperparameters, a line each; the defaults are tuned for room-v0."""

    learning_rate: float = 7e-4  # falls linearly to zero over the steps, or the second half of the time
    n_steps: int = 128  # decision steps per rollout
    batch_size: int = 16384  # samples of people who were inside
    n_epochs: int = 6
    gamma: float = 0.97  # per decision step of 0.1 s
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.003
    hidden: int = 64  # units in each of two layers
    distribution: str = "gaussian"  # of continuous actions: that, or "beta", which is bounded
    log_std_init: float = -0.7  # of a Gaussian
    rule_logit: float = 2.0  # of choices: how much likelier the rule is at first, as a logit
    target_kl: float = 0.05

    def __post_init__(self) -> None:
        known("distribution", self.distribution, DISTRIBUTIONS)


def make_ppo(
    env: CrowdEnv | GeneratedCrowds | RoutingVectorEnv, settings: PPOSettings, seed: int, log_folder: Path | None = None
) -> PPO:
    """Return an untrained PPO model on ``env``, a `CrowdEnv` made with ``autoreset=True``.

    The mean action, of a Beta distribution the likeliest, starts at (1, 0), walk the shortest path, and of discrete actions
    that choice is the likeliest: learning begins at the rule, not at a random walk through the room, and looks for what is
    better.  In `RoutingVectorEnv` the likeliest choice of every region is the exit nearest to its center.
    """
    torch.set_num_threads(1)  # the networks are small: a second thread costs more than it brings
    venv: VecEnv = VectorVecEnv(env) if isinstance(env, RoutingVectorEnv) else CrowdVecEnv(env)
    taken = ("n_steps", "n_epochs", "gamma", "gae_lambda", "clip_range", "ent_coef", "target_kl")
    own = {"log_std_init": settings.log_std_init} if settings.distribution == "gaussian" else {}
    with warnings.catch_warnings():
        # How many samples of people inside a rollout holds is not known before: a last batch that is smaller is no mistake.
        warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
        model = PPO(
            DISTRIBUTIONS[settings.distribution],
            venv,
            learning_rate=FallingRate(settings.learning_rate),
            batch_size=min(settings.batch_size, settings.n_steps * venv.num_envs),
            policy_kwargs={"hidden": settings.hidden, **own},
            seed=seed,
            device="cpu",
            rollout_buffer_class=None if isinstance(env, RoutingVectorEnv) else MaskedRolloutBuffer,
            tensorboard_log=None if log_folder is None else str(log_folder),
            **{name: getattr(settings, name) for name in taken},
        )
    bias = cast(torch.nn.Linear, model.policy.action_net).bias
    with torch.no_grad():
        if isinstance(env, RoutingVectorEnv):
            bias[_nearest(env.batch)] += settings.rule_logit
        elif env.action_kind.frame == "path":
            neutral = np.ravel(env.action_kind.neutral)
            if isinstance(model.policy, BetaPolicy):
                bias.copy_(torch.tensor(bias_at(neutral)))
            elif isinstance(env.single_action_space, gymnasium.spaces.Box):
                bias.copy_(torch.tensor(neutral))
            elif isinstance(env.single_action_space, gymnasium.spaces.Discrete):
                bias[int(neutral[0])] += settings.rule_logit
    return model


def _nearest(batch: RoutingBatch) -> list[int]:
    """Return the output that stands for the exit nearest to the center of each region."""
    routes = batch.layout.routes
    names = [name for name in routes if name in batch.layout.exits]
    if not names:
        return []
    route_set = batch.env.route_set[0]
    numbers = [route_set.number(name) for name in names]
    nearest = route_set.nearest(names, batch.regions.center)
    return [region * len(routes) + routes.index(names[numbers.index(number)]) for region, number in enumerate(nearest)]
