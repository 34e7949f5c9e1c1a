"""A folder of results that is whole at any moment: an interrupted command goes on with the runs that stand in it."""

import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from crowd_env.analysis.results.config import difference
from crowd_env.analysis.results.tables import EXITS, RUNS, read_tables, write_curve, write_tables
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.rollout import Episode
from crowd_env.scenarios.scenario import Scenario

CONFIG, SUMMARY = "config.json", "summary.json"

# Tables are written as a whole, so that each time costs as much as all runs have become: seldom enough that it is a twentieth
# of the time at most, and not more often than every other second.
_PAUSE, _SHARE = 2.0, 0.05  # s


class ResultsFolder:
    """Keeps the runs of one command; as a context manager it writes those that an error leaves unwritten.

    Parameters
    ----------
    folder : where; it need not exist.
    scenario : what is evacuated.
    config : of `crowd_env.analysis.results.config.run_config`.

    Attributes
    ----------
    finished : the runs that the folder held when it was opened.

    Raises
    ------
    ValueError
        If the folder holds results of something else, or of more runs, or cannot be read.  Nothing has been written.
    """

    def __init__(self, folder: Path, scenario: Scenario, config: dict[str, Any]) -> None:
        self.folder, self._scenario, self._config = folder, scenario, config
        self.finished: list[Episode] = []
        self._due = 0.0
        self._unwritten = False
        if (folder / CONFIG).exists():
            there = read_json(folder / CONFIG)
            if not isinstance(there, dict):
                raise ValueError(f"{folder / CONFIG} is not the config of runs; name another folder")
            other = difference(there, config)
            if other:
                raise ValueError(f"{folder} holds runs of another command: {other}; name another folder")
            self.finished = read_tables(folder, scenario)
        else:
            taken = [name for name in (RUNS, EXITS) if (folder / name).exists()]
            if taken:
                raise ValueError(f"{folder} holds {taken[0]} without {CONFIG}; name another folder")
        if self.finished and self.finished[-1].run >= config["runs"]:
            most = self.finished[-1].run + 1
            raise ValueError(f"{folder} holds {most} runs already; ask for as many, or name another folder")
        self._episodes = {episode.run: episode for episode in self.finished}

    def keep(self, episodes: Sequence[Episode]) -> None:
        """Take finished runs, and write the tables if they have not been written for a while.

        Raises
        ------
        OSError
            If they cannot be written.
        """
        self._episodes.update({episode.run: episode for episode in episodes})
        self._unwritten = True
        begin = time.monotonic()
        if begin >= self._due:
            try:
                self._write()
            finally:  # a full disk is not tried again at once
                end = time.monotonic()
                self._due = end + max(_PAUSE, (end - begin) / _SHARE)

    def finish(self, episodes: Sequence[Episode], summary: dict[str, Any]) -> list[Path]:
        """Write everything of the runs there are, and return the paths.

        Parameters
        ----------
        episodes : all that are finished; an interruption may have come before `keep` was given the last.
        summary : figures of `crowd_env.analysis.results.report.report`.

        Raises
        ------
        OSError
            If something cannot be written.
        """
        self._episodes = {episode.run: episode for episode in episodes}
        paths = [*self._write(), write_curve(self.folder, self._in_order()), self.folder / SUMMARY]
        write_json(self.folder / SUMMARY, summary)
        return [*paths, self.folder / CONFIG]

    def __enter__(self) -> "ResultsFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and self._unwritten:
            self._write()

    def _write(self) -> list[Path]:
        write_json(self.folder / CONFIG, self._config)  # first: without it the tables belong to nothing
        paths = write_tables(self.folder, self._scenario, self._in_order())
        self._unwritten = False
        return paths

    def _in_order(self) -> list[Episode]:
        return [self._episodes[run] for run in sorted(self._episodes)]
