"""Sweeps: how the times of an evacuation follow one of its inputs, with intervals, and which input moves them most."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crowd_env.analysis.figures import FIGURES, named, number, with_interval
from crowd_env.core.checks import Plain
from crowd_env.core.files.csv_table import write_csv
from crowd_env.envs.rollout import Episode

TIMES, HEADS = ("t50", "t95", "evacuation_time"), ("T50", "T95", "last out")  # of `FIGURES`
_JUDGED = "t95"


class Variant(NamedTuple):
    """One value of one input, and its runs."""

    name: str
    value: str  # as it was written
    episodes: list[Episode]


def figures_of(one: Variant, base: Sequence[Episode]) -> Plain:
    """Return the times of a variant [s], and by how much T95 is longer than in runs of the same seeds, ready for JSON.

    Differences are paired run by run (common random numbers): a run in which people were left inside has none.
    """
    at_base = {episode.seed: FIGURES[_JUDGED].of(episode) for episode in base}
    gaps = [FIGURES[_JUDGED].of(episode) - at_base.get(episode.seed, np.nan) for episode in one.episodes]
    return {
        "name": one.name,
        "value": one.value,
        "runs": len(one.episodes),
        "unfinished_runs": sum(episode.metrics.unfinished > 0 for episode in one.episodes),
        **{name: named(np.array([FIGURES[name].of(episode) for episode in one.episodes])) for name in TIMES},
        "t95_difference": named(np.array(gaps), least=-np.inf),
    }


def by_effect(rows: Sequence[Plain]) -> list[Plain]:
    """Return the rows of inputs in the order of their effects: the largest change of T95 by any value, the greatest first."""
    effect: dict[str, float] = {}
    for row in rows:
        effect[row["name"]] = max(effect.get(row["name"], 0.0), abs(row["t95_difference"]["mean"] or 0.0))
    return sorted(rows, key=lambda row: -effect[row["name"]])  # stable: the values of an input stay together


def cells(row: Plain) -> dict[str, str]:
    """Return the row of a table: heading -> cell; T95 and the last person out with the 95 % interval."""
    found = {"runs": str(row["runs"]) + (f", {row['unfinished_runs']} unfinished" if row["unfinished_runs"] else "")}
    found |= {f"{head} [s]": with_interval(row[name]) for name, head in zip(TIMES, HEADS, strict=True)}
    found["T50 [s]"] = number(row["t50"]["mean"], digits=1)
    return found | {"ΔT95 [s]": with_interval(row["t95_difference"], sign="+") if row["t95_difference"]["sd"] else "–"}


def write_sweep(path: Path, rows: Sequence[Plain]) -> Path:
    """Write a row for each value, and return the path."""
    columns = ["name", "value", "runs", "unfinished_runs"]
    figures = (*TIMES, "t95_difference")
    head = columns + [f"{name}{part}" for name in figures for part in ("", "_low", "_high")]
    lines = ([*(row[name] for name in columns), *(x for name in figures for x in _numbers(row[name]))] for row in rows)
    return write_csv(path, head, lines)


def _numbers(figure: Plain) -> list[str]:
    return ["" if value is None else f"{value:.10g}" for value in (figure["mean"], *figure["ci95"])]
