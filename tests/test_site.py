"""The site that `make docs` builds from docs/ leaves no page and no public name out."""

import importlib
import re

import pytest
from cases import looped
from repository import ROOT

pytestmark = pytest.mark.more

DOCS = ROOT / "docs"
PAGES = sorted(
    path
    for path in DOCS.rglob("*")
    if path.suffix in {".md", ".rst", ".ipynb"} and ".ipynb_checkpoints" not in path.parts
)
# A page in Markdown lists those below it in a block, one in reStructuredText in an indented paragraph, a notebook none.
TOCTREES = {".md": r"^```\{toctree\}\n(.*?)^```", ".rst": r"^\.\. toctree::\n((?:   .*\n|\n)+)", ".ipynb": r"$^()"}
OF_ONE_MODULE = r"^\.\. currentmodule:: (\S+)\n(.*?)(?=^\.\. currentmodule|\Z)"


def pages_below(page):
    """Return the pages that the tables of contents of a page list."""
    found = set()
    for block in re.findall(TOCTREES[page.suffix], page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        entries = [line.strip() for line in block.splitlines() if line.strip() and not line.strip().startswith(":")]
        for entry in entries:
            hits = [hit for suffix in TOCTREES for hit in page.parent.glob(entry + suffix)]
            assert hits, f"{page.relative_to(ROOT)} lists {entry}, which is no page"
            found.update(hits)
    return found


def test_every_page_is_in_the_site():
    reached, todo = set(), [DOCS / "index.md"]
    while todo:
        page = todo.pop()
        if page not in reached:
            reached.add(page)
            todo += pages_below(page)
    assert sorted(reached) == PAGES


@looped(
    "module",
    [
        "crowd_env",
        "crowd_env.envs.adapters.sb3",
        "crowd_env.recording",
        "crowd_env.rendering.replay",
        "crowd_env.agents",
        "crowd_env.agents.tasks",
    ],
)
def test_every_public_name_is_in_the_reference(module):
    shown = []
    for page in (DOCS / "api").glob("*.rst"):
        for name, part in re.findall(OF_ONE_MODULE, page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            if name == module:
                shown += re.findall(r"^\.\. auto\w+:: (\S+)$", part, re.MULTILINE)
    public = importlib.import_module(module).__all__
    assert sorted(shown) == sorted(public)
