"""Finished runs in a folder, a small file each: what was computed once is not computed again."""

import hashlib
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crowd_env._kernels import jit
from crowd_env.files.atomic import written
from crowd_env.reproduce.lin2016.run import Record, Run, Snapshot

_FORM = 1  # of the files


class Store:
    """A folder of finished runs.

    A file is found by all that decides the result: the parameters of the run, the scheme and the room they stand for, and
    the sources of the compiled physics.  After a change of any of them the old file is not found.  A file that is broken,
    half written or edited is as good as none.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, run: Run) -> Path:
        """Return the file of a run."""
        digest = hashlib.sha256(json.dumps(identity(run), sort_keys=True).encode()).hexdigest()
        return self.folder / f"{run.count}-people-{run.desired_speed:g}-mps-seed-{run.seed}-{digest[:20]}.json"

    def load(self, run: Run) -> Record | None:
        """Return what came of the run, with all its moments; None if that is not here."""
        try:
            content = json.loads(self.path(run).read_text(encoding="utf-8"))
            if content["identity"] != identity(run):
                return None
            record = _record(content["record"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        wanted, there = {_step(run, moment) for moment in run.moments}, {s.time for s in record.snapshots}
        return record if _sound(run, record) and wanted <= there else None

    def keep(self, run: Run, record: Record) -> None:
        """Write what came of the run, whole or not at all.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        content = {"identity": identity(run), "record": asdict(record)}
        content["record"]["snapshots"] = [snapshot._asdict() for snapshot in record.snapshots]
        with written(self.path(run)) as part:
            part.write_text(json.dumps(content, allow_nan=False), encoding="utf-8")


def identity(run: Run) -> dict[str, Any]:
    """Return all that decides the result of a run, ready for JSON."""
    scenario, parameters = run.scenario(), asdict(run)
    del parameters["moments"]
    return {
        "form": _FORM,
        "run": parameters,
        "scheme": repr(run.scheme()),
        "people": repr(scenario.population),
        "walls": scenario.geometry.walls.tolist(),
        "exits": scenario.geometry.exits.tolist(),
        # Of the kernels that this process has loaded, even if their files have been edited since.
        "kernels": jit.STAMP,
    }


def _record(content: dict[str, Any]) -> Record:
    since = content["blocked_since"]
    snapshots = tuple(
        Snapshot(float(s["time"]), *(tuple(map(float, s[name])) for name in Snapshot._fields[1:]))
        for s in content["snapshots"]
    )
    times = tuple(map(float, content["exit_times"]))
    return Record(times, int(content["left"]), None if since is None else float(since), snapshots)


def _sound(run: Run, record: Record) -> bool:
    """Return whether the record can be one of this run."""
    times = record.exit_times
    return (
        len(times) + record.left == run.count
        and all(map(math.isfinite, times))
        and list(times) == sorted(times)
        and (record.blocked_since is None or record.left > 0)
    )


def _step(run: Run, moment: float) -> float:
    """Return the time [s] of the step at which a moment is kept."""
    return round(moment / run.dt) * run.dt
