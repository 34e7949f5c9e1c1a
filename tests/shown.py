"""What the pages show: their fenced blocks, and the commands and outputs in those of a console."""

import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from repository import ROOT

FRONT = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")]
PAGES = [*FRONT, *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / ".github").rglob("*.md"))]
_FENCE = re.compile(r"^([ ]*)(```+|~~~+|:::+)[ ]*([^\n]*)\n(.*?)^\1\2[ ]*$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block.

    Attributes
    ----------
    line : of its fence, from 1.
    kind : what stands behind the fence, such as "python" or "{toctree}"; text if nothing does.
    """

    page: Path
    line: int
    kind: str
    text: str


class Command(NamedTuple):
    """A command line, without its prompt and comment, and the output that is shown below it."""

    line: str
    output: str

    @property
    def words(self) -> list[str]:
        return shlex.split(self.line, comments=True)


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def called(block: Block) -> str:
    return f"{named(block.page)}:{block.line}"


def blocks_of(page: Path) -> list[Block]:
    """Return the fenced blocks of a page."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text.count("\n", 0, found.start()) + 1, found[3].split(" ")[0].strip() or "text", found[4])
        for found in _FENCE.finditer(text)
    ]


def blocks(kind: str) -> list[Block]:
    """Return all blocks of a kind."""
    return [block for page in PAGES for block in blocks_of(page) if block.kind == kind]


def tried(kind: str) -> list[Any]:
    """Return all blocks of a kind as cases of a test: those of the README before a change lands, the others at night."""
    marks = {True: pytest.mark.more, False: pytest.mark.nightly}
    return [
        pytest.param(block, id=called(block), marks=marks[block.page.name == "README.md"]) for block in blocks(kind)
    ]


def commands_of(block: Block) -> list[Command]:
    """Return the commands of a console block; a line that ends in a backslash goes on, and "&&" separates two.

    Raises
    ------
    ValueError
        If something stands before the first prompt: it is no output of a command.
    """
    before, *parts = re.split(r"^\$ ", block.text.replace("\\\n", " "), flags=re.MULTILINE)
    if before.strip():
        raise ValueError(f"{called(block)}: {before.splitlines()[0]!r} is below no command; commands begin with '$ '")
    found = []
    for part in parts:
        line, _, output = part.partition("\n")
        *first, last = line.split(" && ")
        found += [*(Command(one.strip(), "") for one in first), Command(last.strip(), output)]
    return found
