"""The page is one whole HTML file that asks nobody for anything, and holds the recording as documented."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from replayed_pages import Parsed, read_page, walk_out
from shapely.geometry import box

from crowd_env import CrowdEnv, Geometry, Population, Scenario, SpeedZone
from crowd_env.core.behaviors.outline import Outline
from crowd_env.recording import record
from crowd_env.rendering.palette import pressure_color
from crowd_env.rendering.replay import write_page

pytestmark = pytest.mark.more

EVIL = '</script><script>alert("1")</script><!-- {{about}} & \u2028'


def test_what_is_packed_is_the_recording(tmp_path: Path) -> None:
    recording = walk_out(20, contacts=True, stays=4, outline="torso")
    page = write_page(tmp_path / "out.html", recording)
    (found,) = read_page(page.path)
    order = np.argsort(recording.person, kind="stable")
    steps = {"x": recording.position[order, 0], "y": recording.position[order, 1], "angle": recording.angle[order]}
    steps |= {"pressure": recording.pressure[order], "speed": np.linalg.norm(recording.velocity[order], axis=1)}
    about = {one["name"]: one for one in Parsed(page.path.read_text("utf-8")).about()["recordings"][0]["columns"]}
    for name, values in steps.items():
        assert np.abs(found[name] - values).max() <= 0.5001 * about[name]["step"], name
    assert about["x"]["step"] == 1e-3
    np.testing.assert_allclose(found["times"], recording.times, atol=1e-6)
    np.testing.assert_array_equal(found["cohort"], recording.cohort)
    np.testing.assert_allclose(found["exit_time"], np.nan_to_num(recording.exit_time, nan=-1.0), atol=0.51e-4)
    np.testing.assert_array_equal(found["exit_index"], recording.exit_index)
    contacts = recording.contacts
    assert contacts is not None
    np.testing.assert_array_equal(found["contact_i"], contacts.i)
    np.testing.assert_array_equal(found["contact_j"], contacts.j)
    np.testing.assert_allclose(found["contact_force"], contacts.force[:, 0], atol=1.0)
    wall = contacts.j < 0
    np.testing.assert_allclose(found["contact_x"][wall], contacts.point[wall, 0], atol=0.51e-2)
    assert (page.rows, page.frames, page.left_out) == (len(recording.person), (len(recording.times),), (0,))
    assert page.size == page.path.stat().st_size


def test_coordinates_of_maps_lose_nothing(tmp_path: Path) -> None:
    near = walk_out(5)
    away = np.array([360_000.0, 5_628_000.0])
    far = replace(
        near,
        position=near.position + away,
        walkable="POLYGON ((360000 5628000, 360006 5628000, 360006 5628004, 360000 5628004, 360000 5628000))",
        exits=tuple((name, ends + away) for name, ends in near.exits),
        thin_walls=near.thin_walls + away,
    )
    (found,) = read_page(write_page(tmp_path / "far.html", far).path)
    order = np.argsort(far.person, kind="stable")
    np.testing.assert_allclose(found["y"], far.position[order, 1] - 5_628_000.0, rtol=0, atol=0.51e-3)


def test_zones_of_a_recording_are_on_the_page(tmp_path: Path) -> None:
    room = Geometry.from_wkt("POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0))", exits={"out": [[6, 1], [6, 3]]})
    room = room.with_regions({"stairs": box(2, 1, 3, 4), "stage": box(0, 0, 1, 1)})
    people = Population(people=1, starts=[(5.5, 2)])
    place = Scenario("room", room, people, 9.0, zones=(SpeedZone("stairs", speed=0.5),))
    page = write_page(tmp_path / "out.html", record(CrowdEnv([place])))
    about = Parsed(page.path.read_text("utf-8")).about()["recordings"][0]
    (zone,) = about["plan"]["zones"]
    assert zone["name"] == "stairs" and shapely.equals(shapely.Polygon(*zone["rings"]), box(2, 1, 3, 4))
    assert not any("POLYGON" in value for _, value in about["facts"])


def test_the_page_is_well_formed_and_needs_nothing_else(tmp_path: Path) -> None:
    text = write_page(tmp_path / "two.html", [walk_out(), walk_out(strategy="nearest")]).path.read_text("utf-8")
    parsed = Parsed(text)  # checks that elements are in balance
    assert text.startswith("<!doctype html>")
    assert parsed.addresses == ["data:,"]
    assert not re.findall(r"\b(https?:)?//[a-z0-9-]+\.[a-z]", text)  # no address of any host
    assert not re.findall(r"@import|url\(|\bimport\s*\(|\bfetch\s*\(|XMLHttpRequest|sendBeacon|WebSocket", text)
    assert "default-src 'none'" in text
    assert "{{" not in text.replace("{{about}}", "")
    assert parsed.about()["title"] == "hand-made"
    assert [one["label"] for one in parsed.about()["recordings"]] == ["shortest", "nearest"]


def test_names_that_hold_markup_stay_names(tmp_path: Path) -> None:
    recording = walk_out(scenario=EVIL, **{EVIL: {EVIL: EVIL}})
    recording = replace(recording, cohorts=(EVIL, "b"), exits=tuple((EVIL, ends) for _, ends in recording.exits))
    harmless = Parsed(write_page(tmp_path / "a.html", walk_out()).path.read_text("utf-8"))
    parsed = Parsed(write_page(tmp_path / "b.html", recording, names=[EVIL]).path.read_text("utf-8"))
    assert len(parsed.scripts) == len(harmless.scripts)
    assert parsed.texts["title"] == parsed.texts["h1"] == EVIL
    assert parsed.about()["title"] == EVIL
    assert "<" not in parsed.script("about")
    assert [f"{EVIL}: {EVIL}", EVIL] in parsed.about()["recordings"][0]["facts"]
    assert parsed.scripts[-1] == harmless.scripts[-1]  # the program itself


def test_a_page_stays_within_its_bound_and_says_what_it_leaves_out(tmp_path: Path) -> None:
    recording = walk_out(30, stays=10)
    page = write_page(tmp_path / "out.html", recording, most_rows=200)
    assert page.rows <= 200 + 2 * 30
    assert page.frames[0] + page.left_out[0] == len(recording.times)
    about = Parsed(page.path.read_text("utf-8")).about()["recordings"][0]
    assert f"{page.frames[0]} of {len(recording.times)} frames" in about["note"]
    whole = write_page(tmp_path / "whole.html", recording)
    assert whole.left_out == (0,) and whole.size > page.size


def test_colors_are_those_of_all_pictures(tmp_path: Path) -> None:
    about = Parsed(write_page(tmp_path / "out.html", walk_out()).path.read_text("utf-8")).about()
    ramp = pressure_color(np.linspace(0.0, 1.0, about["steps"]))
    assert about["colors"]["pressure"]["fill"][0] == "#{:02x}{:02x}{:02x}".format(*ramp[0])
    assert about["full_pressure"] == 1600.0


def test_the_title_says_what_recordings_share_and_labels_what_tells_them_apart(tmp_path: Path) -> None:
    cases = {
        ("hand-made", "dem · shortest · seed 3 · 6 people · all out after 3.0 s"): [walk_out()],
        ("hand-made", "dem · shortest · 6 people"): [walk_out(), walk_out(seed=4)],
        ("hand-made", "dem · seed 3"): [walk_out(), walk_out(4, strategy="nearest")],
        ("hand-made and other", "dem · shortest · seed 3 · 6 people"): [walk_out(), walk_out(scenario="other")],
    }
    labels = [[""], ["seed 3", "seed 4"], ["shortest · 6 people", "nearest · 4 people"], ["hand-made", "other"]]
    for ((title, summary), recordings), expected in zip(cases.items(), labels, strict=True):
        page = write_page(tmp_path / "out.html", recordings, names=["a", "b"][: len(recordings)])
        parsed = Parsed(page.path.read_text("utf-8"))
        assert parsed.texts["title"] == title
        assert parsed.texts["p"].startswith(f"{summary}Unpacking")
        assert len(recordings) == 1 or [one["label"] for one in parsed.about()["recordings"]] == expected
    same = [walk_out(), walk_out()]
    parsed = Parsed(write_page(tmp_path / "out.html", same, names=["one", "two"]).path.read_text("utf-8"))
    assert [one["label"] for one in parsed.about()["recordings"]] == ["one", "two"]


def test_who_is_left_inside_is_said(tmp_path: Path) -> None:
    about = Parsed(write_page(tmp_path / "out.html", walk_out(6, stays=2)).path.read_text("utf-8")).about()
    assert about["recordings"][0]["outcome"].startswith("2 still inside after")


def test_the_shape_of_bodies_comes_along(tmp_path: Path) -> None:
    about = Parsed(write_page(tmp_path / "out.html", walk_out(outline="torso")).path.read_text("utf-8")).about()
    torso = Outline.of("torso")
    assert torso is not None
    np.testing.assert_allclose(about["recordings"][0]["outline"], np.column_stack(torso.shape[:3]))


def test_bad_requests_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    nobody = walk_out()
    nobody = replace(
        nobody,
        frame_start=0 * nobody.frame_start,
        **{name: getattr(nobody, name)[:0] for name in ("person", "position", "velocity", "pressure")},
    )
    with pytest.raises(ValueError, match=r"must end in \.html"):
        write_page(tmp_path / "out.txt", walk_out())
    with pytest.raises(ValueError, match="1 or 2 recordings; 3 were given"):
        write_page(tmp_path / "out.html", [walk_out()] * 3)
    with pytest.raises(ValueError, match=r"empty\.sqlite holds nobody"):
        write_page(tmp_path / "out.html", nobody, names=["empty.sqlite"])
    assert list(tmp_path.iterdir()) == []
