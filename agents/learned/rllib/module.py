"""The network that RLlib trains: begun as the rule it has to beat, and turned into plain numbers afterwards."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import gymnasium
import numpy as np
import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from agents.learned.ppo import PPOSettings
from agents.networks import MLP
from crowd_env import CrowdEnv

_LAYERS = ("encoder.actor_encoder.net.mlp.0", "encoder.actor_encoder.net.mlp.2", "pi.net.mlp.0")
_SMALL = 0.01  # of the first weights of the last layer: the first actions hardly depend on what is seen


class RuleFirst(DefaultPPOTorchRLModule):
    """RLlib's network for PPO whose mean, or likeliest, first action is that of the rule, whatever is observed."""

    def setup(self) -> None:
        """Make the layers, and set those of the action."""
        super().setup()
        rule, last = self.model_config["rule"], self.pi.net.mlp[0]
        with torch.no_grad():
            last.weight *= _SMALL
            last.bias.zero_()
            if rule["bias"] is not None:
                last.bias += torch.tensor(rule["bias"], dtype=last.bias.dtype)
            if hasattr(self.pi, "log_std"):
                self.pi.log_std.fill_(rule["log_std"])


def module_spec(env: CrowdEnv, settings: PPOSettings) -> RLModuleSpec:
    """Return what RLlib makes the network of."""
    space, neutral, bias = env.single_action_space, env.action_kind.neutral, None
    if env.frame == "path":
        if isinstance(space, gymnasium.spaces.Discrete):
            bias = (settings.rule_logit * (np.arange(int(space.n)) == int(np.asarray(neutral)))).tolist()
        else:
            bias = np.ravel(neutral).tolist()
    layers = DefaultModelConfig(
        fcnet_hiddens=[settings.hidden] * 2,
        fcnet_activation="tanh",
        vf_share_layers=False,
        free_log_std=isinstance(space, gymnasium.spaces.Box),
    )
    rule = {"bias": bias, "log_std": settings.log_std_init}
    return RLModuleSpec(
        module_class=RuleFirst,
        observation_space=env.single_observation_space,
        action_space=space,
        model_config={**asdict(layers), "rule": rule},
    )


def network_of(state: Mapping[str, Any]) -> MLP:
    """Return the policy network of a module's state: what it does without drawing actions at random."""
    weights, biases = ([np.asarray(state[f"{layer}.{name}"]) for layer in _LAYERS] for name in ("weight", "bias"))
    return MLP(tuple(weights), tuple(biases))
