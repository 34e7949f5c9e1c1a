"""Finished runs as two tables, and back again to the last bit: ``runs.csv``, a row a run, and ``exits.csv``, a row a person."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.analysis.results.egress import QUANTILES, egress
from crowd_env.analysis.results.report import exit_names, time_of_share
from crowd_env.core.files.csv_table import Row, Table, read_table, write_csv
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.rollout import Episode
from crowd_env.scenarios.scenario import Scenario

RUNS, EXITS, CURVE = "runs.csv", "exits.csv", "nt.csv"

# Columns of runs.csv with their units, after run and seed; those of `EpisodeMetrics` have its names.
_WHOLE = ("unfinished", "escaped", "unconverged")
_RUN_COLUMNS = ("run", "seed", "people", "end", "time_limit", "t95", *EpisodeMetrics._fields)
_EXIT_COLUMNS = ("run", "time", "exit", "out", "person", "radius", "desired_speed", "group")
# Older tables lack this column: of those who stayed inside they hold one row a run, with the time of its end.
_UNTIL = "until"


def write_tables(folder: Path, scenario: Scenario, episodes: Sequence[Episode]) -> list[Path]:
    """Write both tables, each whole or not at all, and return their paths.

    The exits come first, so that a run that stands in ``runs.csv`` has its exits.
    """
    groups = _groups(scenario)
    exits = write_csv(
        folder / EXITS, (*_EXIT_COLUMNS, _UNTIL), (row for one in episodes for row in _exits(scenario, groups, one))
    )
    return [write_csv(folder / RUNS, _RUN_COLUMNS, map(_run, episodes)), exits]


def write_curve(folder: Path, episodes: Sequence[Episode]) -> Path:
    """Write N(t) over runs, mean and quantiles, and return the path."""
    curve = egress([episode.exit_time for episode in episodes])
    columns = ("time", "inside_mean", *(f"inside_q{round(100 * share):02d}" for share in QUANTILES))
    rows = np.column_stack([curve.time, curve.mean, curve.quantiles])
    return write_csv(folder / CURVE, columns, ([f"{value:.10g}" for value in row] for row in rows))


def read_tables(folder: Path, scenario: Scenario) -> list[Episode]:
    """Return the runs of a folder, in the order of their numbers; none if it has no table yet.

    Raises
    ------
    ValueError
        If a table is not as `write_tables` leaves it; the file and row are named.
    """
    if not (folder / RUNS).exists():
        return []
    runs = read_table(folder / RUNS, "the finished runs", _RUN_COLUMNS, "SI units", "a run")
    exits = read_table(folder / EXITS, "the exit times", _EXIT_COLUMNS, "SI units", "a person")
    of_run: dict[str, list[Row]] = {}
    for row in exits.rows:
        of_run.setdefault(row.cells["run"], []).append(row)
    found = [_episode(scenario, runs, row, exits, of_run.get(row.cells["run"], [])) for row in runs.rows]
    return sorted(found, key=lambda episode: episode.run)


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
    """Return a number so that reading it gives the same one; nan is an empty cell."""
    return "" if value != value else str(value)


def _episode(scenario: Scenario, runs: Table, row: Row, exits: Table, rows: Sequence[Row]) -> Episode:
    what = f"row {row.number}"

    def value(name: str) -> Any:
        number = float("nan") if row.cells[name] == "" else runs.number(row, name, what)
        return number if name not in _WHOLE else int(number)

    metrics = EpisodeMetrics(**{name: value(name) for name in EpisodeMetrics._fields})
    people = scenario.population.people
    columns = np.full((3, people), np.nan)  # exit time, radius, desired speed
    index = np.full(people, -1, dtype=np.int64)
    told = [one for one in rows if one.cells["person"]]
    try:
        for one in told:
            k, out, what = int(one.cells["person"]), one.cells["out"] == "1", f"row {one.number}"
            columns[:, k] = [
                exits.number(one, name, what) if out or one.cells[name] else float("nan")
                for name in ("time", "radius", "desired_speed")
            ]
            if out:
                index[k] = scenario.geometry.exit_names.index(one.cells["exit"])
        number, seed = int(row.cells["run"]), int(row.cells["seed"])
    except (ValueError, IndexError):
        raise ValueError(f"{exits.path}: the exits of run {row.cells['run']!r} are not those of this place") from None
    count = int((index >= 0).sum())
    if count + metrics.unfinished != people:
        raise ValueError(
            f"{exits.path}: run {number} has {count} exits; {people} people without {metrics.unfinished} were expected"
        )
    return Episode(number, seed, metrics, columns[0], index, columns[1], columns[2], value("time_limit"), value("end"))
