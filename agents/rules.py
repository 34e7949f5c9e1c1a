"""Policies without learning: baselines of learned ones."""

import numpy as np

from crowd_env import ObservationLayout, Routing

from .plain import Plain
from .policy import WithoutMemory


class ShortestPath(WithoutMemory):
    """Leave all pedestrians to the rule of the environment: by default the shortest path at full desired speed."""

    name = "shortest"
    steady = True

    def __init__(self) -> None:
        self.env_options: Plain = {}

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return no actions."""
        return None


class StrategyPolicy(ShortestPath):
    """Let all pedestrians follow a strategy of the environment.

    Parameters
    ----------
    strategy : see `Scenario.route_set`.
    rules : whether the control rules of the scenario apply.
    """

    def __init__(self, strategy: str, *, rules: bool = False, name: str = "") -> None:
        self.name, self.routing = name or strategy, Routing(strategy, signs=rules)
        unread = ObservationLayout(terms=("desired_speed",))
        self.env_options = {"routing": self.routing, "observation": unread}


class StandStill(ShortestPath):
    """Keep the desired velocity at zero."""

    name = "stand-still"

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return zero desired velocity."""
        return np.zeros((len(observation), 2))


class RandomWalk(ShortestPath):
    """Draw every desired velocity uniformly from the action space."""

    name = "random"
    steady = False

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return uniform actions."""
        return rng.uniform(-1.0, 1.0, (len(observation), 2))
