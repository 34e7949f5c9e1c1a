"""Policies learned with stable-baselines3 and torch; the only place in agents that knows them."""

from agents.learned.policy import LearnedPolicy
from agents.learned.ppo import PPOSettings, make_ppo

__all__ = ["LearnedPolicy", "PPOSettings", "make_ppo"]
