"""What the tables of docs/tables/ are made of: what commands print, and the files of the folder of a finished run."""

import json
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from crowd_env.core.files.json_file import read_json
from validation.cases.case import DISC
from validation.finished import complete_rows, draws, of_bodies
from validation.pages import ROOT


class Source:
    """What a table is made of: what commands print, or the files of the folder that a finished run has written."""

    def __init__(self, command: Callable[[str], dict[str, Any]], folder: Path | None = None) -> None:
        self._command, self._folder = cache(command), folder

    def __call__(self, line: str) -> dict[str, Any]:
        """Return the object that ``python -m LINE --json`` prints."""
        return self._command(line)

    @property
    def folder(self) -> Path:
        """Folder of the finished run; ValueError if none is named."""
        if self._folder is None:
            raise ValueError("this table is made of the folder that a finished run has written; name it by --from")
        return self._folder

    def read(self, file: str) -> Any:
        """Return the content of a JSON file of the finished run; ValueError if there is none."""
        return read_json(self.folder / file)

    def rows(self, *cases: str, outline: str = DISC) -> list[dict[str, Any]]:
        """Return the finished rows of cases, with how often each was drawn; ValueError if there are none."""
        folder, found = of_bodies(self.folder, outline), []
        for case in cases:
            if some := complete_rows(folder, case):
                least, most = draws(folder, case)
                times = str(least) if least == most else f"{least} to {most}"
                found += [{**row._asdict(), "draws": times} for row in some]
        if not found:
            raise ValueError(f"{folder} holds no finished rows of {', '.join(cases)}")
        return found


def run(line: str) -> dict[str, Any]:
    """Run ``python -m LINE --json`` and return the object that it prints; ValueError if the command fails."""
    words = [sys.executable, "-m", *line.split(), "--json"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(f"python -m {line} --json failed: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
    return dict(json.loads(done.stdout))
