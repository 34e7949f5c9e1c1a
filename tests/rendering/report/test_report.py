"""`crowd-env report` makes one page of folders of runs, escapes every name, and says what may not be concluded."""

import json
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from cases import looped
from reported_pages import Parsed, command

from crowd_env.analysis.results.crowding import CrowdingRecorder
from crowd_env.analysis.results.measurements import CELL, grid_over
from crowd_env.cli.report import place_of
from crowd_env.envs.metrics import t_quantile
from crowd_env.envs.rollout import run_episodes
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.rendering.report.answer import _sentence, answer
from crowd_env.rendering.report.assumptions import limits_of
from crowd_env.rendering.report.figures import differences
from crowd_env.rendering.report.maps import _worst, heat_of, measure
from crowd_env.rendering.report.page import _asked
from crowd_env.rendering.report.runs import Runs, load_runs

pytestmark = pytest.mark.more

EVIL = "<script>alert(1)</script>"
PLAN = "POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0))"


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three folders of runs: two strategies on the same draws, and another place."""
    home = tmp_path_factory.mktemp("reported")
    hall = ("run", "two-exit-hall-v0", "--people", 8, "--runs", 3, "--walking", "hurried")
    for words in (
        (*hall, "--routing", "nearest", "--out", home / "nearest"),
        (*hall, "--routing", "shortest", "--out", home / "shortest"),
        ("run", "room-v0", "--people", 4, "--runs", 2, "--scheme", "dem", "--out", home / "room"),
    ):
        code, _, said = command(*words)
        assert code == 0, said
    return home


def test_pictures_of_a_page_are_never_files(folders, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    assert command("report", folders / "room", "-o", tmp_path / "page.html")[0] == 0
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


@pytest.fixture(scope="module")
def page(folders: Path) -> Path:
    path = folders / "report.html"
    code, _, said = command("report", folders / "nearest", folders / "shortest", "-o", path)
    assert code == 0 and f"report: {path} (" in said
    return path


@looped("people", [1, 2])
def test_one_pedestrian_is_one_person(people: int) -> None:
    time = {"mean": 9.0, "ci95": (None, None)}
    figures = {"people": people, "runs": 1, "unfinished_runs": 0, "evacuation_time": time}
    runs = cast(Runs, SimpleNamespace(figures=figures, episodes=[0]))
    one = people == 1
    assert f"does it take {people} {'person' if one else 'people'} to leave" in _asked([runs])
    assert _sentence(runs) == ("1 person is" if one else "2 people are") + " out after 9.0 s."


def test_the_page_needs_nothing_else_and_shows_every_section(page: Path) -> None:
    found = Parsed(page)
    assert "script" not in found.tags and "link" not in found.tags
    assert found.sources and all(source.startswith("data:image/png;base64,") for source in found.sources)
    for heading in (
        "The answer",
        "RSET",
        "Annex",
        "The plan",
        "Egress",
        "Exits over time",
        "crowded",
        "Population",
        "Assumptions",
        "Limits",
        "Versions",
    ):
        assert heading in found.text
        found.text = found.text[found.text.index(heading) :]  # in this order: the answer first
    found = Parsed(page)
    assert "Do not size a building with it." in found.text
    for row in ("pre-movement time, median and latest", "by hand (SFPE)", "pre-movement time (response time)"):
        assert row in found.text
    assert "crowd-env run --config" in found.text


def test_the_figures_are_those_of_the_folders(folders: Path) -> None:
    words = ("report", folders / "nearest", folders / "shortest", "-o", folders / "figures.html", "--json")
    code, out, _ = command(*words, "--no-maps")
    assert code == 0
    found = json.loads(out)
    assert found["maps"] == []
    for one in found["runs"]:
        summary = json.loads((folders / one["name"] / "summary.json").read_text("utf-8"))
        assert {key: one.get(key, summary[key]) for key in summary} == summary and "flow" in one
    (gap,) = found["differences"]
    first, other = (one["evacuation_time"]["mean"] for one in found["runs"])
    assert gap["evacuation_time"]["mean"] == pytest.approx(other - first)
    assert gap["evacuation_time"]["pairs"] == gap["shared_seeds"] == 3


def test_the_answer_is_what_the_exit_times_say(folders: Path, page: Path) -> None:
    nearest, shortest = load_runs([folders / "nearest", folders / "shortest"], place_of)
    for one in (nearest, shortest):
        times = np.sort([episode.exit_time for episode in one.episodes], axis=1)  # of 3 runs, 8 people
        for k, label in ((3, "T50"), (7, "T95"), (7, "last person out")):
            (row,) = (row for row in answer([one])["rows"] if label in row[0] and "slowest" not in row[0])
            assert float(row[1].split()[0]) == pytest.approx(times[:, k].mean(), abs=0.005)
        (exits,) = answer([one])["exits"]
        people = [float(row[2]) for row in exits["rows"]]
        assert sum(people) == pytest.approx(8, abs=0.1) and people == sorted(people, reverse=True)
        for row in exits["rows"]:
            wait = np.array([seen.wait[one.scenario.exits.index(row[0])] for seen in one.crowding])
            assert row[8] == "-" or float(row[8]) == pytest.approx(wait[wait >= 0.0].mean(), abs=0.06)
        first, last = (np.array([float(row[k]) for row in exits["rows"] if row[k] != "-"]) for k in (3, 4))
        assert (first >= times[:, 0].min() - 0.05).all() and (last <= times[:, -1].max() + 0.05).all()
        assert f"8 people are out after {times[:, -1].mean():.1f} s (mean of 3 runs" in Parsed(page).text


def test_the_number_of_runs_that_convergence_asks_for_follows_the_root(folders: Path) -> None:
    (one,) = load_runs([folders / "nearest"], place_of)
    mean, half = 50.0, 4.0
    figures = {
        **one.figures,
        "runs": 20,
        "evacuation_time": {"mean": mean, "sd": 8.0, "ci95": [mean - half, mean + half]},
    }
    (row,) = (row for row in answer([one._replace(figures=figures)])["rows"] if "convergence" in row[0])
    assert row[1].startswith("± 8.0 % of the mean") and "about 320 runs" in row[1]  # a quarter: 16 times as many


def test_pairs_have_a_shorter_interval_only_where_the_draws_are_the_same(folders: Path) -> None:
    nearest, shortest, room = load_runs([folders / name for name in ("nearest", "shortest", "room")], place_of)
    same, other = differences([nearest, shortest, room])
    times = [np.array([one.metrics.mean_exit_time for one in runs.episodes]) for runs in (shortest, nearest)]
    gap = times[0] - times[1]
    assert same["mean_exit_time"]["mean"] == pytest.approx(gap.mean())
    assert same["mean_exit_time"]["sd"] == pytest.approx(gap.std(ddof=1))
    assert "cannot be paired" in other["why_not"] and "t95" not in other
    later = shortest._replace(episodes=[one._replace(seed=one.seed + 100) for one in shortest.episodes])
    assert "no seed is in both" in differences([nearest, later])[0]["why_not"]
    fatter = shortest._replace(episodes=[one._replace(radius=one.radius + 0.01) for one in shortest.episodes])
    assert "other people" in differences([nearest, fatter])[0]["why_not"]


def test_the_maps_are_those_of_all_runs_and_nothing_is_simulated_for_them(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nearest, room = load_runs([folders / "nearest", folders / "room"], place_of)
    recorder = CrowdingRecorder(nearest.scenario.geometry)
    way = {"scheme": nearest.scheme, "strategy": "nearest", "recorder": recorder, "at_once": 1}
    each = [one.record for one in run_episodes(nearest.scenario, 3, **way)]
    monkeypatch.setattr(Simulation, "advance", None)
    found = measure(nearest)
    assert found is not None and found.runs == 3
    np.testing.assert_array_equal(found.density, np.max([one.density for one in each], axis=0))
    np.testing.assert_array_equal(found.pressure, np.max([one.pressure for one in each], axis=0))
    assert found.densest[0].value <= found.density.max()
    values = [place.value for place in found.densest]
    assert values == sorted(values, reverse=True)
    assert heat_of(found, [found])[1].full == 1600.0
    assert measure(room._replace(crowding=[])) is None


def test_what_is_collected_of_a_run_is_there_before_the_run_and_goes_on_with_it(tmp_path: Path) -> None:
    room = ("run", "room-v0", "--people", 4, "--scheme", "dem", "--record", 0, "--out", tmp_path / "room")
    assert command(*room, "--runs", 2)[0] == 0
    assert sorted(path.name for path in (tmp_path / "room" / "crowding").iterdir()) == ["0.npz", "1.npz"]
    (tmp_path / "room" / "runs" / "1.json").unlink()  # as if killed between the two files
    assert command(*room, "--runs", 3)[0] == 0
    (one,) = load_runs([tmp_path / "room"], place_of)
    assert len(one.episodes) == len(one.crowding) == 3


def test_a_damaged_file_of_crowding_leaves_the_report_the_others(folders: Path, tmp_path: Path) -> None:
    copy = tmp_path / "some"
    shutil.copytree(folders / "nearest", copy)
    (copy / "crowding" / "1.npz").write_bytes(b"no archive")
    (one,) = load_runs([copy], place_of)
    assert len(one.episodes) == 3 and len(one.crowding) == 2


def test_what_an_older_version_collected_is_left_out_and_said(folders: Path, tmp_path: Path) -> None:
    """It took walls for floor, and had other fields."""
    copy, page = tmp_path / "older", tmp_path / "older.html"
    shutil.copytree(folders / "nearest", copy)
    for k in range(3):
        path = copy / "crowding" / f"{k}.npz"
        with np.load(path) as content:
            facts = json.loads(str(content["facts"]))
            facts["injured"] = facts.pop("squeezed")
            np.savez(path, **{**content, "facts": np.array(json.dumps(facts))})
    (one,) = load_runs([copy], place_of)
    assert len(one.episodes) == 3 and one.crowding == [] and measure(one) is None
    code, _, said = command("report", copy, "-o", page)
    assert code == 0, said
    assert "maps, queues and levels of service are of 0 of 3 runs" in Parsed(page).text


def test_a_report_has_intervals_without_scipy(folders: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("scipy", "scipy.special", "scipy.stats"):
        monkeypatch.setitem(sys.modules, name, None)
    t_quantile.cache_clear()
    (one,) = load_runs([folders / "nearest"], place_of)
    code, _, said = command("report", folders / "nearest", "-o", tmp_path / "page.html")
    t_quantile.cache_clear()
    assert code == 0, said
    (row,) = (row for row in answer([one])["rows"] if "convergence" in row[0])
    assert row[1].startswith("± ") and row[1] in Parsed(tmp_path / "page.html").text
    assert None not in one.figures["evacuation_time"]["ci95"]


CHANGES = {  # of a config
    "arguments is []": {"arguments": []},
    "seed is 'x'": {"seed": "x"},
    "scheme is 'nsm2'": {"scheme": "nsm2"},
    "runs is 1.5": {"runs": 1.5},
    "manner is missing": {"manner": ...},
    "versions is missing": {"versions": ...},
    "policy is 'evil.py:Mine'; it must be an object": {"policy": "evil.py:Mine"},
    "config.json: scheme is {'a': 1}; it must be a valid string": {"arguments": {"physics": {"a": 1}}},
}


@looped("words", CHANGES)
def test_a_damaged_config_is_answered_in_a_sentence(words: str, folders: Path, tmp_path: Path) -> None:
    copy = tmp_path / words
    shutil.copytree(folders / "room", copy)
    config = {**json.loads((copy / "config.json").read_text("utf-8")), **CHANGES[words]}
    text = json.dumps({name: value for name, value in config.items() if value is not ...})
    (copy / "config.json").write_text(text, "utf-8")
    code, _, said = command("report", copy, "-o", tmp_path / "page.html")
    assert code == 2 and words in said and len(said.strip().splitlines()) == 1, said


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder whose config holds every field that there can be."""
    home = tmp_path_factory.mktemp("whole")
    (home / "plan.wkt").write_text(PLAN, "utf-8")
    (home / "starts.csv").write_text("x,y\n1,1\n2,2\n3,3\n", "utf-8")
    place = (
        "run",
        home / "plan.wkt",
        "--exit",
        "6,1,6,2.2",
        "--unit",
        "m",
        "--starts",
        home / "starts.csv",
        "--people",
        3,
    )
    people = (
        "--walking",
        "calm",
        "--routing",
        "shortest",
        "--policy",
        "follow",
        "--set",
        "dt=0.01",
        "--time-limit",
        60,
    )
    assert command(*place, *people, "--until", "50%", "--runs", 1, "--workers", 1, "--out", home / "out")[0] == 0
    return home / "out"


