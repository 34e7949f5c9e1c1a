"""PPO with parameter sharing: one network for all pedestrians, which starts as the rule that it is compared with."""

import warnings
from typing import cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from crowd_env.envs.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer, VectorVecEnv
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.routing.env import RoutingVectorEnv

from ..training_config import PPOSettings
from .actor_critic import CrowdPolicy
from .beta import BetaPolicy, bias_at
from .mappo import CentralPolicy, CentralVecEnv

# Distribution of a continuous action -> policy of stable-baselines3.
DISTRIBUTIONS = {"gaussian": CrowdPolicy, "beta": BetaPolicy}
# Settings that stable-baselines3 takes under the same name.
_SAME = ("n_steps", "n_epochs", "gamma", "gae_lambda", "clip_range", "ent_coef", "target_kl")


class FallingRate:
    """A learning rate that falls linearly to zero over the share of the budget that is spent, and never below zero.

    Attributes
    ----------
    spent : share of the budget by the evaluation callback; the larger of this share and that of the steps counts.
    """

    def __init__(self, initial: float) -> None:
        self.initial, self.spent = initial, 0.0

    def __call__(self, steps_left: float) -> float:
        """Return the rate when this share of the steps is left; the last rollout may exceed the budget."""
        return self.initial * max(0.0, min(steps_left, 1.0 - self.spent))


def make_ppo(env: WalkingBatch | RoutingVectorEnv, settings: PPOSettings, seed: int, *, central: bool = False) -> PPO:
    """Return an untrained PPO model on ``env``, made with ``autoreset=True``.

    The mean action (the mode of a Beta distribution) starts at (1, 0), full speed along the shortest path.  For discrete
    actions this choice is the most likely one.  So learning starts at the rule, not at a random walk.  In `RoutingVectorEnv`
    the most likely choice of every region is the exit nearest to its center.

    Parameters
    ----------
    central : the critic also sees the crowd, as in MAPPO.

    Raises
    ------
    ValueError
        If the distribution or a central critic does not fit the actions.
    """
    torch.set_num_threads(1)  # a second thread costs more than it saves in small networks
    venv: VecEnv
    if isinstance(env, RoutingVectorEnv):
        venv = VectorVecEnv(env)
    else:
        venv = CentralVecEnv(env) if central else CrowdVecEnv(env)
    kind = CentralPolicy if central else DISTRIBUTIONS[settings.distribution]
    optimizer = {"eps": 1e-5, "fused": True}
    network = {"net_arch": [settings.hidden], "log_std_init": settings.log_std_init, "optimizer_kwargs": optimizer}
    with warnings.catch_warnings():
        # The number of samples of pedestrians inside is unknown before a rollout: a smaller last batch is no mistake.
        warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
        model = PPO(
            kind,
            venv,
            learning_rate=FallingRate(settings.learning_rate),
            batch_size=min(settings.batch_size, settings.n_steps * venv.num_envs),
            policy_kwargs=network,
            seed=seed,
            device="cpu",
            rollout_buffer_class=MaskedRolloutBuffer if isinstance(venv, CrowdVecEnv) else None,
            **{name: getattr(settings, name) for name in _SAME},
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
    """Return the number of the output for the exit nearest to the center of each region."""
    routes = batch.layout.routes
    names = [name for name in routes if name in batch.layout.exits]
    if not names:
        return []
    route_set = batch.env.route_set[0]
    numbers = [route_set.number(name) for name in names]
    nearest = route_set.nearest(names, batch.regions.center)
    return [region * len(routes) + routes.index(names[numbers.index(number)]) for region, number in enumerate(nearest)]
