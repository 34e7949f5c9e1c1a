"""Recorded starts: read, and checked to be places where people can stand."""

from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.csv_table import read_table
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.placement import closest_pair


def as_positions(starts: Any, people: int = 0) -> Floats:
    """Return a copy of recorded starts (K, 2) [m] as kernels want it.

    Raises
    ------
    ValueError
        If they cannot be positions, or are fewer than ``people``.
    """
    try:
        positions = np.array(starts, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ValueError(f"starts must be numbers, one (x, y) [m] a row: {error}") from None
    if positions.ndim != 2 or positions.shape[1] != 2 or len(positions) < people:
        raise ValueError(f"starts must have the shape ({people}, 2), not {positions.shape}, or more rows to draw from")
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise ValueError(f"start {bad[0]} is {positions[bad[0]].tolist()}; it must be finite")
    return positions


def read_starts(path: str | Path) -> Floats:
    """Return recorded starting positions (K, 2) [m] from a CSV file with the columns ``x`` and ``y``.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column, or holds an entry that is not a number; file and line are named.
    """
    table = read_table(path, "the starting positions", ("x", "y"), "meters", "a person")
    if "frame" in table.columns:
        raise ValueError(
            f"{table.path}: with a column 'frame' this is a trajectory; starting positions are one line a person: keep the "
            "rows of one frame, such as the first, and leave out the column"
        )
    return np.array([[table.number(row, name, f"person {row.number}") for name in ("x", "y")] for row in table.rows])


def read_entries(path: str | Path) -> tuple[Floats, Floats]:
    """Return the times (K,) [s] and places (K, 2) [m] of recorded entries: a CSV file with the columns time, x and y.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column, or holds an entry that is not a number; file and line are named.
    """
    names = ("time", "x", "y")
    table = read_table(path, "the entries", names, "seconds and meters", "a person")
    found = np.array([[table.number(row, name, f"person {row.number}") for name in names] for row in table.rows])
    return found[:, 0].copy(), found[:, 1:].copy()


def check_starts(geometry: Geometry, starts: Floats, radius: Floats, at_once: bool = True) -> None:
    """Raise ValueError unless recorded positions lie inside, clear of walls and, if all stand ``at_once``, of each other."""
    outside = np.flatnonzero(~geometry.contains(starts))
    if len(outside):
        k = outside[0]
        where = "in a part that no exit reaches" if geometry.is_left_out(starts[k]) else "outside the walkable area"
        raise ValueError(f"start {k} at ({starts[k, 0]:g}, {starts[k, 1]:g}) is {where}")
    clearance = geometry.clearance(starts)
    k = int(np.argmin(clearance - radius))
    if clearance[k] < radius[k] - 1e-9:
        raise ValueError(
            f"start {k} at ({starts[k, 0]:g}, {starts[k, 1]:g}) is {clearance[k]:.3f} m from a wall; "
            f"its body of radius {radius[k]:.3f} m does not fit"
        )
    if not at_once:
        return
    i, j, gap = closest_pair(np.ascontiguousarray(starts, dtype=np.float64), radius)
    if gap < -1e-9:
        raise ValueError(
            f"starts {i} and {j} overlap by {-gap:.3f} m: their radii add up to {radius[i] + radius[j]:.3f} m; "
            "take smaller bodies"
        )
