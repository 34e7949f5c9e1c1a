"""Files that appear whole or not at all, and their names as text."""

import itertools
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


def check_suffix(path: str | Path, allowed: Sequence[str]) -> Path:
    """Return ``path`` as a Path.

    Raises
    ------
    ValueError
        If its suffix is not one of ``allowed``.
    """
    path = Path(path)
    if path.suffix.lower() not in allowed:
        raise ValueError(f"{path.name!r} ends in {path.suffix or 'no suffix'!r}; it must end in {', '.join(allowed)}")
    return path


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; move it to ``path`` when the block ends well, else delete it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}-{os.getpid()}.part{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def legible(name: str | Path) -> str:
    r"""Return a name as pages, pictures and tables can hold it: bytes that Python left undecoded as UTF-8, else as ``\xfc``."""
    return str(name).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    with written(path) as part:
        part.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all; the names in it are `legible`."""
    with written(path) as part:
        part.write_text(legible(text), encoding="utf-8")


def keep_aside(path: Path) -> Path:
    """Copy a file that is to be overwritten, and return the copy: FILE~, or FILE~2 and so on if that is taken."""
    names = (f"{path.name}~{'' if k == 1 else k}" for k in itertools.count(1))
    copy = next(one for name in names if not (one := path.with_name(name)).exists())
    copy.write_bytes(path.read_bytes())
    return copy
