"""Rewards: a weighted sum of named terms, each reported as ``reward/<name>``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from crowd_env._jit import kernel
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


# Numbers of the terms that `judge` computes.
PROGRESS, EXIT, TIME, CONTACT = range(4)

# Name -> law: a function of a `Transition` that returns (P,), or the number of one that is compiled in `judge`.
REWARDS: dict[str, Callable[[Transition], Floats] | int] = {
    # travel time saved [s]: sums to the travel time from the start, whatever the way
    "progress": PROGRESS,
    # 1 in the step in which the pedestrian gets out
    "exit": EXIT,
    # minus the time spent inside [s]: sums to minus the egress time
    "time": TIME,
    # minus the contact impulse over the own mass [m/s]
    "contact": CONTACT,
}


@kernel
def judge(step: Transition, row: Ints, terms: Floats) -> None:
    """Write the compiled terms into rows of ``terms`` (K, P), as ``row`` (4,) says; -1 = not wanted."""
    for i in range(len(step.inside)):
        inside = step.inside[i]
        if row[PROGRESS] >= 0:
            terms[row[PROGRESS], i] = step.travel_time_before[i] - step.travel_time_after[i] if inside else 0.0
        if row[EXIT] >= 0:
            terms[row[EXIT], i] = 1.0 if step.left[i] else 0.0
        if row[TIME] >= 0:
            terms[row[TIME], i] = -step.duration[i] if inside else 0.0
        if row[CONTACT] >= 0:
            terms[row[CONTACT], i] = -step.crush[i] / step.mass[i] if inside else 0.0


@kernel
def weigh(
    terms: Floats, order: Ints, weights: Floats, share: float, inside: Bools, env_start: Ints, total: Floats
) -> None:
    """Write the weighted sum (P,) of the rows ``order`` of ``terms`` (K, P), of which ``share`` goes to everyone inside."""
    for e in range(len(env_start) - 1):
        people, all_in_all = 0, 0.0
        for i in range(env_start[e], env_start[e + 1]):
            own = 0.0
            for k in range(len(order)):
                own += weights[k] * terms[order[k], i]
            total[i] = own
            all_in_all += own
            people += inside[i]
        if share > 0.0 and people > 0:
            mean = all_in_all / people
            for i in range(env_start[e], env_start[e + 1]):
                if inside[i]:
                    total[i] = (1.0 - share) * total[i] + share * mean


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
        names = list(REWARDS)
        terms = np.empty((len(names), len(step.inside)))
        row = np.full(4, -1, dtype=np.int64)
        for k, law in enumerate(REWARDS.values()):
            if isinstance(law, int):
                row[law] = k
            else:
                terms[k] = np.where(step.inside, law(step), 0.0)
        judge(step, row, terms)
        total = np.empty(len(step.inside))
        order = np.array([names.index(name) for name in self.weights], dtype=np.int64)
        weights = np.array(list(self.weights.values()), dtype=np.float64)
        weigh(terms, order, weights, float(self.team_share), step.inside, env_start, total)
        return total, dict(zip(names, terms, strict=True))
