"""Rewards: a weighted sum of named terms, each reported as ``reward/<name>``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env._reference import Reference
from crowd_env.checks import SHARE, check_fields, from_table, known, number, refuse, table
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
    env_start: Ints  # (E+1,) first slot of each environment


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


class Weighing(NamedTuple):
    """How the K terms become one reward."""

    row: Ints  # (4,)  row of each compiled term; -1 = not wanted
    order: Ints  # (W,)  rows that are weighed ...
    weights: Floats  # (W,)  ... and by how much
    team_share: float


@kernel
def judge(step: Transition, weighing: Weighing, terms: Floats, reward: Floats) -> None:
    """Write the compiled terms into ``terms`` (K, P), and the weighted sum of all into ``reward`` (P,)."""
    inside, left, duration, crush, mass = step.inside, step.left, step.duration, step.crush, step.mass
    before, after, order, weights, share = (
        step.travel_time_before,
        step.travel_time_after,
        weighing.order,
        weighing.weights,
        weighing.team_share,
    )
    progress, out, time, contact = weighing.row[PROGRESS], weighing.row[EXIT], weighing.row[TIME], weighing.row[CONTACT]
    for e in range(len(step.env_start) - 1):
        begin, end, people, total = step.env_start[e], step.env_start[e + 1], 0, 0.0
        for i in range(begin, end):
            if progress >= 0:
                terms[progress, i] = before[i] - after[i] if inside[i] else 0.0
            if out >= 0:
                terms[out, i] = 1.0 if left[i] else 0.0
            if time >= 0:
                terms[time, i] = -duration[i] if inside[i] else 0.0
            if contact >= 0:
                terms[contact, i] = -crush[i] / mass[i] if inside[i] else 0.0
            own = 0.0
            for k in range(len(order)):
                own += weights[k] * terms[order[k], i]
            reward[i] = own
            total += own
            people += inside[i]
        if share > 0.0 and people > 0:
            mean = total / people
            for i in range(begin, end):
                if inside[i]:
                    reward[i] = (1.0 - share) * reward[i] + share * mean


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
        check_fields("reward", self, team_share=SHARE)
        weights = {
            known("reward term", name, REWARDS): number(f"weight of reward term {name!r}", weight)
            for name, weight in table("reward: weights", self.weights, "weights such as {'time': 1.0}").items()
        }
        object.__setattr__(self, "weights", weights)  # a copy: what is changed in the table later changes nothing here

    def plan(self) -> Weighing:
        """Return how the terms in ``REWARDS``, in their order, become one reward."""
        names = list(REWARDS)
        row = np.full(4, -1, dtype=np.int64)
        for k, law in enumerate(REWARDS.values()):
            if isinstance(law, int):
                row[law] = k
        order = np.array([names.index(name) for name in self.weights], dtype=np.int64)
        weights = np.array(list(self.weights.values()), dtype=np.float64)
        return Weighing(row, order, weights, float(self.team_share))


def make_weights(reward: RewardWeights | Mapping[str, Any] | None) -> RewardWeights:
    """Return weights, those of plain data, or the default.

    Plain data are the weights alone, ``{"time": 1.0}``, or the fields of `RewardWeights`, ``{"weights": {"time": 1.0}}``.

    Raises
    ------
    ValueError
        If it is something else, or a name is unknown.
    """
    if reward is None:
        return RewardWeights()
    if isinstance(reward, Mapping):
        return from_table("reward", RewardWeights, reward) if "weights" in reward else RewardWeights(weights=reward)
    if not isinstance(reward, RewardWeights):
        refuse("reward", reward, "a RewardWeights, a table of weights such as {'time': 1.0} or None")
    return reward


def evaluate(step: Reference, weighing: Reference, terms: Floats) -> Floats:
    """Return the reward (P,) of a `Transition` and write its terms (K, P), unweighted; 0 for those who were not inside."""
    for k, law in enumerate(REWARDS.values()):
        if not isinstance(law, int):
            terms[k] = np.where(step.fields.inside, law(step.fields), 0.0)
    reward = np.empty(terms.shape[1])
    judge(step, weighing, terms, reward)
    return reward
