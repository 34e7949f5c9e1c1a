"""Controllers for ``crowd_env/Routing-v0`` that need no learning: what a learned one has to beat."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crowd_env.envs.routing.batch import RoutingBatch


class Controller(Protocol):
    """Says where people go, in every evacuation of a batch at once."""

    @property
    def name(self) -> str:
        """What tables call it."""
        ...

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the actions (E, R + D) for observations (E, D)."""
        ...


class RandomController:
    """Draw every choice uniformly, every time."""

    name = "random"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return random choices."""
        return rng.integers(0, batch.choices, (len(observation), len(batch.choices)))


@dataclass(frozen=True)
class FixedSplit:
    """Send the regions with their center left of ``x`` [m] to the leftmost exit, the others to the rightmost; doors open."""

    x: float

    @property
    def name(self) -> str:
        """What tables call it."""
        return f"split at {self.x:g} m"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the same choices whatever is observed."""
        geometry, routes = batch.scenario.geometry, batch.layout.routes
        middle = geometry.exits.mean(axis=1)[:, 0]
        left, right = (routes.index(geometry.exit_names[k]) for k in (middle.argmin(), middle.argmax()))
        of_region = np.where(batch.regions.center[:, 0] < self.x, left, right)
        row = np.concatenate([of_region, np.ones(len(batch.layout.doors), dtype=np.int64)])
        return np.tile(row, (len(observation), 1))
