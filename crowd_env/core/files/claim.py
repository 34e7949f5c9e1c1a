"""Places that one process at a time writes to."""

import errno
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

# What systems and file systems without locks answer.
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EINVAL)


@contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Hold the lock file ``path`` as long as the block lasts, and say whether this process alone has it.

    The lock falls with the process, however that ends; a file that a killed process has left is not locked.  The file is
    removed at the end, and so are the folders that were made for it and are empty.  Where the file system has no locks, a
    warning says so, and everyone has the claim.
    """
    made = [folder for folder in path.parents if not folder.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    file = _locked(path)
    if file is None:
        yield False
        return
    try:
        yield True
    finally:
        with suppress(OSError):
            path.unlink()  # while it is locked: nobody else can have taken the new one for the old one
        file.close()
        with suppress(OSError):  # somebody has written there
            for folder in made:
                folder.rmdir()


def _locked(path: Path) -> IO[str] | None:
    """Return the open file, locked where there are locks; None if another process has it."""
    while True:
        file = path.open("w")
        try:
            _lock(file)
        except (BlockingIOError, PermissionError):
            file.close()
            return None
        except (ImportError, OSError) as error:
            if isinstance(error, OSError) and error.errno not in _NO_LOCKS:
                file.close()
                raise
            warnings.warn(
                f"{path.parent} has no file locks: see to it that no other command writes there", stacklevel=4
            )
            return file
        try:
            if os.fstat(file.fileno()).st_ino == path.stat().st_ino:
                return file
        except FileNotFoundError:
            pass
        file.close()  # its owner has removed it between our opening and our locking: lock the next one


def _lock(file: IO[str]) -> None:
    import fcntl  # of POSIX systems

    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
