"""Recordings from other programs: positions alone, frame by frame.

Text files are as in PedPy and the data archive of Juelich: ``id frame x y ...``, one row a line.  Comments begin with
``#`` and hold the frame rate (``framerate: 16 fps``) and the unit (``x/cm``, ``x/m``, ``in cm``, ``in m``).
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.core.checks import at
from crowd_env.core.files.foreign import read_text, rows_in

_RADIUS = 0.2  # m, where a file has no bodies
_FRAME_RATE = re.compile(r"framerate\D*?(\d+(?:\.\d+)?)", re.IGNORECASE)
_UNITS = (("cm", 0.01), ("m", 1.0))
_MARGIN = 0.5  # m, around positions of which no walkable area is known


def recording_of_positions(
    path: Path, frame: Ints, person: Ints, position: Floats, fps: float, walkable: str | None = None
) -> dict[str, Any]:
    """Return the fields of a recording of positions: the frame (R,), the person (R,) and the position (R, 2) [m] of each row.

    Pedestrians are renumbered, in the order of their numbers in the file.  Velocities are differences between the rows before
    and after.  A pedestrian without a row in the last frame has got out, one frame after its last row.  Every radius is 0.2 m;
    unknown values are nan, and an unknown walkable area is the box around all positions.

    Raises
    ------
    ValueError
        If there is no row, the frame rate is not positive, or a person is in two places at once.
    """
    if not len(frame):
        raise ValueError(f"{path} holds no positions")
    if not fps > 0.0:
        raise ValueError(f"{path}: the frame rate is {fps:g}; it must be positive")
    order = np.lexsort((person, frame))
    frame, position = frame[order] - frame.min(), position[order]
    numbers, person = np.unique(person[order], return_inverse=True)
    same = np.flatnonzero((np.diff(frame) == 0) & (np.diff(person) == 0))
    if len(same):
        raise ValueError(f"{path}: {numbers[person[same[0]]]} has two positions in frame {frame[same[0]]}")
    frames = int(frame[-1]) + 1
    last = np.zeros(len(numbers), dtype=np.int64)
    np.maximum.at(last, person, frame)
    if walkable is None:
        (x0, y0), (x1, y1) = position.min(axis=0) - _MARGIN, position.max(axis=0) + _MARGIN
        walkable = f"POLYGON (({x0} {y0}, {x1} {y0}, {x1} {y1}, {x0} {y1}, {x0} {y0}))"
    return {
        "facts": {"file": path.name, "people": len(numbers), "every": 1.0 / fps, "outline": "disc", "finished": True},
        "walkable": walkable,
        "thin_walls": np.zeros((0, 2, 2)),
        "doors": (),
        "exits": (),
        "cohorts": ("",),
        "times": np.arange(frames) / fps,
        "frame_start": row_starts(np.bincount(frame, minlength=frames)),
        "radius": np.full(len(numbers), _RADIUS),
        "desired_speed": np.full(len(numbers), np.nan),
        "cohort": np.zeros(len(numbers), dtype=np.int64),
        "exit_time": np.where(last < frames - 1, (last + 1) / fps, np.nan),
        "exit_index": np.full(len(numbers), -1, dtype=np.int64),
        "person": person.astype(np.int64),
        "position": position,
        "velocity": _velocity(person, frame, position, fps),
        "pressure": np.full(len(frame), np.nan),
    }


def _velocity(person: Ints, frame: Ints, position: Floats, fps: float) -> Floats:
    """Return (position after - position before) over the time between them, for each row (R,)."""
    order = np.lexsort((frame, person))
    who, when, where = person[order], frame[order], position[order]
    row = np.arange(len(order))
    after = np.minimum(row + 1, len(row) - 1)
    after = np.where(who[after] == who, after, row)
    before = np.maximum(row - 1, 0)
    before = np.where(who[before] == who, before, row)
    span = (when[after] - when[before]) / fps
    velocity = np.empty_like(position)
    velocity[order] = (where[after] - where[before]) / np.where(span > 0.0, span, 1.0)[:, None]
    return velocity


def read_text_trajectory(path: Path) -> dict[str, Any]:
    """Return the fields of a recording of the trajectories in a text file.

    Raises
    ------
    ValueError
        If it is no such file, or has no frame rate or unit.
    """
    form = "a trajectory in text has lines of id, frame, x and y, and comments with #"
    text = read_text(path, "the trajectory", form)
    comments = "\n".join(line for line in text.splitlines() if line.startswith("#"))
    rate = _FRAME_RATE.search(comments)
    if rate is None:
        raise ValueError(f"{path}: no frame rate; a comment must tell it, as in '# framerate: 16 fps'")
    named = [size for unit, size in _UNITS if re.search(rf"\b(?:x/|in ){unit}\b", comments, re.IGNORECASE)]
    if not named:
        raise ValueError(f"{path}: no unit; a comment must tell it, as in '# id frame x/m y/m' or '# in cm'")
    with at(f"{path}: a line is not made of id, frame, x and y"):
        cells = [line.split()[:4] for line in rows_in(text)]
        rows = np.array(cells, dtype=np.float64).reshape(-1, 4)
    if not np.isfinite(rows).all():
        raise ValueError(f"{path}: line {int(np.argmin(np.isfinite(rows).all(axis=1))) + 1} of the rows is not finite")
    person, frame = rows[:, :2].T.astype(np.int64)
    return recording_of_positions(path, frame, person, named[0] * rows[:, 2:], float(rate[1]))
