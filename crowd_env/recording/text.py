"""Trajectories in text files, as the data archive of Juelich and PedPy have them: ``id frame x y ...``, one row a line.

Comments begin with ``#`` and tell the frame rate (``framerate: 16 fps``) and the unit (``x/cm``, ``x/m``, ``in cm``, ``in m``).
"""

import re
from pathlib import Path

import numpy as np

from crowd_env.core.files.foreign import read_text
from crowd_env.recording.foreign import recording_of_positions
from crowd_env.recording.recording import Recording

_FRAME_RATE = re.compile(r"framerate\D*?(\d+(?:\.\d+)?)", re.IGNORECASE)
_UNITS = (("cm", 0.01), ("m", 1.0))


def read_text_trajectory(path: Path) -> Recording:
    """Return the trajectories of a text file.

    Raises
    ------
    ValueError
        If it is no such file, or says no frame rate or unit.
    """
    text = read_text(
        path, "the trajectory", "a trajectory in text has lines of id, frame, x and y, and comments with #"
    )
    comments = "\n".join(line for line in text.splitlines() if line.startswith("#"))
    rate = _FRAME_RATE.search(comments)
    if rate is None:
        raise ValueError(f"{path}: no frame rate; a comment must tell it, as in '# framerate: 16 fps'")
    named = [size for unit, size in _UNITS if re.search(rf"\b(?:x/|in ){unit}\b", comments, re.IGNORECASE)]
    if not named:
        raise ValueError(f"{path}: no unit; a comment must tell it, as in '# id frame x/m y/m' or '# in cm'")
    try:
        cells = [line.split()[:4] for line in text.splitlines() if line.strip() and not line.startswith("#")]
        rows = np.array(cells, dtype=np.float64).reshape(-1, 4)
    except ValueError as error:
        raise ValueError(f"{path}: a line is not made of id, frame, x and y: {error}") from None
    if not np.isfinite(rows).all():
        raise ValueError(f"{path}: line {int(np.argmin(np.isfinite(rows).all(axis=1))) + 1} of the rows is not finite")
    person, frame = rows[:, :2].T.astype(np.int64)
    return recording_of_positions(path, frame, person, named[0] * rows[:, 2:], float(rate[1]))