@pytest.mark.parametrize("every", [23, pytest.param(1, marks=pytest.mark.nightly)])
def test_no_field_of_a_config_ends_a_command_in_a_traceback(every: int, whole: Path, tmp_path: Path) -> None:
    before = (whole / "config.json").read_text("utf-8")
    config = json.loads(before)
    fields = [(name,) for name in config]
    fields += [(name, key) for name, table in config.items() if isinstance(table, dict) for key in table]
    assert {"policy", "files"} < {*config} and {"starts", "until", "set"} < {*config["arguments"]}
    values = (3, -1.5, "x", [], [1], {}, {"a": 1}, None)
    page, path = tmp_path / "page.html", whole / "config.json"
    cases = [(field, value) for field in fields for value in values]
    try:
        for field, value in cases[::every]:
            changed = json.loads(before)
            table = changed if len(field) == 1 else changed[field[0]]
            table[field[-1]] = value
            path.write_text(json.dumps(changed), "utf-8")
            for words in (
                ("report", whole, "-o", page, "--no-maps"),
                ("run", "--config", path, "--runs", 1, "--workers", 1),
                ("replay", whole, "-o", page),
            ):
                code, _, said = command(*words)
                assert code == 0 or (code == 2 and said), f"{words[0]} with {field} = {value}"
    finally:
        path.write_text(before, "utf-8")


