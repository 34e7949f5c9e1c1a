"""Training with stable-baselines3 and torch; the only place in agents that knows them.  What is learned needs neither."""

from ..training_config import PPOSettings
from .ppo import make_ppo

__all__ = ["PPOSettings", "make_ppo"]
