"""The network that RLlib trains: it begins as the native one would, and is turned into plain numbers afterwards."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from crowd_env import CrowdEnv

from ...evaluation.entries import RULE
from ...networks import MLP
from ...training_config import make_env
from ..cloning import begin
from ..export import network_of
from ..ppo import PPOSettings, make_ppo

# Layers of the policy in RLlib's network for PPO, and the spread of a Gaussian.
_LAYERS = ("encoder.actor_encoder.net.mlp.0", "encoder.actor_encoder.net.mlp.2", "pi.net.mlp.0")
_SPREAD = "pi.log_std"
_ACTIVATION = "relu"  # of the native network


def model_config(env: CrowdEnv, settings: PPOSettings) -> DefaultModelConfig:
    """Return what RLlib makes the network of: the policy of the native one, and separate layers for values."""
    return DefaultModelConfig(
        fcnet_hiddens=[settings.hidden] * 2,
        fcnet_activation=_ACTIVATION,
        vf_share_layers=False,
        free_log_std=isinstance(env.single_action_space, gymnasium.spaces.Box),
    )


def first_policy(config: Mapping[str, Any], folder: Path, threads: int) -> MLP:
    """Return the policy that training starts from, as the native training would."""
    env = make_env(config, envs=1 if config["start"] == RULE else None)
    model = make_ppo(env, PPOSettings(**config["ppo"]), config["seed"])
    begin(model, config, folder, threads)
    network = network_of(model)
    assert isinstance(network, MLP)
    return network


def state_with(state: Mapping[str, Any], policy: MLP, log_std: float) -> dict[str, Any]:
    """Return the state of RLlib's network with the layers of a policy, and the spread of its actions if they are continuous."""
    found = dict(state)
    for layer, weight, bias in zip(_LAYERS, policy.weights, policy.biases, strict=True):
        found[f"{layer}.weight"], found[f"{layer}.bias"] = weight.astype(np.float32), bias.astype(np.float32)
    if _SPREAD in found:
        found[_SPREAD] = np.full_like(np.asarray(found[_SPREAD]), log_std)
    return found


def policy_in(state: Mapping[str, Any]) -> MLP:
    """Return the policy in the state of RLlib's network: what it does without drawing actions at random."""
    weights, biases = ([np.asarray(state[f"{layer}.{name}"]) for layer in _LAYERS] for name in ("weight", "bias"))
    return MLP(tuple(weights), tuple(biases), _ACTIVATION)
