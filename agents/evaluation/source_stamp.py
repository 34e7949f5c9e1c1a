"""Which code computed a result: a hash of all sources that can change one."""

import functools
import hashlib
from importlib import metadata
from pathlib import Path

import crowd_env

# Libraries whose versions can change a number.
_LIBRARIES = ("numba", "numpy", "scikit-fmm", "shapely")


@functools.cache
def source_stamp() -> str:
    """Return a hash of every source file of ``crowd_env`` and ``agents``, and of the versions of what they calculate with."""
    digest = hashlib.sha256()
    for package in (Path(crowd_env.__file__).parent, Path(__file__).parents[1]):
        for path in sorted(package.rglob("*.py")):
            digest.update(path.relative_to(package.parent).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    for library in _LIBRARIES:
        digest.update(f"{library} {metadata.version(library)}\0".encode())
    return digest.hexdigest()[:16]
