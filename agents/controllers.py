"""Controllers for ``crowd_env/routing-v0`` without learning: baselines of learned ones."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from crowd_env.envs.routing.batch import RoutingBatch

from .plain import Plain


class Controller(Protocol):
    """Sends pedestrians to exits, in all evacuations of a batch at once."""

    @property
    def options(self) -> Plain:
        """Options of `RoutingBatch`: regions, interval and observation."""

    @property
    def name(self) -> str:
        """Name in tables."""

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the actions (E, R + D) for observations (E, D)."""


@dataclass
class RandomController:
    """Draw every choice uniformly in every decision."""

    options: Plain = field(default_factory=dict)
    name = "random"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return random choices."""
        return rng.integers(0, batch.choices, (len(observation), len(batch.choices)))


@dataclass
class FixedSplit:
    """Send regions left of the middle of the plan to the leftmost exit, the others to the rightmost; doors open."""

    options: Plain = field(default_factory=dict)
    name = "split"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the same choices for every observation."""
        geometry, routes = batch.scenario.geometry, batch.layout.routes
        middle = geometry.boundary.exit.mean(axis=1)[:, 0]
        left, right = (routes.index(geometry.exit_names[k]) for k in (middle.argmin(), middle.argmax()))
        center, (low, _, high, _) = batch.regions.center, geometry.bounds
        if geometry.building is not None:
            center, low, high = geometry.on_sheets(center)[0], middle.min(), middle.max()
        of_region = np.where(center[:, 0] < (low + high) / 2.0, left, right)
        row = np.concatenate([of_region, np.ones(len(batch.layout.doors), dtype=np.int64)])
        return np.tile(row, (len(observation), 1))
