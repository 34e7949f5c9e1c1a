"""From a model of stable-baselines3 to the plain numbers of its policy."""

from typing import Any

from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from agents.networks import MLP


def network_of(model: Any) -> MLP:
    """Return the policy network of an actor-critic model: what it does without drawing actions at random.

    Raises
    ------
    ValueError
        If it is more than layers of tanh units on flat observations.
    """
    policy = model.policy
    layers = [*policy.mlp_extractor.policy_net, policy.action_net]
    kinds = [nn.Linear, nn.Tanh] * (len(layers) // 2) + [nn.Linear]
    same = len(layers) == len(kinds) and all(isinstance(one, kind) for one, kind in zip(layers, kinds, strict=True))
    if not same or not isinstance(policy.pi_features_extractor, FlattenExtractor):
        raise ValueError("its network is not made of linear layers with tanh between them")
    linear = layers[::2]
    arrays = [[getattr(one, name).detach().cpu().numpy() for one in linear] for name in ("weight", "bias")]
    return MLP(tuple(arrays[0]), tuple(arrays[1]))
