"""MAPPO (Yu et al. 2022, "The surprising effectiveness of PPO in cooperative multi-agent games"): the critic sees the crowd.

The actor has the observation of one pedestrian; only the actor is kept.  The critic also has the mean observation of all
pedestrians inside the environment, and their number: a state of fixed width, independent of the order of pedestrians.
"""

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn
from torch import Tensor, nn, tanh

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.adapters.sb3 import CrowdVecEnv
from crowd_env.envs.protocol import WalkingBatch

from .actor_critic import CrowdPolicy, Layers

CROWD_SCALE = 50.0  # pedestrians inside for which the critic observes 1/2


class CentralVecEnv(CrowdVecEnv):
    """A `CrowdVecEnv` whose rows (P, 2 D + 1) also hold the mean observation of the crowd of the environment, and its size.

    Raises
    ------
    ValueError
        If actions are not discrete.
    """

    def __init__(self, env: WalkingBatch) -> None:
        super().__init__(env)
        if not isinstance(env.single_action_space, gymnasium.spaces.Discrete):
            raise ValueError(f"action {env.action_kind.name!r} is not discrete; take one such as 'speeds'")
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2 * env.layout.size + 1,), np.float32)

    def _begin(self, seed: int | None) -> np.ndarray:
        return self.widened(super()._begin(seed), self.env.active)

    def step_wait(self) -> VecEnvStepReturn:
        """Advance by one decision step."""
        observation, reward, done, infos = super().step_wait()
        return self.widened(np.asarray(observation), self.env.active), reward, done, infos

    def _close_episodes(
        self, reward: Floats, done: Bools, truncated: Bools, last_observation: np.ndarray
    ) -> list[dict[str, object]]:
        if done.any():  # the bootstrapped value is that of the crowd of the rows cut off
            last_observation = self.widened(last_observation, truncated)
        return super()._close_episodes(reward, done, truncated, last_observation)

    def widened(self, observation: np.ndarray, inside: Bools) -> np.ndarray:
        """Return the rows (P, 2 D + 1) for observations (P, D) and a crowd of the pedestrians ``inside`` (P,)."""
        rooms = self.env.env_of_person
        start = np.flatnonzero(np.diff(rooms, prepend=-1))
        count = np.add.reduceat(inside.astype(np.float32), start)[:, None]
        total = np.add.reduceat(np.where(inside[:, None], observation, np.float32(0.0)), start)
        crowd = np.hstack([total / np.maximum(count, 1.0), count / (count + CROWD_SCALE)])
        return np.hstack([observation, crowd[rooms]], dtype=np.float32)


class _Central(Layers):
    """Two layers for the actor on the first columns, and two for the critic on all columns."""

    def __init__(self, own: int, hidden: int) -> None:
        super().__init__(own, hidden)
        self.critic = nn.Sequential(nn.Linear(2 * own + 1, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())

    def forward_actor(self, rows: Tensor) -> Tensor:
        """Return the last layer of the actor."""
        return tanh(self.second(tanh(self.first(rows[:, : self.first.in_features]))))


class CentralPolicy(CrowdPolicy):
    """Actor and critic of a `CentralVecEnv`."""

    activation = "tanh"

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Central((self.features_dim - 1) // 2, self.net_arch[0])  # type: ignore[index,arg-type]
