"""The learning curve of a training: its rows, its file, and its best row."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.csv_table import write_csv

from ..evaluation.comparison import last_times
from ..evaluation.evaluation import Evaluation
from ..evaluation.plans import Outcome

CURVE = "learning_curve.csv"
SEARCH = "search_curve.csv"  # of a search before the training, with the same columns
MARGIN = 0.5  # s: a smaller difference of evacuation times does not count

# evacuation_time and its standard error are over all validation draws; pedestrians left inside count as in
# `Evaluation.times_of_all`.  reward is the mean return of the episodes that ended since the row before.
CURVE_COLUMNS = (
    *("steps", "seconds", "cpu_seconds", "evacuation_time", "standard_error"),
    *("unfinished", "contact_impulse", "reward", "episodes"),
)


def standard_error(values: Floats) -> float:
    """Return the standard error of the mean of at least two values."""
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def figures_of(result: Evaluation) -> dict[str, float]:
    """Return the figures of an evaluation in a learning curve."""
    times = last_times(result)
    return {
        "evacuation_time": float(times.mean()),
        "standard_error": standard_error(times) if len(times) > 1 else np.nan,
        "unfinished": float(result.column("unfinished").sum()),
        "contact_impulse": float(result.column("contact_impulse").mean()),
    }


def figures_in_plans(outcomes: Sequence[Outcome[float]]) -> dict[str, float]:
    """Return the figures of evacuations in generated places in a learning curve.

    ``unfinished`` is the number of places with a pedestrian left inside or astray.  ``evacuation_time`` is the interquartile
    mean over places, with the standard error of a mean of the middle half.
    """
    missing = np.array([one.left + one.strayed for one in outcomes]) > 0.0
    times = np.sort(np.where(missing, np.inf, [one.time for one in outcomes]))
    middle = times[len(times) // 4 : len(times) - len(times) // 4]
    return {
        "evacuation_time": float(middle.mean()),
        "standard_error": standard_error(middle) if np.isfinite(middle).all() else np.inf,
        "unfinished": float(missing.sum()),
        "contact_impulse": float(np.mean([one.impulse for one in outcomes])),
    }


def score(row: Mapping[str, float]) -> tuple[float, float]:
    """Return the key that ranks a row: fewer pedestrians left inside first, then a shorter evacuation."""
    return row["unfinished"], row["evacuation_time"]


def best_row(curve: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the best row: the one with least contact within `MARGIN` of the shortest evacuation so far."""
    best, soonest = curve[0], score(curve[0])

    def near(row: Mapping[str, float]) -> bool:
        return row["unfinished"] == soonest[0] and row["evacuation_time"] <= soonest[1] + MARGIN

    for row in curve[1:]:
        soonest = min(soonest, score(row))
        if near(row) and (not near(best) or row["contact_impulse"] < best["contact_impulse"]):
            best = row
    return best


def write_curve(path: Path, curve: Sequence[Mapping[str, float]]) -> None:
    """Write a learning curve as CSV, whole or not at all."""
    write_csv(path, CURVE_COLUMNS, ([row[name] for name in CURVE_COLUMNS] for row in curve))


def read_curve(path: Path) -> list[dict[str, float]]:
    """Read a learning curve; a missing file is an empty curve.

    Raises
    ------
    ValueError
        If the file has other columns, or an entry is no number.
    """
    if not path.exists():
        return []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        if not rows or tuple(rows[0]) != CURVE_COLUMNS:
            raise ValueError(f"its columns must be {', '.join(CURVE_COLUMNS)}")
        return [{name: float(row[name]) for name in CURVE_COLUMNS} for row in rows]
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"cannot resume from {path}: {error}") from None
