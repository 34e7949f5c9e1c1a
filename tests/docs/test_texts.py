"""Drawings in letters: the names in them are those of the code."""

import ast
import re

import pytest
from repository import ROOT
from shown import blocks, called, named

from crowd_env import SCHEMES, ObservationLayout

pytestmark = pytest.mark.more

ARCHITECTURE = "docs/architecture.md"


def texts(page):
    """Return the blocks without a language of a page."""
    return [block.text for block in blocks("text") if named(block.page) == page]


def test_every_text_is_about_something_that_is_tried_here():
    """A new one needs a test of its own, or a language."""
    assert [named(block.page) for block in blocks("text")] == [ARCHITECTURE, ARCHITECTURE], [
        called(block) for block in blocks("text")
    ]


def functions(folder):
    """Return the names of all functions and methods in a folder of crowd_env."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "crowd_env" / folder).rglob("*.py")]
    return {node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_the_drawing_of_the_rooms_names_rooms_and_all_schemes():
    drawing = texts(ARCHITECTURE)[0]
    last = drawing.strip().splitlines()[-1]
    assert re.findall(r"[a-z0-9-]+", last) == list(SCHEMES)
    rooms = {path.stem for path in (ROOT / "crowd_env").rglob("*") if path.suffix in ("", ".py")}
    drawn = set(re.findall(r"[a-z]+(?=[ ─►]|$)", drawing.partition("CONTACTS")[0])) - {"direction"}
    assert {"scenario", "routing", "neighbors"} <= drawn
    assert drawn <= rooms | {"metrics", "reward"}


def test_the_drawing_of_a_step_names_files_and_stages_that_exist():
    drawing = texts(ARCHITECTURE)[1]
    files = re.findall(r"\b([\w/<>]+\.py)\b", drawing)
    assert len(files) >= 6
    for file in files:
        assert list((ROOT / "crowd_env").rglob(file.replace("<scheme>", "*"))), file
    stages = [name for name in re.findall(r"^ {14}([a-z_]+)(?:, [a-z]+)?  ", drawing, re.MULTILINE) if name != "the"]
    assert len(stages) >= 5
    assert set(stages) <= functions("physics") | functions("core")
    assert f"observation (P, {ObservationLayout().size}) float32" in drawing
