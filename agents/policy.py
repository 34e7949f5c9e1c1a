"""The protocol of every policy, rule or network."""

from typing import Protocol, runtime_checkable

import numpy as np

from crowd_env import ObservationLayout

from .plain import Plain


@runtime_checkable
class Policy(Protocol):
    """Decides for all pedestrians of a batch at once.

    Attributes
    ----------
    name : name in tables and plots.
    env_options : arguments of `CrowdEnv` that the policy requires (action, observation, walking); empty if it requires none.
    steady : optional; true if its actions follow from the observation alone, so that a crowd at rest stays at rest.
    """

    @property
    def name(self) -> str:
        """Name in tables."""

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv` that the policy requires."""

    def reset(self, env_mask: np.ndarray) -> None:
        """Clear the memory of the environments (E,) that restart."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return actions (P, A) in [-1, 1] for observations (P, D); None: all follow the rule of the environment."""


class WithoutMemory:
    """Base of policies that decide by the present observation."""

    def reset(self, env_mask: np.ndarray) -> None:
        """Do nothing: there is no memory to clear."""
