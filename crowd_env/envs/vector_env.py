"""What natively batched Gymnasium environments have in common: restarts, resets of some rows, infos as Gymnasium has them."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from crowd_env.checks import shown
from crowd_env.envs.client_input import as_numbers, reset_mask
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.state import Bools, Floats


class Advanced(NamedTuple):
    """What one step of E environments did."""

    observation: np.ndarray  # (E, ...)  of what goes on; of environments that began anew, their first
    final: np.ndarray | None  # (E, ...)  the last of those that began anew; None if none did
    reward: Floats  # (E,)
    terminated: Bools  # (E,)
    truncated: Bools  # (E,)
    info: dict[str, Any]  # name -> (E, ...), or a dictionary of such; of the step just made in every row
    metrics: Mapping[int, EpisodeMetrics]  # of the episodes that ended


class BatchVectorEnv(VectorEnv):
    """E environments in one array, with the infos of `gymnasium.vector.SyncVectorEnv` around E single ones.

    Every entry of an info is an array (E, ...), or a dictionary of such, and has a mask ``_<name>`` (E,) bool of the
    environments that it is about; the others' rows are zero.  What becomes of an environment whose episode has ended says
    ``autoreset_mode``, which is also in ``metadata``:

    "SameStep" (default)
        It begins anew in the same step and its row shows the first observation of the next episode.  ``info["final_obs"]``
        holds the last observation of the old one and ``info["final_info"]`` all that there is to tell of the step that ended
        it, its ``metrics`` included.  The other infos of that row are those of a reset.
    "NextStep"
        Its row shows the last observation, and the info its ``metrics``.  In the next step it begins anew, whatever its
        action; reward 0.
    "Disabled"
        As before, but it has to be reset by ``reset(options={"reset_mask": mask})`` before the next step.

    Parameters
    ----------
    num_envs : E.
    observation_space, action_space : of one environment.
    at_start : infos of a reset, (E, ...) each.
    autoreset_mode : an `AutoresetMode` or its value.
    """

    def __init__(
        self,
        num_envs: int,
        observation_space: gymnasium.spaces.Box,
        action_space: gymnasium.Space,
        at_start: Mapping[str, np.ndarray],
        autoreset_mode: AutoresetMode,
    ) -> None:
        self.render_mode = None
        self.num_envs = num_envs
        self.autoreset_mode = autoreset_mode
        self.metadata = {**self.metadata, "autoreset_mode": autoreset_mode}
        self.single_observation_space, self.single_action_space = observation_space, action_space
        self.observation_space = batch_space(observation_space, num_envs)
        self.action_space = batch_space(action_space, num_envs)
        self._at_start = at_start
        self._begun = False
        self._ended = np.zeros(num_envs, dtype=np.bool_)  # and wait to begin anew
        # Rows as they were last shown: what a reset of others is to return of them.
        self._last = np.zeros((num_envs, *(observation_space.shape or ())), dtype=observation_space.dtype)

    @abstractmethod
    def _begin(self, seed: int | Sequence[int] | None, mask: Bools | None) -> np.ndarray:
        """Begin new episodes everywhere or where ``mask`` is true; return observations (E, ...), right at least there."""

    @abstractmethod
    def _advance(self, actions: np.ndarray) -> Advanced:
        """Advance what goes on by one step; if the mode is SAME_STEP, what ends begins anew.

        What has ended before stays as it is, with reward 0, neither terminated nor truncated.
        """

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin new episodes everywhere, or where ``options["reset_mask"]`` (E,) is true.

        Parameters
        ----------
        seed : as in `CrowdEnv.reset`; seeds of environments that are not reset mean nothing.
        options : None or {"reset_mask": boolean array}; it is left as it is.

        Returns
        -------
        All observations (E, ...), of environments that are not reset as they were last shown, and the infos of those that are.

        Raises
        ------
        ValueError
            If an option is unknown or the mask no boolean array (E,) with a True, or if the first reset is of some only.
        """
        mask = reset_mask(options, self.num_envs)
        if mask is None:
            mask = np.ones(self.num_envs, dtype=np.bool_)
            observation = self._begin(seed, None)
        elif not self._begun:
            raise ValueError("reset all environments before some of them")
        else:
            fresh, observation = self._begin(seed, mask), self._last.copy()
            observation[mask] = fresh[mask]
        self._begun = True
        self._ended[mask] = False
        self._last[:] = observation
        return observation, about(self._at_start, mask)

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every environment by one step; ``actions`` have the shape of ``action_space`` and no other.

        Raises
        ------
        ValueError
            If actions are malformed, before the first `reset`, or if an environment waits to be reset.
        """
        if not self._begun:
            raise ValueError("call reset before the first step")
        made = self._advance(self._checked(actions))
        observation, over = made.observation, made.terminated | made.truncated
        began = np.zeros(self.num_envs, dtype=np.bool_)
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            began = over
        elif self._ended.any():
            began, fresh = self._ended, self._begin(None, self._ended)
            observation[began] = fresh[began]
        info = about(made.info, ~began)
        for name, values in self._at_start.items():
            info[name][began], info[f"_{name}"][began] = values[began], True
        if over.any():
            at_end: dict[str, Any] = {"metrics": as_columns(made.metrics, self.num_envs)}
            if made.final is not None:
                at_end = {"final_obs": made.final, "final_info": made.info | at_end}
            info |= about(at_end, over)
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            self._ended = over
        self._last[:] = observation
        return observation, made.reward, made.terminated, made.truncated, info

    def _checked(self, actions: Any) -> np.ndarray:
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            e = int(np.argmax(self._ended))
            raise ValueError(f"environment {e} has ended; reset it first: reset(options={{'reset_mask': mask}})")
        return as_numbers(actions, self.action_space.shape or (), "the array of actions")


def as_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return a mode given by itself or by its value.

    Raises
    ------
    ValueError
        If there is no such mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(str(one.value) for one in AutoresetMode)
        raise ValueError(f"unknown autoreset_mode {shown(mode)}; known: {known}") from None


def about(values: Mapping[str, Any], rows: Bools) -> dict[str, Any]:
    """Return infos (E, ...) of these rows (E,) as Gymnasium has them: each with its mask, zero in the other rows."""
    info: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            info[name] = about(value, rows)
        else:
            info[name] = value.copy()
            info[name][~rows] = 0
        info[f"_{name}"] = rows.copy()
    return info


def as_columns(metrics: Mapping[int, EpisodeMetrics], count: int) -> dict[str, np.ndarray]:
    """Return the metrics of some of so many environments as one array (E,) a field, zero elsewhere."""
    columns: dict[str, np.ndarray] = {}
    for e, episode in metrics.items():
        for name, value in episode._asdict().items():
            columns.setdefault(name, np.zeros(count, dtype=type(value)))[e] = value
    return columns
