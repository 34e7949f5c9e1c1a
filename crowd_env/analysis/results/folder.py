"""The runs of one command in a folder: what was finished is kept, and the same command goes on with it.

Finished runs are two tables beside it, ``runs.csv``, a row a run, and ``exits.csv``, a row a person; and N(t), how many people
are inside, over time, in one run and in many.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.analysis.figures import exit_names, time_of_share
from crowd_env.analysis.results.config import FREE
from crowd_env.analysis.results.crowding import Crowding, CrowdingRecorder, crowding_of
from crowd_env.analysis.sections import Place, rows_of
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain
from crowd_env.core.files.csv_table import write_csv
from crowd_env.core.files.json_file import json_number, write_json
from crowd_env.core.files.store import Store
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.rollout import Episode
from crowd_env.scenarios.scenario import Scenario

CONFIG, SUMMARY, KEPT, CROWDING = "config.json", "summary.json", "runs", "crowding"

_NUMBERS = ("seed", "end", "time_limit")
_ARRAYS = {"exit_time": np.float64, "exit_index": np.int64, "radius": np.float64, "desired_speed": np.float64}


class ResultsFolder(Store):
    """A folder of finished runs of one place, a file each, by their seeds.

    Parameters
    ----------
    config : of `crowd_env.analysis.results.config.run_config`.
    scenario : that place; a run that cannot be one of it is as good as none.

    Raises
    ------
    ValueError
        If the folder holds results of something else.
    """

    def __init__(self, folder: Path, config: Plain, scenario: Scenario) -> None:
        super().__init__(folder, config, about=CONFIG, free=FREE, owned=_OWNED)
        self._scenario = scenario

    def finished(self) -> list[Episode]:
        """Return the runs of the config that are here, in the order of their numbers."""
        assert self.identity is not None
        first, runs = self.identity["seed"], self.identity["runs"]
        seeds = {int(path.stem) for path in (self.folder / KEPT).glob("*") if path.stem.isdecimal()}
        asked = sorted(seed for seed in seeds if first <= seed < first + runs)
        read = (decode(seed - first, self.load(f"{KEPT}/{seed}")) for seed in asked)
        return [one for seed, one in zip(asked, read, strict=True) if one is not None and self._may_be(one, seed)]

    def _may_be(self, one: Episode, seed: int) -> bool:
        """Return whether a run has the people and exits of the place, and the seed of its name."""
        people, exits = self._scenario.population.people, len(self._scenario.geometry.exits)
        return (
            one.seed == seed and len(one.exit_time) == people and bool(np.isin(one.exit_index, range(-1, exits)).all())
        )

    def end_at(self, runs: int) -> None:
        """Limit the folder to ``runs``: runs beyond are kept, and counted if the command asks for more."""
        assert self.identity is not None
        self.identity["runs"] = runs

    def crowding(self, episodes: Sequence[Episode]) -> list[Crowding]:
        """Return what was collected of these runs; of a damaged file, or one of an older version, nothing."""
        shapes = CrowdingRecorder(self._scenario.geometry).shapes()
        found = (crowding_of(self.load(f"{CROWDING}/{episode.seed}"), shapes) for episode in episodes)
        return [one for one in found if one is not None]

    def keep_runs(self, episodes: Sequence[Episode]) -> None:
        """Write runs that have just ended, and the `Crowding` that was recorded of them.

        Raises
        ------
        OSError
            If they cannot be written.
        """
        for episode in episodes:
            if isinstance(episode.record, dict):  # first: a run that is here has all that was collected of it
                self.keep(f"{CROWDING}/{episode.seed}", episode.record["crowding"]._asdict())
            self.keep(f"{KEPT}/{episode.seed}", encode(episode))

    def finish(self, episodes: Sequence[Episode], summary: Plain, places: Sequence[Place] = ()) -> list[Path]:
        """Write tables, the curve N(t) and the ``summary``; return the paths.

        Crossings are of ``places``.

        Raises
        ------
        OSError
            If something cannot be written.
        """
        # An interruption may have come before the last of them were kept.
        self.keep_runs([one for one in episodes if self.path(f"{KEPT}/{one.seed}") is None])
        write_json(self.about, self.identity)  # with the number of runs, and the command, of now
        write_json(self.folder / SUMMARY, summary)
        paths = [*write_tables(self.folder, self._scenario, episodes), write_curve(self.folder, episodes)]
        if places:
            crossed = (row for one in episodes for row in rows_of(places, one))
            paths.append(write_csv(self.folder / SECTIONS, _SECTION_COLUMNS, crossed))
        return [*paths, self.folder / SUMMARY, self.about]


def encode(episode: Episode) -> Plain:
    """Return a run, ready for JSON to the last bit, without what a recorder kept of it."""
    numbers: dict[str, list[Any]] = {
        name: [json_number(one) for one in getattr(episode, name).tolist()] for name in _ARRAYS
    }
    if episode.entry_time is not None:  # JSON knows neither nan nor inf
        numbers["entry_time"] = [str(one) for one in episode.entry_time.tolist()]
    metrics = {name: json_number(one) for name, one in episode.metrics._asdict().items()}
    crossed = {} if episode.crossings is None else {"crossings": episode.crossings.tolist()}
    return {**{name: getattr(episode, name) for name in _NUMBERS}, "metrics": metrics, **numbers, **crossed}


def decode(run: int, content: Plain | None) -> Episode | None:
    """Return the run of the number ``run`` that was encoded; None if this is no whole run."""
    if content is None:
        return None
    try:
        told: dict[str, Any] = {name: np.array(content[name], dtype=_ARRAYS[name]) for name in _ARRAYS}
        told |= {name: content[name] for name in _NUMBERS}
        metrics: Any = {name: float("nan") if one is None else one for name, one in content["metrics"].items()}
        if "entry_time" in content:
            told["entry_time"] = np.array(content["entry_time"], dtype=np.float64)
        crossed = np.array(content["crossings"], dtype=np.float64).reshape(-1, 4) if "crossings" in content else None
        found = Episode(run, metrics=EpisodeMetrics(**metrics), crossings=crossed, **told)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError):
        return None
    numbers = (found.seed, found.end, found.time_limit, *found.metrics)
    lists = {getattr(found, name).shape for name in _ARRAYS}
    whole = len(lists) == 1 and found.exit_time.ndim == 1 and all(isinstance(one, int | float) for one in numbers)
    return found if whole else None


RUNS, EXITS, CURVE, SECTIONS = "runs.csv", "exits.csv", "nt.csv", "sections.csv"

# What the folder comes to hold, and what says that it is one of ``crowd-env evaluate``.
_OWNED = (RUNS, EXITS, CURVE, SECTIONS, SUMMARY, KEPT, CROWDING, "nt.png", "recordings", "evaluation.json")

# Columns of runs.csv with their units, after run and seed; figures of `EpisodeMetrics` have its names.
_RUN_COLUMNS = ("run", "seed", "people", "end", "time_limit", "t95", *EpisodeMetrics._fields)
_SECTION_COLUMNS = ("run", "section", "towards", "time", "person")
_EXIT_COLUMNS = ("run", "time", "exit", "out", "person", "radius", "desired_speed", "cohort", "until")


def write_tables(folder: Path, scenario: Scenario, episodes: Sequence[Episode]) -> list[Path]:
    """Write both tables, each whole or not at all, and return their paths."""
    cohorts = _cohorts(scenario)
    rows = (row for one in episodes for row in _exits(scenario, cohorts, one))
    return [write_csv(folder / RUNS, _RUN_COLUMNS, map(_run, episodes)), write_csv(folder / EXITS, _EXIT_COLUMNS, rows)]


def write_curve(folder: Path, episodes: Sequence[Episode]) -> Path:
    """Write N(t) over runs, mean and quantiles, and return the path."""
    curve = egress([episode.exit_time for episode in episodes], [episode.entries for episode in episodes])
    columns = ("time", "inside_mean", *(f"inside_q{round(100 * share):02d}" for share in QUANTILES))
    rows = np.column_stack([curve.time, curve.mean, curve.quantiles])
    return write_csv(folder / CURVE, columns, ([f"{value:.10g}" for value in row] for row in rows))


def _cohorts(scenario: Scenario) -> np.ndarray:
    """Return the name of the cohort of each person (N,), or its number if cohorts have none; "" if there is one alone."""
    parts = scenario.population.parts
    names = [part.name or (str(k + 1) if len(parts) > 1 else "") for k, part in enumerate(parts)]
    return np.repeat(names, [part.people for part in parts])


def _run(episode: Episode) -> list[object]:
    times = (episode.end, episode.time_limit, time_of_share(episode.exit_time[episode.came], 0.95))
    return [episode.run, episode.seed, int(episode.came.sum()), *map(_cell, (*times, *episode.metrics))]


def _exits(scenario: Scenario, cohorts: np.ndarray, episode: Episode) -> list[tuple[object, ...]]:
    """Return the rows of a run in the order of time; pedestrians left inside come last, without a time and an exit."""
    names = exit_names(scenario, episode.exit_index)
    order = np.argsort(episode.exit_time, kind="stable")  # nan go last
    rows: list[tuple[object, ...]] = []
    for k in order[episode.came[order]]:
        time, *body = (_cell(float(one[k])) for one in (episode.exit_time, episode.radius, episode.desired_speed))
        until = "" if time else _cell(episode.end)
        rows.append((episode.run, time, names[k], int(bool(time)), int(k), *body, cohorts[k], until))
    return rows


def _cell(value: float | int) -> str:
    """Return a number with all of its digits; nan is an empty cell."""
    return "" if value != value else str(value)


QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_MOST_ROWS = 1000
_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # s


class Egress(NamedTuple):
    """How many are inside at T times, over runs; a run that has ended stays as it ended."""

    time: Floats  # (T,)  s
    mean: Floats  # (T,)
    quantiles: Floats  # (T, Q)  of `QUANTILES`


def inside(exit_time: Floats, time: Floats, entry_time: Floats | None = None) -> np.ndarray:
    """Return how many people are inside at ``time`` (T,) [s]; ``exit_time`` (N,) [s] is nan for a pedestrian left inside.

    ``entry_time`` (M,) [s] is that of the people that came; nan for one that could not enter.
    """
    come = len(exit_time) if entry_time is None else np.searchsorted(np.sort(entry_time), time, side="right")
    return come - np.searchsorted(np.sort(exit_time), time, side="right")


def egress(exit_times: Sequence[Floats], entry_times: Sequence[Floats | None] | None = None) -> Egress:
    """Return N(t) over runs from the exit and entry times (N,) [s] of each, at round times up to the last exit of all."""
    known = np.concatenate([times[np.isfinite(times)] for times in exit_times])
    end = float(known.max(initial=0.0))
    step = next((step for step in _STEPS if end / step < _MOST_ROWS), _STEPS[-1])
    # whole multiples over whole parts: 0.3, not 0.30000000000000004
    time = np.round(np.arange(np.ceil(end / step - 1e-9) + 1) * step, 1)
    entries = entry_times or [None] * len(exit_times)
    counts = np.array([inside(times, time, came) for times, came in zip(exit_times, entries, strict=True)])
    return Egress(time, counts.mean(axis=0), np.quantile(counts, QUANTILES, axis=0).T)
