"""Policies on the variations of a task: what they gain in the task as it stands, and whether they lose it elsewhere."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from rich.table import Table

from crowd_env import Scenario
from crowd_env.core.console import say

from ..drivers import Hindrance
from ..runs import versions
from ..tasks.task import Task, place_digest
from ..tasks.variations import AS_IT_STANDS, Variation, variations
from .entries import Entry, Unsuited, make_entries
from .evaluation import Evaluation
from .folder import EvaluationFolder, settings_of
from .protocol import credible_lines, task_row, task_table

LEAST_RUNS, PART = 10, 5  # of the draws of a task, by default


class Trial(NamedTuple):
    """Policies on one variation of a task."""

    variation: Variation
    place: Scenario
    scheme: str
    entries: list[Entry]
    left_out: list[str]  # policies that cannot move a part of the people, or not in that place


def facts_of_variation(task: Task, one: Variation, place: Scenario) -> dict[str, Any]:
    """Return what a variation is, ready for JSON; the digest is of the place."""
    return {
        "variation": one.name,
        "about": one.about,
        "scheme": one.scheme or task.scheme,
        "people": place.population.people,
        "learned_share": one.learned_share or task.learned_share or 1.0,
        "digest": place_digest(place),
    }


Found = Sequence[tuple[Trial, Sequence[Evaluation]]]


def few_runs(task: Task) -> int:
    """Return the draws of each variation by default: a fifth of those of the task."""
    return max(LEAST_RUNS, task.runs // PART)


def make_trials(task: Task, policies: Sequence[str]) -> list[Trial]:
    """Return a trial for the task as it stands and for each variation, before any of them is run.

    Raises
    ------
    ValueError
        As `make_entries`, and if people do not fit.
    """
    return [make_trial(task, one, policies) for one in variations(task)]


def make_trial(task: Task, one: Variation, policies: Sequence[str]) -> Trial:
    """Return a trial of one variation; see `make_trials`."""
    place, named = one.place(task), list(policies)
    left_out: list[str] = []
    while True:
        try:
            entries = make_entries(named, place, task, learned_share=one.learned_share)
            hindered = [replace(entry, hindrance=Hindrance(**one.hindrances())) for entry in entries]
            return Trial(one, place, one.scheme or task.scheme, hindered, left_out)
        except Unsuited as error:
            if one is AS_IT_STANDS:
                raise
            if len(named) == 1:
                return Trial(one, place, one.scheme or task.scheme, [], [*left_out, error.policy])
            named.remove(error.policy)
            left_out.append(error.policy)


def judge_trial(
    task: Task,
    trial: Trial,
    compare: Callable[..., list[Evaluation]],
    *,
    runs: int,
    seed: int = 0,
    threads: int = 1,
    out: Path | None = None,
) -> list[Evaluation]:
    """Evaluate the policies of a trial on the same draws.

    Parameters
    ----------
    compare : `crowd_env.agents.evaluation.same_draws.compare`, or what does its work elsewhere.
    out : holds a folder for each variation, from which an interrupted evaluation goes on.
    """
    say(f"{trial.variation.name}: {trial.variation.about}")
    kept = None
    if out is not None:
        settings = settings_of(trial.place, runs, seed, task, trial.variation.learned_share)
        kept = EvaluationFolder(out / trial.variation.name, settings)
    return compare(trial.entries, trial.place, [trial.scheme], runs=runs, seed=seed, threads=threads, folder=kept)


def summary_of_trials(task: Task, found: Found, runs: int, seed: int) -> dict[str, Any]:
    """Return everything about policies on the variations of a task but single runs, ready for JSON.

    The rows are those of the protocol with a ``variation``; "task" is the task as it stands.
    """
    return {
        "task": task.identity(),
        "runs": runs,
        "seed": seed,
        "variations": [facts_of_variation(task, one.variation, one.place) for one, _ in found],
        "rows": [
            {**task_row(task, trial.place, one, results), "variation": trial.variation.name}
            for trial, results in found
            for one in results
        ],
        "versions": versions(),
    }


def lines_of_trials(found: Found) -> list[str]:
    """Return what a table cannot say: which results cannot be believed, and which policies were left out."""
    lines = []
    for trial, results in found:
        name = trial.variation.name
        lines += [f"{name}: {one}" for one in credible_lines(results, trial.place) if one.startswith("NOT")]
        if trial.left_out:
            lines.append(f"{name}: left out, since they cannot move these people there: {', '.join(trial.left_out)}.")
    return lines


def robustness_table(found: Found, title: str) -> Table:
    """Return the table of a task with a section for each variation."""
    groups = {trial.variation.name: results for trial, results in found}
    return task_table(groups, title, " A variation's policies are judged on the same draws.")
