"""Tables of the documentation that a command makes: their places, their cells, and what a mistake leaves behind."""

import json
import re

import pytest
from repository import ROOT
from typer.testing import CliRunner

from validation.cli import app
from validation.pages import TABLES, fill, run

RUN = {
    "overlap_mm": {"mean": 0.01863, "max": 12.345}, "evacuation_time": {"mean": 4.444, "sd": 0.55}, "runs": 50,
    "flow": {"mean": None, "sd": None}, "unfinished": 34, "unfinished_runs": 3, "max_speed": 2.96,
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_every_table_has_one_place_of_its_own_with_its_head(name):
    page = (ROOT / TABLES[name].page).read_text(encoding="utf-8")
    (found,) = re.findall(rf"<!-- table: {name} -->\n(.*?)<!-- end -->", page, re.DOTALL)
    assert found.splitlines()[0] == f"| {' | '.join(TABLES[name].head)} |"


def test_every_place_has_a_table():
    marked = [
        name for page in (ROOT / "docs").glob("*.md") for name in re.findall(r"<!-- table: (\w+) -->", page.read_text())
    ]
    assert sorted(marked) == sorted(TABLES)


def test_a_table_replaces_what_stands_between_its_marks_and_nothing_else(tmp_path):
    page = tmp_path / "docs" / "physics.md"
    page.parent.mkdir()
    page.write_text("before\n<!-- table: schemes -->\n| old |\n<!-- end -->\nafter\n", encoding="utf-8")
    asked = []

    def command(line):
        asked.append(line)
        return RUN

    assert fill("schemes", command, tmp_path) == page
    lines = page.read_text(encoding="utf-8").splitlines()
    assert (lines[0], lines[-1]) == ("before", "after") and "| old |" not in lines
    assert "| `dem` | 0.0186 / 12.3 | 4.44 ± 0.55 | – | 34 people in 3 of 50 runs | 3.0 |" in lines
    assert asked[0] == "crowd_env run room-v0 --scheme dem --runs 50"


def test_a_command_that_fails_leaves_the_page_as_it_was(tmp_path):
    page = tmp_path / "docs" / "physics.md"
    page.parent.mkdir()
    page.write_text("<!-- table: schemes -->\n| old |\n<!-- end -->\n", encoding="utf-8")

    def command(line):
        raise ValueError("it failed")

    with pytest.raises(ValueError, match="it failed"):
        fill("schemes", command, tmp_path)
    assert "| old |" in page.read_text(encoding="utf-8")
    page.write_text("no place\n")
    with pytest.raises(
        ValueError, match=r"docs/physics\.md has no place for schemes; mark one with <!-- table: schemes -->"
    ):
        fill("schemes", command, tmp_path)


def test_commands_are_run_as_anyone_would_run_them():
    assert set(run("crowd_env list")) >= {"scenarios", "schemes"}
    with pytest.raises(ValueError, match=r"python -m crowd_env run nowhere --json failed: .*nowhere"):
        run("crowd_env run nowhere")


def test_an_unknown_table_is_one_line():
    found = CliRunner().invoke(app, ["pages", "speeds"])
    assert found.exit_code == 2 and "unknown table 'speeds'; known: schemes, clogging, strategies" in found.stderr


def test_the_names_of_pages_can_be_had_as_json(monkeypatch, tmp_path):
    monkeypatch.setattr("validation.cli.fill", lambda name, command: tmp_path / f"{name}.md")
    found = CliRunner().invoke(app, ["pages", "clogging", "--json"])
    assert json.loads(found.stdout) == {"clogging": "clogging.md"}
