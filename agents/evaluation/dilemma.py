"""Does it pay to push?  What everybody loses where all push, and what one pedestrian gains by it while the others queue.

A crowd that follows a policy is held against a few who deviate, on the same draws.  What the best deviator gains is the
exploitability of the policy (Lanctot et al. 2017, "A unified game-theoretic approach to multiagent reinforcement learning").
Every deviator that is tried bounds it from below, the free walk of the deviator from above.  Payoffs of both kinds over the
share of pedestrians that push are the diagram of Schelling (1973), as Perolat et al. (2017) and Hughes et al. (2018, "Inequity
aversion improves cooperation in intertemporal social dilemmas") draw it for learners.  A policy among others that it never
trained with is what Leibo et al. (2021, "Scalable evaluation of multi-agent reinforcement learning with Melting Pot") judge.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import cast

import numpy as np

from crowd_env import CrowdEnv, ObservationLayout
from crowd_env.analysis.figures import named
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.tasks.task import HELD_OUT_SEED, Task

from ..drivers import DrivenCrowd, own_arguments
from ..mixed import MixedEnv
from ..plain import Plain
from ..policy import Policy
from ..rules import ShortestPath
from .comparison import clearing_times, mean_times, paired
from .evaluation import Evaluation, evaluate_crowd

SHARES = (0.01, 0.05, 0.2, 0.5, 0.8)
_SETTLED = 50  # iterations of the time of a free walk, which converges within a few relaxation times


class RandomSpeed(ShortestPath):
    """Walk the shortest path, at a share of the desired speed that is drawn in every decision, uniformly from 0 to 1."""

    name = "random speed"
    steady = False

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return the drawn shares of speed."""
        return np.column_stack([rng.uniform(size=len(observation)), np.zeros(len(observation))])


def follow(policy: Policy, task: Task, *, runs: int, deviator: Policy | None = None, share: float = 0.01) -> Evaluation:
    """Evaluate a crowd of which everyone follows a policy, but for a ``share`` that follows ``deviator`` if there is one.

    Pedestrians that deviate are the ``learned`` of the evaluation.

    Parameters
    ----------
    share : of the people, at least one; those of a small share are among those of a larger one.
    runs : the first held-out draws of the task.

    Raises
    ------
    ValueError
        If one of the policies cannot be told what it observes where the other observes more.
    """
    return evaluate_crowd(_crowd(policy, task, deviator, share), runs=runs)


def _crowd(policy: Policy, task: Task, deviator: Policy | None, share: float) -> DrivenCrowd:
    crowd = DrivenCrowd(policy, task.place(), task.arguments())
    return crowd if deviator is None else replace(crowd, policy=deviator, learned_share=share, others=policy)


def among(policy: Policy, background: Policy, task: Task, *, runs: int) -> Evaluation:
    """Evaluate the pedestrians that a policy moves in a task with a mixed crowd whose others follow ``background``.

    The same pedestrians of the same draws follow each policy.  These focal pedestrians are the ``learned`` of the evaluation.

    Raises
    ------
    ValueError
        If the policy moves all pedestrians of the task, or one of the policies cannot be mixed with the other.
    """
    if task.learned_share is None:
        raise ValueError(f"in the task {task.name} a policy moves everyone: there is no background")
    crowd = _crowd(background, task, policy, task.learned_share)
    walking = own_arguments(background).get("walking")
    if walking is not None:  # in a mixed crowd this is how the others walk; without it they walk at full speed
        crowd = replace(crowd, others=None, arguments={**crowd.arguments, "walking": walking})
    return evaluate_crowd(crowd, runs=runs)


def gain(before: Evaluation, after: Evaluation) -> Plain:
    """Return how much sooner pedestrians are out [s] that deviate in the second evaluation alone, on the same draws.

    It is a `paired` difference of their mean times, over draws in which they got out both times; ``share`` is its mean over the
    mean time before, None where no draw is left.  ``counted`` is the difference over all draws, in which pedestrians left
    inside count to the limit.

    Raises
    ------
    ValueError
        If no more pedestrians deviate in the second evaluation.
    """
    who = np.zeros((after.runs, 0), dtype=bool) if after.learned is None else after.learned
    who = who if before.learned is None else who & ~before.learned
    if not who.any():
        raise ValueError("no more pedestrians deviate in the second evaluation than in the first")
    counted = (_mean_of(one.times_of_all(), who) for one in (before, after))
    return {**_relative(before.mean_exit_of(who), after.mean_exit_of(who)), "counted": paired(*counted)}


def _relative(before: Floats, after: Floats) -> Plain:
    found = paired(before, after)
    return {**found, "share": _ratio(found["mean"], named(before[np.isfinite(after)])["mean"])}


def _mean_of(times: Floats, who: Bools) -> Floats:
    return np.where(who, times, 0.0).sum(axis=1) / who.sum(axis=1)


