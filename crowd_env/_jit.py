"""How crowd_env compiles: one decorator, one cache folder.

numba's on-disk cache looks at the file of the kernel itself, not at the files of the kernels it calls: after an edit to a
helper it would silently run the OLD helper.  The cache folder therefore carries a stamp: the hash of every source file of
the package that holds kernels.  Any edit opens a new folder; folders unused for a month are removed.
"""

import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import config, event
from numba.core.event import register, unregister

# numba guards every signed index against being negative, and a loop with such guards does not vectorise: four times slower.
# Hence ``for i in range(index(begin), index(end))`` wherever begin is not a plain zero.
index = np.uint64

_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
_KEEP_SECONDS = 30 * 24 * 3600.0


def kernel_stamp() -> str:
    """Return a hash of all sources of the package that hold kernels or say how they are compiled, and of the numba version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        text = path.read_bytes()
        if b"crowd_env._jit" in text or b"numba" in text:
            digest.update(path.name.encode())
            digest.update(text)
    return digest.hexdigest()[:16]


def _usable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _cache_folder() -> Path:
    """Return the stamped cache folder: $NUMBA_CACHE_DIR, else the user's cache, else a temporary folder."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    root = Path(own) if own else Path(home) / "crowd_env"
    folder = root / f"kernels-{kernel_stamp()}"
    if not _usable(folder):
        folder = Path(tempfile.gettempdir()) / f"crowd_env-{os.getuid() if hasattr(os, 'getuid') else 0}" / folder.name
        _usable(folder)
    _remove_stale(folder)
    return folder


def _remove_stale(folder: Path) -> None:
    """Delete sibling stamps that nothing has opened for a month."""
    for other in folder.parent.glob("kernels-*"):
        try:
            if other != folder and time.time() - other.stat().st_mtime > _KEEP_SECONDS:
                shutil.rmtree(other, ignore_errors=True)
        except OSError:  # another process removed it first
            continue


CACHE_FOLDER = _cache_folder()


class _Note(event.Listener):
    """Says once that kernels are being compiled: the silence before a first step would otherwise last half a minute."""

    def on_start(self, event: event.Event) -> None:
        """Speak up at the first kernel of this package that is not in the cache."""
        if event.data["dispatcher"].py_func.__module__.startswith("crowd_env."):
            unregister("numba:compile", self)
            print(
                "crowd_env: compiling kernels, once for this version and scheme: about half a minute ...",
                file=sys.stderr,
            )

    def on_end(self, event: event.Event) -> None:
        """Say nothing."""


if not os.environ.get("CROWD_ENV_QUIET"):
    register("numba:compile", _Note())


def kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` for one thread, cached in the stamped folder.

    No fast-math: the order of every sum is the order written, so the same build gives the same bits.

    Nothing may be allocated inside (use `allocating_kernel` for that): without numba's reference counting a physics step was
    measured to run three times as fast.  The global lock is released: ranges of environments run side by side in ordinary
    threads.  Tuples of arrays are best handed over as a `crowd_env._reference.Reference`.
    """
    return _compile(function, {"_nrt": False})


def inner_kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` like `kernel`, for calls from other kernels alone.

    The code that unpacks Python's arguments, which it does without, would be a fifth of all that is compiled for a first step.
    """
    return _compile(function, {"_nrt": False, "no_cpython_wrapper": True})


def allocating_kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` like `kernel`, but let it allocate and return arrays: for work done once, not at every step."""
    return _compile(function, {})


def _compile(function: Callable[..., Any], extra: dict[str, Any]) -> Any:
    # numba picks the cache folder when the decorator runs; other users of numba in the process keep their own.
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = str(CACHE_FOLDER)  # type: ignore[attr-defined]
    try:
        return numba.njit(**_OPTIONS, **extra)(function)
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]
