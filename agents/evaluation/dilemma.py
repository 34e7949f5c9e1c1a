"""Does it pay to push?  What everybody loses where all push, and what one gains who does so while the others queue.

A crowd that follows a policy is held against a few who deviate, on the same draws.  What the best deviator gains is the
exploitability of the policy (Lanctot et al. 2017, "A unified game-theoretic approach to multiagent reinforcement learning");
every deviator that is tried bounds it from below.  Payoffs of both kinds over the share of those who push are the diagram of
Schelling (1973), as Perolat et al. (2017) and Hughes et al. (2018, "Inequity aversion improves cooperation in intertemporal
social dilemmas") draw it for learners.
"""

from dataclasses import replace
from typing import cast

import numpy as np

from crowd_env.analysis.figures import named
from crowd_env.envs.tasks.task import HELD_OUT_SEED, Task

from ..drivers import DrivenCrowd
from ..mixed import MixedEnv
from ..plain import Plain
from ..policy import Policy
from .comparison import clearing_times, paired
from .evaluation import Evaluation, evaluate_crowd

SHARES = (0.01, 0.05, 0.2, 0.5, 0.8)


def follow(policy: Policy, task: Task, *, runs: int, deviator: Policy | None = None, share: float = 0.01) -> Evaluation:
    """Evaluate a crowd of which everyone follows a policy, but for a ``share`` who follow ``deviator`` if there is one.

    Those who deviate are the ``learned`` of the evaluation.

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


def gain(all_follow: Evaluation, some_deviate: Evaluation) -> Plain:
    """Return how much sooner those are out who deviate [s] than the same people in the same draws where they follow.

    It is a `paired` difference; ``share`` is its mean over the mean time of following, None where no draw is left.

    Raises
    ------
    ValueError
        If nobody deviates in the second evaluation.
    """
    who = some_deviate.learned
    if who is None:
        raise ValueError("nobody deviates in the second evaluation")
    following, deviating = all_follow.mean_exit_of(who), some_deviate.mean_exit_of(who)
    found = paired(following, deviating)
    return {**found, "share": _ratio(found["mean"], named(following[np.isfinite(deviating)])["mean"])}


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


def price_of_anarchy(all_push: Evaluation, all_follow: Evaluation) -> Plain:
    """Return the time of a crowd that pushes over that of one that follows a policy.

    ``mean_exit`` of everybody and ``last_exit`` are over the runs that everyone left, None where there are none; ``blocked``
    holds how many the others are.  The price of anarchy (Koutsoupias, Papadimitriou 1999) has the best that a crowd can do
    below; a policy is the best that is known.
    """
    one, other = payoffs(all_push), payoffs(all_follow)
    found = {name: _ratio(one[name]["mean"], other[name]["mean"]) for name in ("mean_exit", "last_exit")}
    return {**found, "blocked": [one["blocked"], other["blocked"]], "runs": all_push.runs}


def payoffs(result: Evaluation) -> Plain:
    """Return the times of a crowd [s], and of those who deviate and of the others if somebody deviates.

    They are over the runs that everyone left; ``blocked`` counts the others.
    """
    last, who = clearing_times(result), result.learned
    left = np.isfinite(last)
    kinds = {"mean_exit": np.ones_like(result.exit_times, dtype=np.bool_)}
    if who is not None:
        kinds |= {"mean_exit_deviators": who, "mean_exit_others": ~who}
    return {
        **{name: named(result.mean_exit_of(those)[left]) for name, those in kinds.items()},
        "last_exit": named(last),
        "contact_impulse": named(result.column("contact_impulse")),
        "blocked": int((~left).sum()),
        "runs": result.runs,
    }


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below
