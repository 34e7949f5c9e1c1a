"""What is said of every policy on a task: the same figures, in the same order, for every task."""

from collections.abc import Sequence

from crowd_env import Scenario
from crowd_env.envs.tasks.task import Task

from ..plain import Plain
from .comparison import rows_beside
from .credible import credibility
from .evaluation import Evaluation

_MEANS = ("contact_impulse", "mean_exit_learned", "mean_exit_others")  # the last two of mixed crowds
_FIGURES = (
    *("max_speed", "escaped", "blocked_share", "unfinished_share", "learned_share", "max_overlap", "constants"),
    *("walked", "max_density", "max_pressure", "crushed_share", "crushed_time", "pressure_is_force", "hurry"),
)


def task_rows(task: Task, place: Scenario, results: Sequence[Evaluation]) -> list[Plain]:
    """Return the `task_figures` of results on a task, each beside the first policy under its scheme."""
    rows = rows_beside(results)
    found = zip(task_figures(task.name, place, rows), rows, strict=True)
    return [{**figures, "minus_first": row["minus_first"]} for figures, row in found]


def task_figures(task: str, place: Scenario, rows: Sequence[Plain]) -> list[Plain]:
    """Return the figures of policies on a task, from their `Evaluation.row`, ready for JSON, in SI units.

    ``blocked`` counts the runs that ended because nobody had got out for ``blocked_after`` of the task, ``unfinished`` all runs
    in which somebody was left inside, blocked ones included.  ``median_time`` is when the last person was out in half of all
    runs, None if more never cleared.  ``clearing_time``, of the last person, and ``mean_exit``, of everybody, are over the runs
    that cleared: no time limit counts as a time.  ``flow`` is the mean over runs of the slope of people out against time.
    ``max_speed`` is of anyone, and ``escaped`` counts people who were found outside of the walls.  Means are over runs, with
    95 % t intervals; shares of runs have Wilson's.

    ``max_pressure`` [N/m] is the greatest contact force on someone over circumference, mean of a decision step;
    ``crushed_share`` the share of people for whom it once exceeded the 1600 N/m of an injury, ``crushed_time`` [s] for how long
    in all.  Where ``pressure_is_force`` is false, the scheme has no forces that anyone would feel.  ``learned_share`` is of the
    people whom the policy moves; the others follow the rule of the task.  ``credible`` holds the result against the rule.
    """
    return [
        {
            "task": task,
            "policy": row["policy"],
            "scheme": row["scheme"],
            "people": place.population.people,
            "runs": row["runs"],
            "blocked": row["blocked_runs"],
            "unfinished": row["unfinished_runs"],
            "median_time": row["median_time"],
            "clearing_time": _mean(row["evacuation_time"]),
            "mean_exit": _mean(row["mean_exit"]),
            "flow": row["flow"]["mean"],
            **{name: row[name] for name in _FIGURES if name in row},  # some are of runs that were measured
            **{name: _mean(row[name]) for name in _MEANS if name in row},
            "left": row["unfinished"],
            "credible": credibility(row, rows, place),
        }
        for row in rows
    ]


def credible_lines(rows: Sequence[Plain]) -> list[str]:
    """Return whether the results of `task_rows` can be believed, in words, and what speaks against it."""
    alone = len({row["scheme"] for row in rows}) == 1
    named = [(row["policy"] if alone else f"{row['policy']} under {row['scheme']}", row["credible"]) for row in rows]
    lines = []
    for ok, words in ((True, "Credible, held against the rule"), (None, "Not held against the rule, add rule")):
        if names := [name for name, found in named if found["ok"] is ok]:
            lines.append(f"{words}: {', '.join(names)}.")
    return lines + [
        f"NOT CREDIBLE: {name}: {'; '.join(found['reasons'])}." for name, found in named if found["ok"] is False
    ]


def _mean(found: Plain) -> Plain:
    """Return mean and interval alone."""
    return {"mean": found["mean"], "ci95": found["ci95"]}
