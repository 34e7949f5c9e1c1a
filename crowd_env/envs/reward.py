"""Rewards: a weighted sum of named terms, each reported as ``reward/<name>``.

Progress is the loss of a potential, the travel time left on the current route.  Over an episode it sums to the travel time at
the start less that at the end, whatever happens in between: a closed loop pays nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints
from crowd_env.core.checks import Share, array, check_fields, from_data
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref
from crowd_env.envs.observation.view import SLOWEST
from crowd_env.envs.terms import RewardTerm, own_terms, weighed_terms


class Transition(NamedTuple):
    """The effect of a decision step on each pedestrian inside at its start, and the running sums of the episodes."""

    inside: Bools  # (P,)   inside at the start
    left: Bools  # (P,)   went out during the step
    travel_time_before: Floats  # (P,)   s, at the desired speed, by the potential of the route at the start
    travel_time_after: Floats  # (P,)   s, of the current route; 0 after an exit
    duration: Floats  # (P,)   s inside during the step
    impulse_magnitude: Floats  # (P,)   N s, sum of the magnitudes of the contact impulses
    bodies: Bodies
    state: CrowdState  # at the end of the step
    truncated: Bools  # (P,)   still inside when the episode ended in this step
    impulse: Floats  # (P,)   N s  sum of the contact impulse magnitudes of the episode
    step_start: Floats  # (E,)   s    when the step started
    time_limit: Floats  # (E,)   s
    blocked_after: Floats  # (E,)   s
    last_exit: Floats  # (E,)   s    of the last exit in this episode, or of the first possible one
    finished: Bools  # (E,)   the episode is over, or none has begun
    ended: Bools  # (E,)   the episode ended in this step
    coming: Ints  # (E,)   people still to come in


# The rows of the terms that `compute_reward` writes.
PROGRESS, EXIT, TIME, CONTACT, HEAD = range(5)

REWARDS: Mapping[str, int] = {
    # travel time saved [s]: sums to the travel time at the start less that at the end; a switch to another route counts
    "progress": PROGRESS,
    # 1 in the step in which the pedestrian gets out
    "exit": EXIT,
    # minus the time spent inside [s]: sums to minus the egress time
    "time": TIME,
    # minus the contact impulse over the pedestrian's mass [m/s]
    "contact": CONTACT,
    # minus the time [s] as the head of a queue: inside at the step's start, no pedestrian nearer the exit by the same route.
    # Over all of a route it sums to minus the time until the last of them is out, but for the rest of a step in which a
    # head leaves.  It charges each for the delay of others: to follow closely pays, to push in front does not
    "head": HEAD,
}


class RewardSpec(NamedTuple):
    """How the K terms become one reward."""

    order: Ints  # (W,)  rows that are weighed ...
    weights: Floats  # (W,)  ... and by how much
    team_share: float


@inner_kernel
def charge_heads(step: Transition, begin: int, end: int, term: Floats) -> None:
    """Write the term `head` of ``begin:end``: of equally near pedestrians the one in the first slot is the head."""
    routes = 0
    for i in range(begin, end):
        term[i] = 0.0
        routes = max(routes, step.state.route[i] + 1)
    for route in range(routes):
        head, least = -1, np.inf
        for i in range(begin, end):
            if step.inside[i] and step.state.route[i] == route:
                rest = step.travel_time_before[i] * max(step.bodies.desired_speed[i], SLOWEST)  # m
                if rest < least:
                    head, least = i, rest
        if head >= 0:
            term[head] = -step.duration[head]


@kernel
def compute_reward(step: Transition, spec: RewardSpec, terms: Floats, reward: Floats) -> None:
    """Write the compiled terms into ``terms`` (K, P), and the weighted sum of all into ``reward`` (P,)."""
    inside, left, duration = step.inside, step.left, step.duration
    impulse, mass = step.impulse_magnitude, step.bodies.mass
    before, after, env_start = step.travel_time_before, step.travel_time_after, step.bodies.env_start
    order, weights, share = spec.order, spec.weights, spec.team_share
    for e in range(len(env_start) - 1):
        begin, end, total = env_start[e], env_start[e + 1], 0.0
        charge_heads(step, begin, end, terms[HEAD])
        for i in range(begin, end):
            terms[PROGRESS, i] = before[i] - after[i] if inside[i] else 0.0
            terms[EXIT, i] = 1.0 if left[i] else 0.0
            terms[TIME, i] = -duration[i] if inside[i] else 0.0
            terms[CONTACT, i] = -impulse[i] / mass[i] if inside[i] else 0.0
            own = 0.0
            for k in range(len(order)):
                own += weights[k] * terms[order[k], i]
            reward[i] = own
            total += own
        if share > 0.0:
            mean = total / (end - begin)  # over all, pedestrians outside included: time inside is the cost
            for i in range(begin, end):
                reward[i] = (1.0 - share) * reward[i] + share * mean


@dataclass(frozen=True)
class RewardWeights:
    """The weights of the terms.

    Parameters
    ----------
    weights : names in ``REWARDS`` or `RewardTerm` objects -> weight.  A name that is left out has weight 0 but is still
        reported; so is an object of weight 0.
    team_share : 0 = individual rewards; 1 = the mean over all N people of the environment; linear between.
        Pedestrians outside count in the mean with 0, and receive their share of it until the episode ends.

    Raises
    ------
    ValueError
        If a term is unknown, two have the same name, a weight is not finite, or the share is not in [0, 1].
    """

    weights: Mapping[Any, float] = field(default_factory=lambda: {"progress": 1.0, "exit": 1.0, "time": 0.5})
    team_share: Share = 0.0

    def __post_init__(self) -> None:
        check_fields("reward", self)
        # A copy: later changes of the table have no effect.
        object.__setattr__(self, "weights", weighed_terms("reward: weights", self.weights, REWARDS))


def make_weights(reward: RewardWeights | Mapping[Any, Any] | None) -> RewardWeights:
    """Return weights, the weights of plain data, or the default.

    Plain data are the weights alone, ``{"time": 1.0}``, or the fields of `RewardWeights`, ``{"weights": {"time": 1.0}}``.

    Raises
    ------
    ValueError
        If it is of a wrong type, or a name is unknown.
    """
    if isinstance(reward, Mapping) and "weights" not in reward:
        return RewardWeights(weights=reward)
    allowed = "a RewardWeights, a table of weights such as {'time': 1.0} or None"
    return from_data("reward", RewardWeights, reward, allowed)


class RewardFunction:
    """The reward of the steps of one batch.

    Parameters
    ----------
    weights : of the terms.
    people : number of slots P.
    """

    def __init__(self, weights: RewardWeights, people: int) -> None:
        self._own_terms = own_terms(RewardTerm, weights.weights)  # terms that are not compiled
        row: dict[Any, int] = {**REWARDS, **{term: len(REWARDS) + k for k, term in enumerate(self._own_terms)}}
        order = np.array([row[term] for term in weights.weights], dtype=np.int64)
        weight = np.array(list(weights.weights.values()), dtype=np.float64)
        self._spec = struct_ref(RewardSpec(order, weight, weights.team_share))
        self._names = [f"reward/{name}" for name in (*REWARDS, *(term.name for term in self._own_terms))]
        self._people = people

    def __call__(self, step: StructRef) -> tuple[Floats, dict[str, Floats]]:
        """Return the reward (P,) of a `Transition`, and its terms (P,) each, unweighted; 0 for pedestrians outside at first.

        Raises
        ------
        ValueError
            If a custom function does not return (P,) finite numbers.
        """
        terms, reward = np.empty((len(self._names), self._people)), np.empty(self._people)
        for k, term in enumerate(self._own_terms, start=len(REWARDS)):
            values = array(f"reward term {term.name!r}", term.function(step.fields), (self._people,), "biuf")
            terms[k] = term.finite(np.where(step.fields.inside, values, 0.0))
        compute_reward(step, self._spec, terms, reward)
        return reward, dict(zip(self._names, terms, strict=True))
