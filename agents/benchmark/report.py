"""What a comparison of algorithms comes to: scores with intervals, a table, curves, and performance profiles.

The score of a run is the bound of its task over the time of the last person, 0 where somebody was left inside.  The score of a
training is the mean over its draws.  Trainings are summed up by interquartile means over seeds, or over seeds and tasks, with
bootstrap intervals that draw seeds of each task, and by the share of trainings above a score (Agarwal et al. 2021, "Deep
reinforcement learning at the edge of the statistical precipice").
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.analysis.figures import cell
from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.json_file import json_number
from crowd_env.rendering import learning_curve, save_figure

from .. import starts_from
from ..evaluation.plans import interquartile_mean
from ..plain import Plain
from .jobs import ALGORITHMS

Results: TypeAlias = Mapping[str, Mapping[str, Sequence[Plain]]]  # name -> task -> its finished results, one a seed
_RESAMPLES = 20_000
_FEWEST = 10  # seeds: an interval of fewer is too short, see `bootstrap_interval`
_POINTS = 200  # of a curve


def score(times: ArrayLike, bound: float) -> float:
    """Return the mean over runs of ``bound`` [s] over the times (runs,) [s] of the last person; nan or None counts as 0."""
    known = np.array(times, dtype=np.float64)  # None is nan
    return float(np.nan_to_num(bound / known).mean())


def bootstrap_interval(*of_tasks: ArrayLike) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of the interquartile mean of all values, always the same one.

    Seeds are drawn within each task.  Fewer than ten values of a task have no interval, (nan, nan): of 400 samples with one
    hump, and of 400 with two, "95 %" held the true value in 76 and 72 % for 3 values, in 87 and 88 % for 5, in 95 and 91 % for
    10, in 94 and 93 % for 20.

    Parameters
    ----------
    of_tasks : values (seeds,) of each task.
    """
    samples = [np.asarray(values, dtype=np.float64) for values in of_tasks]
    if min(map(len, samples)) < _FEWEST:
        return float("nan"), float("nan")
    from scipy.stats import bootstrap  # which the extra "train" brings

    found = bootstrap(
        samples,
        lambda *drawn, axis: interquartile_mean(np.concatenate(drawn, axis=-1)),
        vectorized=True,
        n_resamples=_RESAMPLES,
        method="percentile",
        random_state=np.random.default_rng(0),
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def _middle(*of_tasks: Floats) -> Plain:
    """Return the interquartile mean and its interval, ready for JSON."""
    every = np.concatenate(of_tasks)
    if not len(every):
        return {"iqm": None, "ci95": [None, None]}
    return {
        "iqm": float(interquartile_mean(every)),
        "ci95": [json_number(one) for one in bootstrap_interval(*of_tasks)],
    }


def summarize(results: Results) -> dict[str, Plain]:
    """Return a row for each algorithm or policy, ready for JSON.

    ``tasks`` holds for each task ``clearing_time``, the interquartile mean over seeds of the mean time of the last person [s]
    over the held-out runs that cleared; ``unfinished`` of ``runs``; ``decisions``, and ``seconds`` of processor time, of a
    training.  ``score`` is over the seeds of all tasks.  ``score_at`` is that of the curves where all algorithms have had as
    many decisions, ``equal`` of each task.
    """
    equal = {task: min(_curve(one)[0][-1] for one in found) for task, found in _trainings(results).items()}
    return {name: _row(name, of_tasks, equal) for name, of_tasks in results.items()}


def _row(name: str, of_tasks: Mapping[str, Sequence[Plain]], equal: Mapping[str, float]) -> Plain:
    first = next(iter(of_tasks.values()))[0]
    row = {
        "tasks": {task: _of_task(found) for task, found in of_tasks.items()},
        "score": _middle(*(_scores(found) for found in of_tasks.values())),
    }
    if "seed" not in first:
        return {"seeds": 0, "start": starts_from(name), **row}
    at = [np.array([_at(equal[task], one) for one in found]) for task, found in of_tasks.items()]
    told = {"seeds": min(map(len, of_tasks.values())), "start": ALGORITHMS[name].begins}
    return {**told, **row, "score_at": _middle(*at), "equal": {task: round(equal[task]) for task in of_tasks}}


def _of_task(found: Sequence[Plain]) -> Plain:
    times = [np.array(one["held_out"]["clearing_times"], dtype=np.float64) for one in found]
    means = np.array([np.nanmean(one) for one in times if np.isfinite(one).any()])
    last = [one["curve"][-1] for one in found if "seed" in one]
    return {
        "clearing_time": _middle(means),
        "unfinished": sum(int(np.isnan(one).sum()) for one in times),
        "runs": sum(map(len, times)),
        "decisions": round(np.mean([row["steps"] for row in last])) if last else None,
        "seconds": float(np.mean([row["seconds"] for row in last])) if last else None,
    }


def _scores(found: Sequence[Plain]) -> Floats:
    return np.array([score(one["held_out"]["clearing_times"], one["bound"]) for one in found])


def _trainings(results: Results) -> dict[str, list[Plain]]:
    """Return the results with a curve, task by task."""
    found: dict[str, list[Plain]] = {}
    for of_tasks in results.values():
        for task, those in of_tasks.items():
            found.setdefault(task, []).extend(one for one in those if "seed" in one)
    return {task: those for task, those in found.items() if those}


def _curve(result: Plain, over: str = "steps") -> tuple[Floats, Floats]:
    """Return decisions, or ``seconds`` of processor time, and scores (T,) of a training."""
    rows = result["curve"]
    scores = [score(row["clearing_times"], result["bound"]) for row in rows]
    return np.array([row[over] for row in rows], dtype=np.float64), np.array(scores)


def _at(where: Floats | float, result: Plain, over: str = "steps") -> Floats:
    return np.asarray(np.interp(where, *_curve(result, over)))


# ---------------------------------------------------------------------------------------------------------- what is shown


def table(rows: Mapping[str, Plain]) -> str:
    """Return the rows as a table in Markdown, the highest score first."""
    tasks = list(dict.fromkeys(task for row in rows.values() for task in row["tasks"]))
    head = ["policy", "starts from", "seeds", *(f"{task}, s" for task in tasks), "score", "at equal decisions"]
    lines = [head, ["---"] * len(head)]
    for name, row in sorted(rows.items(), key=lambda item: -item[1]["score"]["iqm"]):
        cells = [f"`{name}`", row["start"], cell("{seeds}", {"seeds": row["seeds"] or None})]
        cells += [_task_cell(row["tasks"].get(task)) for task in tasks]
        lines.append([*cells, _told(row["score"], 2), _told(row.get("score_at"), 2)])
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _task_cell(found: Plain | None) -> str:
    if found is None:
        return "–"
    left = f", left in {found['unfinished']} of {found['runs']}" if found["unfinished"] else ""
    return _told(found["clearing_time"], 1) + left


def _told(found: Plain | None, digits: int) -> str:
    if found is None or found["iqm"] is None:
        return "–"
    low, high = found["ci95"]
    return f"{found['iqm']:.{digits}f}" + ("" if low is None else f" [{low:.{digits}f}, {high:.{digits}f}]")


def draw(results: Results, folder: Path) -> None:
    """Draw the mean score over tasks while algorithms learn, over CPU seconds and decisions, and the performance profiles.

    A band is the range over seeds.  Only seeds with all tasks are drawn.
    """
    learned = {name: of_tasks for name, of_tasks in results.items() if any("seed" in one for one in _every(of_tasks))}
    for file, over, label in (
        ("algorithms-seconds.png", "seconds", "CPU seconds of a training"),
        ("algorithms-decisions.png", "steps", "decisions of pedestrians"),
    ):
        last = min(_curve(one, over)[0][-1] for of_tasks in learned.values() for one in _every(of_tasks))
        at = np.linspace(0.0, last, _POINTS)
        series = {name: _means(of_tasks, at, over) for name, of_tasks in learned.items()}
        title = "Mean score over tasks: seeds, mean and range"
        save_figure(learning_curve(at, series, title=title, xlabel=label, ylabel="score"), folder / file)
    at = np.linspace(0.0, 1.5, _POINTS)
    above = {
        name: (np.concatenate([_scores(found) for found in of_tasks.values()])[:, None] > at).mean(axis=0)
        for name, of_tasks in learned.items()
    }
    figure = learning_curve(at, above, title="Trainings above a score", xlabel="score", ylabel="share of trainings")
    save_figure(figure, folder / "algorithms-profiles.png")


def _every(of_tasks: Mapping[str, Sequence[Plain]]) -> Iterable[Plain]:
    return (one for found in of_tasks.values() for one in found)


def _means(of_tasks: Mapping[str, Sequence[Plain]], at: Floats, over: str) -> Floats:
    """Return the mean over tasks of the curve (seeds, T) of each seed."""
    of_seeds = zip(*of_tasks.values(), strict=False)
    return np.array([np.mean([_at(at, one, over) for one in those], axis=0) for those in of_seeds])
