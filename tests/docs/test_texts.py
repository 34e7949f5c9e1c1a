"""Drawings in letters: the names in them are those of the code, and a format that is described is read as described."""

import ast
import base64
import gzip
import re

import numpy as np
import pytest
from cases import looped
from repository import ROOT
from shown import blocks, called, named

from crowd_env import SCHEMES, ObservationLayout
from crowd_env.rendering.replay.pack import Column, pack

pytestmark = pytest.mark.more

ARCHITECTURE, REPLAY = "docs/architecture.md", "docs/replay.md"


def texts(page):
    """Return the blocks without a language of a page."""
    return [block.text for block in blocks("text") if named(block.page) == page]


def test_every_text_is_about_something_that_is_tried_here():
    """A new one needs a test of its own, or a language."""
    assert [named(block.page) for block in blocks("text")] == [ARCHITECTURE, ARCHITECTURE, REPLAY], [
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


@looped("order", [0, 1, 2])
def test_columns_of_a_page_are_read_as_the_three_lines_say(order):
    (described,) = texts(REPLAY)
    assert [line.split(" = ")[0].strip() for line in described.splitlines()[:2]] == ["w", "d"]
    values = np.array([3.0, 3.5, -2.0, 1000.25, 1000.25, 0.0])
    about, text = pack([Column("v", values, step=0.25, order=order, offset=1.0)])
    (column,) = about
    data = np.frombuffer(gzip.decompress(base64.b64decode(text)), dtype=np.uint8)
    z = sum(data[k * len(values) : (k + 1) * len(values)].astype(np.uint32) << (8 * k) for k in range(4))
    d = (z >> 1) ^ -(z & 1).astype(np.int32).astype(np.uint32)
    for _ in range(order):
        d = np.cumsum(d, dtype=np.uint32)
    w = d.astype(np.int32)
    assert described.count("order") == 1
    np.testing.assert_allclose(w * column["step"] + column["offset"], values, atol=column["step"] / 2)
