"""A report of a building has a picture and a row for each storey and stair, with the figures of the run."""

import json

import pytest
from reported_pages import Parsed, command

pytestmark = pytest.mark.more

HOUSE = """
name = "house"
time_limit = 60
levels = [
  { name = "ground", height = 0, walkable = { box = [0, 0, 14, 6] }, exits = { street = [[0, 2], [0, 4]] } },
  { name = "first", height = 3, walkable = { box = [0, 0, 14, 6] } },
]
stairs = [{ name = "stair", lower = "ground", upper = "first", foot = [4, 3], direction = 0 }]
cohorts = [{ people = 11, start_region = "first" }]
"""


def test_a_report_says_of_each_storey_who_came_and_left_and_when_it_was_empty(tmp_path):
    (tmp_path / "house.toml").write_text(HOUSE, encoding="utf-8")
    code, said, error = command("run", tmp_path / "house.toml", "--runs", 2, "--out", tmp_path / "out", "--json")
    assert code == 0, error
    of_run = json.loads(said)["storeys"]
    code, said, error = command("report", tmp_path / "out", "-o", tmp_path / "report.html", "--json")
    assert code == 0, error
    found = json.loads(said)
    assert (
        found["runs"][0]["storeys"] == of_run == json.loads((tmp_path / "out" / "summary.json").read_text())["storeys"]
    )
    assert [*of_run] == ["first", "stair", "ground"]
    assert {name: one["started"]["mean"] for name, one in of_run.items()} == {
        "first": 11.0,
        "stair": 0.0,
        "ground": 0.0,
    }
    left = [
        one["left"][way]["people"] for one, way in zip(of_run.values(), ("stair", "ground", "exit street"), strict=True)
    ]
    assert left == [22] * 3
    zones = {zone["name"]: zone for zone in found["maps"][0]["zones"]}
    page = Parsed(tmp_path / "report.html")
    text = "".join(page.text.split())
    row = f"first+3.00m11.011.0{zones['first']['densest']:.1f}{of_run['first']['empty']['mean']:.1f}stair:11people"
    assert "Storeysandstairs" in text and row in text and "Zones" not in text
    table = (tmp_path / "out" / "sections.csv").read_text(encoding="utf-8")
    assert table.count("first – stair") >= 22 and "to stair" in table
