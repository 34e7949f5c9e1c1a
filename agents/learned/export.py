"""From torch to plain numbers: what a policy does without drawing actions at random."""

from typing import Any

from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from ..networks import MLP, BetaMLP
from .beta import BetaPolicy


def network_of(model: Any) -> MLP:
    """Return the policy network of an actor-critic model of stable-baselines3.

    Raises
    ------
    ValueError
        If it is more than layers of tanh units on flat observations.
    """
    policy = model.policy
    if not isinstance(policy.pi_features_extractor, FlattenExtractor):
        raise ValueError("its network does not take flat observations")
    layers = [*policy.mlp_extractor.policy_net, policy.action_net]
    kinds = [nn.Linear, nn.Tanh] * (len(layers) // 2) + [nn.Linear]
    if len(layers) != len(kinds) or not all(map(isinstance, layers, kinds)):
        raise ValueError("its network is not made of linear layers with tanh between them")
    arrays = [[getattr(one, name).detach().cpu().numpy() for one in layers[::2]] for name in ("weight", "bias")]
    return (BetaMLP if isinstance(policy, BetaPolicy) else MLP)(tuple(arrays[0]), tuple(arrays[1]))


def spread_of(model: Any) -> list[float] | None:
    """Return the standard deviations of the components of a Gaussian action; None of another distribution."""
    if not isinstance(model.policy.action_dist, DiagGaussianDistribution):
        return None
    return [float(one) for one in model.policy.log_std.detach().exp()]
