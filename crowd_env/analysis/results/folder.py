"""The runs of one command in a folder: what was finished is kept, and the same command goes on with it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.analysis.results.config import FREE
from crowd_env.analysis.results.tables import RUNS, write_curve, write_tables
from crowd_env.core.files.json_file import json_number, write_json
from crowd_env.core.files.store import Store
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.rollout import Episode
from crowd_env.scenarios.scenario import Scenario

CONFIG, SUMMARY, KEPT = "config.json", "summary.json", "runs"

_ARRAYS = ("exit_time", "exit_index", "radius", "desired_speed")


class ResultsFolder(Store):
    """A folder of finished runs of one place, a file each, by their seeds.

    Parameters
    ----------
    config : of `crowd_env.analysis.results.config.run_config`.

    Raises
    ------
    ValueError
        If the folder holds results of something else, or tables of version 0.1.0, which kept no runs.
    """

    def __init__(self, folder: Path, config: dict[str, Any]) -> None:
        super().__init__(folder, config, about=CONFIG, free=FREE)
        if (folder / RUNS).exists() and not (folder / KEPT).exists():
            raise ValueError(
                f"{folder} holds {RUNS} without the runs that it is made of, as version 0.1.0 left it; run the command again, "
                "into another folder"
            )

    def finished(self) -> list[Episode]:
        """Return the runs of the config that are here, in the order of their numbers."""
        assert self.identity is not None
        first, runs = self.identity["seed"], self.identity["runs"]
        kept = ((run, self.load(f"{KEPT}/{first + run}")) for run in range(runs))
        return [decode(run, content) for run, content in kept if content is not None]

    def keep_runs(self, episodes: Sequence[Episode]) -> None:
        """Write runs that have just ended.

        Raises
        ------
        OSError
            If they cannot be written.
        """
        for episode in episodes:
            self.keep(f"{KEPT}/{episode.seed}", encode(episode))

    def finish(self, scenario: Scenario, episodes: Sequence[Episode], summary: dict[str, Any]) -> list[Path]:
        """Write tables, the curve N(t) and the ``summary``; return the paths.

        Raises
        ------
        OSError
            If something cannot be written.
        """
        # An interruption may have come before the last of them were kept.
        self.keep_runs([one for one in episodes if self.path(f"{KEPT}/{one.seed}") is None])
        write_json(self.about, self.identity)  # with the number of runs, and the command, of now
        write_json(self.folder / SUMMARY, summary)
        paths = [*write_tables(self.folder, scenario, episodes), write_curve(self.folder, episodes)]
        return [*paths, self.folder / SUMMARY, self.about]


def encode(episode: Episode) -> dict[str, Any]:
    """Return a run, ready for JSON to the last bit, without what a recorder kept of it."""
    numbers = {name: [json_number(one) for one in getattr(episode, name).tolist()] for name in _ARRAYS}
    metrics = {name: json_number(one) for name, one in episode.metrics._asdict().items()}
    return {
        "seed": episode.seed,
        "end": episode.end,
        "time_limit": episode.time_limit,
        "metrics": metrics,
        **numbers,
    }


def decode(run: int, content: dict[str, Any]) -> Episode:
    """Return the run of the number ``run`` that was encoded."""
    index = np.array(content["exit_index"], dtype=np.int64)
    told: dict[str, Any] = {name: np.array(content[name], dtype=np.float64) for name in _ARRAYS if name != "exit_index"}
    told |= {name: content[name] for name in ("seed", "end", "time_limit")}
    metrics: dict[str, Any] = {name: float("nan") if one is None else one for name, one in content["metrics"].items()}
    return Episode(run, metrics=EpisodeMetrics(**metrics), exit_index=index, **told)
