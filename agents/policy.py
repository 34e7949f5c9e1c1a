"""The door by which every policy enters, rule or network."""

from typing import Protocol, runtime_checkable

import numpy as np

from crowd_env import ObservationLayout

from .plain import Plain


@runtime_checkable
class Policy(Protocol):
    """Decides for all people of a batch at once.

    Attributes
    ----------
    name : what tables and plots call it.
    env_options : arguments of `CrowdEnv` the policy was made for (action, observation, walking); empty if any will do.
    steady : optional; true where what it asks for follows from what it is shown alone, so that a crowd at rest stays so.
    """

    @property
    def name(self) -> str:
        """What tables call it."""

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv` the policy was made for."""

    def reset(self, env_mask: np.ndarray) -> None:
        """Forget what belongs to the environments (E,) that start anew."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return actions (P, A) in [-1, 1] for observations (P, D); None leaves everyone to the rule of the environment."""
