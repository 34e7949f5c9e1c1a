"""stable-baselines3: batches as its VecEnv, and rollouts without the samples of pedestrians outside."""

from crowd_env.envs.adapters.sb3.normalize import MaskedVecNormalize
from crowd_env.envs.adapters.sb3.rollout_buffer import MaskedRolloutBuffer
from crowd_env.envs.adapters.sb3.vec_env import KEPT_EPISODES, CrowdVecEnv, SlotRewards, Slots, VectorVecEnv

__all__ = [
    "KEPT_EPISODES",
    "CrowdVecEnv",
    "MaskedRolloutBuffer",
    "MaskedVecNormalize",
    "SlotRewards",
    "Slots",
    "VectorVecEnv",
]
