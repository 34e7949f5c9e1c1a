"""Training with stable-baselines3 and torch, the only part of agents that imports them; learned policies need neither."""

from ..training_config import PPOSettings
from .ppo import make_ppo
from .training import policy_of

__all__ = ["PPOSettings", "make_ppo", "policy_of"]
