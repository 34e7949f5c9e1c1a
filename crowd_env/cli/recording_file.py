"""``crowd-env run --record``: files of single runs, which grow while these go on."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from crowd_env.analysis.results.config import DECISION_DT
from crowd_env.cli.console import claim
from crowd_env.core.checks import POSITIVE, number
from crowd_env.core.console import check_place
from crowd_env.envs.arguments import parts_of
from crowd_env.envs.rollout import Recorder

_ALL = "all"


@dataclass(frozen=True)
class RecordingFile:
    """``--record``, with ``--record-runs``, ``--record-contacts`` and ``--every`` [s]."""

    path: Path | None
    which: str | None
    contacts: bool
    every: float | None

    def check(self, runs: int) -> None:
        """Raise if an option is out of range or stands alone, the path cannot be written, or a library is missing.

        ``runs`` is how many are made.
        """
        given = {
            "--record-runs": self.which is not None,
            "--record-contacts": self.contacts,
            "--every": self.every is not None,
        }
        for option, there in given.items():
            if there and self.path is None:
                raise ValueError(f"{option} belongs to --record, which is not given")
        if self.every is not None:
            parts_of("--every", number("--every", self.every, POSITIVE, "s"), "decisions", DECISION_DT)
        if self.path is not None:
            from crowd_env.recording.formats import check_writable

            self.numbers(runs)
            check_writable("--record", self.path)
            check_place("--record", self.path)

    def numbers(self, runs: int) -> frozenset[int]:
        """Return which of so many runs are recorded: none without ``--record``, and the first if nothing else is said.

        Raises
        ------
        ValueError
            If one of them is not made, or the option is not understood.
        """
        if self.path is None:
            return frozenset()
        if self.which is None:
            return frozenset({0})
        if self.which == _ALL:
            return frozenset(range(runs))
        found: set[int] = set()
        for part in self.which.split(","):
            ends = part.strip().split("-")
            if len(ends) > 2 or not all(end.strip().isdecimal() for end in ends):
                raise ValueError(
                    f"--record-runs is {self.which!r}; it must be numbers such as 3, 0,3,7 or 0-9, or {_ALL}"
                )
            first, last = int(ends[0]), int(ends[-1])
            if not first <= last < runs:
                raise ValueError(f"--record-runs is {self.which!r}, but the runs are numbered from 0 to {runs - 1}")
            found.update(range(first, last + 1))
        return frozenset(found)

    def recorder(self, context: typer.Context, runs: int, seed: int, facts: Mapping[str, Any]) -> Recorder | None:
        """Return what writes the files, which are this command's alone; None without ``--record``.

        Raises
        ------
        ValueError
            If another command writes them now.
        """
        if self.path is None:
            return None
        from crowd_env.recording import RunRecorder

        claim(context, "--record", self.path, self.path.with_name(f".{self.path.name}.lock"))
        how: dict[str, Any] = {"contacts": self.contacts, "every": self.every, "facts": facts}
        return RunRecorder(self.path, runs=self.numbers(runs), seed=seed, **how)
