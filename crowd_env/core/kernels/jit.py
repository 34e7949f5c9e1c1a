"""How crowd_env compiles: one decorator, one cache folder.

numba's on-disk cache looks at the file of the kernel itself, not at the files of the kernels it calls or takes constants from:
after an edit to one of these it would silently run the OLD kernel.  The cache folder therefore carries a stamp: the hash of
every file that holds kernels or that such a file imports.  Any edit there opens a new folder; folders unused for a month are
removed.  Since the stamp says what a kernel is, equal sources share kernels, wherever they lie; and kernels that were compiled
elsewhere, for processors of a kind, can be installed: the package crowd_env_kernels (`make kernels-wheel`).

numba unpickles the files of the folder, so any user with write access could run code here: a folder is used only if no other
user has it.  Installed kernels are trusted as all installed code is, and only read.

With ``NUMBA_DISABLE_JIT=1`` in the environment nothing is compiled: every kernel is the plain Python function that is written
here, so debuggers stop in it and coverage reports count its lines.
"""

import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_features
from numba.core import caching, config, event
from numba.core.event import register, unregister

# numba guards every signed index against being negative, and a loop with such guards does not vectorise: four times slower.
# Hence ``for i in range(index(begin), index(end))`` wherever begin is not a plain zero.  Plain Python wants plain numbers: to
# NumPy the sum of a uint64 and an int64 is a float.
index: Any = int if config.DISABLE_JIT else np.uint64  # type: ignore[attr-defined]

Result = TypeVar("Result")

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
_KEEP_SECONDS = 30 * 24 * 3600.0

# What a kernel is made of is imported by whole names at the top of a file; what a function imports later is no part of it.
_HOLDS_KERNELS = re.compile(r"^@(?:inner_|allocating_)?kernel\b", re.MULTILINE)
_IMPORTED = re.compile(r"^from (crowd_env[\w.]*) import", re.MULTILINE)
_STAMPED = re.compile(r"kernels-[0-9a-f]{16}")
_MARKER = "written-by-crowd_env"  # a file in every folder that this package has made: it deletes no other
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH

# Installed kernels are for this processor and no further features, as numba names them; it is one that can do all of these.
PORTABLE = ("x86-64-v3", "")
_ABILITIES = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")


def source_stamp(package: Path) -> str:
    """Return a hash of all sources of a package, and of the numba version."""
    return _hash_of(package, sorted(package.rglob("*.py")))


def kernel_stamp(package: Path = Path(__file__).parents[2]) -> str:
    """Return a hash of the sources that a kernel is made of, and of the numba version.

    These are the files that hold kernels, and all files of the package that they import, directly or not.
    """
    return _hash_of(package, kernel_sources(package))


