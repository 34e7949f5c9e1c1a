"""The files and the command of clogging."""

import json

import numpy as np
import pytest
from clogging_samples import needs_powerlaw, pareto
from typer.testing import CliRunner

from crowd_env.analysis.clogging import exits_of_run
from crowd_env.analysis.exit_times import read_exits, write_exits, write_gaps
from crowd_env.cli.main import app

# ------------------------------------------------------------------------------------------------------------- files


def test_what_is_written_is_read_again(tmp_path):
    runs = [
        exits_of_run([1.25, 0.1 + 0.2, np.nan], 130.0, ["east", "west", ""]),
        exits_of_run([4.0, 5.0], exit=["west", "west"]),
        exits_of_run([np.nan], 7.0),
    ]
    again = read_exits(write_exits(tmp_path / "new" / "exits.csv", runs, range(3)))
    assert len(again) == 3
    for one, other in zip(runs, again, strict=True):
        assert one.time.tolist() == other.time.tolist()
        assert one.until == other.until or np.isnan([one.until, other.until]).all()
        assert [str(name) for name in one.exit] == list(other.exit)
    lines = write_gaps(tmp_path / "gaps.csv", {"sheep, 2014": runs}).read_text().splitlines()
    assert lines == [
        "data,run,gap,open",
        '"sheep, 2014",0,0.950000,0',
        '"sheep, 2014",0,128.750000,1',
        '"sheep, 2014",1,1.000000,0',
    ]


@pytest.mark.filterwarnings("ignore:.*not in the order of time")
def test_two_columns_are_enough(tmp_path):
    (tmp_path / "a.csv").write_text("# door 0.7 m\nrun,time\nb,3\na,1\nb,2.5\n")
    runs = read_exits(tmp_path / "a.csv")
    assert [run.time.tolist() for run in runs] == [[2.5, 3.0], [1.0]]
    assert all(np.isnan(run.until) for run in runs)


def test_exits_out_of_order_are_taken_in_order_with_a_note(tmp_path):
    (tmp_path / "a.csv").write_text("run,time\nb,3\na,1\nb,2.5\n")
    with pytest.warns(UserWarning, match="run 'b' are not in the order of time"):
        runs = read_exits(tmp_path / "a.csv")
    assert runs[0].time.tolist() == [2.5, 3.0]


# ----------------------------------------------------------------------------------------------------------- command

KEYS = {
    "name": None,
    "manner": None,
    "outline": None,
    "runs": None,
    "exits": None,
    "unfinished_runs": None,
    "blocked_runs": None,
    "blocked_share": {"mean", "ci95"},
    "gaps": {"count", "mean", "cv", "q90", "max", "open", "longest_open"},
    "bursts": {"pause", "count", "mean_size", "max_size", "sizes"},
    "tail": {"alpha", "error", "x_min", "n", "distance", "rate", "ratio", "p", "alpha_open"},
    "no_tail": None,
    "clogged": None,
    "statement": None,
}
ROOM = ["clogging", "room-v0", "--physics", "dem", "--runs", "4", "--seed", "3"]


@needs_powerlaw
def test_the_command_prints_one_json_object_and_writes_what_it_saw(tmp_path):
    result = CliRunner().invoke(app, [*ROOM, "--json", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    (told,) = json.loads(result.stdout)["sets"]
    assert set(told) == set(KEYS)
    for name, parts in KEYS.items():
        assert parts is None or set(told[name]) == parts
    assert told["runs"] == 4 and told["exits"] == 80 and told["gaps"]["count"] == 76
    assert (tmp_path / "survival.png").read_bytes()[:4] == b"\x89PNG"
    assert len((tmp_path / "gaps.csv").read_text().splitlines()) == 1 + 76
    again = CliRunner().invoke(app, ["clogging", "--times", str(tmp_path / "exits.csv"), "--json"])
    (read,) = json.loads(again.stdout)["sets"]
    assert {**read, "name": None} == {**told, "name": None, "manner": None, "outline": None}


@needs_powerlaw
def test_an_evacuation_becomes_the_exits_of_a_run():
    from crowd_env.cli.clogging import exits_of_episode
    from crowd_env.envs.rollout import run_episodes
    from crowd_env.scenarios import make_scenario

    place = make_scenario("room-v0", time_limit=6.0)
    episodes = run_episodes(place, 3, scheme="dem", seed=5)
    runs = [exits_of_episode(episode, place.geometry) for episode in episodes]
    for run, episode in zip(runs, episodes, strict=True):
        metrics = episode.metrics
        assert len(run.time) == 20 - metrics.unfinished
        assert run.time.mean() == pytest.approx(metrics.mean_exit_time, rel=1e-12)
        assert np.isnan(run.until) if metrics.unfinished == 0 else run.until == pytest.approx(6.0)
    assert any(np.isfinite(run.until) for run in runs)


@needs_powerlaw
def test_the_command_prints_a_table_and_sets_side_by_side(tmp_path):
    (tmp_path / "sheep.csv").write_text("run,time\n" + "\n".join(f"0,{t}" for t in np.cumsum(pareto(1.7, 200, 3))))
    result = CliRunner().invoke(
        app, [*ROOM, "--people", "3", "--set", "speed=1.5", "--times", str(tmp_path / "sheep.csv")]
    )
    assert result.exit_code == 0, result.stderr
    for words in ("room-v0, dem, 3 people, 1.5 m/s", "sheep.csv", "± ", "no exponent: 8 gaps", "diverges", "bursts"):
        assert words in " ".join(result.stdout.split()), words
    assert "nan" not in result.stdout
    assert "share blocked, 95 % 0 (0..49) % 0 (0..79) %" in " ".join(result.stdout.split())  # none of 4 runs, none of 1


@needs_powerlaw
def test_files_of_one_name_do_not_hide_each_other(tmp_path):
    lines = ["clogging", "--json"]
    for name, count in (("a", 3), ("b", 5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "exits.csv").write_text("run,time\n" + "".join(f"0,{t}\n" for t in range(count)))
        lines += ["--times", str(tmp_path / name / "exits.csv")]
    told = json.loads(CliRunner().invoke(app, lines).stdout)["sets"]
    assert [one["exits"] for one in told] == [3, 5]
