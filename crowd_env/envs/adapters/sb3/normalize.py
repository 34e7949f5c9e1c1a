"""Normalization of a `CrowdVecEnv` by the observations and returns of pedestrians inside."""

from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from crowd_env.envs.adapters.sb3.vec_env import CrowdVecEnv, SlotRewards
from crowd_env.envs.restorable import Restorable


class MaskedVecNormalize(Restorable, VecNormalize):
    """A `VecNormalize` with means and variances of the pedestrians inside that actions move.

    Under a `VecNormalize` pedestrians outside count too, with zeros: half of all rows, and more the sooner people are out.

    Parameters
    ----------
    venv : a `CrowdVecEnv`, or a wrapper around one.
    settings : all others of `VecNormalize`.

    Raises
    ------
    ValueError
        If there is no `CrowdVecEnv`.
    """

    _behind = "venv"
    _kept = ("obs_rms", "ret_rms", "returns", "old_obs", "old_reward")

    def __init__(self, venv: VecEnv, **settings: Any) -> None:
        if not isinstance(venv.unwrapped, CrowdVecEnv):
            raise ValueError(f"MaskedVecNormalize needs a CrowdVecEnv, not {type(venv.unwrapped).__name__}")
        super().__init__(venv, **settings)
        self.old_obs: np.ndarray = np.zeros(0)

    def reset(self) -> np.ndarray:
        """Start new episodes in all rows."""
        self.old_obs = observation = np.asarray(self.venv.reset())
        self.returns = np.zeros(self.num_envs)
        self._agree()
        self._count(observation)
        return np.asarray(self.normalize_obs(observation))

    def step_async(self, actions: np.ndarray) -> None:
        """Hand the actions on."""
        self._check_whole()
        super().step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Advance by one decision step."""
        observation, rewards, dones, infos = self.venv.step_wait()
        self.old_obs, self.old_reward = np.asarray(observation), rewards
        self._count(self.old_obs)
        if self.training:
            self._update_reward(rewards)
        for i in np.flatnonzero(dones):
            infos[i]["terminal_observation"] = self.normalize_obs(infos[i]["terminal_observation"])
        self.returns[dones] = 0.0
        return self.normalize_obs(self.old_obs), self.normalize_reward(rewards), dones, infos

    def _count(self, observation: np.ndarray) -> None:
        """Let observations enter the statistics."""
        active, learned = (self.venv.get_attr(name, 0)[0] for name in ("active", "learned"))
        rows = np.logical_and(active, learned)
        if self.training and self.norm_obs and rows.any():
            statistics: Any = self.obs_rms  # no dictionary: observations are arrays
            statistics.update(observation[rows])

    def _update_reward(self, reward: np.ndarray) -> None:
        assert isinstance(reward, SlotRewards) and reward.slots is not None, "a wrapper has replaced the rewards"
        self.returns = self.returns * self.gamma + np.asarray(reward)
        if reward.slots.acted.any():
            self.ret_rms.update(self.returns[reward.slots.acted])