def kernel_sources(package: Path) -> list[Path]:
    """Return the files of a package that hold kernels and the files that they import, directly or not; sorted."""
    texts = {path: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    found: set[Path] = set()
    new = {path for path, text in texts.items() if _HOLDS_KERNELS.search(text)}
    while new:
        found |= new
        imported = {module for path in new for module in _IMPORTED.findall(texts[path])}
        places = {package.parent.joinpath(*module.split(".")) for module in imported}
        new = {path for place in places for path in (place.with_suffix(".py"), place / "__init__.py") if path in texts}
        new -= found
    return sorted(found)


def _hash_of(package: Path, files: list[Path]) -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in files:
        text = path.read_bytes()
        digest.update(f"{path.relative_to(package).as_posix()} {len(text)} ".encode())
        digest.update(text)
    return digest.hexdigest()[:16]


def cache_folder(stamp: str) -> Path | None:
    """Return the stamped cache folder: in $NUMBA_CACHE_DIR, else in the user's cache.

    None if that cannot be used: every process then compiles kernels in memory.
    """
    root = _root()
    folder = root and root / f"kernels-{stamp}"
    problem = "there is no home folder" if folder is None else _open(folder)
    if problem:
        _say_not_kept(problem)
        return None
    assert folder is not None
    if os.access(folder, os.W_OK):
        _remove_stale(folder)
    return folder


def _say_not_kept(problem: str) -> None:
    _say(f"kernels are not kept: {problem}; set NUMBA_CACHE_DIR to a folder that only you can write to")


def _root() -> Path | None:
    """Return where stamped folders lie; None where a user has no home."""
    if own := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(own).absolute()  # numba writes later, perhaps from somewhere else
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if cache.is_absolute():  # others are to be ignored, says the standard
        return cache / "crowd_env"
    try:
        return Path.home() / ".cache" / "crowd_env"
    except RuntimeError:  # a user id without an account, as in containers
        return None


def _open(folder: Path) -> str | None:
    """Make the folder unless it is there, for this user alone; returns why it cannot be used, None if it can."""
    try:
        for above in reversed(folder.parents):  # with ``parents=True`` they would be as open as the umask lets them
            above.mkdir(mode=0o700, exist_ok=True)
        if problem := _shared(folder.parent, others=(0,)):
            return problem
        try:
            folder.mkdir(mode=0o700)
            (folder / _MARKER).touch()
        except FileExistsError:
            pass
        if problem := _shared(folder):
            return problem
        for above in folder.parent.parents:  # a user that can rename a folder there can put another in its place
            mode = above.stat().st_mode
            if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
                return f"other users can write to {above}"
    except OSError as error:
        return f"{folder} cannot be written: {error.strerror}"
    with suppress(OSError):  # a folder that can only be read
        os.utime(folder)
    return None


def _shared(folder: Path, others: tuple[int, ...] = ()) -> str | None:
    """Return why another user could put files into a folder, None if no other could.

    It has to belong to this user, or to one of ``others``: then entries of it are still safe if only their owners may replace
    them (the sticky bit, as in /tmp).
    """
    if not hasattr(os, "getuid"):  # Windows: folders in the user's profile are the user's
        return None
    found = folder.stat() if others else folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        return f"{folder} is not a folder"
    if found.st_uid not in (os.getuid(), *others):
        return f"{folder} belongs to another user"
    if found.st_mode & _OTHERS_WRITE and not (others and found.st_mode & stat.S_ISVTX):
        return f"other users can write to {folder}"
    return None


def _remove_stale(folder: Path) -> None:
    """Delete sibling folders that this package has made and that nothing has opened for a month."""
    for other in folder.parent.glob("kernels-*"):
        try:
            ours = other != folder and _STAMPED.fullmatch(other.name) is not None and _shared(other) is None
            if ours and (other / _MARKER).is_file() and time.time() - other.stat().st_mtime > _KEEP_SECONDS:
                shutil.rmtree(other, ignore_errors=True)
        except OSError:  # another process removed it first
            continue


def folder_of_installed(stamp: str) -> str:
    """Return the name of the folder of crowd_env_kernels with kernels of these sources and numba, for this Python."""
    return f"kernels-{stamp}-{sys.implementation.cache_tag}"


def installed_kernels(stamp: str) -> Path | None:
    """Return the folder of installed kernels; None if there are none that fit, or if NUMBA_CPU_NAME asks for others."""
    found = find_spec("crowd_env_kernels")
    if config.CPU_NAME or found is None or not found.submodule_search_locations:  # type: ignore[attr-defined]
        return None
    folder = Path(found.submodule_search_locations[0]) / folder_of_installed(stamp)
    if not folder.is_dir():
        _say("installed kernels are not used: they are of another version of crowd_env, numba or Python")
        return None
    able = get_host_cpu_features()
    if lacks := [name for name in _ABILITIES if not able.get(name)]:
        _say(f"installed kernels are not used: this processor has no {', '.join(lacks)}")
        return None
    return folder


@cache
def _say(note: str) -> None:
    if not os.environ.get("CROWD_ENV_QUIET"):
        print(f"crowd_env: {note}", file=sys.stderr)


_PROCESS = uuid.uuid4().hex[:16]
STAMP = kernel_stamp()
CACHE_FOLDER = cache_folder(STAMP)
INSTALLED = installed_kernels(STAMP)


class _Locator(caching._SourceFileBackedLocatorMixin, caching._CacheLocator):
    """Where a kernel lies: one of this package in a folder named for its module, others where numba would put them."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._py_file, self._lineno = py_file, py_func.__code__.co_firstlineno
        module = py_func.__module__
        self.folder_name = module if module.startswith("crowd_env.") else self.get_suitable_cache_subpath(py_file)

    def ensure_cache_path(self) -> None:
        """Make the folder, unless nothing is to be written."""
        if CACHE_FOLDER is not None:
            super().ensure_cache_path()

    def get_cache_path(self) -> str:
        """Return the folder that is written to."""
        return str((CACHE_FOLDER or INSTALLED) / self.folder_name)  # type: ignore[operator]

    def get_source_stamp(self) -> Any:
        """Return what changes with the kernel's own file, but not with its time, as in some versions of numba.

        A file that is edited after the stamp was taken, and imported then, is seen so.
        """
        return hashlib.sha256(Path(self._py_file).read_bytes()).hexdigest()


class _Kept(caching.CompileResultCacheImpl):
    """What is kept of a kernel: all but its types in words, which name folders of this machine."""

    _locator_classes = [_Locator, *caching.CompileResultCacheImpl._locator_classes]

    def reduce(self, cres: Any) -> Any:
        """Return what is written."""
        return super().reduce(cres._replace(type_annotation=""))


class _Files(caching.IndexDataCacheFile):
    """The files of a kernel, each of which begins with its hash: damage would go unseen, and run."""

    def _save_data(self, name: str, data: Any) -> None:
        kept = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(kept).digest() + kept)

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        digest, kept = content[:32], content[32:]
        if digest != hashlib.sha256(kept).digest():
            raise EOFError
        return pickle.loads(kept)


class _Cache(caching.FunctionCache):
    """numba's cache in `CACHE_FOLDER`, and behind it what is `INSTALLED`, which is never written to."""

    _impl_class = _Kept

    def __init__(self, py_func: Callable[..., Any]) -> None:
        super().__init__(py_func)
        impl = self._impl
        self._cache_file = _Files(self._cache_path, impl.filename_base, impl.locator.get_source_stamp())
        # numba counts from 1: two processes at once would give one name to the kernels of different arguments, and mix them up.
        self._cache_file._data_name_pattern = f"{self._impl.filename_base}.{_PROCESS}-{{number:d}}.nbc"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a kernel from where it is kept; None if it has to be compiled."""
        kept = super().load_overload(sig, target_context)
        if kept is not None or INSTALLED is None or not isinstance(self._impl.locator, _Locator):
            return kept
        folder = INSTALLED / self._impl.locator.folder_name
        files = _Files(str(folder), self._impl.filename_base, self._impl.locator.get_source_stamp())
        _, (system, *_), code = self._index_key(sig, target_context.codegen())
        data = _load(files, (sig, (system, *PORTABLE), code))
        return data and self._impl.rebuild(target_context, data)

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        data = _load(self._cache_file, self._index_key(sig, target_context.codegen()))
        return data and self._impl.rebuild(target_context, data)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel that was compiled, where there is room."""
        if CACHE_FOLDER is not None:
            try:
                super().save_overload(sig, data)
            except OSError as error:
                _say_not_kept(f"{CACHE_FOLDER} cannot be written: {error.strerror}")


def _load(files: _Files, key: Any) -> Any:
    """Return what files hold under a key; None if they hold nothing, or are damaged: these are removed where they can be."""
    try:
        return files.load(key)
    except Exception:  # unpickling raises whatever damaged bytes make it raise
        _say(f"a kernel in {files._cache_path} is damaged, and compiled again")
        if INSTALLED is None or not files._cache_path.startswith(str(INSTALLED)):
            with suppress(OSError):
                os.unlink(files._index_path)
        return None


class _Note(event.Listener):
    """Says once that kernels are being compiled: the silence before a first step would otherwise last half a minute."""

    def on_start(self, event: event.Event) -> None:
        """Speak up at the first kernel of this package that is not in the cache."""
        if event.data["dispatcher"].py_func.__module__.startswith("crowd_env."):
            unregister("numba:compile", self)
            kept = CACHE_FOLDER is not None and os.access(CACHE_FOLDER, os.W_OK)
            often = "once for this version and scheme" if kept else "in every process"
            _say(f"compiling kernels, {often}: about half a minute ...")

    def on_end(self, event: event.Event) -> None:
        """Say nothing."""


if not os.environ.get("CROWD_ENV_QUIET"):
    register("numba:compile", _Note())


def kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` for one thread, cached in the stamped folder.

    No fast-math: the order of every sum is the order written, so the same build gives the same bits.

    Nothing may be allocated inside (use `allocating_kernel` for that): without numba's reference counting a physics step was
    measured to run three times as fast.  The global lock is released: ranges of environments run side by side in ordinary
    threads.  Tuples of arrays are best handed over as a `crowd_env.core.kernels.struct_ref.StructRef`.
    """
    return _quiet(_compile(function, {"_nrt": False}))


def is_kernel(function: Any) -> bool:
    """Whether a function is compiled; with ``NUMBA_DISABLE_JIT=1`` any function is as good."""
    return callable(function) and (bool(config.DISABLE_JIT) or hasattr(function, "py_func"))  # type: ignore[attr-defined]


def inner_kernel(function: Callable[..., Result]) -> Callable[..., Result]:
    """Compile ``function`` like `kernel`, for calls from other kernels alone.

    The code that unpacks Python's arguments, which it does without, would be a fifth of all that is compiled for a first step.
    """
    compiled: Callable[..., Result] = _compile(function, {"_nrt": False, "no_cpython_wrapper": True})
    return compiled


def allocating_kernel(function: Callable[..., Any]) -> Any:
    """Compile ``function`` like `kernel`, but let it allocate and return arrays: for work done once, not at every step."""
    return _quiet(_compile(function, {}))


def _quiet(compiled: Callable[..., Any]) -> Any:
    """Let plain Python divide by zero and take inf from inf without a warning, as compiled code does.

    A warning of an overflow stays: of floats it is rare, and a number that does not fit its integer type is a mistake.
    """
    if not config.DISABLE_JIT:  # type: ignore[attr-defined]
        return compiled
    return np.errstate(divide="ignore", invalid="ignore")(compiled)


def _compile(function: Callable[..., Any], extra: dict[str, Any]) -> Any:
    compiled = numba.njit(**_OPTIONS, **extra)(function)
    if not config.DISABLE_JIT and (CACHE_FOLDER or INSTALLED):  # type: ignore[attr-defined]
        compiled._cache = _Cache(function)  # what cache=True does, with a cache of our own
    return compiled
