"""Counts at doors, passages and lines: against positions one by one, against PedPy, and what is told of them."""

import csv
from itertools import pairwise

import numpy as np
import pytest
from commands import call, figures
from late import late
from shapely.geometry import box

from crowd_env import Geometry, Scenario, make_scenario
from crowd_env.analysis.figures import cells, doubts
from crowd_env.analysis.plan_check import check_place
from crowd_env.analysis.sections import CrossingRecorder, crossings, flows_at, for_good, places_of
from crowd_env.envs.rollout import Recorders, run_episodes
from crowd_env.recording import RunRecorder
from crowd_env.scenarios.sections import Section, parse_section

NECK = [box(0, 0, 8, 8), box(7.9, 3.4, 10.1, 4.6), box(10, 0, 16, 8)]


def neck(people=40, **options):
    """Two rooms with a neck of 1.2 m between them, a door in front of it, and a line behind it."""
    rooms = {"left": box(0, 0, 8, 8), "right": box(12, 0, 16, 8)}
    exits, doors = {"out": [(16, 3), (16, 5)], "back": [(0, 3), (0, 5)]}, {"gate": [(8, 3.4), (8, 4.6)]}
    half = people // 2
    crowd = [
        {"people": people - half, "start_region": "left", "exits": ("out",)},
        {"people": half, "start_region": "right", "exits": ("back",)},
    ]
    geometry = Geometry.from_polygon(NECK, exits=exits, doors=doors, regions=rooms)
    options = {"sections": (Section("line", ((11, -1), (11, 9))),)} | options
    return Scenario("neck", geometry, crowd, 120.0, **options)


def counted(place, runs=1, recording=None):
    """Return the places, the runs with their crossings, and figures."""
    places = places_of(check_place(place))
    seen = {"sections": CrossingRecorder(places)} | ({} if recording is None else {"recording": recording})
    episodes = run_episodes(place, runs, seed=3, recorder=Recorders(**seen))
    episodes = [one._replace(crossings=one.record["sections"]) for one in episodes]
    return places, episodes, flows_at(places, episodes)


def test_doors_passages_and_lines_are_places():
    places = places_of(check_place(neck()))
    assert [one.name for one in places][::2] == ["gate", "line"]  # the other mouth of the neck is between them
    assert places[1].name.startswith("passage at (") and places[1].length == pytest.approx(1.2)
    assert places[2].length == pytest.approx(8.0)  # of ten meters: what lies on the floor
    assert [one.directions for one in places][::2] == [("to -x", "to +x")] * 2


def test_everybody_is_counted_each_way():
    _, (run,), found = counted(neck())
    assert np.isfinite(run.exit_time).all()
    for flows in found.values():
        way, back = (flows["towards"][name]["people"] for name in ("to +x", "to -x"))
        assert 20 <= way == back <= 22  # the stream against them carries one back for seconds
        for one in flows["towards"].values():
            assert one["peak_flow_per_meter"]["mean"] >= one["flow_per_meter"]["mean"] > 0.0


def test_positions_one_by_one_have_the_same_crossings():
    rng = np.random.default_rng(1)
    lines = np.array([[(0.0, -1.0), (0.5, 1.0)], [(0.5, 1.0), (2.0, 1.5)], [(-1.0, 0.0), (1.0, 0.0)]])
    track = np.cumsum(rng.normal(scale=0.2, size=(200, 30, 2)), axis=0)
    for before, after in pairwise(track):
        person, line, part, sign = crossings(before, after, lines)
        seen = set(zip(person.tolist(), line.tolist(), sign.tolist(), strict=True))
        for k, (p, q) in enumerate(zip(before, after, strict=True)):
            for j, (a, b) in enumerate(lines):
                share, along = np.linalg.solve(np.column_stack([q - p, a - b]), a - p)
                meets = 0.0 <= share <= 1.0 and 0.0 <= along <= 1.0
                left = np.cross([*(b - a), 0.0], [*(q - p), 0.0])[2] > 0.0
                assert ((k, j, 1 if left else -1) in seen) == meets
                if meets:
                    assert part[(person == k) & (line == j)] == pytest.approx(share)


def test_a_way_over_the_joint_of_two_lines_counts_once():
    lines = np.array([[(0.0, 0.0), (0.0, 1.0)], [(0.0, 1.0), (0.0, 2.0)]])
    person, *_ = crossings(np.array([[1.0, 1.0]]), np.array([[-1.0, 1.0]]), lines)
    assert person.tolist() == [0]
    there = crossings(np.array([[1.0, 0.5]]), np.array([[0.0, 0.5]]), lines)[3]  # to the line, and on
    assert there.tolist() + crossings(np.array([[0.0, 0.5]]), np.array([[-1.0, 0.5]]), lines)[3].tolist() == [1]


