"""stable-baselines3: a VecEnv over pedestrian slots with a shared policy, and rollouts that skip those who are out.

Every slot of every environment is one sub-environment of the VecEnv.  Its episode is that of its environment: ``done`` is true
when that ends, ``TimeLimit.truncated`` for those who are then still inside, so that the value of their last observation is
bootstrapped.  Who has left before waits with zeros as observation, and with his share of what the others earn as reward, if
there is a ``team_share``: leaving is an absorbing state.  `MaskedRolloutBuffer` knows what that state is worth, and keeps it
out of the loss.
"""

import warnings
from collections import deque
from collections.abc import Generator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.state import Bools, Floats, Ints

KEPT_EPISODES = 1000  # metrics of finished environments that are kept until somebody takes them


class Slots(NamedTuple):
    """Who the rows of a step are."""

    acted: Bools  # (P,)  whose pedestrian was inside when the step began: the rows worth learning from
    inside: Bools  # (P,)  who is inside after it, in an environment that has restarted everyone
    cut_off: Bools  # (P,)  whom the end of the episode found inside
    environment: Ints  # (P,)
    team_share: float


class SlotRewards(np.ndarray):
    """Rewards (P,) of a step that carry along whose they are; so does what is computed from them.

    A rollout buffer is told nothing else by its algorithm, which may have been loaded, or given another environment, since the
    buffer was made; and other environments may have been stepped in between.

    Attributes
    ----------
    slots : who the rows are; None if that got lost.
    """

    slots: Slots | None

    def __array_finalize__(self, made_from: Any) -> None:
        self.slots = getattr(made_from, "slots", None)

    @classmethod
    def of(cls, reward: Floats, slots: Slots) -> "SlotRewards":
        """Return rewards as float32 that carry ``slots`` along."""
        rewards = np.array(reward, dtype=np.float32).view(cls)
        rewards.slots = slots
        return rewards


