"""Pieces of HTML in which every text is escaped: nothing that a scenario, a file or a command is called becomes markup."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any


def table(rows: Iterable[Sequence[Any]], head: Sequence[Any] = (), *, kind: str = "") -> str:
    """Return a table; the first cell of a row is its head, and one cell stands for columns that all say
    alike, unless there is a kind.

    ``kind`` is a class of the style sheet, such as that of figures, which stand in their own columns.
    """
    top = (
        "<thead><tr>" + "".join(f'<th scope="col">{_cell(one)}</th>' for one in head) + "</tr></thead>" if head else ""
    )
    body = "".join(
        f'<tr><th scope="row">{_cell(row[0])}</th>' + _cells(row[1:], merged=not kind) + "</tr>" for row in rows
    )
    return f'<div class="wide"><table class="{escape(kind)}">{top}<tbody>{body}</tbody></table></div>'


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph."""
    return f'<p class="{escape(kind)}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def bullets(texts: Iterable[str], kind: str = "") -> str:
    """Return a list; nothing if it is empty."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f'<ul class="{escape(kind)}">{items}</ul>' if items else ""


def code(lines: Iterable[str]) -> str:
    """Return lines to be copied into a terminal."""
    return f"<pre>{escape(chr(10).join(lines))}</pre>"


def heading(text: str) -> str:
    """Return the heading of a part of a section."""
    return f"<h3>{escape(text)}</h3>"


def section(title: str, *parts: str) -> str:
    """Return a section of finished parts under a heading."""
    return f"<section><h2>{escape(title)}</h2>{''.join(parts)}</section>"


def picture(png: bytes, says: str, caption: str = "", kind: str = "") -> str:
    """Return an image that lies in the page; ``says`` is read to those who do not see it."""
    data = base64.b64encode(png).decode("ascii")
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    image = f'<img alt="{escape(says)}" src="data:image/png;base64,{data}">'
    return f'<figure class="{escape(kind)}"><div class="wide">{image}</div>{below}</figure>'


class Drawer:
    """A folder in which pictures are drawn on their way into a page; a context manager that removes it."""

    def __init__(self) -> None:
        self._folder = TemporaryDirectory(prefix="crowd-env-")
        self.path = Path(self._folder.name) / "picture.png"

    def taken(self) -> bytes:
        """Return the picture that was drawn last."""
        return self.path.read_bytes()

    def __enter__(self) -> "Drawer":
        return self

    def __exit__(self, *error: object) -> None:
        self._folder.cleanup()


def _cells(values: Sequence[Any], *, merged: bool) -> str:
    if merged and len(values) > 1 and len(set(values)) == 1:
        return f'<td colspan="{len(values)}">{_cell(values[0])}</td>'
    return "".join(f"<td>{_cell(one)}</td>" for one in values)


def _cell(value: Any) -> str:
    return escape(str(value)).replace("\n", "<br>")
