"""stable-baselines3: a natively batched Gymnasium VectorEnv as a VecEnv; one sub-environment a row.

For one policy shared by all pedestrians see `crowd_env.adapters.sb3`.
"""

from collections import deque
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from crowd_env.adapters.sb3 import KEPT_EPISODES
from crowd_env.envs.metrics import EpisodeMetrics


class VectorVecEnv(VecEnv):
    """A Gymnasium `VectorEnv` that restarts rows in the step in which they end, for stable-baselines3.

    ``infos[row]["terminal_observation"]``, ``["TimeLimit.truncated"]`` (so that the value of the last observation is
    bootstrapped) and ``["episode"]`` (return ``r``, length ``l``) are set in that step.

    Parameters
    ----------
    env : for instance ``gymnasium.make_vec("crowd_env/Routing-v0", num_envs=8)``.

    Attributes
    ----------
    finished_episodes : metrics of the evacuations that have ended since `take_finished` was last called, the last 1000
        of them.

    Raises
    ------
    ValueError
        If the batch does not restart rows in the same step.
    """

    def __init__(self, env: VectorEnv) -> None:
        if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ValueError("stable-baselines3 needs a VectorEnv with AutoresetMode.SAME_STEP")
        self.env = env
        self.render_mode = None
        self.finished_episodes: deque[EpisodeMetrics] = deque(maxlen=max(KEPT_EPISODES, env.num_envs))
        self._actions = np.empty(0)
        self._return = np.zeros(env.num_envs)
        self._length = np.zeros(env.num_envs, dtype=np.int64)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> np.ndarray:
        """Start all rows anew, from the seed given to `seed` if there was one since the last reset."""
        observation, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._reset_options()
        self._return[:] = 0.0
        self._length[:] = 0
        return np.asarray(observation)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Advance all rows by one step."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        self._return += reward
        self._length += 1
        done = np.logical_or(terminated, truncated)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for e in np.flatnonzero(done):
            infos[e] = {
                "terminal_observation": info["final_obs"][e],
                "TimeLimit.truncated": bool(truncated[e] and not terminated[e]),
                "episode": {"r": float(self._return[e]), "l": int(self._length[e])},
            }
        self._return[done] = 0.0
        self._length[done] = 0
        metrics = info.get("final_info", {}).get("metrics", {})
        for e in np.flatnonzero(done) if metrics else ():
            self.finished_episodes.append(EpisodeMetrics(*(metrics[name][e].item() for name in EpisodeMetrics._fields)))
        return np.asarray(observation), np.asarray(reward, dtype=np.float32), done, infos

    def take_finished(self) -> list[EpisodeMetrics]:
        """Return the metrics of the evacuations that have ended since the last call."""
        taken = list(self.finished_episodes)
        self.finished_episodes.clear()
        return taken

    def close(self) -> None:
        """Close the batch."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the batch, once for each row asked for."""
        value = None if attr_name == "render_mode" else getattr(self.env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the whole batch; it cannot differ between rows."""
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the batch once and return its result for each row asked for."""
        result = getattr(self.env, method_name)(*method_args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each row asked for: there are no wrappers inside."""
        return [False for _ in self._get_indices(indices)]
