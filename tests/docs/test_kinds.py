"""No block escapes: each is of a kind that some test tries, and nothing looks like code outside of a block."""

import re

import pytest
from cases import looped
from repository import ROOT
from shown import PAGES, blocks, blocks_of, called, commands_of, named

pytestmark = pytest.mark.more

# Kind of block -> the test that would be red if one of them were wrong.
TRIED = {
    "python": "docs/test_python.py",
    "console": "docs/test_consoles.py",
    "toml": "docs/test_scenario_files.py",
    "text": "docs/test_texts.py",
    "{toctree}": "test_site.py",
    "{include}": "docs/test_kinds.py",
}
WITH_FORMULAS = ("docs/clogging.md", "docs/physics.md", "docs/walking.md")


@looped("page", PAGES, ids=named)
def test_every_block_is_of_a_kind_that_is_tried(page):
    unknown = [called(block) for block in blocks_of(page) if block.kind not in TRIED]
    assert not unknown, f"no test tries these; known kinds: {', '.join(TRIED)}"
    fences = re.findall(r"^\s*(?:```|~~~|:::)", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(fences) == 2 * len(blocks_of(page)), "a fence is not closed, or is indented otherwise than its end"


@looped("test", sorted(set(TRIED.values())))
def test_what_tries_them_is_there(test):
    assert (ROOT / "tests" / test).exists()


@looped("page", PAGES, ids=named)
def test_only_formulas_are_shown_by_indentation_alone(page):
    text = page.read_text(encoding="utf-8")
    for block in blocks_of(page):
        text = text.replace(block.text, "")
    indented = re.findall(r"(?<=\n\n)(?:(?: {4}|\t).*\n)+", text)
    assert not indented or named(page) in WITH_FORMULAS
    assert not [one for one in indented if "=" not in one or re.search(r"^\s*(\$|>>>|import|from|def) ", one, re.M)]


@looped("page", sorted((ROOT / "docs").rglob("*.rst")), ids=named)
def test_pages_of_the_reference_show_no_code(page):
    """They take examples from docstrings; a block here would be tried by nothing."""
    text = page.read_text(encoding="utf-8")
    assert not re.findall(
        r"^\s*\.\. (?:code|code-block|literalinclude|parsed-literal|doctest)::|^(?!\s*\.\. ).*::$|^\s*>>>", text, re.M
    )


@looped("block", blocks("console"), ids=called)
def test_consoles_hold_commands_and_their_output(block):
    assert commands_of(block)


@looped("block", blocks("{include}"), ids=called)
def test_what_is_included_is_there(block):
    (line,) = [line for line in block.page.read_text(encoding="utf-8").splitlines() if line.startswith("```{include}")]
    assert (block.page.parent / line.split()[1]).exists()