class CrowdVecEnv(VecEnv):
    """A `CrowdEnv` with autoreset as a stable-baselines3 VecEnv of P = E * N slots.

    Attributes
    ----------
    acted : (P,) bool, whose pedestrian was inside when the last step began: the rows worth learning from.
    finished_episodes : metrics of the environments that finished since `take_finished` was last called, the last 1000 of them.

    The info of a slot, in the step in which its environment finishes, holds ``episode`` (return ``r`` and length ``l`` of the
    environment's episode), ``steps_inside`` (decision steps until the pedestrian left), ``is_success`` (whether he did),
    ``terminal_observation`` and ``TimeLimit.truncated``; in other steps it is empty.

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
        self.finished_episodes: deque[EpisodeMetrics] = deque(maxlen=max(KEPT_EPISODES, env.num_envs))
        self._actions: np.ndarray = np.empty(0)
        self._return = np.zeros(env.num_people)
        self._length = np.zeros(env.num_people, dtype=np.int64)
        self._inside = np.zeros(env.num_people, dtype=np.int64)
        super().__init__(env.num_people, env.single_observation_space, env.single_action_space)

    def reset(self) -> np.ndarray:
        """Start all environments anew, from the seed given to `seed` if there was one since the last reset."""
        seed = self._seeds[0]
        observation, _ = self.env.reset(seed)
        self._reset_seeds()
        self._reset_options()
        for sums in (self._return, self._length, self._inside):
            sums[:] = 0
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
        env = self.env
        self.acted = env.active.copy()
        step = env.step(self._actions)
        done = step.info["finished"][env.env_of_person]
        self._return += step.reward
        self._length += 1
        self._inside += self.acted
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        final = step.info.get("final_observation", step.observation)
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": final[i],
                "TimeLimit.truncated": bool(step.truncated[i]),
                "is_success": not step.truncated[i],
                "episode": {"r": float(self._return[i]), "l": int(self._length[i])},
                "steps_inside": int(self._inside[i]),
            }
        for sums in (self._return, self._length, self._inside):
            sums[done] = 0
        self.finished_episodes.extend(step.info["metrics"].values())
        share = env.reward_weights.team_share
        slots = Slots(self.acted, env.active.copy(), step.truncated, env.env_of_person, share)
        return step.observation, SlotRewards.of(step.reward, slots), done, infos

    def take_finished(self) -> list[EpisodeMetrics]:
        """Return the metrics of the environments that finished since the last call."""
        taken = list(self.finished_episodes)
        self.finished_episodes.clear()
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

    Who they are comes with the rewards of a `CrowdVecEnv`, see `SlotRewards`: whichever environment the model has at the time.

    Having left is worth nothing without a ``team_share`` s; with one it is worth what the critic expects of the others.  Let M
    be the mean over all N people of an environment of what is still to come.  The n who are inside expect
    V = (1 - s) own + s M each, the others s M; so the sum of V over those inside is ((1 - s) N + s n) M.

    Parameters
    ----------
    args, kwargs : as for RolloutBuffer.
    venv : no longer needed; models that were saved by earlier versions name it.
    """

    def __init__(self, *args: Any, venv: object = None, **kwargs: Any) -> None:
        if venv is not None:
            text = "MaskedRolloutBuffer finds its environment by itself: leave out rollout_buffer_kwargs={'venv': ...}"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
        super().__init__(*args, **kwargs)

    def reset(self) -> None:
        """Empty the buffer."""
        super().reset()
        self.mask = np.zeros((self.buffer_size, self.n_envs), dtype=np.bool_)
        self._slots: Slots | None = None  # of the last step

    def add(
        self,
        obs: np.ndarray,
        action: np.ndarray,
        reward: np.ndarray,
        episode_start: np.ndarray,
        value: torch.Tensor,
        log_prob: torch.Tensor,
    ) -> None:
        """Add one step of all slots.

        Raises
        ------
        ValueError
            If the rewards do not say whose they are.
        """
        slots: Slots | None = getattr(reward, "slots", None)
        if slots is None:
            raise ValueError(
                "MaskedRolloutBuffer needs the rewards of a CrowdVecEnv as they are or computed from them; "
                "the environment is another one, or a wrapper has replaced them by plain arrays"
            )
        t = self.pos
        super().add(obs, action, reward, episode_start, value, log_prob)
        self.mask[t], self._slots = slots.acted, slots
        self.values[t] = np.where(
            slots.acted, self.values[t], _worth_of_having_left(self.values[t], slots.acted, slots)
        )
        if slots.team_share > 0.0 and slots.cut_off.any():
            # stable-baselines3 has bootstrapped those who were cut off.  For those who had left the episode goes on as well:
            # what it is worth to them is known of those cut off, one observation earlier.
            later = _worth_of_having_left(self.values[t], slots.cut_off, slots)
            self.rewards[t] += np.where(slots.cut_off, 0.0, self.gamma * later)

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray) -> None:
        """Compute lambda-returns and advantages; whoever has left is worth what `add` says."""
        assert self._slots is not None, "the buffer is empty"
        values, inside = last_values.detach().cpu().numpy().flatten(), self._slots.inside
        values = np.where(inside, values, _worth_of_having_left(values, inside, self._slots)).astype(np.float32)
        super().compute_returns_and_advantage(torch.as_tensor(values), dones)

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """Yield shuffled minibatches of the samples that count; only they are left in the buffer's arrays then.

        A last minibatch of fewer than half the size is joined to the one before it: its gradient would be all noise.
        """
        assert self.full, "the buffer is not full yet"
        if not self.generator_ready:
            valid = np.flatnonzero(self.swap_and_flatten(self.mask)[:, 0])
            for name in ("observations", "actions", "values", "log_probs", "advantages", "returns"):
                setattr(self, name, self.swap_and_flatten(getattr(self, name))[valid])
            self.generator_ready = True
        order = np.random.permutation(len(self.values))  # noqa: NPY002 - the generator that stable-baselines3 seeds
        size = batch_size or len(order)
        count = max(1, int(np.floor(len(order) / size + 0.5)))
        for part in np.array_split(order, count):
            yield self._get_samples(part)


def _worth_of_having_left(values: np.ndarray, inside: Bools, slots: Slots) -> Floats:
    """Return what those of each slot's environment who have left still expect (P,), from the values of those inside."""
    if slots.team_share == 0.0:
        return np.zeros(len(values))
    room, share = slots.environment, slots.team_share
    expected = np.bincount(room, weights=np.where(inside, values, 0.0))
    weight = (1.0 - share) * np.bincount(room) + share * np.bincount(room, weights=inside)
    mean = np.divide(expected, weight, out=np.zeros_like(expected), where=weight > 0.0)
    return np.asarray(share * mean)[room]
