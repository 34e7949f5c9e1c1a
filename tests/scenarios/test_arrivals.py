"""Arrivals as data: how many come and when, in Python, tables and files."""

import json

import numpy as np
import pytest
from evacuations import evacuated
from repository import ROOT

from crowd_env import Arrivals, CrowdEnv, Geometry, Population, Scenario, make_scenario
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.geometry.geometry import box
from crowd_env.scenarios.population import population_of
from crowd_env.scenarios.schema import json_schema

HALL = Geometry.from_polygon(box(0, 0, 6, 4), exits={"east": [(6, 1), (6, 3)]}, regions={"west": box(0, 0, 2, 4)})
LINE = [(0, 1), (0, 3)]

FILE = """
time_limit = 60
[geometry]
walkable = { box = [0, 0, 6, 4] }
exits = { east = [[6, 1], [6, 3]] }
regions = { west = { box = [0, 0, 2, 4] } }
[[cohorts]]
arrivals = %s
"""


def come(arrivals, people=None, draws=1):
    """Return how many come in each of some draws."""
    rng = np.random.default_rng(0)
    return np.array([np.isfinite(arrivals.draw(rng, people or arrivals.people)).sum() for _ in range(draws)])


def test_a_poisson_source_has_the_mean_and_the_variance_of_its_law():
    arrivals, draws = Arrivals(rate=1.5, since=5.0, until=25.0), 4000
    counts = come(arrivals, draws=draws)
    assert counts.mean() == pytest.approx(30.0, abs=4 * np.sqrt(30.0 / draws))
    assert counts.var(ddof=1) == pytest.approx(30.0, rel=4 * np.sqrt(2.0 / draws))
    assert counts.max() < arrivals.people
    times = np.concatenate([arrivals.draw(np.random.default_rng(k), arrivals.people) for k in range(200)])
    times = times[np.isfinite(times)]
    assert times.min() >= 5.0
    assert times.mean() == pytest.approx(15.0, abs=4 * 20.0 / np.sqrt(12 * len(times)))  # uniform over the span


def test_gaps_of_a_poisson_source_are_exponential():
    times = Arrivals(rate=2.0).draw(np.random.default_rng(0), 3000)
    gaps = np.diff(times, prepend=0.0)
    assert gaps.mean() == pytest.approx(0.5, rel=4 / np.sqrt(3000))
    assert (gaps > 1.0).mean() == pytest.approx(np.exp(-2.0), abs=4 * np.sqrt(0.117 / 3000))


def test_a_regular_source_is_as_even_as_a_clock():
    arrivals = Arrivals(rate=1.5, since=1.0, until=61.0, spacing="regular")
    times = arrivals.draw(np.random.default_rng(0), arrivals.people)
    assert len(times) == 90
    assert times == pytest.approx(1.0 + np.arange(90) / 1.5)


def test_times_and_timetables_are_kept():
    rng = np.random.default_rng(0)
    assert Arrivals(times=(3.0, 1.0)).draw(rng, 2).tolist() == [3.0, 1.0]
    assert Arrivals(timetable=((10.0, 2), (5.0, 1))).draw(rng, 3).tolist() == [10.0, 10.0, 5.0]


def test_the_number_of_people_follows_from_the_arrivals():
    assert population_of("p", {"arrivals": {"times": [0, 1]}, "start_region": "west"}).people == 2
    assert population_of("p", {"arrivals": {"timetable": [[0, 4], [9, 3]]}, "start_region": "west"}).people == 7
    most = population_of("p", {"arrivals": {"rate": 1.0, "until": 100}, "start_region": "west"}).people
    assert 100 < most < 200
    assert population_of("p", {"people": 20, "arrivals": {"rate": 1.0}, "start_region": "west"}).people == 20


@pytest.mark.parametrize(
    ("arrivals", "message"),
    [
        ({}, "give one of rate, times and timetable, not none"),
        ({"rate": 1.0, "times": [1]}, "not rate and times"),
        ({"rate": -1.0}, "rate is -1"),
        ({"rate": 1.0, "since": 9, "until": 9}, "until is 9 s; it must be later than since"),
        ({"times": [-1.0]}, "times"),
        ({"timetable": [[1.0, 2.5]]}, "whole number of people"),
        ({"rate": 1.0, "spacing": "odd"}, "spacing"),
        ({"rate": 1.0, "line": [[0, 0]]}, "line of arrivals"),
        ({"rate": 1.0}, "without an end"),
    ],
)
def test_wrong_arrivals_are_refused_in_a_sentence(arrivals, message):
    with pytest.raises(ValueError, match=message) as refused:
        population_of("population", {"arrivals": arrivals, "start_region": "west"})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "need an entrance"),
        ({"start_region": "west", "group_size": 2}, "walk alone"),
        ({"starts": [(1, 1)] * 5}, "recorded start of their own"),
    ],
)
def test_people_who_arrive_need_one_entrance_and_no_group(options, message):
    with pytest.raises(ValueError, match=message):
        Population(4, arrivals=Arrivals(rate=1.0), **options)
    with pytest.raises(ValueError, match="people is 3, but 2 arrivals are listed"):
        Population(3, arrivals=Arrivals(times=(0.0, 1.0)), start_region="west")


