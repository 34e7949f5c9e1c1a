"""Links lead somewhere, and files that are named are there."""

import re

import pytest
from cases import looped
from repository import ROOT
from shown import PAGES, named

pytestmark = pytest.mark.more


@looped("page", PAGES, ids=named)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#\s]+)", text) + re.findall(r'src="([^"]+)"', text)
    local = [link for link in links if "://" not in link]
    missing = [link for link in local if not (page.parent / link).exists()]
    assert not missing


@looped("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=named)
def test_files_that_are_named_exist(page):
    """The changelog names what was there at its time."""
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:crowd_env|agents|benchmarks|validation|tests|docs|examples)/[\w./-]*)`", text)
    names = {name for name in named if not re.search(r"-v\d+$|/[A-Z]+(/|$)", name)}  # environments; TASK is any task
    missing = sorted(name for name in names if not (ROOT / name).exists())
    assert not missing