def test_worst_places_are_peaks_and_not_the_slopes_beside_them(folders: Path) -> None:
    (nearest,) = load_runs([folders / "nearest"], place_of)
    geometry = nearest.scenario.geometry
    grid = grid_over(geometry)
    rows, columns = np.indices(grid.shape)
    x, y = (low + CELL * (at + 0.5) for low, at in zip(grid.origin, (columns, rows), strict=True))
    cones = [height - 0.5 * np.hypot(x - 4.0, y - at) for height, at in ((3.0, 3.0), (2.0, 9.0))]
    one, other = _worst(geometry, grid, np.maximum(np.maximum(*cones), 0.0))
    assert np.hypot(one.x - 4.0, one.y - 3.0) < CELL and np.hypot(other.x - 4.0, other.y - 9.0) < CELL
    assert one.exit == "west" and one.distance == pytest.approx(5.0, abs=CELL)  # to (0, 6)


def test_no_name_becomes_markup(tmp_path: Path) -> None:
    home = tmp_path / EVIL.replace("/", "")
    home.mkdir()
    plan = home / "$x_<img src=x>.wkt"
    plan.write_text(PLAN, "utf-8")
    runs = ("run", plan, "--exit", "6,1,6,2.2", "--people", 3, "--runs", 1)
    assert command(*runs, "--out", home / "<b>one")[0] == 0
    assert command(*runs, "--out", home / "_$two")[0] == 0
    page = tmp_path / "report.html"
    code, _, said = command("report", home / "<b>one", home / "_$two", "-o", page, "--title", EVIL, "--no-maps")
    assert code == 0, said
    found = Parsed(page)
    assert not {"script", "b"} & set(found.tags)
    assert all(source.startswith("data:") for source in found.sources)
    assert EVIL in found.text and "<b>one" in found.text


