"""Policies that need no learning: what a learned one has to beat."""

import numpy as np

from crowd_env import ObservationLayout, Routing

from .plain import Plain


class ShortestPath:
    """Leave everyone to the rule of the environment: by default to walk the shortest path at full desired speed."""

    name = "shortest"
    steady = True  # a crowd at rest is asked for the same again and again

    def __init__(self) -> None:
        self.env_options: Plain = {}

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Leave everyone to the environment."""
        return None


class StrategyPolicy(ShortestPath):
    """Let everyone walk as a strategy of the environment says.

    Parameters
    ----------
    strategy : see `Scenario.route_set`.
    rules : whether the control rules of the scenario are in force.
    """

    def __init__(self, strategy: str, *, rules: bool = False, name: str = "") -> None:
        self.name, self.routing = name or strategy, Routing(strategy, signs=rules)
        unread = ObservationLayout(terms=("desired_speed",))
        self.env_options = {"routing": self.routing, "observation": unread}


class StandStill(ShortestPath):
    """Want to stay where one is."""

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
