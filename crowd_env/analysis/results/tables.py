"""Finished runs as two tables: ``runs.csv``, a row a run, and ``exits.csv``, a row a person."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crowd_env.analysis.figures import exit_names, time_of_share
from crowd_env.analysis.results.egress import QUANTILES, egress
from crowd_env.core.files.csv_table import write_csv
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.rollout import Episode
from crowd_env.scenarios.scenario import Scenario

RUNS, EXITS, CURVE = "runs.csv", "exits.csv", "nt.csv"

# Columns of runs.csv with their units, after run and seed; those of `EpisodeMetrics` have its names.
_RUN_COLUMNS = ("run", "seed", "people", "end", "time_limit", "t95", *EpisodeMetrics._fields)
_EXIT_COLUMNS = ("run", "time", "exit", "out", "person", "radius", "desired_speed", "group", "until")


def write_tables(folder: Path, scenario: Scenario, episodes: Sequence[Episode]) -> list[Path]:
    """Write both tables, each whole or not at all, and return their paths."""
    groups = _groups(scenario)
    rows = (row for one in episodes for row in _exits(scenario, groups, one))
    return [write_csv(folder / RUNS, _RUN_COLUMNS, map(_run, episodes)), write_csv(folder / EXITS, _EXIT_COLUMNS, rows)]


def write_curve(folder: Path, episodes: Sequence[Episode]) -> Path:
    """Write N(t) over runs, mean and quantiles, and return the path."""
    curve = egress([episode.exit_time for episode in episodes])
    columns = ("time", "inside_mean", *(f"inside_q{round(100 * share):02d}" for share in QUANTILES))
    rows = np.column_stack([curve.time, curve.mean, curve.quantiles])
    return write_csv(folder / CURVE, columns, ([f"{value:.10g}" for value in row] for row in rows))


def _groups(scenario: Scenario) -> np.ndarray:
    """Return the name of the group of each person (N,), or its number if groups have none; "" if there is one alone."""
    parts = scenario.population.parts
    names = [part.name or (str(k + 1) if len(parts) > 1 else "") for k, part in enumerate(parts)]
    return np.repeat(names, [part.people for part in parts])


def _run(episode: Episode) -> list[object]:
    metrics = [_cell(value) for value in episode.metrics]
    first = (episode.run, episode.seed, len(episode.exit_time))
    return [
        *first,
        _cell(episode.end),
        _cell(episode.time_limit),
        _cell(time_of_share(episode.exit_time, 0.95)),
        *metrics,
    ]


def _exits(scenario: Scenario, groups: np.ndarray, episode: Episode) -> list[tuple[object, ...]]:
    """Return the rows of a run in the order of time; the people who stayed come last, without a time and an exit."""
    names = exit_names(scenario, episode.exit_index)
    order = np.argsort(episode.exit_time, kind="stable")  # nan go last
    rows: list[tuple[object, ...]] = []
    for k in order:
        out = bool(np.isfinite(episode.exit_time[k]))
        body = (_cell(float(one)) for one in (episode.radius[k], episode.desired_speed[k]))
        first = (episode.run, _cell(float(episode.exit_time[k])), names[k], int(out), int(k))
        rows.append((*first, *body, groups[k], "" if out else _cell(episode.end)))
    return rows


def _cell(value: float | int) -> str:
    """Return a number with all of its digits; nan is an empty cell."""
    return "" if value != value else str(value)
