"""What is said of every policy on a task: the same figures, in the same order, for every task."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from crowd_env import Scenario
from crowd_env.analysis.figures import number, percent

from ..tasks.task import Task
from .comparison import minus_first
from .credible import credibility
from .evaluation import Evaluation
from .report import half, table_of, with_interval

_MEANS = ("contact_impulse", "mean_exit_learned", "mean_exit_others")  # the last two of mixed crowds
_FIGURES = (
    *("max_speed", "escaped", "blocked_share", "unfinished_share", "learned_share", "max_overlap", "constants"),
    *("walked", "max_density", "max_pressure", "crushed_share", "crushed_time", "pressure_is_force", "hurry"),
)


def task_row(task: Task, place: Scenario, result: Evaluation, results: Sequence[Evaluation]) -> dict[str, Any]:
    """Return the `task_figures` of one of the ``results`` on a task, beside the first of them."""
    first = next(one for one in results if one.scheme == result.scheme)
    return {
        **task_figures(task.name, place, result.row(), [one.row() for one in results]),
        "minus_first": minus_first(result, first),
    }


def task_figures(
    task: str, place: Scenario, row: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the figures of a policy on a task, ready for JSON, in SI units.

    ``blocked`` counts the runs that ended because nobody had got out for ``blocked_after`` of the task, ``unfinished`` all runs
    in which somebody was left inside, blocked ones included.  ``median_time`` is when the last person was out in half of all
    runs, None if more never cleared.  ``clearing_time``, of the last person, and ``mean_exit``, of everybody, are over the runs
    that cleared: no time limit counts as a time.  ``flow`` is the mean over runs of the slope of people out against time.
    ``max_speed`` is of anyone, and ``escaped`` counts people who were
    found outside of the walls.  Means are over runs, with 95 % t intervals; shares of runs have Wilson's.

    ``max_pressure`` [N/m] is the greatest contact force on someone over circumference, mean of a decision step;
    ``crushed_share`` the share of people for whom it once exceeded the 1600 N/m of an injury, ``crushed_time`` [s] for how long
    in all.  Where ``pressure_is_force`` is false, the scheme has no forces that anyone would feel.  ``learned_share`` is of the
    people whom the policy moves; the others follow the rule of the task.  ``credible`` holds the result against the rule.

    Parameters
    ----------
    row, rows : of `Evaluation.row`, of the policy and of all beside it.
    """
    return {
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


def task_table(
    groups: Mapping[str, Sequence[Evaluation]], title: str, note: str = "", starts: Mapping[str, str] | None = None
) -> Table:
    """Return a table of the figures by which policies are judged on a task, with a section for each group.

    ``starts`` says what policies knew before they learned (`crowd_env.agents.starts_from`): a line below, for want of room.
    """
    for start in dict.fromkeys((starts or {}).values()):
        note += f" Starts from {start}: {', '.join(name for name, told in (starts or {}).items() if told == start)}."
    caption = (
        "Runs of all in which the exits blocked, and in which someone was left inside, blocked ones included; %: with its "
        "95 % interval (Wilson). half: s, when the last person was out in half of all runs. clearing, of the last person, and "
        "mean exit, of everybody: s, in the runs that cleared, with the 95 % interval."
    )

    def cells(result: Evaluation, first: Evaluation) -> dict[str, str]:
        row = result.row()
        return {
            "blocked": f"{row['blocked_runs']} of {row['runs']}",
            "%": percent(row["blocked_share"]),
            "unfinished": str(row["unfinished_runs"]),
            "half": half(row["median_time"]),
            "clearing": with_interval(row["evacuation_time"]),
            "mean exit": with_interval(row["mean_exit"]),
            "flow\n1/s": number(row["flow"]["mean"]),
        }

    return table_of(groups, cells, caption + note, title)


def credible_lines(results: Sequence[Evaluation], place: Scenario) -> list[str]:
    """Return whether results can be believed, in words, and what speaks against it."""
    rows = [one.row() for one in results]
    found = [(one, credibility(row, rows, place)) for one, row in zip(results, rows, strict=True)]
    lines = []
    for ok, words in ((True, "Credible, held against the rule"), (None, "Not held against the rule, add rule")):
        names = [_named(one, results) for one, said in found if said["ok"] is ok]
        if names:
            lines.append(f"{words}: {', '.join(names)}.")
    for one, said in found:
        if said["ok"] is False:
            lines.append(f"NOT CREDIBLE: {_named(one, results)}: {'; '.join(said['reasons'])}.")
    return lines


def _named(result: Evaluation, results: Sequence[Evaluation]) -> str:
    alone = all(one.scheme == result.scheme for one in results)
    return result.policy if alone else f"{result.policy} under {result.scheme}"


def _mean(found: dict[str, Any]) -> dict[str, Any]:
    """Return mean and interval alone."""
    return {"mean": found["mean"], "ci95": found["ci95"]}