def test_an_unfinished_folder_and_another_version_are_said(folders: Path, tmp_path: Path) -> None:
    copy = tmp_path / "some"
    shutil.copytree(folders / "nearest", copy)
    config = json.loads((copy / "config.json").read_text("utf-8"))
    (copy / "config.json").write_text(json.dumps({**config, "runs": 50, "version": "0.0.9"}), "utf-8")
    code, _, said = command("report", copy, "-o", tmp_path / "report.html", "--no-maps")
    assert code == 0
    assert "3 of 50 runs were finished" in said and "by version 0.0.9" in said
    assert "3 of 50 runs were finished" in Parsed(tmp_path / "report.html").text


@looped(
    ("changed", "says"),
    [
        (None, "has no config.json"),
        ({"fingerprint": "0"}, "config.json or crowd-env has changed since"),
        ({"fingerprint": "0", "version": "0.0.1"}, "made by version 0.0.1"),
        ({"arguments": {"scenario": "no-such-place"}}, "cannot be read again"),
    ],
)
def test_what_is_no_folder_of_runs_is_refused_before_a_page_is_written(
    folders: Path, tmp_path: Path, changed: dict[str, object] | None, says: str
) -> None:
    copy = tmp_path / "some"
    copy.mkdir(exist_ok=True)
    if changed is not None:
        config = json.loads((folders / "nearest" / "config.json").read_text("utf-8"))
        (copy / "config.json").write_text(json.dumps(config | changed), "utf-8")
    code, _, said = command("report", copy, "-o", tmp_path / "report.html")
    assert code == 2 and says in said
    assert not (tmp_path / "report.html").exists()


def test_a_scheme_without_a_row_says_so(folders: Path) -> None:
    (room,) = load_runs([folders / "room"], place_of)
    found = limits_of(room)  # dem, competitive
    assert {row[0] for row in found.rows} == {"clogging", "row"}
    assert "1 of 2 judged cases are met; not met: clogging." in found.summary
    assert "39 have no row of dem, competitive" in found.summary
    printed = room._replace(config={**room.config, "scheme": {**room.config["scheme"], "name": "nsm2-printed"}})
    assert "no row of nsm2-printed, competitive" in limits_of(printed).summary
    slower = room._replace(config={**room.config, "dt": 0.005})
    assert "0.005 s" in " ".join(limits_of(slower).notes)


def test_people_who_keep_no_distance_are_told_of(folders: Path) -> None:
    (room,) = load_runs([folders / "room"], place_of)
    assert "full speed whatever is in front" in " ".join(limits_of(room).notes)
    calm = room._replace(config={**room.config, "manner": "calm"})
    assert "full speed" not in " ".join(limits_of(calm).notes)
