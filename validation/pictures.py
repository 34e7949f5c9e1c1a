"""The pictures of docs/images/: each is made again by the command of docs/tables/made_by.csv.

A command is run in a folder of its own with links: ``examples`` and ``train.py`` to the checkout, ``DATA`` to the recordings,
and ``map`` to one folder for all cases of validation.  A picture may lie anywhere in it: the end of its path decides.
"""

import os
import shlex
import subprocess
import sys
from pathlib import Path

from crowd_env.core.files.atomic import written
from validation.pages import MADE_BY, ROOT, read_table

IMAGES = ROOT / "docs/images"
DATA, MAP = "DATA", "map"


def commands() -> dict[str, list[str]]:
    """Return command -> paths of its pictures below docs/images/, which may be patterns."""
    found: dict[str, list[str]] = {}
    for name, command, _ in read_table(MADE_BY)[1:]:
        if name.endswith((".png", ".gif")):
            found.setdefault(command, []).append(name)
    return found


def remade(command: str, names: list[str], out: Path, data: Path | None = None) -> dict[Path, Path]:
    """Run a command, unless it has ended below ``out`` already; return picture of docs/images/ -> the one that it made.

    Raises
    ------
    ValueError
        If the command makes no such picture.
    """
    first = names[0].rpartition(".")[0].replace("*", "all").replace("/", "-")
    folder, shared = (out / first).resolve(), (out / MAP).resolve()
    for path in (folder, shared):
        path.mkdir(parents=True, exist_ok=True)
    links = {"examples": ROOT / "examples", "train.py": ROOT / "train.py", MAP: shared}
    for name, target in (links | ({DATA: data.resolve()} if data else {})).items():
        if not (folder / name).is_symlink():
            (folder / name).symlink_to(target)
    made, log = {name: _below(name, folder, shared) for name in names}, folder / "log.txt"
    if not (log.exists() and all(made.values())):  # the log is there once the command has ended
        environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
        with written(log) as part, part.open("w", encoding="utf-8") as file:
            for line in command.split(" && "):  # a case of validation that does not pass draws its picture all the same
                subprocess.run(_words(line), cwd=folder, env=environment, stdout=file, stderr=file, check=False)
        made = {name: _below(name, folder, shared) for name in names}
    found: dict[Path, Path] = {}
    for name, paths in made.items():
        if not paths:
            last = (log.read_text(encoding="utf-8").strip().splitlines() or ["nothing"])[-1]
            raise ValueError(f"{command!r} made no {name}; it ends with: {last} ({log})")
        found |= {IMAGES / end: path for end, path in paths.items()}
    return found


def _below(name: str, *folders: Path) -> dict[str, Path]:
    """Return end of the path -> path, of the files in folders that end as ``name`` does."""
    length = len(Path(name).parts)
    paths = (path for folder in folders for path in folder.rglob(Path(name).name) if path.match(name))
    return {Path(*path.parts[-length:]).as_posix(): path for path in paths}


def _words(line: str) -> list[str]:
    """Return the words of a command, with the Python and the package of this process."""
    program, *rest = shlex.split(line)
    return [sys.executable, *(("-m", "crowd_env") if program == "crowd-env" else ()), *rest]
