"""The network that RLlib trains: it begins as the native one would, and is turned into plain numbers afterwards."""

from collections.abc import Mapping
from pathlib import Path

import gymnasium
import numpy as np
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.protocol import CrowdBatch

from ...evaluation.entries import RULE
from ...networks import MLP
from ...training_config import PPOSettings, TrainingConfig, make_env
from ..actor_critic import network_of
from ..ppo import make_ppo
from ..starts import begin

# Layers of the policy in RLlib's network for PPO, and the logarithms of standard deviations of a Gaussian.
_LAYERS = ("encoder.actor_encoder.net.mlp.0", "encoder.actor_encoder.net.mlp.2", "pi.net.mlp.0")
_LOG_STD = "pi.log_std"
_ACTIVATION = "relu"  # of the native network


def model_config(env: CrowdBatch, settings: PPOSettings) -> DefaultModelConfig:
    """Return what RLlib makes the network of: the policy of the native one, and separate layers for values."""
    return DefaultModelConfig(
        fcnet_hiddens=[settings.hidden] * 2,
        fcnet_activation=_ACTIVATION,
        vf_share_layers=False,
        free_log_std=isinstance(env.single_action_space, gymnasium.spaces.Box),
    )


def first_policy(config: TrainingConfig, folder: Path, threads: int) -> MLP:
    """Return the policy that training starts from, as the native training would."""
    model = make_ppo(make_env(config, envs=1 if config.start == RULE else None), config.ppo, config.seed)
    begin(model, config, folder, threads)
    return network_of(model)


def state_with(state: Mapping[str, Floats], policy: MLP, log_std: float) -> dict[str, Floats]:
    """Return the state of RLlib's network with the layers of a policy, and the ``log_std`` of continuous actions."""
    found = dict(state)
    for layer, weight, bias in zip(_LAYERS, policy.weights, policy.biases, strict=True):
        found[f"{layer}.weight"], found[f"{layer}.bias"] = weight.astype(np.float32), bias.astype(np.float32)
    if _LOG_STD in found:
        found[_LOG_STD] = np.full_like(np.asarray(found[_LOG_STD]), log_std)
    return found


def policy_in(state: Mapping[str, Floats]) -> MLP:
    """Return the policy in the state of RLlib's network: what it does without drawing actions at random."""
    weights, biases = ([np.asarray(state[f"{layer}.{name}"]) for layer in _LAYERS] for name in ("weight", "bias"))
    return MLP(tuple(weights), tuple(biases), _ACTIVATION)
