"""The folder of results: what stands in it is what was run, and an interrupted command goes on with it."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from cases import looped
from repository import ROOT

from crowd_env import Cohorts, Geometry, Population, Scenario, make_scenario
from crowd_env.analysis.exit_times import read_exits
from crowd_env.analysis.figures import cells, exits_of, named, peak_flow, report, time_of_share
from crowd_env.analysis.results.config import FREE, run_config
from crowd_env.analysis.results.crowding import CrowdingRecorder
from crowd_env.analysis.results.folder import ResultsFolder, egress, write_curve, write_tables
from crowd_env.core.files.csv_table import read_table
from crowd_env.core.files.store import difference as differs
from crowd_env.envs.metrics import flow_slope
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.settings import Routing
from crowd_env.physics.settings import Physics

NAN = float("nan")


def hall():
    """Return a hall with two exits and two cohorts, of which one is too slow to get out in time."""
    people = Cohorts((Population(4, name="quick"), Population(3, name="slow", desired_speed=0.05)))
    return make_scenario("two-exit-hall-v0", population=people, time_limit=20.0)


def config(place, runs=3, scheme="dem", **changed):
    physics = Physics(scheme, changed.pop("dt", None))
    routing = Routing(changed.pop("strategy", "nearest"), changed.pop("rules", True))
    return run_config(place, physics, routing, runs, **{"seed": 2, **changed})


@pytest.fixture(scope="module")
def place():
    return hall()


@pytest.fixture(scope="module")
def episodes(place):
    return run_episodes(place, 3, scheme="dem", seed=2, strategy="nearest")


def test_no_interval_of_what_is_never_negative_reaches_below_zero():
    """The t interval of two runs is mean ± 6.4 times their distance."""
    assert named(np.array([2.0, 4.0]))["ci95"] == [0.0, pytest.approx(3.0 + 12.7062, rel=1e-5)]
    assert named(np.array([2.0, 4.0]), least=-np.inf)["ci95"][0] == pytest.approx(3.0 - 12.7062, rel=1e-5)
    assert named(np.array([NAN, 4.0]))["ci95"] == [None, None]
    few = run_episodes(hall(), 2, scheme="dem", seed=2, strategy="nearest")
    figures = report(hall(), "dem", few)
    ends = [one for each in figures["exits"].values() for one in each.values() if isinstance(one, dict)]
    bounds = [one["ci95"][0] for one in (*figures.values(), *ends) if isinstance(one, dict) and "ci95" in one]
    assert len(bounds) > 10 and min(low for low in bounds if low is not None) >= 0.0


def difference(there, here):
    return differs(there, here, FREE)


def same(found, expected):
    """Return whether runs are the same to the last bit."""
    for one, other in zip(found, expected, strict=True):
        assert (one.run, one.seed, one.time_limit, one.end) == (other.run, other.seed, other.time_limit, other.end)
        np.testing.assert_array_equal(one.metrics, other.metrics)
        np.testing.assert_array_equal(one.exit_time, other.exit_time)
        np.testing.assert_array_equal(one.exit_index, other.exit_index)
        np.testing.assert_array_equal(one.radius, other.radius)
        np.testing.assert_array_equal(one.desired_speed, other.desired_speed)
    return True


def test_the_exits_are_those_that_clogging_reads(place, episodes, tmp_path):
    write_tables(tmp_path, place, episodes)
    for run, episode in zip(read_exits(tmp_path / "exits.csv"), episodes, strict=True):
        np.testing.assert_array_equal(run.time, np.sort(episode.exit_time[np.isfinite(episode.exit_time)]))
        assert run.until == episode.end and set(run.exit) <= {"west", "east"}


def test_a_row_a_person_tells_who_it_was(place, episodes, tmp_path):
    write_tables(tmp_path, place, episodes)
    rows = [row.cells for row in read_table(tmp_path / "exits.csv", "x", ("run",), "s", "a row").rows]
    out, stayed = ([row for row in rows if row["out"] == told] for told in "10")
    assert {row["cohort"] for row in out} == {"quick"} and not any(row["until"] for row in out)
    assert [(row["run"], row["person"], row["cohort"]) for row in stayed] == [
        (str(run), str(k), "slow") for run in range(3) for k in (4, 5, 6)
    ]
    assert {(row["time"], row["exit"], row["until"]) for row in stayed} == {("", "", str(episodes[0].end))}
    for row in rows:
        body = place.population.draw(np.random.default_rng(2 + int(row["run"])), place.geometry)[0]
        k = int(row["person"])
        assert (float(row["radius"]), float(row["desired_speed"])) == (body.radius[k], body.desired_speed[k])


def test_n_of_t_counts_those_inside_and_a_run_that_has_ended_stays_as_it_was(tmp_path):
    curve = egress([np.array([0.2, 1.0]), np.array([0.7, NAN])])
    np.testing.assert_allclose(curve.time, np.arange(11) / 10)
    np.testing.assert_array_equal(curve.mean, [2, 2, 1.5, 1.5, 1.5, 1.5, 1.5, 1, 1, 1, 0.5])
    np.testing.assert_array_equal(curve.quantiles[-1], np.quantile([0, 1], [0.05, 0.25, 0.5, 0.75, 0.95]))
    assert len(egress([np.array([5000.0])]).time) <= 1001 and egress([np.array([NAN])]).mean.tolist() == [1]


def test_the_curve_begins_with_everyone(episodes, tmp_path):
    rows = read_table(write_curve(tmp_path, episodes), "x", ("time",), "s", "a row").rows
    assert rows[0].cells["time"] == "0" and {rows[0].cells[name] for name in rows[0].cells if name != "time"} == {"7"}
    assert float(rows[-1].cells["inside_mean"]) == 3.0  # the slow ones


def test_the_time_of_a_share_of_the_people():
    times = np.arange(1.0, 21.0)
    assert (time_of_share(times, 0.95), time_of_share(times, 1.0), time_of_share(times[:1], 0.95)) == (19.0, 20.0, 1.0)
    assert np.isnan(time_of_share(np.array([1.0, NAN]), 0.95))


def test_the_report_tells_who_took_which_exit(place, episodes):
    told = report(place, "dem", episodes, strategy="nearest")
    counted = {name: told["exits"][name]["people"] for name in ("west", "east")}
    assert sum(counted.values()) == 12 and all(counted.values())
    assert sum(told["exits"][name]["share"]["mean"] for name in counted) == pytest.approx(1.0)
    assert told["t95"]["mean"] is None and 0 < told["mean_exit_time"]["mean"] < 20.0
    assert (told["seed"], told["dt"], told["strategy"], told["time_limit"]) == (2, 0.01, "nearest", 20.0)
    json.dumps(told, allow_nan=False)


def test_every_column_is_explained(place, episodes, tmp_path):
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    paths = [*write_tables(tmp_path, place, episodes), write_curve(tmp_path, episodes)]
    columns = {name for path in paths for name in path.read_text().splitlines()[0].split(",")}
    missing = {name for name in columns if f"`{name}`" not in text}
    assert missing == {"inside_q25", "inside_q50", "inside_q75"}  # between the first and the last, which are named


# --------------------------------------------------------------------------------------------------------- the folder


def test_a_folder_goes_on_with_the_runs_it_has(place, episodes, tmp_path):
    out = tmp_path / "out"
    first = ResultsFolder(out, config(place), place)
    assert first.finished() == [] and not out.exists()
    first.keep_runs(episodes[:1])
    again = ResultsFolder(out, config(place), place)
    assert same(again.finished(), episodes[:1])
    again.keep_runs(episodes[1:])
    paths = again.finish(episodes, {"runs": 3})
    assert {path.name for path in paths} | {"runs"} == {path.name for path in out.iterdir()}
    assert same(ResultsFolder(out, config(place, runs=5), place).finished(), episodes)
    assert same(ResultsFolder(out, config(place, runs=2), place).finished(), episodes[:2])


DAMAGE = {  # of a run
    "a key is missing": lambda run: run.pop("exit_time"),
    "a figure is missing": lambda run: run["metrics"].pop("flow"),
    "a figure too many": lambda run: run["metrics"].update(evil=1),
    "figures are a list": lambda run: run.update(metrics=[]),
    "a figure is text": lambda run: run["metrics"].update(flow="fast"),
    "no such exit": lambda run: run.update(exit_index=[99] * 7),
    "a negative exit": lambda run: run.update(exit_index=[-2] * 7),
    "times are text": lambda run: run.update(exit_time=["x"] * 7),
    "times are nested": lambda run: run.update(exit_time=[[1.0, 2.0]] * 7),
    "one time too few": lambda run: run.update(exit_time=run["exit_time"][:-1]),
    "other people": lambda run: run.update({key: value[:-1] for key, value in run.items() if isinstance(value, list)}),
    "another seed": lambda run: run.update(seed=9),
    "no end": lambda run: run.update(end=None),
}


@looped("name", DAMAGE)
def test_a_damaged_run_is_as_good_as_none(name, place, episodes, tmp_path):
    folder = ResultsFolder(tmp_path / name, config(place, runs=10**9), place)
    folder.keep_runs(episodes)
    (path,) = (tmp_path / name / "runs").glob("3.*")
    run = json.loads(path.read_text())
    DAMAGE[name](run)
    path.write_text(json.dumps(run))
    assert same(folder.finished(), [episodes[0], episodes[2]])
    path.write_text("[1, 2]")
    assert same(folder.finished(), [episodes[0], episodes[2]])


CROWDED = {
    "a member is missing": {"density": None},
    "a member too many": {"evil": np.zeros(3)},
    "another shape": {"density": np.zeros((2, 2), np.float32)},
    "a text": {"impact": "hard"},
}


@looped("name", CROWDED)
def test_what_was_collected_and_is_damaged_is_as_good_as_none(name, place, tmp_path):
    (run,) = run_episodes(place, 1, scheme="dem", seed=2, recorder=CrowdingRecorder(place.geometry))
    whole = [run._replace(record={"crowding": run.record})]
    folder = ResultsFolder(tmp_path / name, config(place), place)
    folder.keep_runs(whole)
    assert [one.impact for one in folder.crowding(whole)] == [run.record.impact]
    with np.load(tmp_path / name / "crowding" / "2.npz") as file:
        content = {key: file[key] for key in file.files}
    facts = json.loads(str(content.pop("facts")))
    changed = {**content, **{key: value for key, value in CROWDED[name].items() if key != "impact"}}
    facts.update({key: value for key, value in CROWDED[name].items() if key == "impact"})
    arrays = {key: value for key, value in changed.items() if value is not None}
    np.savez_compressed(tmp_path / name / "crowding" / "2.npz", facts=np.array(json.dumps(facts)), **arrays)
    assert folder.crowding(whole) == []


def test_a_folder_of_something_else_is_refused_and_left_alone(place, episodes, tmp_path):
    folder = ResultsFolder(tmp_path, config(place), place)
    folder.keep_runs(episodes)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.json")}
    other = replace(place, time_limit=30.0)
    for changed, words in (
        (config(place, seed=3), "seed is 2 there and 3 here"),
        (config(place, scheme="nsm2"), "scheme.name is dem there and nsm2 here"),
        (config(place, dt=0.005), "dt is 0.01 there and 0.005 here"),
        (config(other), "time_limit is 20.0 there and 30.0 here"),
    ):
        with pytest.raises(ValueError, match=f"holds results of another command: .*{words}; name another folder"):
            ResultsFolder(tmp_path, changed, place)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.json")} == before


def test_tables_without_what_made_them_are_not_written_over(place, episodes, tmp_path):
    write_tables(tmp_path, place, episodes)
    with pytest.raises(ValueError, match=r"holds runs\.csv, which this command did not write; name another folder"):
        ResultsFolder(tmp_path, config(place), place)


def test_configs_differ_in_what_decides_results_alone(place):
    here = json.loads(json.dumps(config(place), allow_nan=False))
    assert here == config(place)
    assert difference(here, config(hall())) == ""
    assert difference(here, {**here, "runs": 7, "command": ["x"], "platform": "y"}) == ""
    thinner = replace(place, population=Cohorts((Population(4, name="quick", radius=0.2), place.population.parts[1])))
    assert difference(here, config(thinner)) == "population[0].radius.low is 0.15 there and 0.2 here"
    other = replace(place, geometry=make_scenario("room-v0").geometry, target="nearest")
    assert difference(here, config(other)).startswith(f"fingerprint is {here['fingerprint']} there and ")
    files = [
        {**one, "files": {"/a.toml": "0", "/b.dxf": digest}} for one, digest in ((here, "1"), (config(other), "2"))
    ]
    assert difference(*files) == "/b.dxf has changed since"
    files = [{**one, "files": {"/b.dxf": digest}} for one, digest in ((here, "1"), ({**here, "seed": 7}, "2"))]
    assert difference(*files).startswith("seed is ")


def test_the_peak_flow_of_an_exit_is_that_of_its_ten_busiest_seconds():
    steady = 3.0 + 0.5 * np.arange(100.0)
    assert peak_flow(steady) == pytest.approx(2.0)
    busy = np.sort([*steady, *np.arange(20.05, 25.0, 0.25)])  # 20 more within 5 of those seconds
    assert peak_flow(busy) == pytest.approx(4.0)
    assert peak_flow(steady[:10]) == pytest.approx(2.0)  # used for less than 10 s: the flow
    assert np.isnan([peak_flow(np.array([1.0, 2.0])), peak_flow(np.full(5, 2.0))]).all()


STOPPED = np.r_[
    0.4 * np.arange(12), 40.0 + 0.4 * np.arange(12)
]  # twelve people in 4.4 s, twice, with a stop in between


def test_the_peak_flow_is_never_below_the_flow():
    """For people who come in any manner: a few, many, in bursts, with a stop in the middle, one alone."""
    rng = np.random.default_rng(2)
    ways = [STOPPED, 9.0 * np.arange(5), np.array([3.0]), np.empty(0), np.array([1.0, 2.0, 2.5, 5.0])]
    ways += [np.sort(rng.uniform(0.0, span, count)) for span in (1.0, 8.0, 12.0, 60.0) for count in (2, 3, 12, 100)]
    ways += [np.cumsum(rng.lognormal(-1.0, 2.0, count)) for count in (3, 12, 12, 12, 100) for _ in range(20)]
    for times in ways:
        flow, peak = flow_slope(times), peak_flow(times)
        assert peak >= flow or (np.isnan(peak) and np.isnan(flow)), times
    assert (
        peak_flow(STOPPED) == pytest.approx(1.1) and flow_slope(STOPPED) < 0.6
    )  # eleven follow the first in ten seconds


def test_figures_of_exits_are_those_of_the_people_who_took_them(place, episodes):
    found = report(place, "dem", episodes)["exits"]
    for k, name in enumerate(("west", "east")):
        times = [one.exit_time[one.exit_index == k] for one in episodes]
        used = [one for one in times if len(one)]
        assert found[name]["people"] == sum(map(len, times))
        for key, of in (("first", np.min), ("last", np.max)):
            expected = np.mean([of(one) for one in used]) if used else None
            assert found[name][key]["mean"] == (None if expected is None else pytest.approx(expected))


def test_the_busiest_exits_come_first_where_not_all_are_named():
    walls = {name: [[k, 0.0], [k + 1.0, 0.0]] for k, name in zip(range(1, 15, 2), "abcdefg", strict=True)}
    place = Scenario("many", Geometry.from_polygon(shapely.box(0, 0, 16, 8), exits=walls), Population(28), 60.0)
    row = {name: place.geometry.exit_names.index(name) for name in walls}
    took = np.repeat([row[name] for name in "abcdefg"], [1, 2, 3, 4, 5, 6, 7])
    figures = report(place, "dem", [run_by(place, took)])
    told = cells(place, figures)
    assert told["shares of the exits"] == "g 25 %, f 21 %, e 18 %, d 14 %, and 3 more"
    assert told["exits"] == "g 1.00 m, f 1.00 m, e 1.00 m, d 1.00 m, and 3 more" and list(figures["exits"]) == [
        *"gfedcba"
    ]


def run_by(place, exit_index):
    """Return a run of a place in which people took these exits, one a second."""
    (episode,) = run_episodes(place, 1, scheme="dem", seed=0)
    return episode._replace(exit_index=exit_index, exit_time=1.0 + np.arange(len(exit_index)))


def test_flows_of_a_small_zone_and_of_a_handful_of_people_are_no_records():
    """Two a second who walk into a box of 0.2 m x 0.4 m from all sides are no 5 a second and meter."""
    walkable, exits = shapely.box(0, 0, 9, 8), {"zone": shapely.box(5, 4, 5.2, 4.4), "door": [[9, 2], [9, 3]]}
    place = Scenario("zones", Geometry.from_polygon(walkable, exits=exits), Population(50), 60.0)
    zone, door = (place.geometry.exit_names.index(name) for name in exits)
    times = np.r_[np.arange(20) / 2.0, np.arange(9) / 9.0]
    run = SimpleNamespace(exit_time=times, exit_index=np.r_[zone + np.arange(20) % 4, np.full(9, door)])
    found = exits_of(place, [run])
    for key in ("flow_per_meter", "peak_flow_per_meter"):
        assert found["zone"][key]["mean"] == pytest.approx(2.0 / 1.2) and found["door"][key]["mean"] is None
    assert found["door"]["people"] == 9