def free_walks(task: Task, *, runs: int) -> Floats:
    """Return how soon everyone [s] (R, N) could be out of each held-out draw alone.

    A pedestrian starts from rest and walks in a straight line to the nearest exit, at distance d, by its own drive alone:

        d = v_0 (t - tau (1 - exp(-t / tau)))

    This bounds the time of every response, unless others push the pedestrian beyond its desired speed.
    """
    place = task.place()
    env = CrowdEnv(place, num_envs=runs, **task.arguments())
    env.reset(list(range(HELD_OUT_SEED, HELD_OUT_SEED + runs)))
    bodies, position = env.simulation.bodies, env.simulation.state.position
    start, end = place.geometry.exits[:, 0], place.geometry.exits[:, 1]
    along = end - start
    reached = np.einsum("pxk,xk->px", position[:, None] - start, along) / (along**2).sum(axis=1)
    nearest = start + np.clip(reached, 0.0, 1.0)[:, :, None] * along
    direct = np.linalg.norm(position[:, None] - nearest, axis=2).min(axis=1) / bodies.desired_speed
    time = direct
    for _ in range(_SETTLED):  # from below: never later than the solution
        time = direct + bodies.relaxation_time * (1.0 - np.exp(-time / bodies.relaxation_time))
    return time.reshape(runs, -1)


def exploitability(all_follow: Evaluation, tried: Mapping[str, Evaluation], free: Floats) -> Plain:
    """Return the `gain` of each deviator that was tried, and the bracket of the exploitability of the policy of the others.

    ``below`` is the gain of the best of them, ``tried`` its name; 0 and None where none gains.  ``above`` is what a pedestrian
    would gain that is out after its free walk.  Both have a ``mean`` [s], and its ``share`` of the mean time of following.

    Parameters
    ----------
    tried : evaluations with deviators, the same pedestrians in each.
    free : times (R, N) [s] of `free_walks`.
    """
    gains = {name: gain(all_follow, one) for name, one in tried.items()}
    who = next(iter(tried.values())).learned
    assert who is not None
    best = max(gains, key=lambda name: gains[name]["mean"] or 0.0)
    gains_most = (gains[best]["mean"] or 0.0) > 0.0
    return {
        "gain": gains,
        "tried": best if gains_most else None,
        "below": gains[best] if gains_most else {"mean": 0.0, "share": 0.0},
        "above": _relative(all_follow.mean_exit_of(who), _mean_of(free, who)),
    }


def deterrent(policy: Policy, task: Task, *, runs: int, deviator: Policy, share: float) -> float:
    """Return the price of contacts [s per m/s] at which those who deviate are no better off than those who follow.

    It is a weight of the reward term ``contact`` beside a weight of 1 of ``time``: means over the runs that everyone left, nan
    where there is none, infinite where who deviates touches no more.
    """
    driver = _crowd(policy, task, deviator, share)(runs)
    driver.reset([HELD_OUT_SEED + k for k in range(runs)])
    env, state = cast(MixedEnv, driver.env), driver.env.simulation.state
    touched = np.zeros(env.num_people)
    while not env.finished.all():
        touched -= driver.step().info["reward/contact"]
    left = np.logical_and.reduceat(np.isfinite(state.exit_time), env.env_start[:-1])[env.env_of_person]
    if not left.any():
        return np.nan
    sooner, harder = (
        values[left & ~env.learned].mean() - values[left & env.learned].mean() for values in (state.exit_time, -touched)
    )
    return float(sooner / harder) if harder > 0.0 else np.inf


def price_of_anarchy(all_push: Plain, all_follow: Plain) -> Plain:
    """Return the time of a crowd that pushes over that of one that follows a policy, from their `payoffs`.

    ``counted`` is of the mean exit over all runs, ``mean_exit`` and ``last_exit`` are of the runs that everyone left, None
    where there are none.  The price of anarchy (Koutsoupias, Papadimitriou 1999) has the worst equilibrium above and the best
    that a crowd can do below; a policy is the best that is known.
    """
    names = ("counted", "mean_exit", "last_exit")
    return {name: _ratio(all_push[name]["mean"], all_follow[name]["mean"]) for name in names}


def payoffs(result: Evaluation) -> Plain:
    """Return the times of a crowd [s], and of those who deviate and of the others if somebody deviates.

    They are over the runs that everyone left; ``blocked`` counts the others.  ``counted`` is the mean exit of everybody over
    all runs, in which pedestrians left inside count to the limit, ``counted_deviators`` that of the pedestrians that deviate.
    """
    last, who = clearing_times(result), result.learned
    left = np.isfinite(last)
    kinds = {"mean_exit": np.ones_like(result.exit_times, dtype=bool)}
    counted = {"counted": named(mean_times(result))}
    if who is not None:
        kinds |= {"mean_exit_deviators": who, "mean_exit_others": ~who}
        counted["counted_deviators"] = named(_mean_of(result.times_of_all(), who))
    return {
        **{name: named(result.mean_exit_of(those)[left]) for name, those in kinds.items()},
        **counted,
        "last_exit": named(last),
        "contact_impulse": named(result.column("contact_impulse")),
        "blocked": int((~left).sum()),
        "runs": result.runs,
    }


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below
