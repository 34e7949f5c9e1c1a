"""Rewards: a weighted sum of named terms, each reported as ``reward/<name>``.

Progress is the loss of a potential, the travel time that is left on the way that one follows: over an episode it sums to the
travel time at the start less that at the end, whatever happens in between, so that nothing that ends where it began pays.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from crowd_env._kernels.jit import kernel
from crowd_env._kernels.struct_ref import StructRef, struct_ref
from crowd_env.checks import SHARE, check_fields, from_table, known, number, refuse, table
from crowd_env.envs.buffers import BufferPool
from crowd_env.state import Bools, Floats, Ints


class Transition(NamedTuple):
    """What a decision step did to everyone who was inside at its start."""

    inside: Bools  # (P,)   inside at the start
    left: Bools  # (P,)   went out during the step
    travel_time_before: Floats  # (P,)   s, at the own desired speed, by the potential of the way followed then
    travel_time_after: Floats  # (P,)   s, of the way followed now; 0 for those who went out
    duration: Floats  # (P,)   s inside during the step
    crush: Floats  # (P,)   N s, sum of contact impulse magnitudes
    mass: Floats  # (P,)   kg
    env_start: Ints  # (E+1,) first slot of each environment


# Numbers of the terms that `judge` computes.
PROGRESS, EXIT, TIME, CONTACT = range(4)

# Name -> law: a function of a `Transition` that returns (P,), or the number of one that is compiled in `judge`.  An environment
# keeps the terms that were here when it was made.
REWARDS: dict[str, Callable[[Transition], Floats] | int] = {
    # travel time saved [s]: sums to the travel time at the start less that at the end; a switch to another way counts
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
        begin, end, total = step.env_start[e], step.env_start[e + 1], 0.0
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
        if share > 0.0:
            mean = total / (end - begin)  # of all, those who have left too: to be inside is what costs
            for i in range(begin, end):
                reward[i] = (1.0 - share) * reward[i] + share * mean


@dataclass(frozen=True)
class RewardWeights:
    """How the terms are weighed.

    Parameters
    ----------
    weights : name in ``REWARDS`` -> weight; terms not named weigh nothing but are still reported.
    team_share : 0 = everyone for oneself; 1 = everyone gets the mean over all N people of the environment, linear between.
        Those who have left count in the mean with 0, and go on getting their share of it until the episode ends.

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


class RewardFunction:
    """What the steps of one batch are worth, by the terms that are in `REWARDS` now: later changes do not reach it.

    Parameters
    ----------
    weights : of the terms.
    people : number of slots P.

    Raises
    ------
    ValueError
        If a term that is weighed is no longer in `REWARDS`.
    """

    def __init__(self, weights: RewardWeights, people: int) -> None:
        for name in weights.weights:
            known("reward term", name, REWARDS)
        names = list(REWARDS)
        self._names = [f"reward/{name}" for name in names]
        self._own = [(k, law) for k, law in enumerate(REWARDS.values()) if not isinstance(law, int)]
        row = np.full(4, -1, dtype=np.int64)
        for k, law in enumerate(REWARDS.values()):
            if isinstance(law, int):
                row[law] = k
        order = np.array([names.index(name) for name in weights.weights], dtype=np.int64)
        weight = np.array(list(weights.weights.values()), dtype=np.float64)
        self._weighing = struct_ref(Weighing(row, order, weight, float(weights.team_share)))
        self._terms = BufferPool((len(names), people))

    def __call__(self, step: StructRef) -> tuple[Floats, dict[str, Floats]]:
        """Return the reward (P,) of a `Transition`, and its terms (P,) each, unweighted; 0 for those who were not inside."""
        terms = self._terms.take()
        for k, law in self._own:
            terms[k] = np.where(step.fields.inside, law(step.fields), 0.0)
        reward = np.empty(terms.shape[1])
        judge(step, self._weighing, terms, reward)
        return reward, dict(zip(self._names, terms, strict=True))
