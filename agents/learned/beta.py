"""A policy of stable-baselines3 with Beta distributions of actions: bounded, with a mode that can be the bound."""

from typing import Self

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn
from torch.nn.functional import softplus

from crowd_env.core.arrays.state import Floats

from ..networks import BetaMLP
from ..networks.network import LEAST, beta_mode
from .actor_critic import CrowdPolicy

_MARGIN = 1e-6  # between samples and the bounds, where densities are infinite or zero
_CONCENTRATION = 3.0  # at first: alpha + beta - 2
_LOG_WIDTH = 0.6931471805599453  # log 2: actions are in [-1, 1], Beta distributions over [0, 1]


class BetaActions(Distribution):
    """Independent Beta distributions over [-1, 1] with the parameters of `crowd_env.agents.networks.network.BetaMLP`."""

    alpha: Tensor  # (K, A)
    beta: Tensor  # (K, A)

    def proba_distribution_net(self, latent_dim: int, *, outputs: int) -> nn.Linear:
        """Return the layer from latent features to 2 A numbers."""
        return nn.Linear(latent_dim, 2 * outputs)

    def proba_distribution(self, parameters: Tensor) -> Self:
        """Take the outputs (K, 2 A) of the last layer."""
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
        """Return the most likely actions (K, A)."""
        return 2.0 * torch.as_tensor(beta_mode(self.alpha.detach().numpy(), self.beta.detach().numpy())) - 1.0

    def actions_from_params(self, parameters: Tensor, deterministic: bool = False) -> Tensor:
        """Return actions for parameters (K, 2 A)."""
        return self.proba_distribution(parameters).get_actions(deterministic)

    def log_prob_from_params(self, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """Return random actions for parameters (K, 2 A), and their log density."""
        actions = self.actions_from_params(parameters)
        return actions, self.log_prob(actions)


class BetaPolicy(CrowdPolicy):
    """An actor-critic policy with `BetaActions`, for a Box over [-1, 1].

    A Gaussian with a mean beyond a bound draws only the bound: clipping removes the gradient, and the policy explores nothing
    else any more.  A Beta distribution has all of its mass inside.

    Raises
    ------
    ValueError
        If the actions are not continuous.
    """

    kind = BetaMLP
    action_dist: BetaActions

    def _build(self, lr_schedule: Schedule) -> None:
        if not isinstance(self.action_space, gymnasium.spaces.Box):
            raise ValueError(f"a Beta distribution is of continuous actions, not of {self.action_space}")
        super()._build(lr_schedule)
        del self.log_std
        self.action_dist = BetaActions()
        outputs = self.action_space.shape[0]
        self.action_net = last = self.action_dist.proba_distribution_net(
            self.mlp_extractor.latent_dim_pi, outputs=outputs
        )
        nn.init.orthogonal_(last.weight, gain=0.01)
        nn.init.zeros_(last.bias)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]  # of Adam

    def _get_action_dist_from_latent(self, latent_pi: Tensor) -> Distribution:
        return self.action_dist.proba_distribution(self.action_net(latent_pi))


def bias_at(action: Floats) -> Floats:
    """Return the outputs (2 A,) of the last layer for a most likely action (A,) in [-1, 1]."""
    share = (np.asarray(action, dtype=np.float64) + 1.0) / 2.0
    parameters = 1.0 + _CONCENTRATION * np.concatenate([share, 1.0 - share])
    return np.log(np.expm1(parameters - LEAST))
