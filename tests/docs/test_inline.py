"""Commands inside of sentences: the program is there, and has the command and the options that are named."""

import re

import pytest
from cases import looped
from named_commands import check_command
from shown import PAGES, blocks_of, named

pytestmark = pytest.mark.more

STANDS_FOR_MORE = re.compile(r"\.\.\.|\[|\|")  # "crowd-env run ... --film out.mp4", "[--json]", "FILE.sqlite|.h5"

OF_AN_EXAMPLE = "crowd-env reproduce two-fig1 --set width=1.2"  # of a paper that the block above it has made up


def sentences_of(page):
    """Return the commands between backticks of a page, outside of its blocks."""
    text = page.read_text(encoding="utf-8")
    for block in blocks_of(page):
        text = text.replace(block.text, "")
    found = re.findall(r"`((?:crowd-env|python3?|make|pip) [^`]+)`", text)
    return list(dict.fromkeys(one for one in found if not STANDS_FOR_MORE.search(one) and one != OF_AN_EXAMPLE))


SENTENCES = {page: sentences_of(page) for page in PAGES if page.name != "CHANGELOG.md"}


@looped("page", [page for page, found in SENTENCES.items() if found], ids=named)
def test_commands_in_sentences_are_understood(page):
    for sentence in SENTENCES[page]:
        check_command(sentence)
