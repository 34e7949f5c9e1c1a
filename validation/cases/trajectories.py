"""Recorded trajectories: the text format of the Jülich archive, first positions, and times at a counting line."""

import gzip
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.files.foreign import rows_in


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Positions of N people over time, sorted by person, then frame."""

    person: Ints  # (R,)  number of the person in the file
    time: Floats  # (R,)  s, frame / frame rate
    position: Floats  # (R, 2)  m

    @property
    def starts(self) -> Floats:
        """First recorded position of every person (N, 2) [m]."""
        return self.position[np.unique(self.person, return_index=True)[1]]

    def crossing_times(self, y: float) -> Floats:
        """Return when each person first crosses the line at ``y`` towards smaller y (N,) [s]; nan for those who do not.

        Linear between frames.
        """
        people = np.unique(self.person)
        times = np.full(len(people), np.nan)
        above, below = self.position[:-1, 1], self.position[1:, 1]
        same = self.person[:-1] == self.person[1:]
        for k in np.flatnonzero(same & (above > y) & (below <= y))[::-1]:  # the first one last: it stays
            part = (above[k] - y) / (above[k] - below[k])
            times[np.searchsorted(people, self.person[k])] = self.time[k] + part * (self.time[k + 1] - self.time[k])
        return times


def find_recording(data: Path) -> Path:
    """Return the one trajectory file (.txt or .txt.gz) in a folder, or the file itself.

    Raises
    ------
    ValueError
        If there is none, or more than one.
    """
    if data.is_file():
        return data
    found = sorted([*data.glob("*.txt"), *data.glob("*.txt.gz")])
    if len(found) != 1:
        what = "no such folder" if not data.is_dir() else f"{len(found)} files *.txt or *.txt.gz"
        raise ValueError(f"{data}: {what}; give the folder that holds the trajectory file, or the file itself")
    return found[0]


def read_trajectories(path: Path, frame_rate: float | None = None, unit: float = 1.0) -> Trajectories:
    """Read a text file with columns id, frame, x, y; further columns are ignored, and a name that ends in .gz is unpacked.

    Parameters
    ----------
    frame_rate : 1/s; by default that of a comment line such as "# framerate: 25".
    unit : m, of the columns x and y.

    Raises
    ------
    ValueError
        If the file cannot be read, has no frame rate, or holds something else than numbers.
    """
    try:
        content = path.read_bytes()
        text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode("utf-8", errors="replace")
    except (OSError, EOFError) as error:
        raise ValueError(f"cannot read the trajectories {path}: {error}") from None
    if frame_rate is None:
        rate = re.search(r"^#.*framerate:\s*([0-9.]+)", text, re.MULTILINE)
        if rate is None or not float(rate[1]) > 0:
            raise ValueError(f"{path}: no comment line such as '# framerate: 25'")
        frame_rate = float(rate[1])
    lines = [line.split() for line in rows_in(text)]
    try:
        rows = np.array([[float(word) for word in line[:4]] for line in lines])
    except ValueError as error:
        raise ValueError(f"{path}: {error}; the columns must be id, frame, x, y") from None
    if rows.ndim != 2 or rows.shape[1] != 4 or not np.isfinite(rows).all():
        raise ValueError(f"{path}: every line needs at least the four numbers id, frame, x, y")
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    return Trajectories(rows[:, 0].astype(np.int64), rows[:, 1] / frame_rate, unit * rows[:, 2:])
