"""Interface of environments for training and evaluation: a batch of evacuations with any kind of agents."""

from typing import Any, Literal, Protocol

import gymnasium
import numpy as np

from crowd_env.core.arrays.state import Bools, Ints
from crowd_env.envs.action import ActionKind, Masks
from crowd_env.envs.crowd import Reset, Step
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.reward import RewardWeights
from crowd_env.scenarios.scenario import Scenario

StepArrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]
"""Observation, reward, terminated, truncated of each row that acts, and the info: a `Step` is one too."""


class CrowdBatch(Protocol):
    """Evacuations side by side: `CrowdEnv`, `MixedEnv`, `GeneratedCrowds`, `RoutingVectorEnv`.

    A row acts: of a `WalkingBatch` a pedestrian, else one controller an environment.
    """

    num_envs: int

    @property
    def single_observation_space(self) -> gymnasium.Space[Any]:
        """Observation space of one row."""

    @property
    def single_action_space(self) -> gymnasium.Space[Any]:
        """Action space of one row."""

    @property
    def decides(self) -> Literal["walking", "routing"]:
        """The agents: pedestrians ("walking"), or one controller an environment ("routing")."""

    @property
    def finished(self) -> Bools:
        """Environments that wait for a reset (E,); none of them where each restarts by itself."""

    def reset(self, *, seed: int | None = None) -> Reset:
        """Start new episodes everywhere; return the observations of all rows."""

    def step(self, action: Any, /) -> StepArrays:
        """Advance all environments by one decision step under the actions of all rows."""


class WalkingBatch(CrowdBatch, Protocol):
    """Evacuations in which each of P pedestrians acts: `CrowdEnv`, `MixedEnv`, `GeneratedCrowds`."""

    env_of_person: Ints  # (P,) environment of each slot
    decision_dt: float  # s
    autoreset: bool  # whether an environment that ends starts a new episode in the same step
    layout: ObservationLayout  # columns of an observation
    action_kind: ActionKind  # meaning of an action
    reward_weights: RewardWeights  # weights of the terms of the reward

    @property
    def decides(self) -> Literal["walking"]:
        """Each row is a pedestrian."""

    @property
    def num_people(self) -> int:
        """Number of slots P."""

    @property
    def active(self) -> Bools:
        """Pedestrians inside (P,)."""

    @property
    def learned(self) -> Bools | bool:
        """Pedestrians that actions move (P,), or one answer for all."""

    @property
    def action_mask(self) -> Masks | None:
        """Choices of each slot that count now (P, n); None where all always do."""

    @property
    def scenario_of_env(self) -> list[Scenario]:
        """Place of each environment."""

    def people(self, e: int) -> slice:
        """Return the slots of environment ``e``."""

    def metrics(self, e: int) -> EpisodeMetrics:
        """Return the metrics of the episode of environment ``e`` so far."""

    def reset(self, seed: int | None = None) -> Reset:
        """Start new episodes everywhere; return the observations (P, D)."""

    def step(self, action: np.ndarray | None = None, /) -> Step:
        """Advance all environments by one decision step; without actions all pedestrians follow the rule."""
