"""Rewards: a weighted sum of named terms, each one function over arrays and each reported as ``reward/<name>``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from crowd_env.state import Bools, Floats, Ints


class Transition(NamedTuple):
    """What a decision step did to everyone who was inside at its start."""

    inside: Bools  # (P,)   inside at the start
    left: Bools  # (P,)   went out during the step
    travel_time_before: Floats  # (P,)   s, at the own desired speed
    travel_time_after: Floats  # (P,)   s, 0 for those who went out
    duration: Floats  # (P,)   s inside during the step
    crush: Floats  # (P,)   N s, sum of contact impulse magnitudes
    mass: Floats  # (P,)   kg


def progress(step: Transition) -> Floats:
    """Travel time saved [s]: sums to the travel time from the start, whatever the way."""
    return step.travel_time_before - step.travel_time_after


def exit_bonus(step: Transition) -> Floats:
    """1 in the step in which the pedestrian gets out."""
    return step.left.astype(np.float64)


def time(step: Transition) -> Floats:
    """Minus the time spent inside [s]: sums to minus the egress time."""
    return -step.duration


def contact(step: Transition) -> Floats:
    """Minus the contact impulse over the own mass [m/s]."""
    return -step.crush / step.mass


# Name -> function of a transition.
REWARDS: dict[str, Callable[[Transition], Floats]] = {
    "progress": progress,
    "exit": exit_bonus,
    "time": time,
    "contact": contact,
}


@dataclass(frozen=True)
class RewardWeights:
    """How the terms are weighed.

    Parameters
    ----------
    weights : name in ``REWARDS`` -> weight; terms not named weigh nothing but are still reported.
    team_share : 0 = everyone for oneself; 1 = everyone inside gets the mean over all inside; linear between.

    Raises
    ------
    ValueError
        If a term is unknown, a weight is not finite, or the share is not in [0, 1].
    """

    weights: Mapping[str, float] = field(default_factory=lambda: {"progress": 1.0, "exit": 1.0, "time": 0.5})
    team_share: float = 0.0

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if name not in REWARDS:
                raise ValueError(f"unknown reward term {name!r}; known: {', '.join(REWARDS)}")
            if not np.isfinite(weight):
                raise ValueError(f"weight of reward term {name!r} is {weight!r}; it must be finite")
        if not 0.0 <= self.team_share <= 1.0:
            raise ValueError(f"team_share is {self.team_share!r}; it must be in [0, 1]")

    def evaluate(self, step: Transition, env_start: Ints) -> tuple[Floats, dict[str, Floats]]:
        """Return the reward (P,) and its terms by name, unweighted; 0 for those who were not inside."""
        terms = {name: np.where(step.inside, law(step), 0.0) for name, law in REWARDS.items()}
        total = np.zeros(len(step.inside))
        for name, weight in self.weights.items():
            total += weight * terms[name]
        if self.team_share > 0.0:
            people = np.maximum(np.add.reduceat(step.inside.astype(np.float64), env_start[:-1]), 1.0)
            mean = np.repeat(np.add.reduceat(total, env_start[:-1]) / people, np.diff(env_start))
            total = np.where(step.inside, (1.0 - self.team_share) * total + self.team_share * mean, 0.0)
        return total, terms
