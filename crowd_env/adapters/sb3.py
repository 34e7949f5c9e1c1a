"""stable-baselines3: a VecEnv over pedestrian slots with a shared policy, and rollouts that skip those who are out.

Every slot of every environment is one sub-environment of the VecEnv.  ``done`` is true exactly once an episode: when the
pedestrian gets out (terminal) or at the time limit (``TimeLimit.truncated``, so that the value of the last observation is
bootstrapped).  After that the slot is inert until its environment starts anew; `MaskedRolloutBuffer` keeps what it shows then
out of the loss.
"""

from collections.abc import Generator, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from crowd_env.env import CrowdEnv
from crowd_env.metrics import EpisodeMetrics

_NOTHING: dict[str, Any] = {}


class CrowdVecEnv(VecEnv):
    """A `CrowdEnv` with autoreset as a stable-baselines3 VecEnv of P = E * N slots.

    Attributes
    ----------
    acted : (P,) bool, whose pedestrian was inside when the last step began: the rows worth learning from.
    finished_episodes : metrics of the environments that finished since `take_finished` was last called.

    Parameters
    ----------
    env : a batch made with ``autoreset=True``.

    Raises
    ------
    ValueError
        If the batch does not restart by itself.
    """

    def __init__(self, env: CrowdEnv) -> None:
        if not env.autoreset:
            raise ValueError("CrowdVecEnv needs a CrowdEnv made with autoreset=True")
        self.env = env
        self.render_mode = None
        self.acted = np.zeros(env.num_people, dtype=np.bool_)
        self.finished_episodes: list[EpisodeMetrics] = []
        self._actions: np.ndarray = np.empty(0)
        self._return = np.zeros(env.num_people)
        self._length = np.zeros(env.num_people, dtype=np.int64)
        super().__init__(env.num_people, env.single_observation_space, env.single_action_space)

    def reset(self) -> np.ndarray:
        """Start all environments anew, from the seed given to `seed` if there was one since the last reset."""
        seed = self._seeds[0]
        observation, _ = self.env.reset(seed)
        self._reset_seeds()
        self._reset_options()
        self._return[:] = 0.0
        self._length[:] = 0
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Fix what the next reset draws: environment ``e`` uses (seed, e)."""
        self._seeds = [seed] * self.num_envs
        return self._seeds

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Advance by one decision step."""
        self.acted = self.env.active.copy()
        step = self.env.step(self._actions)
        self._return += step.reward
        self._length += self.acted
        done = step.terminated | step.truncated
        infos: list[dict[str, Any]] = [_NOTHING] * self.num_envs
        final = step.info.get("final_observation", step.observation)
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": final[i],
                "TimeLimit.truncated": bool(step.truncated[i]),
                "episode": {"r": float(self._return[i]), "l": int(self._length[i])},
            }
        self._return[done] = 0.0
        self._length[done] = 0
        self.finished_episodes.extend(step.info["metrics"].values())
        return step.observation, step.reward.astype(np.float32), done, infos

    def take_finished(self) -> list[EpisodeMetrics]:
        """Return the metrics of the environments that finished since the last call."""
        taken, self.finished_episodes = self.finished_episodes, []
        return taken

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the batch, once for each slot asked for."""
        value = None if attr_name == "render_mode" else getattr(self.env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the whole batch; it cannot differ between slots."""
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the batch once and return its result for each slot asked for."""
        result = getattr(self.env, method_name)(*method_args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each slot asked for: there are no wrappers inside."""
        return [False for _ in self._get_indices(indices)]


class MaskedRolloutBuffer(RolloutBuffer):
    """A rollout buffer that hands out only the samples of pedestrians who were inside when they acted.

    Parameters
    ----------
    venv : the `CrowdVecEnv` the rollouts are collected from; give it by ``rollout_buffer_kwargs={"venv": venv}``.
    args, kwargs : as for RolloutBuffer.
    """

    def __init__(self, *args: Any, venv: CrowdVecEnv, **kwargs: Any) -> None:
        self.venv = venv
        super().__init__(*args, **kwargs)

    def reset(self) -> None:
        """Empty the buffer."""
        super().reset()
        self.mask = np.zeros((self.buffer_size, self.n_envs), dtype=np.bool_)

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Add one step of all slots."""
        self.mask[self.pos] = self.venv.acted
        super().add(*args, **kwargs)

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """Yield shuffled minibatches of the samples that count.

        A last minibatch of fewer than half the size is joined to the one before it: its gradient would be all noise.
        """
        assert self.full, "the buffer is not full yet"
        if not self.generator_ready:
            for name in ("observations", "actions", "values", "log_probs", "advantages", "returns"):
                setattr(self, name, self.swap_and_flatten(getattr(self, name)))
            self._valid = np.flatnonzero(self.swap_and_flatten(self.mask)[:, 0])
            self.generator_ready = True
        order = np.random.permutation(self._valid)  # noqa: NPY002 - the generator that stable-baselines3 seeds
        size = batch_size or len(order)
        count = max(1, int(np.floor(len(order) / size + 0.5)))
        for part in np.array_split(order, count):
            yield self._get_samples(part)
