"""From torch to plain numbers: what a policy does without drawing actions at random."""

from typing import Any

from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.torch_layers import FlattenExtractor

from ..networks import MLP, BetaMLP
from .actor_critic import CrowdPolicy
from .beta import BetaPolicy


def network_of(model: Any) -> MLP:
    """Return the policy network of an actor-critic model of stable-baselines3.

    Raises
    ------
    ValueError
        If it is another than a `CrowdPolicy` on flat observations.
    """
    policy = model.policy
    if not isinstance(policy, CrowdPolicy) or not isinstance(policy.pi_features_extractor, FlattenExtractor):
        raise ValueError(f"its network is no {CrowdPolicy.__name__} on flat observations")
    layers = [policy.mlp_extractor.first, policy.mlp_extractor.second, policy.action_net]
    arrays = [[getattr(one, name).detach().cpu().numpy() for one in layers] for name in ("weight", "bias")]
    return (BetaMLP if isinstance(policy, BetaPolicy) else MLP)(tuple(arrays[0]), tuple(arrays[1]), "relu")


def spread_of(model: Any) -> list[float] | None:
    """Return the standard deviations of the components of a Gaussian action; None of another distribution."""
    if not isinstance(model.policy.action_dist, DiagGaussianDistribution):
        return None
    return [float(one) for one in model.policy.log_std.detach().exp()]
