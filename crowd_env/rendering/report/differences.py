"""Folders beside each other, run by run on the same draws: what the first one's figures differ from."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crowd_env.analysis.figures import named, time_of_share
from crowd_env.envs.rollout import Episode
from crowd_env.rendering.report.runs import Runs

COMPARED = {"evacuation_time": "evacuation time", "t95": "95 % of the people out", "mean_exit_time": "mean exit time"}


def differences(runs: Sequence[Runs]) -> list[dict[str, Any]]:
    """Return how much longer each folder took than the first, ready for JSON.

    Runs of one seed are paired where they begin with the same people in the same places (common random numbers): the interval
    of the mean difference is then that of paired values (Student's t).  ``pairs`` is the number of pairs in which both runs
    have the figure; a mean exit time counts where everyone got out, since those who got out of a run that was cut short are
    the quick ones.  A folder whose plan, people or seeds are others has ``why_not`` in place of figures.
    """
    return [_minus(other, runs[0]) for other in runs[1:]]


def _minus(one: Runs, first: Runs) -> dict[str, Any]:
    head = {"name": one.name, "minus": first.name}
    if one.draw != first.draw:
        return {**head, "why_not": "the plan or the people are others, so that runs cannot be paired"}
    by_seed = {episode.seed: episode for episode in first.episodes}
    pairs = [(episode, by_seed[episode.seed]) for episode in one.episodes if episode.seed in by_seed]
    if not pairs:
        return {**head, "why_not": "no seed is in both, so that runs cannot be paired"}
    if not all(_same_people(*pair) for pair in pairs):
        return {**head, "why_not": "runs of the same seed are of other people, so that they cannot be paired"}
    found: dict[str, Any] = {**head, "shared_seeds": len(pairs)}
    for name in COMPARED:
        gap = np.array([_value(a, name) - _value(b, name) for a, b in pairs])
        found[name] = {**named(gap), "pairs": int(np.isfinite(gap).sum())}
    return found


def _same_people(one: Episode, other: Episode) -> bool:
    """Whether the bodies and desired speeds of all who got out in both runs are the same."""
    both = np.isfinite(one.exit_time) & np.isfinite(other.exit_time)
    return all(
        np.array_equal(a[both], b[both])
        for a, b in ((one.radius, other.radius), (one.desired_speed, other.desired_speed))
    )


def _value(episode: Episode, name: str) -> float:
    if name == "t95":
        return time_of_share(episode.exit_time, 0.95)
    return float("nan") if episode.metrics.unfinished else float(getattr(episode.metrics, name))
