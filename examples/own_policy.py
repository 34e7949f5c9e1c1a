"""A policy of your own beside the rule: python -m examples.own_policy (from the checkout).

Everyone walks the shortest path, the slower the more people are near.  A policy is any object with `name`, `env_options`,
`reset` and `act`; on the command line it is `--policies examples/own_policy.py:Patient`.
"""

from typing import Any

import numpy as np
from rich.console import Console

from crowd_env import ObservationLayout
from crowd_env.agents import make_policy
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.report import comparison_table


class Patient:
    """Slow down where it is crowded."""

    name = "patient"

    def __init__(self) -> None:
        self.env_options: dict[str, Any] = {"action": "continuous"}

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray:
        """Return (P, 2): forward, at a share of the desired speed that falls with the density."""
        density = observation[:, layout["density"]][:, 0]
        return np.column_stack([np.clip(1.2 - 2.0 * density, 0.3, 1.0), np.zeros(len(density))])


def main(runs: int = 50) -> None:
    results = [
        evaluate(policy, "room-v0", physics="nsm2", runs=runs) for policy in (make_policy("shortest"), Patient())
    ]
    Console().print(comparison_table(results, f"room-v0, nsm2, {runs} held-out draws"))


if __name__ == "__main__":
    main()
