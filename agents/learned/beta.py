"""A policy of stable-baselines3 whose actions follow Beta distributions: bounded, with a mode that can be the bound."""

from typing import ClassVar, Self

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn
from torch.nn.functional import softplus

from crowd_env.core.arrays.state import Floats

from ..networks import MLP, BetaMLP
from ..networks.network import LEAST
from .actor_critic import CrowdPolicy

_MARGIN = 1e-6  # of samples from the bounds, where densities are infinite or zero
_CONCENTRATION = 3.0  # at first: alpha + beta - 2
_LOG_WIDTH = 0.6931471805599453  # log 2: actions are in [-1, 1], Beta distributions over [0, 1]


class BetaActions(Distribution):
    """Independent Beta distributions over [-1, 1], see `crowd_env.agents.networks.network.BetaMLP` for their parameters."""

    alpha: Tensor  # (K, A)
    beta: Tensor  # (K, A)

    def proba_distribution_net(self, latent_dim: int, *, outputs: int) -> nn.Linear:
        """Return the layer from latent features to 2 A numbers."""
        return nn.Linear(latent_dim, 2 * outputs)

    def proba_distribution(self, parameters: Tensor) -> Self:
        """Take parameters (K, 2 A) as the last layer has them."""
        self.alpha, self.beta = (LEAST + softplus(parameters)).chunk(2, dim=-1)
        self._inner = torch.distributions.Beta(self.alpha, self.beta, validate_args=False)
        return self

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log density (K,) of actions (K, A)."""
        share = ((actions + 1.0) / 2.0).clamp(_MARGIN, 1.0 - _MARGIN)
        return (self._inner.log_prob(share) - _LOG_WIDTH).sum(dim=-1)

    def entropy(self) -> Tensor:
        """Return the entropy (K,)."""
        return (self._inner.entropy() + _LOG_WIDTH).sum(dim=-1)

    def sample(self) -> Tensor:
        """Return random actions (K, A)."""
        with torch.no_grad():
            return 2.0 * self._inner.sample().clamp(_MARGIN, 1.0 - _MARGIN) - 1.0

    def mode(self) -> Tensor:
        """Return the likeliest actions (K, A), see `crowd_env.agents.networks.network.beta_mode`."""
        over, under = (self.alpha - 1.0).clamp(min=0.0), (self.beta - 1.0).clamp(min=0.0)
        inner = (over + under) > 0.0
        share = over / torch.where(inner, over + under, 1.0)
        return torch.where(inner, 2.0 * share - 1.0, (self.alpha - self.beta).sign())

    def actions_from_params(self, parameters: Tensor, deterministic: bool = False) -> Tensor:
        """Return actions of parameters (K, 2 A)."""
        return self.proba_distribution(parameters).get_actions(deterministic)

    def log_prob_from_params(self, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """Return random actions of parameters (K, 2 A), and their log density."""
        actions = self.actions_from_params(parameters)
        return actions, self.log_prob(actions)


class BetaPolicy(CrowdPolicy):
    """An actor-critic policy with `BetaActions`, for a Box over [-1, 1].

    A Gaussian whose mean lies beyond a bound draws nothing but the bound: what is clipped away has no gradient, and nothing
    else is tried any more.  A Beta distribution has all of its mass inside.

    Raises
    ------
    ValueError
        If the actions are not continuous.
    """

    kind: ClassVar[type[MLP]] = BetaMLP
    action_dist: BetaActions

    def __init__(
        self,
        observation_space: gymnasium.Space,
        action_space: gymnasium.Space,
        lr_schedule: Schedule,
        **options: object,
    ) -> None:
        if not isinstance(action_space, gymnasium.spaces.Box):
            raise ValueError(f"a Beta distribution is of continuous actions, not of {action_space}")
        super().__init__(observation_space, action_space, lr_schedule, **options)
        del self.log_std
        self.action_dist = BetaActions()
        last = self.action_dist.proba_distribution_net(self.mlp_extractor.latent_dim_pi, outputs=action_space.shape[0])
        nn.init.orthogonal_(last.weight, gain=0.01)
        nn.init.zeros_(last.bias)
        self.action_net = last
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]  # of Adam

    def _get_action_dist_from_latent(self, latent_pi: Tensor) -> Distribution:
        return self.action_dist.proba_distribution(self.action_net(latent_pi))


def bias_at(action: Floats) -> Floats:
    """Return the outputs (2 A,) of the last layer at which the likeliest action (A,) is this one, in [-1, 1]."""
    share = (np.asarray(action, dtype=np.float64) + 1.0) / 2.0
    parameters = 1.0 + _CONCENTRATION * np.concatenate([share, 1.0 - share])
    return np.asarray(np.log(np.expm1(parameters - LEAST)))
