"""Commands on places where people come in: what is told is of the people who came."""

import json
import re
from pathlib import Path

import pytest
from commands import call, figures
from reported_pages import Parsed

HALL = """
time_limit = 60
[geometry]
walkable = { box = [0, 0, 8, 6] }
exits = { east = [[8, 2], [8, 4]], north = [[2, 6], [4, 6]] }
regions = { stairs = { box = [0, 4, 1.5, 6] } }
[[cohorts]]
name = "street"
"""
LINE = "[[0, 1], [0, 3]]"


@pytest.fixture
def hall(tmp_path: Path):
    """Return a function that writes a place with the ``arrivals`` of a cohort, and returns its path."""

    def write(arrivals: str, more: str = "") -> Path:
        path = tmp_path / "hall.toml"
        path.write_text(f"{more}\n{HALL}arrivals = {arrivals}\n")
        return path

    return write


def test_a_report_counts_the_people_who_came(hall, tmp_path):
    out, page = tmp_path / "out", tmp_path / "page.html"
    came = figures(f"run {hall(f'{{ rate = 1.0, until = 5, line = {LINE} }}')} --runs 2 --out {out}")["came"]["mean"]
    assert call(f"report {out} -o {page} --no-maps").exit_code == 0
    text = Parsed(page).text
    assert f"{came:.1f}".removesuffix(".0") + " people are out after" in text
    assert re.search(r"pre-movement time, median and latest\s*0 s: all walk when they come", text)
    assert re.search(r"number\s*up to \d+", text)
    played = tmp_path / "replay.html"
    assert call(f"replay {out} --out {played}").exit_code == 0
    one = json.loads((out / "runs" / "0.json").read_text())
    many = sum(time not in ("inf", "nan") for time in one["entry_time"])
    assert f"{many} people" in Parsed(played).text


def test_room_is_told_of_where_people_start(hall, tmp_path):
    """A line has no room of its own; a region of arrivals is no place of a start."""
    path = hall(f"{{ rate = 1.0, until = 5, line = {LINE} }}")
    whole = figures(f"plan {path} --out {tmp_path / 'a.png'}")["plans"][0]["capacity"]
    said = call(f"plan {path} --out {tmp_path / 'a.png'}").stdout
    assert f"about {whole} people on the 48.0 m2 of the plan" in said
    more = '\n[[cohorts]]\npeople = 2\nstart_region = "stairs"\n'
    path.write_text(path.read_text() + more)
    there = figures(f"plan {path} --out {tmp_path / 'a.png'}")["plans"][0]["capacity"]
    assert there < whole / 5
    assert (
        f"about {there} people on the 3.0 m2 where they start" in call(f"plan {path} --out {tmp_path / 'a.png'}").stdout
    )


SHUT = 'closed_doors = ["d"]'
OF_EAST = '[geometry.doors]\nd = "east"\n[[cohorts]]'


@pytest.mark.parametrize(
    ("line", "more", "said"),
    [
        ("[[8, 2], [8, 4]]", "", "people of 'street' come in at exit 'east' and leave by it at once"),
        ("[[8, 2], [8, 4]]", 'exits = ["north"]', ""),
        ("[[8, 2], [8, 4]]", 'route = "north"', ""),
        (LINE, "", ""),
        (LINE, 'exits = ["east"]', "people of 'street' may leave only by east, which d shut for good"),
        (LINE, 'exits = ["east", "north"]', ""),
    ],
)  # fmt: skip
def test_a_plan_and_a_run_tell_what_no_run_can_end(line, more, said, hall, tmp_path):
    path = hall(f"{{ times = [1, 2], line = {line} }}\n{more}", SHUT if "shut" in said else "")
    if "shut" in said:
        path.write_text(path.read_text().replace("[[cohorts]]", OF_EAST))
    (plan,) = figures(f"plan {path} --out {tmp_path / 'a.png'}")["plans"]
    assert any(said in one for one in plan["remarks"]) if said else not plan["remarks"]
    notes = call(f"run {path} --runs 1 --time-limit 3 --json").stderr
    assert f"note: {said}" in notes if said else "people" not in notes.replace("walk out", "")


def test_a_run_that_ends_before_anyone_has_come_has_no_times(hall):
    found = figures(f"run {hall(f'{{ times = [70, 80], line = {LINE} }}')} --runs 1")
    assert found["came"]["mean"] == 0 and found["t95"]["mean"] is None
