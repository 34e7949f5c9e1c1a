"""What Gymnasium's Env and VectorEnv of this package are made of: E environments with one controller each, over arrays."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import EpisodeMetrics


class BatchStep(NamedTuple):
    """What one step did to E environments."""

    observation: np.ndarray  # (E, ...)  where an episode has restarted, the first of the new one
    final: np.ndarray | None  # (E, ...)  where an episode has restarted, the last of the old one; None if none has
    reward: Floats  # (E,)
    terminated: Bools  # (E,)
    truncated: Bools  # (E,)
    info: dict[str, Any]  # name -> (E, ...), or a dictionary of such; always of the step that was made
    metrics: Mapping[int, EpisodeMetrics]  # environment -> metrics of the episode that ended in this step


class Batch(Protocol):
    """E environments with one controller each; an episode that has ended stays as it is, with reward 0, until it restarts."""

    env: CrowdEnv
    layout: Any  # where the columns of an observation are

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Space of the observations of one environment."""
        ...

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Space of the actions of one environment."""
        ...

    def info_at_reset(self) -> dict[str, np.ndarray]:
        """Return the infos of a reset, (E, ...) each, in arrays that belong to the caller."""
        ...

    def reset(self, seed: int | Sequence[int] | None = None, mask: Bools | None = None) -> np.ndarray:
        """Start new episodes everywhere, or where ``mask`` (E,) is true; return observations (E, ...), valid there."""
        ...

    def step(self, actions: Any) -> BatchStep:
        """Advance by one step; if the batch was made with ``autoreset``, restart each episode that ends in it."""
        ...