def test_steps_that_are_taken_back_do_not_count():
    to_and_fro = [(1.0, 0, 0, 1), (1.5, 0, 0, -1), (2.0, 0, 0, 1), (3.0, 1, 0, 1), (4.0, 1, 0, -1), (9.0, 1, 0, 1)]
    later = [(20.0, 1, 0, -1), (20.0, 1, 1, 1)]
    kept = for_good(np.array([*later, *to_and_fro], dtype=float))
    assert kept.tolist() == [[2.0, 0, 0, 1], [9.0, 1, 0, 1], [20.0, 1, 0, -1], [20.0, 1, 1, 1]]
    assert for_good(np.empty((0, 4))).shape == (0, 4)


@pytest.mark.more
def test_pedpy_counts_the_same_people_at_the_same_time(tmp_path):
    pedpy = late("pedpy")
    place = neck()
    places, (run,), _ = counted(place, recording=RunRecorder(tmp_path / "run.sqlite"))
    trajectory = pedpy.load_trajectory_from_jupedsim_sqlite(trajectory_file=run.record["recording"])
    crossed = for_good(run.crossings)
    for k, one in enumerate(places):
        line = pedpy.MeasurementLine(one.lines[0])
        _, frames = pedpy.compute_n_t(traj_data=trajectory, measurement_line=line)
        ours = dict(crossed[crossed[:, 2] == k][:, [1, 0]].tolist())
        theirs = dict(zip(frames.id, frames.frame / trajectory.frame_rate, strict=True))
        assert ours.keys() == theirs.keys() and len(ours) == 40
        late_by = np.array([theirs[person] - ours[person] for person in ours])
        assert np.median(np.abs(late_by)) < 0.1  # a frame; people who step back come through later


def test_the_command_counts_at_lines_of_its_own(tmp_path):
    line = "run room-v0 --people 30 --runs 2 --section row=0,4,9,4 --section 2,2,2,3"
    found = figures(f"{line} --out {tmp_path / 'o'}")["sections"]
    assert list(found) == ["row", "section-2"] and found["row"]["runs"] == 2
    rows = list(csv.DictReader((tmp_path / "o" / "sections.csv").open()))
    for name, flows in found.items():
        for way, one in flows["towards"].items():
            assert one["people"] == sum(row["section"] == name and row["towards"] == way for row in rows)
    again = figures(f"{line} --out {tmp_path / 'o'}")["sections"]  # of the runs that are kept
    assert again == found


def test_a_fast_door_inside_is_doubted():
    place = make_scenario("room-v0", people=12)
    found = {"to +x": {"people": 40, "flow_per_meter": {"mean": 2.4}, "peak_flow_per_meter": {"mean": 2.6}}}
    sections = {"gate": {"length": 1.2, "runs": 2, "towards": found}}
    told = {"exits": {}, "unfinished": 0, "manner": "calm", "sections": sections}
    assert doubts(told).startswith("2.4 people per second and meter pass gate; ")
    whole = figures("run room-v0 --people 12 --runs 1") | {"sections": sections}
    assert cells(place, whole)["flow inside"] == "gate, 1.20 m: 20 people to +x, 2.40 1/(s m), peak 2.60"


def test_sections_move_with_the_place():
    turned = neck().turned(90.0)
    (one,) = turned.sections
    assert one.length_on(turned.geometry) == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("a=1,2,3", "section 'a=1,2,3' is not understood; it must be x1,y1,x2,y2 or NAME=x1,y1,x2,y2"),
        ("a=1,2,1,2", "section 'a': line is"),
        ("a=1,nan,1,2", "section 'a=1,nan,1,2' is not understood"),
    ],
)
def test_lines_that_are_none_are_refused(line, said):
    with pytest.raises(ValueError, match="section") as error:
        parse_section(line, 1)
    assert said in str(error.value)


def test_a_line_off_the_floor_is_refused():
    result = call("run room-v0 --runs 1 --section far=100,0,101,0")
    assert result.exit_code != 0 and "section 'far' lies off the walkable area" in result.stderr
    twice = call("run room-v0 --runs 1 --section a=1,1,2,2 --section a=2,2,3,3")
    assert "two sections have the name 'a'" in twice.stderr
