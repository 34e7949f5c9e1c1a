"""The command ``crowd-env plan``: what it says of a place, and that it draws every kind of place."""

import sys

import numpy as np
import pytest
import shapely
from cases import looped
from commands import call, figures
from late import late
from shapely.geometry import box

from crowd_env.scenarios import SCENARIOS

image = late("matplotlib.image")

FOYER = "examples/foyer.wkt"
DOOR = "--exit 14,4.5,14,6"


def written(path, area):
    path.write_text(area.wkt)
    return path


def of(line, out):
    """Return what is said of the one place of a command that draws into ``out``."""
    (head,) = figures(f"plan {line} --out {out}")["plans"]
    assert out.read_bytes()[:4] == b"\x89PNG"
    return head


@pytest.mark.more
def test_it_says_how_large_a_plan_is_and_how_wide_its_exits(tmp_path):
    head = of(f"{FOYER} {DOOR} --people 40", tmp_path / "foyer.png")
    assert head["bounds"] == [0, 0, 14, 8] and head["area"] == pytest.approx(9 * 8 + 5 * 2.5 - 0.8**2)
    (door,) = head["exits"]
    assert (door["name"], door["width"]) == ("exit-0", 1.5)
    assert door["narrowest_passage"]["width"] == pytest.approx(1.5) and door["narrowest_passage"]["is_exit"]
    assert head["people"] == 40 and head["body_diameter"] == [0.3, 0.38] and not head["remarks"]
    # A center keeps 0.2 m off all walls but the exit; the pillar keeps people off all around.
    assert 0.85 * head["area"] < head["free_area"] < head["area"]
    assert 0.75 < head["capacity"] * np.sqrt(12) * 0.19**2 / head["area"] < 1.0  # a hexagon around each disc


@pytest.mark.more
def test_it_answers_for_the_people_of_the_run(tmp_path):
    """Larger bodies have less room and may not pass; recorded starts and an outline count as they do in a run."""
    narrow = written(
        tmp_path / "narrow.wkt", box(0, 0, 6, 4).difference(box(3, 0, 3.2, 1.6)).difference(box(3, 2.3, 3.2, 4))
    )
    line, picture = f"{narrow} --exit 6,1,6,2", tmp_path / "narrow.png"
    usual, large = of(line, picture), of(f"{line} --set radius=0.3,0.4", picture)
    assert large["body_diameter"] == [0.6, 0.8] and large["free_area"] < usual["free_area"]
    assert large["capacity"] < usual["capacity"]
    assert not usual["remarks"] and any("narrower than the largest bodies (0.80 m)" in one for one in large["remarks"])
    assert of(f"{line} --set outline=torso", picture)["capacity"] < usual["capacity"]
    without = f"{narrow}"  # of which no exit is known yet
    assert of(f"{without} --set outline=torso --set radius=0.3", picture)["capacity"] < of(without, picture)["capacity"]
    behind = tmp_path / "behind.csv"
    behind.write_text("x,y\n4,1\n5,2\n5,3\n")
    told = of(f"{line} --starts {behind}", picture)
    (door,) = told["exits"]
    assert told["people"] == 3 and door["narrowest_passage"]["is_exit"]  # nobody has to pass the door before it
    assert of("room-v0 --set radius=0.4 --people 3", picture)["body_diameter"] == [0.8, 0.8]
    for bad, words in (
        (f"{line} --set radius=wide", "--set radius=wide: this must be one number"),
        (f"{line} --starts {behind} --people 4", "--people is 4, but "),
        (f"room-v0 floor-v0 --starts {behind}", "--starts is for one floor plan, but 2 places are given"),
    ):
        result = call(f"plan {bad} --out {picture}")
        assert result.exit_code == 2 and words in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.more
def test_what_a_plan_has_room_for_is_what_a_run_can_place(tmp_path):
    line = f"{FOYER} {DOOR} --set radius=0.25"
    most = of(line, tmp_path / "foyer.png")["capacity"]
    assert not of(f"{line} --people {most}", tmp_path / "foyer.png")["remarks"]
    refused = call(f"run {line} --people {most + 1} --runs 1 --time-limit 1")
    assert refused.exit_code == 2 and f"a regular lattice holds {most} there" in refused.stderr


@pytest.mark.more
def test_a_plan_without_exits_is_drawn_so_that_they_can_be_read_off(tmp_path):
    head = of(FOYER, tmp_path / "foyer.png")
    assert head["exits"] == [] and head["not_reached"] == []
    assert "none yet: give --exit x1,y1,x2,y2" in call(f"plan {FOYER} --out {tmp_path / 'foyer.png'}").stdout
    assert call(f"run {FOYER}").exit_code == 2  # to run, it needs one


