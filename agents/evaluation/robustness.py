"""Policies on the variations of a task: what they gain in the task as it stands, and whether they lose it elsewhere."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

from rich.table import Table

from crowd_env import Scenario
from crowd_env.core.console import say
from crowd_env.core.executors import Executor
from crowd_env.envs.tasks.task import Task, place_digest

from ..drivers import Hindrance
from ..plain import Plain
from ..runs import versions
from ..tasks.variations import AS_IT_STANDS, Variation, variations
from .entries import Entry, Unsuited, make_entries
from .evaluation import Evaluation
from .folder import EvaluationFolder, settings_of
from .protocol import credible_lines, task_rows
from .report import task_table
from .same_draws import compare

LEAST_RUNS, PART = 10, 5  # of the draws of a task, by default


class Trial(NamedTuple):
    """Policies on one variation of a task."""

    task: Task
    variation: Variation
    place: Scenario
    entries: list[Entry]
    left_out: list[str]  # policies that cannot move a part of the people, or not in that place


Judged: TypeAlias = tuple[Trial, list[Evaluation]]  # all policies of a trial on the same draws


def facts_of_variation(task: Task, one: Variation, place: Scenario) -> Plain:
    """Return what a variation is, ready for JSON; the digest is of the place."""
    return {
        "variation": one.name,
        "about": one.about,
        "scheme": one.scheme or task.scheme,
        "people": place.population.people,
        "learned_share": one.learned_share or task.learned_share or 1.0,
        "digest": place_digest(place),
    }


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
    entries: list[Entry] = []
    while named:
        try:
            entries = make_entries(named, place, task, learned_share=one.learned_share)
            break
        except Unsuited as error:
            if one is AS_IT_STANDS:
                raise
            named.remove(error.policy)
            left_out.append(error.policy)
    hindrance = Hindrance(**one.hindrances())
    return Trial(task, one, place, [replace(entry, hindrance=hindrance) for entry in entries], left_out)


def judge_trial(
    trial: Trial,
    runs: int,
    seed: int = 0,
    *,
    threads: int = 1,
    folder: Path | None = None,
    executor: Executor | None = None,
) -> list[Evaluation]:
    """Evaluate the policies of a trial on the same draws; from its ``folder`` an interrupted evaluation goes on."""
    task, one, place = trial.task, trial.variation, trial.place
    say(f"{one.name}: {one.about}")
    kept = None
    if folder is not None:
        kept = EvaluationFolder(folder, settings_of(place, runs, seed, task, one.learned_share))
    scheme = one.scheme or task.scheme
    return compare(
        trial.entries, place, [scheme], runs=runs, seed=seed, threads=threads, folder=kept, executor=executor
    )


def summary_of_trials(task: Task, found: Sequence[Judged], runs: int, seed: int) -> Plain:
    """Return everything about policies on the variations of a task but single runs, ready for JSON.

    The rows are those of the protocol with a ``variation``; "task" is the task as it stands.
    """
    return {
        "task": task.identity(),
        "runs": runs,
        "seed": seed,
        "variations": [facts_of_variation(task, one.variation, one.place) for one, _ in found],
        "rows": [
            {**row, "variation": one.variation.name}
            for one, results in found
            for row in task_rows(task, one.place, results)
        ],
        "versions": versions(),
    }


def lines_of_trials(found: Sequence[Judged]) -> list[str]:
    """Return what a table cannot say: which results cannot be believed, and which policies were left out."""
    lines = []
    for trial, results in found:
        name, credible = trial.variation.name, credible_lines(task_rows(trial.task, trial.place, results))
        lines += [f"{name}: {one}" for one in credible if one.startswith("NOT")]
        if trial.left_out:
            lines.append(f"{name}: left out, since they cannot move these people there: {', '.join(trial.left_out)}.")
    return lines


def robustness_table(found: Sequence[Judged], title: str) -> Table:
    """Return the table of a task with a section for each variation."""
    groups = {trial.variation.name: results for trial, results in found}
    return task_table(groups, title, " A variation's policies are judged on the same draws.")
