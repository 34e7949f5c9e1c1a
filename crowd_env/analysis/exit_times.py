"""Exit times in files, of an experiment or of a simulation, in one form.

Column ``time`` [s].  More may be there: ``run``, that an exit belongs to, ``exit``, the name of the exit taken,
and ``out``, 1 for someone who got out; a row with 0 says that watching the run ended at that time with people inside.  Where a
column ``until`` holds that time, ``time`` is empty, and there may be such a row for each of them.
"""

import warnings
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from crowd_env.analysis.clogging import RunExits, exit_gaps, exits_of_run
from crowd_env.core.checks import at
from crowd_env.core.files.csv_table import read_table, write_csv


def read_exits(path: str | Path) -> list[RunExits]:
    """Return the runs of a CSV file of exit times, in the order in which the file first names them.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column, or holds something that is no time >= 0; the file and row are named.
    """
    table = read_table(path, "the exit times", ("time",), "seconds", "an exit")
    times: dict[str, list[float]] = {}
    exits: dict[str, list[str]] = {}
    until: dict[str, float] = {}
    for row in table.rows:
        what = f"row {row.number}"
        run = row.cells.get("run", "0")
        until_then = row.cells.get("out") == "0" and not row.cells["time"] and bool(row.cells.get("until"))
        time = table.number(row, "until" if until_then else "time", what)
        if time < 0:
            raise ValueError(f"{table.path}: {what}: time is {time:g} s; it must be >= 0, from the start of the run")
        out = row.cells.get("out") or "1"
        if out not in ("0", "1"):
            raise ValueError(f"{table.path}: {what}: out is {out!r}; it must be 1 (got out) or 0 (watched until then)")
        of_run, taken = times.setdefault(run, []), exits.setdefault(run, [])
        if out == "1":
            of_run.append(time)
            taken.append(row.cells.get("exit") or "")
        elif until_then and until.get(run) == time:
            pass  # one more pedestrian left inside then
        elif run in until:
            raise ValueError(f"{table.path}: {what}: run {run!r} has a second row with out = 0; watching ends once")
        else:
            until[run] = time
    mixed = [run for run, of_run in times.items() if any(after < before for before, after in pairwise(of_run))]
    if mixed:
        warnings.warn(
            f"{table.path}: the exits of run {mixed[0]!r} are not in the order of time; they are taken in that order, as those "
            "of one run",
            stacklevel=2,
        )
    runs = []
    for run, of_run in times.items():
        inside = [np.nan] if run in until else []
        with at(f"{table.path}: run {run!r}"):
            runs.append(exits_of_run([*of_run, *inside], until.get(run, np.nan), [*exits[run], *([""] * len(inside))]))
    return runs


def write_gaps(path: str | Path, sets: Mapping[str, Sequence[RunExits]], *, per_exit: bool = False) -> Path:
    """Write every gap [s], name of its data and number of its run before it, and return the path.

    ``open`` is 1 for a gap that had not ended: it is longer.
    """
    rows: list[tuple[object, ...]] = []
    for name, runs in sets.items():
        for k, run in enumerate(runs):
            gaps = exit_gaps(run, per_exit=per_exit)
            rows += [(name, k, f"{gap:.6f}", 0) for gap in gaps.closed]
            rows += [(name, k, f"{gap:.6f}", 1) for gap in gaps.open]
    return write_csv(Path(path), ("data", "run", "gap", "open"), rows)
