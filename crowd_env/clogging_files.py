"""Exit times in files: read those of an experiment, write those of a simulation, in one form.

Columns ``run,time``: the run that an exit belongs to, and its time [s].  Two more may follow: ``exit``, the name of the exit
taken, and ``out``, 1 for someone who got out; a row with 0 says that watching the run ended at that time with people inside.
"""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from crowd_env.clogging import Run, exit_gaps, exits_of_run
from crowd_env.rendering.saving import written


def read_exits(path: str | Path) -> list[Run]:
    """Return the runs of a CSV file of exit times, in the order in which the file first names them.

    Raises
    ------
    ValueError
        If the file cannot be read, lacks a column, or holds something that is no time; the file and row are named.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"cannot read the exit times {path}: {error}") from None
    if not rows:
        raise ValueError(f"{path}: no exit times; the file needs a header line 'run,time' and one line an exit")
    missing = {"run", "time"} - set(rows[0])
    if missing:
        raise ValueError(
            f"{path}: column {min(missing)!r} is missing; the header line must name run and time (seconds)"
        )
    times: dict[str, list[float]] = {}
    exits: dict[str, list[str]] = {}
    until: dict[str, float] = {}
    for k, row in enumerate(rows):
        run, time = row["run"] or "", _time(row["time"], path, k)
        out = (row.get("out") or "1").strip()
        if out not in ("0", "1"):
            raise ValueError(f"{path}: row {k + 1}: out is {out!r}; it must be 1 (got out) or 0 (watched until then)")
        times.setdefault(run, [])
        exits.setdefault(run, [])
        if out == "1":
            times[run].append(time)
            exits[run].append(row.get("exit") or "")
        elif run in until:
            raise ValueError(f"{path}: row {k + 1}: run {run!r} has a second row with out = 0; watching ends once")
        else:
            until[run] = time
    runs = []
    for run, of_run in times.items():
        inside = [np.nan] if run in until else []
        try:
            runs.append(exits_of_run([*of_run, *inside], until.get(run, np.nan), [*exits[run], *([""] * len(inside))]))
        except ValueError as error:
            raise ValueError(f"{path}: run {run!r}: {error}") from None
    return runs


def _time(text: str | None, path: Path, row: int) -> float:
    try:
        time = float(text or "")
    except ValueError:
        time = float("nan")
    if not np.isfinite(time):
        raise ValueError(f"{path}: row {row + 1}: time is {text!r}, not a number of seconds")
    return time


def write_exits(path: str | Path, runs: Sequence[Run], labels: Sequence[object]) -> Path:
    """Write exit times so that `read_exits` reads them again, and return the path; ``labels`` name the runs."""
    rows: list[tuple[object, ...]] = []
    for label, run in zip(labels, runs, strict=True):
        rows += [(label, repr(float(time)), exit, 1) for time, exit in zip(run.time, run.exit, strict=True)]
        if np.isfinite(run.until):
            rows.append((label, repr(run.until), "", 0))
    return _write(Path(path), ("run", "time", "exit", "out"), rows)


def write_gaps(path: str | Path, sets: Mapping[str, Sequence[Run]], *, per_exit: bool = False) -> Path:
    """Write every gap [s], name of its data and number of its run before it, and return the path.

    ``open`` is 1 for a gap that had not ended: it is longer.
    """
    rows: list[tuple[object, ...]] = []
    for name, runs in sets.items():
        for k, run in enumerate(runs):
            gaps = exit_gaps(run, per_exit=per_exit)
            rows += [(name, k, f"{gap:.6f}", 0) for gap in gaps.closed]
            rows += [(name, k, f"{gap:.6f}", 1) for gap in gaps.open]
    return _write(Path(path), ("data", "run", "gap", "open"), rows)


def _write(path: Path, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    with written(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
    return path
