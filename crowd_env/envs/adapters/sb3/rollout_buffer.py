"""Rollouts of a `CrowdVecEnv` without the samples of pedestrians outside."""

from collections.abc import Generator
from typing import Any, ClassVar

import numpy as np
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.adapters.sb3.vec_env import Slots

_SAMPLED = ("observations", "actions", "values", "log_probs", "advantages", "returns")  # as samples hold them


class MaskedRolloutBuffer(RolloutBuffer):
    """A rollout buffer that returns only the samples of pedestrians inside at the time of their action.

    The rewards of a `CrowdVecEnv` carry the mask, see `SlotRewards`, whichever environment the model has at the time.

    Having left is worth nothing without a ``team_share`` s; with one it is worth what the critic expects of the others.  Let M
    be the mean return-to-go over all N pedestrians of an environment.  The n pedestrians inside expect V = (1 - s) own + s M
    each, and the others s M.  So the sum of V over the pedestrians inside is ((1 - s) N + s n) M.

    For ``MaskablePPO`` it is the first base, and the buffer of action masks of sb3-contrib the second, of a class with the
    ``samples`` of the second.
    """

    samples: ClassVar[Any] = RolloutBufferSamples

    def reset(self) -> None:
        """Empty the buffer."""
        super().reset()
        self.mask = np.zeros((self.buffer_size, self.n_envs), dtype=bool)
        self._slots: Slots | None = None  # of the last step

    def add(
        self,
        obs: np.ndarray,
        action: np.ndarray,
        reward: np.ndarray,
        episode_start: np.ndarray,
        value: torch.Tensor,
        log_prob: torch.Tensor,
        **masks: Any,
    ) -> None:
        """Add one step of all slots.

        Raises
        ------
        ValueError
            If the rewards carry no `Slots`.
        """
        slots: Slots | None = getattr(reward, "slots", None)
        if slots is None:
            raise ValueError(
                "MaskedRolloutBuffer needs the rewards of a CrowdVecEnv as they are or computed from them; "
                "the environment is another one, or a wrapper has replaced them by plain arrays"
            )
        t = self.pos
        super().add(obs, action, reward, episode_start, value, log_prob, **masks)
        self.mask[t], self._slots = slots.acted, slots
        self.values[t] = np.where(
            slots.acted, self.values[t], _worth_of_having_left(self.values[t], slots.acted, slots)
        )
        if slots.team_share > 0.0 and slots.cut_off.any():
            # stable-baselines3 has bootstrapped the rows that were cut off.  For pedestrians outside the episode would go on as
            # well: its value for them follows from the values of the rows cut off, one observation earlier.
            later = _worth_of_having_left(self.values[t], slots.cut_off, slots)
            self.rewards[t] += np.where(slots.cut_off, 0.0, self.gamma * later)

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray) -> None:
        """Compute lambda-returns and advantages; the class docstring defines the value of having left."""
        assert self._slots is not None, "the buffer is empty"
        slots = self._slots
        values, inside = last_values.detach().cpu().numpy().flatten(), slots.inside
        values = np.where(inside, values, _worth_of_having_left(values, inside, slots)).astype(np.float32)
        super().compute_returns_and_advantage(torch.as_tensor(values), dones)

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """Yield shuffled minibatches of the masked samples; afterwards the buffer's arrays hold these samples alone.

        Samples are shuffled once a rollout, and minibatches at every call: they are views, and no sample is copied twice.  A
        last minibatch of fewer than half the size is joined to the one before it: its gradient would be all noise.

        Raises
        ------
        ValueError
            If an observation or a reward is no finite number: one of them would spoil the network for good.
        """
        assert self.full, "the buffer is not full yet"
        permutation, names = np.random.permutation, (*_SAMPLED, *self.samples._fields[len(_SAMPLED) :])
        if not self.generator_ready:
            valid = permutation(np.flatnonzero(self.mask))
            for name in names:
                array = getattr(self, name)
                setattr(self, name, array.reshape(self.mask.size, *array.shape[2:])[valid])
                if not np.isfinite(getattr(self, name)).all():
                    raise ValueError(
                        f"{name} of this rollout are not all finite: an observation term or a reward is not"
                    )
            self.generator_ready = True
        tensors = [torch.as_tensor(getattr(self, name), device=self.device) for name in names]
        total = len(self.values)
        count = max(1, int(np.floor(total / (batch_size or total) + 0.5)))
        bounds = np.linspace(0, total, count + 1).astype(int)
        for k in permutation(count):
            yield self.samples(*(one[bounds[k] : bounds[k + 1]] for one in tensors))


def _worth_of_having_left(values: np.ndarray, inside: Bools, slots: Slots) -> Floats:
    """Return the value (P,) of having left each slot's environment, from the values of the pedestrians inside."""
    if slots.team_share == 0.0:
        return np.zeros(len(values))
    room, share = slots.environment, slots.team_share
    expected = np.bincount(room, weights=np.where(inside, values, 0.0))
    weight = (1.0 - share) * np.bincount(room) + share * np.bincount(room, weights=inside)
    mean = np.divide(expected, weight, out=np.zeros_like(expected), where=weight > 0.0)
    return (share * mean)[room]
