"""The files and the command of clogging."""

import json

import numpy as np
import pytest
from clogging_samples import needs_powerlaw, pareto
from typer.testing import CliRunner

from crowd_env.analysis.clogging import exits_of_run
from crowd_env.analysis.exit_times import read_exits, write_gaps
from crowd_env.cli.main import app

# ------------------------------------------------------------------------------------------------------------- files


def test_every_gap_is_written(tmp_path):
    runs = [
        exits_of_run([1.25, 0.3, np.nan], 130.0, ["east", "west", ""]),
        exits_of_run([4.0, 5.0], exit=["west", "west"]),
        exits_of_run([np.nan], 7.0),
    ]
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of four runs."""
    folder = tmp_path_factory.mktemp("runs") / "room"
    result = CliRunner().invoke(app, f"run room-v0 --scheme dem --runs 4 --seed 0 --record 0 --out {folder}".split())
    assert result.exit_code == 0, result.output
    return folder


@pytest.mark.more
@needs_powerlaw
def test_the_command_prints_one_json_object_and_writes_what_it_saw(folder, tmp_path):
    result = CliRunner().invoke(app, ["clogging", str(folder), "--json", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    (told,) = json.loads(result.stdout)["sets"]
    assert set(told) == set(KEYS)
    for name, parts in KEYS.items():
        assert parts is None or set(told[name]) == parts
    assert told["runs"] == 4 and told["exits"] == 80 and told["gaps"]["count"] == 76
    assert (tmp_path / "survival.png").read_bytes()[:4] == b"\x89PNG"
    assert len((tmp_path / "gaps.csv").read_text().splitlines()) == 1 + 76
    again = CliRunner().invoke(app, ["clogging", str(folder / "exits.csv"), "--json"])
    (read,) = json.loads(again.stdout)["sets"]
    assert {**read, "name": "room"} == told


@needs_powerlaw
def test_the_place_says_when_an_exit_counts_as_blocked(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"blocked_after": 30.0}))
    (tmp_path / "exits.csv").write_text("run,time,out\n0,1.0,1\n0,60.0,0\n")
    for source, blocked in ((tmp_path, 1), (tmp_path / "exits.csv", 0)):
        (told,) = json.loads(CliRunner().invoke(app, ["clogging", str(source), "--json"]).stdout)["sets"]
        assert told["blocked_runs"] == blocked


@needs_powerlaw
def test_the_command_prints_a_table_and_sets_side_by_side(folder, tmp_path):
    (tmp_path / "sheep.csv").write_text("run,time\n" + "\n".join(f"0,{t}" for t in np.cumsum(pareto(1.7, 200, 3))))
    (tmp_path / "few.csv").write_text("run,time\n0,1\n0,2.5\n")
    files = [str(folder), str(tmp_path / "sheep.csv"), str(tmp_path / "few.csv")]
    result = CliRunner().invoke(app, ["clogging", *files])
    assert result.exit_code == 0, result.stderr
    for words in ("room", "sheep.csv", "± ", "no exponent: 1 gaps", "diverges", "bursts"):
        assert words in " ".join(result.stdout.split()), words
    assert "nan" not in result.stdout
    assert "share blocked, 95 % 0 (0..49) % 0 (0..79) %" in " ".join(result.stdout.split())  # none of 4 runs, none of 1


@needs_powerlaw
def test_files_of_one_name_do_not_hide_each_other(tmp_path):
    lines = ["clogging", "--json"]
    for name, count in (("a", 3), ("b", 5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "exits.csv").write_text("run,time\n" + "".join(f"0,{t}\n" for t in range(count)))
        lines.append(str(tmp_path / name / "exits.csv"))
    told = json.loads(CliRunner().invoke(app, lines).stdout)["sets"]
    assert [one["exits"] for one in told] == [3, 5]
