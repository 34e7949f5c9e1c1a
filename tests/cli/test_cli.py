"""The command line: what it prints, and one plain line for every mistake."""

import json
import subprocess
import sys

import pytest
from repository import ROOT
from typer.testing import CliRunner

from crowd_env import SCENARIOS, SCHEMES
from crowd_env.cli.main import app
from crowd_env.envs.rollout import report, run_episodes
from crowd_env.scenarios import make_scenario

FILES = {
    "plan.wkt": "POLYGON ((0 0, 6 0, 6 5, 0 5, 0 0), (2 2, 3 2, 3 3, 2 3, 2 2))",
    "bow.wkt": "POLYGON ((0 0, 5 5, 5 0, 0 5, 0 0))",
    "open.wkt": "POLYGON ((0 0, 5 0, 5 5, 0 5))",
    "flat.wkt": "POLYGON ((0 0, 5 0, 5 0, 0 0))",
    "line.wkt": "LINESTRING (0 0, 5 0)",
    "prose.wkt": "a room with a door",
    "two.wkt": "MULTIPOLYGON (((0 0, 4 0, 4 4, 0 4, 0 0)), ((6 0, 9 0, 9 4, 6 4, 6 0)))",
    "starts.csv": "# recorded\nx,y\n1.0,1.0\n1.0,4.0\n4.0,4.0\n",
    "column.csv": "x,z\n1,1\n",
    "outside.csv": "x,y\n1,1\n7,1\n",
    "overlap.csv": "x,y\n1,1\n1.1,1\n",
    "wall.csv": "x,y\n1,1\n0.1,3\n",
    "hole.csv": "x,y\n2.5,2.5\n",
    "word.csv": "x,y\n1,one\n",
    "nan.csv": "x,y\n1,nan\n",
    "short.csv": "x,y\n1\n",
    "empty.csv": "x,y\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder with floor plans and positions, good and bad."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text + "\n")
    (tmp_path / "binary.wkt").write_bytes(b"\xff\xfe\x00\x01")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(line):
    return CliRunner().invoke(app, line.split())


