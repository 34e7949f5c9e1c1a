"""Batches as VecEnvs of stable-baselines3: one row a pedestrian (`CrowdVecEnv`), or one row an environment (`VectorVecEnv`)."""

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import refuse
from crowd_env.envs.action import Masks
from crowd_env.envs.arguments import Place, check_options
from crowd_env.envs.controlled import check_render_mode, frame_rate, frames_of
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.restorable import Restorable
from crowd_env.envs.tasks.task import Task
from crowd_env.scenarios.scenario import Scenario

KEPT_EPISODES = 1000  #: metrics of finished environments that are kept until `take_finished` is called


class BatchVecEnv(Restorable, VecEnv):
    """The common part of batches for stable-baselines3: the row's return and length, seeds, metrics, attributes.

    Parameters
    ----------
    env : the batch; its single spaces are the spaces of a row.
    rows : number of sub-environments of the VecEnv.

    Attributes
    ----------
    env : the batch, in which attributes and methods are looked up.
    render_mode : "rgb_array" if `render` returns a picture of all environments, such as for ``VecVideoRecorder``, or None.
    finished_episodes : metrics of the environments that finished since `take_finished` was last called, the last 1000 of them.
    """

    env: WalkingBatch | VectorEnv
    _kept: Collection[str] = ("finished_episodes", "_return", "_length", "_seeds", "_options")

    def __init__(self, env: WalkingBatch | VectorEnv, rows: int, render_mode: str | None, render_fps: float) -> None:
        self.env, self.render_mode = env, render_mode
        self.finished_episodes: deque[EpisodeMetrics] = deque(maxlen=max(KEPT_EPISODES, env.num_envs))
        self._actions: np.ndarray = np.empty(0)
        self._return = np.zeros(rows)
        self._length = np.zeros(rows, dtype=np.int64)
        super().__init__(rows, env.single_observation_space, env.single_action_space)
        self.metadata = cast(dict[str, Any], {**self.metadata, "render_fps": render_fps})

    @abstractmethod
    def _begin(self, seed: int | None) -> np.ndarray:
        """Start new episodes in all rows; return observations (rows, D)."""

    def reset(self) -> np.ndarray:
        """Start new episodes in all rows, from the seed given to `seed` if there was one since the last reset."""
        observation = self._begin(self._seeds[0])
        self._reset_seeds()
        self._reset_options()
        self._return[:] = 0.0
        self._length[:] = 0
        self._agree()
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Fix the draws of the next reset: environment ``e`` of the batch uses (seed, e)."""
        self._seeds = [seed] * self.num_envs
        return self._seeds

    def set_options(self, options: Any = None) -> None:
        """Raise ValueError if there are options: a reset of a batch takes none."""
        for one in [options] if isinstance(options, dict) else options or []:
            check_options(one)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._check_whole()
        self._actions = actions

    def _close_episodes(
        self, reward: Floats, done: Bools, truncated: Bools, last_observation: np.ndarray
    ) -> list[dict[str, object]]:
        """Add up the rewards of a step; return the infos of all rows, empty unless the row is ``done``."""
        self._return += reward
        self._length += 1
        infos: list[dict[str, object]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": last_observation[i],
                "TimeLimit.truncated": bool(truncated[i]),
                "episode": {"r": float(self._return[i]), "l": int(self._length[i])},
            }
        self._return[done] = 0.0
        self._length[done] = 0
        return infos

    def take_finished(self) -> list[EpisodeMetrics]:
        """Return the metrics of the environments that finished since the last call."""
        taken = list(self.finished_episodes)
        self.finished_episodes.clear()
        return taken

    def close(self) -> None:
        """Close the batch, if it can be closed."""
        if hasattr(self.env, "close"):
            self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        """Return an attribute of the batch, once for each row in ``indices``."""
        value = getattr(self if attr_name in ("render_mode", "metadata", "action_masks") else self.env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the whole batch; it cannot differ between rows."""
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: object, indices: VecEnvIndices = None, **kwargs: object
    ) -> list[object]:
        """Call a method of the batch once and return its result for each row in ``indices``; each its own of `action_masks`."""
        if method_name == "action_masks":
            masks = self.action_masks()
            return [masks[row] for row in self._get_indices(indices)]
        result = getattr(self.env, method_name)(*method_args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    @property
    def action_masks(self) -> Callable[[], Masks]:
        """Method that returns the choices of each row that count now (rows, n), as ``MaskablePPO`` asks for it.

        There is no such attribute where all choices always count.
        """
        mask: Masks | None = getattr(self.env, "action_mask", None)
        if mask is None:
            raise AttributeError(f"every choice in the {type(self.env).__name__} always counts: it has no masks")
        return lambda: mask.reshape(self.num_envs, -1)

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each row in ``indices``: there are no wrappers inside."""
        return [False for _ in self._get_indices(indices)]


class Slots(NamedTuple):
    """Which rows of a step belong to pedestrians inside."""

    acted: Bools  # (P,)  inside when the step began: the rows worth learning from
    inside: Bools  # (P,)  inside after the step; all of them in an environment that has restarted
    cut_off: Bools  # (P,)  still inside when the episode ended
    environment: Ints  # (P,)
    team_share: float


class SlotRewards(np.ndarray):
    """Rewards (P,) of a step that carry their `Slots` along, as does every array computed from them.

    A rollout buffer receives nothing else from its algorithm.  Since the buffer was made, the algorithm may have been loaded or
    given another environment, and other environments may have been stepped in between.

    Attributes
    ----------
    slots : the rows of the step; None if they got lost.
    """

    slots: Slots | None

    def __array_finalize__(self, made_from: object) -> None:
        self.slots = getattr(made_from, "slots", None)

    @classmethod
    def of(cls, reward: Floats, slots: Slots) -> "SlotRewards":
        """Return rewards as float32 that carry ``slots`` along."""
        rewards = np.array(reward, dtype=np.float32).view(cls)
        rewards.slots = slots
        return rewards


class CrowdVecEnv(BatchVecEnv):
    """A `CrowdEnv` with autoreset, or `GeneratedCrowds`, as a VecEnv of P slots, one policy shared by all pedestrians.

    The episode of a slot is that of its environment: ``done`` is true when that ends.  ``TimeLimit.truncated`` is true for
    pedestrians still inside then, so that the value of their last observation is bootstrapped.  A pedestrian outside waits with
    zeros as observation, and with its ``team_share``, if any, as reward: leaving is an absorbing state.
    `MaskedRolloutBuffer` computes the value of that state, and keeps it out of the loss.  A slot that was always empty is never
    ``done``.

    The info of a slot, in the step in which its environment finishes, holds ``episode`` (return ``r`` and length ``l`` of the
    environment's episode), ``score`` (when the last one got out [s]; inf if one did not), ``steps_inside`` (decision steps
    until the pedestrian left), ``is_success`` (whether the pedestrian left), ``terminal_observation`` and
    ``TimeLimit.truncated``; in other steps it is empty.

    Attributes
    ----------
    acted : (P,) bool, the pedestrian was inside when the last step began and moved by its action: worth learning from.
    finished_episodes : metrics of the environments that finished since `take_finished` was last called, the last 1000 of them.

    Parameters
    ----------
    env : a batch made with ``autoreset=True``, or what `CrowdEnv` makes one of: the name of a task, a scenario, a file.
    render_mode : None or "rgb_array", of a `CrowdEnv`: `render` returns all its environments side by side.
    arguments : of `CrowdEnv`, if it is made here.

    Raises
    ------
    ValueError
        If the batch does not restart by itself, or the render mode is unknown or not for this batch.
    """

    env: WalkingBatch
    _kept = (*BatchVecEnv._kept, "acted", "_inside")

    def __init__(self, env: WalkingBatch | Place, *, render_mode: str | None = None, **arguments: Any) -> None:
        if isinstance(env, str | Path | Scenario | Task | Mapping):
            env = CrowdEnv(env, autoreset=True, **arguments)
        if not env.autoreset:
            raise ValueError("CrowdVecEnv needs a CrowdEnv made with autoreset=True")
        self.acted = np.zeros(env.num_people, dtype=bool)
        self._inside = np.zeros(env.num_people, dtype=np.int64)
        check_render_mode(render_mode)
        if render_mode is not None and not isinstance(env, CrowdEnv):
            refuse("env", type(env).__name__, "a CrowdEnv where frames are asked for")
        self._canvas: list[Any] = []
        super().__init__(env, env.num_people, render_mode, frame_rate(env.decision_dt))

    def get_images(self) -> list[np.ndarray]:
        """Return a frame (H, W, 3) uint8 of each environment, all of one size."""
        return frames_of(cast(CrowdEnv, self.env), self._canvas)

    def _begin(self, seed: int | None) -> np.ndarray:
        self._inside[:] = 0
        return self.env.reset(seed)[0]

    def step_wait(self) -> VecEnvStepReturn:
        """Advance by one decision step."""
        env = self.env
        self.acted = env.active & env.learned
        step = env.step(self._actions)
        self._inside += self.acted
        done = step.info["finished"][env.env_of_person] & (self._inside > 0)
        last_observation = step.info.get("final_observation", step.observation)
        infos = self._close_episodes(step.reward, done, step.truncated, last_observation)
        for i in np.flatnonzero(done):
            score = step.info["metrics"][int(env.env_of_person[i])].score
            infos[i] |= {"is_success": not step.truncated[i], "steps_inside": int(self._inside[i]), "score": score}
        self._inside[done] = 0
        self.finished_episodes.extend(step.info["metrics"].values())
        share = env.reward_weights.team_share
        slots = Slots(self.acted, env.active.copy(), step.truncated, env.env_of_person, share)
        return step.observation, SlotRewards.of(step.reward, slots), done, infos


class VectorVecEnv(BatchVecEnv):
    """A Gymnasium `VectorEnv` that restarts rows in the step in which they end, as a VecEnv; one sub-environment a row.

    ``infos[row]["terminal_observation"]``, ``["TimeLimit.truncated"]`` (so that the value of the last observation is
    bootstrapped) and ``["episode"]`` (return ``r``, length ``l``) are set in that step.

    Parameters
    ----------
    env : for instance ``gymnasium.make_vec("crowd_env/routing-v0", num_envs=8)``.

    Raises
    ------
    ValueError
        If the batch does not restart rows in the same step.
    """

    env: VectorEnv

    def __init__(self, env: VectorEnv) -> None:
        if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ValueError("stable-baselines3 needs a VectorEnv with AutoresetMode.SAME_STEP")
        super().__init__(env, env.num_envs, env.render_mode, env.metadata.get("render_fps", 10))

    def get_images(self) -> list[np.ndarray]:
        """Return a frame (H, W, 3) uint8 of each environment; nothing if the batch has no render mode."""
        return list(cast(tuple[np.ndarray, ...], self.env.render()) or ())

    def _begin(self, seed: int | None) -> np.ndarray:
        return self.env.reset(seed=seed)[0]

    def step_wait(self) -> VecEnvStepReturn:
        """Advance all rows by one step."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = np.logical_or(terminated, truncated)
        infos = self._close_episodes(reward, done, truncated & ~terminated, info.get("final_obs", observation))
        metrics = info.get("final_info", {}).get("metrics", {})
        for e in np.flatnonzero(done) if metrics else ():
            self.finished_episodes.append(EpisodeMetrics(*(metrics[name][e].item() for name in EpisodeMetrics._fields)))
        return np.asarray(observation), np.asarray(reward, dtype=np.float32), done, infos