def test_a_line_without_room_is_refused():
    with pytest.raises(ValueError, match=r"along the line from \(9, 1\) to \(9, 3\)"):
        Scenario("hall", HALL, {"arrivals": {"times": [0], "line": [(9, 1), (9, 3)]}}, time_limit=9.0)


def test_without_arrivals_nothing_is_drawn_and_fingerprints_stay():
    people = Population(5)
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    assert np.isnan(people.draw_entries(rng, HALL).due).all()
    assert rng.bit_generator.state == before
    assert fingerprint(people) == fingerprint(Population(5, arrivals=None, wait=None))
    assert fingerprint(people) != fingerprint(Population(5, wait=1.0))


def test_a_turned_place_has_its_line_turned():
    place = Scenario("hall", HALL, {"people": 3, "arrivals": {"rate": 1.0, "line": LINE}}, time_limit=30.0)
    turned = place.turned(0.7)
    turn = np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
    (before,), (after,) = place.population.parts, turned.population.parts
    assert after.arrivals.line == pytest.approx(before.arrivals.line @ turn)
    assert len(after.spots(turned.geometry)) == pytest.approx(len(before.spots(HALL)), abs=2)


def test_the_time_limit_leaves_time_for_the_last_who_comes(tmp_path):
    path = tmp_path / "late.toml"
    path.write_text(FILE.replace("time_limit = 60\n", "") % '{ times = [500, 600] }\nstart_region = "west"')
    assert make_scenario(path).time_limit > 600.0


def test_a_file_has_every_kind_of_arrivals(tmp_path):
    (tmp_path / "entries.csv").write_text("time,x,y,id\n0.5,1.0,2.0,7\n0.6,1.0,2.0,8\n4.0,1.5,1.0,9\n")
    for k, (arrivals, people) in enumerate(
        [
            ("{ rate = 2.0, until = 10, line = [[0, 1], [0, 3]] }", 51),
            ('{ rate = 2.0, until = 10, spacing = "regular", line = "LINESTRING (0 1, 0 3)" }', 20),
            ('{ timetable = [[1, 2], [3, 4]] }\nstart_region = "west"', 6),
            ('{ file = "entries.csv" }', 3),
        ]
    ):
        path = tmp_path / f"place{k}.toml"
        path.write_text(FILE % arrivals)
        place = make_scenario(path)
        assert place.population.people == people
        assert place.has_arrivals
    env = evacuated(place)
    assert env.simulation.entrances.entry_time[[0, 2]] == pytest.approx([0.5, 4.0])
    assert env.simulation.entrances.entry_time[1] > 0.65  # waits until the first has made room


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{ file = "gone.csv" }', "gone.csv"),
        ('{ file = "../entries.csv" }', "outside of the folder"),
        ('{ file = "entries.csv", rate = 1 }', "unknown key 'rate'; known: file"),
        ('{ file = "lacks.csv" }', "column 'time' is missing"),
    ],
)
def test_a_mistake_in_a_file_is_named(tmp_path, content, message):
    (tmp_path / "lacks.csv").write_text("x,y\n1,1\n")
    path = tmp_path / "place.toml"
    path.write_text(FILE % content)
    with pytest.raises(ValueError, match=message) as refused:
        make_scenario(path)
    assert str(refused.value).startswith(str(path))


def test_the_station_of_the_examples_is_read():
    place = make_scenario(ROOT / "examples" / "station.toml")
    assert [part.arrivals is not None for part in place.population.parts] == [True] * 3
    assert place.gates[0].flow == 1.2
    assert place.goes_on


def test_the_schema_knows_arrivals_waits_and_gates():
    schema = json_schema()
    people = schema["definitions"]["Population"]["properties"]
    assert set(schema["definitions"]["Arrivals"]["properties"]) == {
        "rate",
        "since",
        "until",
        "spacing",
        "times",
        "timetable",
        "line",
        "file",
    }
    assert {"arrivals", "wait"} <= set(people)
    assert schema["properties"]["gates"]["items"]["$ref"].endswith("Gate")
    json.dumps(schema)


def test_only_people_who_came_count_in_an_episode():
    place = Scenario("hall", HALL, {"arrivals": {"rate": 1.0, "until": 5.0, "line": LINE}}, time_limit=60.0)
    env = CrowdEnv(place, num_envs=3)
    env.reset(seed=0)
    while not env.finished.all():
        env.step(None)
    for e in range(3):
        assert env.metrics(e).unfinished == 0
        assert env.simulation.state.time[e] < 30.0
