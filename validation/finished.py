"""What a run of the map has finished: a file for each case, scheme and manner, which is neither lost nor computed again.

Rows of bodies that are no discs have a folder of their own, OUTLINE/CASE.

Several processes may fill one folder at the same time, each with other schemes, manners or cases: every file has one writer.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from crowd_env import SCHEMES
from crowd_env.core.behaviors.headway import MANNERS, Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import Plain
from crowd_env.core.files.json_file import read_json
from crowd_env.core.files.store import Store
from crowd_env.core.kernels import jit
from validation.cases.case import DISC, Row, Setting, plain


def of_bodies(folder: Path, outline: Any) -> Path:
    """Return the folder of the rows and pictures of bodies of an outline: that of the run itself for discs."""
    return folder if outline == DISC else folder / str(outline)


class Finished(Store):
    """The folder of a run: ``CASE/SCHEME-MANNER.json``, or ``OUTLINE/CASE/SCHEME-MANNER.json``."""

    def rows(self, case: str, setting: Setting) -> list[Row] | None:
        """Return the rows of a case under a setting; None if they are not here, or not all of them.

        Raises
        ------
        ValueError
            If they are those of another number of draws, seed, manner or version of the compiled physics, or of runs with
            recordings where now there are none.
        """
        content = self.load(_name(case, setting), identity(setting))
        return [Row(**one) for one in content["rows"]] if content is not None and content["complete"] else None

    def keep_rows(self, case: str, setting: Setting, rows: list[Row], complete: bool, seconds: float) -> None:
        """Write the rows of a case under a setting, whole or not at all; a file that holds more of them stays as it is.

        Parameters
        ----------
        complete : these are all of them.
        seconds : s, processor time of this process that they took.
        """
        before = None if complete else self.load(_name(case, setting))
        if before is not None and len(before["rows"]) > len(rows):
            return
        content = {"complete": complete, "seconds": round(seconds, 1), "rows": [one._asdict() for one in rows]}
        self.keep(_name(case, setting), content, identity(setting))


def _name(case: str, setting: Setting) -> str:
    return str(of_bodies(Path(), setting.outline) / case / f"{setting.scheme}-{setting.manner}")


def identity(setting: Setting) -> Plain:
    """Return what decides the rows of a case beside scheme and manner, ready for JSON."""
    walking, outline = Headway.of(setting.manner), Outline.of(setting.outline)
    return {
        "draws": setting.draws,
        "seed": setting.seed,
        "recordings": setting.data is not None,
        "walking": None if walking is None else asdict(walking),
        "outline": None if outline is None else plain(asdict(outline)),
        "kernels": jit.STAMP,
    }


def complete_rows(folder: Path, case: str) -> list[Row]:
    """Return the rows of a case under all schemes and manners that are finished, in the order in which these are listed.

    Raises
    ------
    ValueError
        If a file is broken.
    """
    schemes, manners = list(SCHEMES), list(MANNERS)
    found = []
    for path, content in _complete(folder, case):
        scheme, _, manner = path.stem.rpartition("-")
        found.append((schemes.index(scheme), manners.index(manner), [Row(**one) for one in content["rows"]]))
    return [one for *_, rows in sorted(found) for one in rows]


def draws(folder: Path, case: str) -> tuple[int, int]:
    """Return the fewest and the most draws of a case that is finished under some scheme and manner."""
    found = [content["made_by"]["draws"] for _, content in _complete(folder, case)]
    return min(found), max(found)


def _complete(folder: Path, case: str) -> list[tuple[Path, Plain]]:
    every = [(path, read_json(path)) for path in (folder / case).glob("*.json")]
    return [(path, content) for path, content in every if content["complete"]]
