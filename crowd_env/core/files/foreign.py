"""Which kind of file an unexpected one is, by its first bytes, so that an error can name it in plain words."""

import re
from collections.abc import Collection
from pathlib import Path

_STARTS = (
    (b"SQLite format 3\x00", "an SQLite database"),
    (b"PK\x03\x04", "a zip archive or an Excel workbook"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook"),
    (b"%PDF", "a PDF"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"\x89HDF", "an HDF5 file"),
    (b"AC10", "a DWG drawing"),
    (b"AutoCAD Binary DXF", "a DXF drawing"),
    (b"ISO-10303-21", "an IFC or STEP model"),
)
_DXF = re.compile(r"\s*(999\s*\n[^\n]*\n\s*)*0\s*\n\s*SECTION\b")


def foreign_kind(head: bytes) -> str | None:
    """Return in words what kind of file begins with ``head``; None = no known kind."""
    for start, kind in _STARTS:
        if head.startswith(start):
            return kind
    text = head.decode("utf-8", errors="replace").lstrip("\ufeff \t\r\n")
    if _DXF.match(text.replace("\r", "")):
        return "a DXF drawing"
    if text.startswith("<"):
        return "an XML file"
    if text.startswith(("{", "[")):
        geo = '"coordinates"' in text or '"FeatureCollection"' in text or '"Feature"' in text
        return "GeoJSON" if geo else "JSON"
    return None


def require_file(path: Path) -> None:
    """Raise ValueError if a path is that of a device or a pipe, which may have no end; what is not there is for the reader."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise ValueError(f"{path} is no regular file but a device or a pipe; copy what it holds into a file")


def rows_in(text: str) -> list[str]:
    """Return the lines of a text that are neither blank nor a comment."""
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def read_text(path: Path, what: str, read: str, kinds: Collection[str] = ()) -> str:
    """Return the text of a file without a byte order mark; ``what`` is expected, ``read`` says which forms are read.

    ``kinds`` are those of `foreign_kind` that are right here.

    Raises
    ------
    ValueError
        If the file cannot be read or is no text; the message says what it is if that is known.
    """
    require_file(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"cannot read {what} {path}: {error.strerror or error}") from None
    kind = foreign_kind(data[:4096])
    if kind is not None and kind not in kinds:
        raise ValueError(f"{path} is {kind}; {read}")
    try:
        return data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(
            f"cannot read {what} {path}: it is no text in UTF-8 ({error.reason} at byte {error.start})"
        ) from None
