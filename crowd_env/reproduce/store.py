"""Finished runs in a folder, a small file each: what was computed once is not computed again."""

import hashlib
import json
from pathlib import Path
from typing import Any

from crowd_env.core.files.atomic import write_text
from crowd_env.core.kernels import jit
from crowd_env.reproduce.run import Record, Run

_FORM = 1  # of the files


class Store:
    """A folder of finished runs.

    A file is found by all that decides the record: the identity of the run, and the sources of the compiled physics.
    After a change of any of them the old file is not found.  A file that is broken, half written or edited is as good as
    none.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, run: Run[Any]) -> Path:
        """Return the file of a run."""
        digest = hashlib.sha256(json.dumps(identity(run), sort_keys=True).encode()).hexdigest()
        return self.folder / f"{run.label()}-{digest[:20]}.json"

    def load(self, run: Run[Record]) -> Record | None:
        """Return the record of the run; None if it is not here, or not with everything that the run asks for."""
        try:
            content = json.loads(self.path(run).read_text(encoding="utf-8"))
            return run.decode(content["record"]) if content["identity"] == identity(run) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def keep(self, run: Run[Record], record: Record) -> None:
        """Write the record of the run, whole or not at all.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        content = {"identity": identity(run), "record": run.encode(record)}
        write_text(self.path(run), json.dumps(content, allow_nan=False))


def identity(run: Run[Any]) -> dict[str, Any]:
    """Return all that decides the record of a run, ready for JSON."""
    # The kernels that this process has loaded, even if their files have been edited since.
    return {"form": _FORM, "kernels": jit.STAMP, **run.identity()}
