"""How far runs are while they are under way, also in other processes: simulated seconds and people out of each."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.rollout import Episode

_EVERY = 0.2  # s  of the clock on the wall between two looks: a few a second cost nothing that could be measured


class Sofar(NamedTuple):
    """What all runs together have come to."""

    seconds: float  # s  simulated
    out: int  # people


class Tally:
    """A row a run, which the process that computes it writes and this one reads: a `crowd_env.envs.rollout.Watch`.

    The rows lie in a temporary file that is mapped into the memory of all processes of this machine; a copy, or a pickle,
    writes into the same rows.  As a context manager it removes the file.

    Attributes
    ----------
    begun : s of `time.monotonic`, when the last batch of this process was about to take its first step.
    spent : s, how long it took after that step, in which what is not compiled is compiled.
    decisions : how many steps that were.
    """

    def __init__(self, runs: int) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="crowd-env-")
        self._open(Path(self._folder.name) / "rows", runs, "w+")

    def _open(self, path: Path, runs: int, mode: Any) -> None:
        self._path = path
        self._rows = np.memmap(path, np.float64, mode, shape=(runs, 2))
        self._due = self._first = self.begun = self.spent = 0.0
        self.decisions = 0

    def __enter__(self) -> "Tally":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        del self._rows
        self._folder.cleanup()

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopened, (self._path, len(self._rows))

    def look(self, runs: Sequence[int], env: CrowdEnv, over: bool) -> None:
        """Write the rows of a batch, if it is time to, or the batch is over."""
        now = time.monotonic()
        if not env.simulation.state.time.any():
            self.begun, self.decisions, self._due = now, -1, now
        else:
            self.decisions += 1
            self._first = now if self.decisions == 0 else self._first
            self.spent = now - self._first
        if now < self._due and not over:
            return
        self._due = now + _EVERY
        out = np.isfinite(env.simulation.state.exit_time)
        self._rows[list(runs), 0] = env.simulation.state.time
        self._rows[list(runs), 1] = np.add.reduceat(out, env.env_start[:-1], dtype=np.int64)

    def take(self, episode: Episode) -> None:
        """Write the row of a run that is over, and that nobody has watched."""
        self._rows[episode.run] = episode.end, int(np.isfinite(episode.exit_time).sum())

    def sofar(self) -> Sofar:
        """Return what all runs together have come to by now."""
        seconds, out = self._rows.sum(axis=0)
        return Sofar(float(seconds), int(out))


def _reopened(path: Path, runs: int) -> Tally:
    tally = Tally.__new__(Tally)
    tally._open(path, runs, "r+")
    return tally
