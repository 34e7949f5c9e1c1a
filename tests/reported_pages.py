"""Commands that make reports, and pages as they are read."""

from html.parser import HTMLParser
from pathlib import Path

from typer.testing import CliRunner

from crowd_env.cli.main import app


def command(*words: str | Path) -> tuple[int, str, str]:
    """Return the exit code of a command, and what it wrote to both streams."""
    result = CliRunner().invoke(app, list(map(str, words)))
    return result.exit_code, result.stdout, " ".join(result.stderr.split())


class Parsed(HTMLParser):
    """The tags of a page, what they point at, and its text."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.text = ""
        self.feed(page.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href", "srcset")]

    def handle_data(self, data: str) -> None:
        self.text += data