@pytest.mark.more
def test_what_no_exit_reaches_is_told_with_its_area_and_place(tmp_path):
    shaft = written(tmp_path / "shaft.wkt", shapely.union_all([box(0, 0, 6, 4), box(8, 1, 10, 3)]))
    head = of(f"{shaft} --exit 6,1,6,2", tmp_path / "shaft.png")
    (part,) = head["not_reached"]
    assert part["area"] == pytest.approx(4.0) and part["at"] == pytest.approx([9.0, 2.0])
    assert any("no exit can be reached from a part of 4 m2" in note for note in head["notes"])
    narrow = box(0, 0, 6, 4).difference(box(4, 0, 4.1, 1.9)).difference(box(4, 2.1, 4.1, 4))
    locked = written(tmp_path / "locked.wkt", narrow)
    (part,) = of(f"{locked} --exit 0,1,0,2", tmp_path / "locked.png")["not_reached"]
    assert part["area"] == pytest.approx(1.9 * 4, rel=0.05) and 4.1 < part["at"][0] < 6


@pytest.mark.more
@looped(
    ("exit", "words"),
    [
        ("14,4.5,14,4.78", "0.28 m wide, narrower than the smallest body (0.30 m): nobody passes"),
        ("14,4.5,14,4.85", "0.35 m wide, narrower than the largest bodies (0.38 m)"),
    ],
)
def test_an_exit_narrower_than_a_body_is_remarked(tmp_path, exit, words):
    head = of(f"{FOYER} --exit {exit}", tmp_path / "foyer.png")
    assert any(words in remark for remark in head["remarks"])
    assert words.split(",")[0] in " ".join(
        call(f"plan {FOYER} --exit {exit} --out {tmp_path / 'p.png'}").stdout.split()
    )


@pytest.mark.more
def test_wide_exits_and_passages_narrower_than_bodies_are_remarked(tmp_path):
    area = box(0, 0, 60, 30).difference(box(20, 0, 20.2, 14)).difference(box(20, 14.35, 20.2, 30))
    plan = written(tmp_path / "hall.wkt", area)
    remarks = of(f"{plan} --exit 60,1,60,26", tmp_path / "hall.png")["remarks"]
    assert any("25.00 m wide, which is rare" in remark for remark in remarks)
    assert any("pass 0.35 m at (20." in remark and "largest bodies" in remark for remark in remarks)


def test_more_people_than_fit_are_refused_in_one_sentence(tmp_path):
    wrong = call(f"plan {FOYER} {DOOR} --people 4000 --out {tmp_path / 'foyer.png'}")
    assert wrong.exit_code == 2 and "4000 people do not fit" in wrong.stderr and not list(tmp_path.iterdir())
    nowhere = of(f"{FOYER} --people 4000", tmp_path / "foyer.png")  # without exits there is nothing to run yet
    assert any("people cannot be placed: 4000 people do not fit" in remark for remark in nowhere["remarks"])


@pytest.mark.more
def test_coordinates_of_millions_of_meters_lose_nothing(tmp_path):
    plan = tmp_path / "utm.wkt"
    plan.write_text("POLYGON ((500000 5000000, 500012 5000000, 500012 5000009, 500000 5000009, 500000 5000000))")
    (door,) = of(f"{plan} --exit 500012,5000003,500012,5000004.2", tmp_path / "utm.png")["exits"]
    assert door["width"] == pytest.approx(1.2) and door["narrowest_passage"]["width"] == pytest.approx(1.2)


@pytest.mark.more
def test_several_make_a_sheet_and_the_picture_grows_with_them(tmp_path):
    one, sheet = tmp_path / "one.png", tmp_path / "sheet.png"
    assert call(f"plan floor-v0 --out {one}").exit_code == 0
    told = call(f"plan {' '.join(SCENARIOS)} {FOYER} --out {sheet}")
    assert told.exit_code == 0, told.stderr
    assert all(name in told.stdout for name in SCENARIOS)
    height, width = image.imread(sheet).shape[:2]
    assert height > 1.5 * width


@looped(
    ("line", "words"),
    [
        ("floor-v0 --out plan.gif", ".png"),
        (f"{FOYER} floor-v0 {DOOR}", "--exit is for one floor plan, but 2 places are given"),
        (f"floor-v0 {DOOR}", "has its own exits"),
        ("floor-v0 --unit cm", "is in meters"),
        (f"{FOYER} --exit 3,3,4,4", "not on the boundary"),
    ],
)
def test_mistakes_are_one_sentence(line, words, tmp_path):
    out = "" if "--out" in line else f" --out {tmp_path / 'plan.png'}"
    wrong = call(f"plan {line}{out}")
    assert wrong.exit_code == 2 and words in wrong.stderr and "Traceback" not in wrong.output
    assert not list(tmp_path.iterdir())


def test_without_a_drawing_library_there_are_figures_and_a_note(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = call("plan room-v0")
    assert result.exit_code == 0 and "narrowest passage" in result.stdout
    assert "no picture" in result.stderr and "matplotlib" in result.stderr and not list(tmp_path.iterdir())
    assert figures("plan room-v0")["picture"] is None
    asked = call("plan room-v0 --out room.png")  # who asks for a picture is told that there is none
    assert asked.exit_code == 2 and "matplotlib" in asked.stderr
