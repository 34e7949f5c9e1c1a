"""A folder of finished pieces of work: a command that is stopped at any time, even by ``kill -9``, goes on where it was.

Every piece is a file that appears whole or not at all.  An identity says what decided it: the configuration, the stamp of the
code, the versions.  What has another identity is never mixed with what is made now.  A lock keeps a second command out.
"""

import errno
import json
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.checks import Plain
from crowd_env.core.files.atomic import written
from crowd_env.core.files.json_file import read_json, write_json

_LOCK = ".lock"
_MADE_BY = "made_by"
_MOST = 2**28  # bytes of the arrays of a piece
_FACTS = "facts"  # the member of an ``.npz`` file that holds a JSON object as text
# What file systems without locks answer.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EINVAL)


class Store:
    """Keeps pieces of work by their names.

    Parameters
    ----------
    folder : where; it is made with the first piece.
    identity : what decides all pieces, ready for JSON; None = each piece says so itself, as its ``made_by``.
    about : name of the file that holds the identity.
    free : entries of the identity in which two commands may differ and still go on with each other's pieces.
    owned : patterns of names that a folder without an identity must not hold: another program wrote them.

    Raises
    ------
    ValueError
        If the folder has another identity, or holds what something else wrote.  Nothing has been written.
    """

    def __init__(
        self,
        folder: Path,
        identity: Plain | None = None,
        *,
        about: str = "identity.json",
        free: Collection[str] = (),
        owned: Collection[str] = (),
    ) -> None:
        self.folder, self.about = folder, folder / about
        self.identity = None if identity is None else _as_json(identity)
        self._free, self._owned, self._begun = free, owned, False
        self._check()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other commands from writing into the folder until the block ends.

        Raises
        ------
        ValueError
            If another command writes there now, or has made the folder its own meanwhile.
        """
        with claimed(self.folder / _LOCK) as ours:
            if not ours:
                raise ValueError(f"{self.folder}: another command is writing there; let it end, or name another folder")
            self._check()
            yield

    def load(self, name: str, made_by: Plain | None = None, *, redo: bool = False) -> dict[str, Any] | None:
        """Return the content of a piece; None if it is not here or damaged.

        Parameters
        ----------
        made_by : what must have decided it.
        redo : a piece that something else decided is as good as none.

        Raises
        ------
        ValueError
            If something else decided it, unless it may be ``redo``-ne.
        """
        path = self.path(name)
        if path is None:
            return None
        try:
            content = _read(path)
            there = content.pop(_MADE_BY, {})
        except Exception:  # a damaged file fails in a dozen ways: zip, zlib, header of an array, JSON
            return None
        other = "" if made_by is None else difference(there, _as_json(made_by))
        if not other:
            return content
        if redo:
            return None
        raise ValueError(f"{path} was made by another command: {other}; name another folder, or remove it")

    def keep(self, name: str, content: Plain, made_by: Plain | None = None) -> None:
        """Write a piece, whole or not at all: as JSON, or, if its content names arrays, as ``.npz``.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        if self.identity is not None and not self._begun:  # first: without it the pieces belong to nothing
            write_json(self.about, self.identity)
            self._begun = True
        arrays: dict[str, Any] = {key: value for key, value in content.items() if isinstance(value, np.ndarray)}
        facts = {key: value for key, value in content.items() if key not in arrays}
        if made_by is not None:
            facts = {_MADE_BY: made_by, **facts}
        if arrays:
            arrays[_FACTS] = np.array(json.dumps(facts, allow_nan=False))
            with written(self.folder / f"{name}.npz") as part:
                np.savez_compressed(part, **arrays)
        else:
            write_json(self.folder / f"{name}.json", facts)

    def path(self, name: str) -> Path | None:
        """Return the file of a piece; None if there is none."""
        files = (self.folder / f"{name}{suffix}" for suffix in (".json", ".npz"))
        return next((file for file in files if file.exists()), None)

    def _check(self) -> None:
        if self.identity is None:
            return
        if not self.about.exists():
            for name in (path.name for pattern in self._owned for path in self.folder.glob(pattern)):
                raise ValueError(f"{self.folder} holds {name}, which this command did not write; name another folder")
            return
        there = read_json(self.about)
        if not isinstance(there, dict):
            raise ValueError(f"{self.about} does not say what decided the results there; name another folder")
        other = difference(there, self.identity, self._free)
        if other:
            raise ValueError(f"{self.folder} holds results of another command: {other}; name another folder")


def _read(path: Path) -> dict[str, Any]:
    if path.suffix == ".json":
        return dict(read_json(path))
    with np.load(path, allow_pickle=False) as file:  # nothing in the file is executed, whatever it holds
        if sum(member.file_size for member in file.zip.infolist()) > _MOST:
            raise ValueError("it unpacks to more than any piece has")
        arrays = {name: file[name] for name in file.files}
    return {**json.loads(str(arrays.pop(_FACTS))), **arrays}


def _as_json(content: Any) -> Any:
    """Return plain data as reading a file gives it back."""
    return json.loads(json.dumps(content, allow_nan=False))


def difference(there: Plain, here: Plain, free: Collection[str] = ()) -> str:
    """Return in words the first thing in which two identities differ, but for what is ``free``; "" if in none.

    Where that is the fingerprint, the files are named that have other digests in ``files``.
    """
    before, now = (files if isinstance(files := one.get("files"), dict) else {} for one in (there, here))
    changed = ", ".join(file for file, digest in now.items() if before.get(file, digest) != digest)
    for name in dict.fromkeys((*here, *there)):
        if name not in free and there.get(name) != here.get(name):
            own = changed and name in ("fingerprint", "time_limit")  # the limit may follow from a drawing
            return f"{changed} has changed since" if own else _words(name, there.get(name), here.get(name))
    return ""


def _words(name: str, there: Any, here: Any) -> str:
    if isinstance(there, dict) and isinstance(here, dict):
        key = next(key for key in dict.fromkeys((*here, *there)) if there.get(key) != here.get(key))
        return _words(f"{name}.{key}", there.get(key), here.get(key))
    if isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        k = next(k for k, pair in enumerate(zip(there, here, strict=True)) if pair[0] != pair[1])
        return _words(f"{name}[{k}]" if len(here) > 1 else name, there[k], here[k])
    return f"{name} is {there} there and {here} here"


@contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Hold the lock file ``path`` as long as the block lasts, and say whether this process alone has it.

    The lock falls with the process, however that ends.  A file that a killed process has left is not locked.  A link is not
    followed.  The file is removed at the end, and so are the folders that were made for it and are empty.  Where the file
    system has no locks, a warning says so, and every process has the claim.
    """
    from filelock import FileLock, Timeout  # a tenth of a second, which reading a store does not need

    if path.is_dir():
        raise ValueError(f"{path} is a folder; remove it: the lock file of this command goes there")
    made = [folder for folder in path.parents if not folder.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path, timeout=0.1)  # s  time to try again where the owner has just removed the file
    try:
        lock.acquire()
    except Timeout:
        yield False
        return
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        warnings.warn(f"{path.parent} has no file locks: see to it that no other command writes there", stacklevel=3)
    try:
        yield True
    finally:
        with suppress(OSError):
            path.unlink()  # while it is locked: no other process can have taken the new one for the old one
        lock.release()
        with suppress(OSError):  # something has been written there
            for folder in made:
                folder.rmdir()