def figures(line):
    result = call(line + " --json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    return json.loads(result.stdout)


# --------------------------------------------------------------------------------------------------------------- run

# What programs may rely on.
KEYS = {
    "scenario": None,
    "scheme": None,
    "runs": None,
    "unfinished": None,
    "evacuation_time": {"mean", "sd", "ci95"},
    "flow": {"mean", "sd", "ci95"},
    "overlap_mm": {"mean", "max"},
    "outside_mm": None,
    "max_speed": None,
    "escaped": None,
    "residual": None,
    "people": None,
    "unfinished_runs": None,
    "unfinished_share": {"mean", "ci95"},
    "blocked_runs": None,
    "blocked_share": {"mean", "ci95"},
    "blocked": None,
    "unconverged_steps": None,
}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_run_prints_one_json_object_with_the_documented_keys(scheme):
    told = figures(f"run room-v0 --scheme {scheme} --runs 3 --seed 5 --time-limit 30")
    assert set(told) == set(KEYS)
    for name, parts in KEYS.items():
        assert parts is None or set(told[name]) == parts
    assert (told["scenario"], told["scheme"], told["runs"], told["people"]) == ("room-v0", scheme, 3, 20)
    place = make_scenario("room-v0", time_limit=30.0)
    assert told == json.loads(json.dumps(report(place, scheme, run_episodes(place, 3, scheme=scheme, seed=5))))


def test_run_prints_a_table():
    result = call("run --runs 2 --n 5 --scheme dem")
    assert result.exit_code == 0 and result.stderr == ""
    for words in ("room-v0: 5 people, dem, 2 runs", "evacuation time", "flow", "0 people in 0 runs", "overlap", "1/s"):
        assert words in result.stdout
    assert "nan" not in result.stdout


def test_one_run_of_few_people_has_no_spread_and_says_so():
    told = figures("run --runs 1 --n 2")
    assert told["evacuation_time"]["sd"] is None and told["flow"]["mean"] is None
    assert "nan" not in call("run --runs 1 --n 2").stdout


def test_options_reach_the_population():
    slow = figures("run --runs 2 --n 4 --speed 0.5 --radius 0.2")["evacuation_time"]["mean"]
    fast = figures("run --runs 2 --n 4 --speed 2 --radius 0.2,0.25")["evacuation_time"]["mean"]
    assert slow > 2 * fast


def test_a_floor_plan_of_ones_own(folder):
    told = figures("run plan.wkt --exit 6,2,6,3 --n 10 --runs 2")
    assert (told["scenario"], told["people"], told["unfinished"]) == ("plan", 10, 0)
    assert told["outside_mm"] < 100
    assert 1.0 < told["max_speed"] < 12.5 and told["escaped"] == 0
    by_line = call("run plan.wkt --exit POLYGON((6\u00a02))".replace("\u00a0", " ") + " --n 3")
    assert by_line.exit_code == 2  # half a polygon
    args = ["run", "plan.wkt", "--exit", "LINESTRING (6 2, 6 3)", "--exit", "0,1,0,2", "--runs", "1", "--json"]
    assert json.loads(CliRunner().invoke(app, args).stdout)["unfinished"] == 0


def test_recorded_starting_positions(folder):
    told = figures("run room-v0 --starts starts.csv --runs 2")
    assert told["people"] == 3 and told["unfinished"] == 0
    assert figures("run plan.wkt --exit 6,2,6,3 --starts starts.csv --n 3 --runs 1")["people"] == 3


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("run rooom", "rooom room-v0"),
        ("run --scheme glue", "glue dem nsm1 nsm2"),
        ("run --runs 0", "runs 0 at least 1"),
        ("run --runs -3", "runs -3 at least 1"),
        ("run --n 900", "900 do not fit"),
        ("run --radius wide", "--radius wide 0.2,0.25"),
        ("run --radius 0.1,0.2,0.3", "--radius 0.2,0.25"),
        ("run --radius 0.3,0.2", "0.3 0.2 not be larger"),
        ("run --radius -0.2", "radius > 0"),
        ("run --radius nan", "nan"),
        ("run --radius inf", "inf finite"),
        ("run --radius 0.6 --n 3", "door 0.82 m narrower 1.20 m"),
        ("run --speed -1", "speed >= 0"),
        ("run --speed inf", "inf finite"),
        ("run --dt 0", "dt > 0"),
        ("run --dt nan", "dt > 0"),
        ("run --dt 0.03", "0.03 whole number"),
        ("run --dt 0.1 --scheme dem", "dem stable step"),
        ("run --time-limit 0", "time limit > 0"),
        ("run --time-limit nan", "time limit > 0"),
        ("run --exit 5,2,5,3", "room-v0 --exit"),
        ("run none.wkt --exit 6,2,6,3", "none.wkt"),
        ("run binary.wkt --exit 6,2,6,3", "binary.wkt"),
        ("run . --exit 6,2,6,3", "cannot read"),
        ("run plan.wkt", "plan.wkt exit"),
        ("run plan.wkt --exit 5,2,5,3", "plan.wkt exit boundary"),
        ("run plan.wkt --exit 6,2,6", "plan.wkt 6,2,6 x1,y1,x2,y2"),
        ("run plan.wkt --exit door", "plan.wkt door"),
        ("run plan.wkt --exit 6,2,6,2.3", "0.30 m narrower 0.40 m"),
        ("run plan.wkt --exit 6,2,6,3 --n 900", "900 do not fit"),
        ("run bow.wkt --exit 0,1,0,2", "bow.wkt self-intersection (2.5, 2.5)"),
        ("run open.wkt --exit 0,1,0,2", "open.wkt closed"),
        ("run flat.wkt --exit 0,1,0,2", "flat.wkt no area"),
        ("run line.wkt --exit 0,1,0,2", "line.wkt LineString POLYGON"),
        ("run prose.wkt --exit 0,1,0,2", "prose.wkt WKT"),
        ("run --starts none.csv", "none.csv"),
        ("run --starts binary.csv", "binary.csv"),
        ("run --starts .", "cannot read"),
        ("run --starts column.csv", "column.csv y missing"),
        ("run --starts outside.csv", "start 1 (7, 1) outside"),
        ("run --starts overlap.csv", "starts 0 and 1 overlap smaller bodies"),
        ("run --starts wall.csv", "start 1 wall does not fit"),
        ("run plan.wkt --exit 6,2,6,3 --starts hole.csv", "start 0 outside"),
        ("run --starts word.csv", "word.csv person 1 one"),
        ("run --starts nan.csv", "nan.csv finite"),
        ("run --starts short.csv", "short.csv y"),
        ("run --starts empty.csv", "empty.csv no positions"),
        ("run --starts starts.csv --n 5", "--n 5 starts.csv 3"),
        ("run --film out.avi", "out.avi .gif .mp4"),
        ("run --film none/out.gif", "none"),
        ("warmup --scheme glue", "glue nsm2"),
    ],
)
def test_a_mistake_is_answered_by_one_plain_line_before_anything_is_written(line, words, folder):
    before = sorted(folder.rglob("*"))
    result = call(line)
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    for word in words.split():
        assert word in result.stderr
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("line", ["run --n 0", "run --seed -1", "run --runs many", "run --dt", "fly", "run a b"])
def test_a_malformed_command_is_a_usage_error(line):
    result = call(line)
    assert result.exit_code == 2 and result.stdout == "" and "Traceback" not in result.output


def test_the_first_run_can_be_filmed(folder):
    result = call("run --n 2 --runs 1 --film out.gif --json")
    assert result.exit_code == 0, result.output
    assert (folder / "out.gif").read_bytes()[:3] == b"GIF"
    assert json.loads(result.stdout)["people"] == 2


# ------------------------------------------------------------------------------------------------------ the other ones


def test_list_names_everything():
    told = json.loads(call("list --json").stdout)
    assert set(told["scenarios"]) == set(SCENARIOS) and set(told["schemes"]) == set(SCHEMES)
    table = call("list").stdout
    assert all(name in table for name in (*SCENARIOS, *SCHEMES))


def test_warmup_compiles_what_is_asked_for():
    told = json.loads(call("warmup --scheme nsm2 --json").stdout)
    assert set(told) == {"seconds"} and set(told["seconds"]) == {"nsm2"} and told["seconds"]["nsm2"] >= 0
    assert call("warmup --scheme dem").stdout.startswith("dem")


def test_help_and_module():
    told = subprocess.run([sys.executable, "-m", "crowd_env", "--help"], capture_output=True, text=True, cwd=ROOT)
    assert told.returncode == 0
    assert all(command in told.stdout for command in ("run", "list", "warmup"))
    assert "--exit" in call("run --help").stdout
