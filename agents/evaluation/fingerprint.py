"""One short text for everything that the code holds, and what it calculates with: another after any change."""

import functools
from pathlib import Path

import crowd_env
from crowd_env.core.files.fingerprint import fingerprint

from ..runs import versions


@functools.cache
def source_stamp() -> str:
    """Return a hash of every source file of ``crowd_env`` and ``agents``, and of the versions of what they calculate with."""
    folders = Path(crowd_env.__file__).parent, Path(__file__).parents[1]
    sources = {
        path.relative_to(folder.parent).as_posix(): path.read_bytes()
        for folder in folders
        for path in folder.rglob("*.py")
    }
    return fingerprint(sources, versions())
