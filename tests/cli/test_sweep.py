"""``crowd-env sweep``: paired runs at values of an input, their table, files and order, and what is refused."""

import csv
import json

import numpy as np
import pytest
from commands import call, figures

from crowd_env import make_scenario
from crowd_env.analysis.sweep import by_effect
from crowd_env.scenarios.variants import with_exit_widths, with_times

FILE = """
closed_doors = ["side"]
[geometry]
walkable = { box = [0, 0, 8, 8] }
exits = { out = [[8, 3], [8, 5]] }
thin_walls = [[[4, 0], [4, 3]]]
doors = { side = [[4, 3], [4, 4]], out = "out" }
regions = { half = { box = [0, 0, 4, 8] } }
[population]
response_time = { distribution = "lognormal", median = 5, sigma = 0.5, high = 30 }
[[cohorts]]
name = "staff"
people = 4
[[cohorts]]
name = "visitors"
people = 8
"""


@pytest.fixture
def place(tmp_path):
    (tmp_path / "hall.toml").write_text(FILE)
    return tmp_path / "hall.toml"


def test_a_sweep_is_the_runs_of_each_value(tmp_path):
    line = "sweep room-v0 door_width=0.8..1.6/2 --people 8 --scheme dem --runs 3 --seed 5"
    found = figures(f"{line} --out {tmp_path / 's'}")
    narrow, wide = found["rows"]
    assert [one["value"] for one in found["rows"]] == ["0.8", "1.6"]
    for one in (narrow, wide):
        alone = figures(f"run room-v0 --set door_width={one['value']} --people 8 --scheme dem --runs 3 --seed 5")
        assert one["t95"] == alone["t95"] and one["evacuation_time"] == alone["evacuation_time"]
    gap = wide["t95_difference"]["mean"]
    assert gap == pytest.approx(wide["t95"]["mean"] - narrow["t95"]["mean"]) and narrow["t95_difference"]["mean"] == 0.0
    rows = list(csv.DictReader((tmp_path / "s" / "sweep.csv").open()))
    assert [float(row["t95"]) for row in rows] == pytest.approx([one["t95"]["mean"] for one in (narrow, wide)])
    assert (tmp_path / "s" / "sweep.png").stat().st_size > 10_000
    more = figures(f"{line.replace('1.6/2', '1.6/3')} --out {tmp_path / 's'}")["rows"]  # goes on with what is there
    assert [more[0], more[2]] == [narrow, wide]


def test_kept_runs_are_not_made_again(tmp_path, monkeypatch):
    line = f"sweep room-v0 people=4,6 --scheme dem --runs 2 --out {tmp_path / 's'}"
    first = figures(line)
    monkeypatch.setattr("crowd_env.cli.run.run_episodes", lambda *_, **__: pytest.fail("runs again"))
    assert figures(line) == first


def test_several_inputs_come_in_the_order_of_their_effect():
    found = figures("sweep room-v0 radius=x0.99 response_time=10 people=6,8 --people 8 --scheme dem --runs 2")
    assert found["base"] == "as it is" and found["rows"][0]["name"] == ""
    names = [one["name"] for one in found["rows"][1:]]
    assert names[0] == "response_time" and sorted(names) == ["people", "people", "radius", "response_time"]
    assert found["rows"][1]["t95_difference"]["mean"] == pytest.approx(10.0, abs=0.2)
    rows = [{"name": name, "t95_difference": {"mean": mean}} for name, mean in (("a", 1.0), ("b", None), ("c", -2.0))]
    assert [one["name"] for one in by_effect(rows)] == ["c", "a", "b"]


def test_the_usual_inputs_are_varied_where_none_is_named(place):
    found = figures(f"sweep {place} --scheme dem --runs 1 --workers 1")
    names = list(dict.fromkeys(one["name"] for one in found["rows"][1:]))
    assert sorted(names) == ["exit_width", "people", "radius", "response_time", "speed", "walking"]
    gaps = {
        name: [abs(one["t95_difference"]["mean"]) for one in found["rows"] if one["name"] == name] for name in names
    }
    assert list(map(max, gaps.values())) == sorted(map(max, gaps.values()), reverse=True)


@pytest.mark.parametrize("key", ["cohorts.visitors.people", "cohorts.1.people"])
def test_a_key_of_a_file_is_an_input(place, key):
    assert figures(f"run {place} --set {key}=3 --scheme dem --runs 1")["people"] == 7
    rows = figures(f"sweep {place} {key}=3,5 --scheme dem --runs 1")["rows"]
    assert [one["value"] for one in rows] == ["3", "5"]


def test_a_factor_moves_the_draws_by_itself(place):
    hall = make_scenario(place)
    late = with_times(hall, "response_time", 2.0)
    drawn = [one.population.draw(np.random.default_rng(1), one.geometry)[0].response_time for one in (hall, late)]
    np.testing.assert_allclose(drawn[1], 2.0 * drawn[0])
    assert [part.people for part in with_times(hall, "people", 1.5).population.parts] == [6, 12]


def test_a_wider_exit_keeps_all_else(place):
    hall = make_scenario(place)
    wide = with_exit_widths(hall, lambda width: 1.5 * width)
    assert wide.geometry.exit_lengths == {"out": pytest.approx(3.0)}
    for name in ("doors", "exits_of_door", "exit_names"):
        assert getattr(wide.geometry, name) == getattr(hall.geometry, name)
    assert (
        len(wide.geometry.walls) == len(hall.geometry.walls)
        and wide.geometry.regions.keys() == hall.geometry.regions.keys()
    )
    assert wide.geometry.walkable.equals(hall.geometry.walkable)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("people", "people: this must be NAME=VALUES such as people=50..200, each name once"),
        ("people=a..3", "people=a..3: 'a' is no number; a range is FROM..TO or FROM..TO/COUNT"),
        ("moon=1,2", "--set moon: nothing has this name"),
        ("time_gap=x2", "time_gap is not set: give numbers, not factors"),
        ("moon=x2", "unknown number of people 'moon'; known: people, radius"),
        ("people=many", "people=many: 'many' is no number"),
        ("cohorts.guests.people=3", "key 'cohorts.guests.people' cannot be set: there is no 'guests'"),
        ("exit_width=30", "an exit of this width leaves its wall: exit 'out' reaches beyond the boundary"),
        ("geometry.layers=1,2", "geometry: layers tells how a drawing is read, and there is no file"),
        ("geometry.unit=m,cm", "geometry: unit tells how a drawing is read"),
        ("exit_width=-1,2", "exit_width is -1"),
        ("exit_width=0,1", "exit_width is 0"),
        ("people=x-1,x1", "people=x-1 is -1"),
    ],
)
def test_what_is_no_input_is_refused(place, given, said):
    result = call(f"sweep {place} {given} --runs 1")
    assert result.exit_code == 2 and said in result.stderr and "Traceback" not in result.stderr


def test_the_folder_of_another_sweep_is_refused(tmp_path):
    line = f"sweep room-v0 people=4 --scheme dem --runs 1 --out {tmp_path / 's'}"
    json.dumps(figures(line))
    assert call(f"{line} --seed 9").exit_code == 2
