"""Folders of training runs, and the versions of the software in them."""

import subprocess
from functools import cache
from pathlib import Path

from crowd_env.core.files.versions import versions_of


def new_folder(root: Path, name: str) -> Path:
    """Make and return ``root/name``, or ``root/name-2`` and so on if that is taken: no run overwrites another.

    Raises
    ------
    ValueError
        If the name leads elsewhere, or the folder cannot be made.
    """
    if name in ("", ".", "..") or any(character in name for character in "/\\\0"):
        raise ValueError(f"{name!r} cannot name a run: it must be the name of one folder, without / or \\")
    number, folder = 1, root / name
    try:
        root.mkdir(parents=True, exist_ok=True)
        while True:
            try:
                folder.mkdir()  # only one of several processes succeeds
                return folder
            except FileExistsError:
                number += 1
                folder = root / f"{name}-{number}"
    except OSError as error:
        raise ValueError(f"cannot make the folder {folder}: {error.strerror or error}") from None


def versions() -> dict[str, str]:
    """Return the versions of all software that can change a result."""
    return versions_of("gymnasium", "pettingzoo", "stable-baselines3", "torch")


@cache
def commit() -> str | None:
    """Return the git commit of the checkout that this is, with "-dirty" where tracked files differ; None elsewhere."""
    here = Path(__file__).resolve()
    try:
        tracked, at, changed = (
            subprocess.run(["git", *words], cwd=here.parent, capture_output=True, text=True, check=True).stdout.strip()
            for words in (["ls-files", here.name], ["rev-parse", "HEAD"], ["status", "-s", "-uno"])
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{at}{'-dirty' if changed else ''}" if tracked else None
