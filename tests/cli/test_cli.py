"""The command line: what it prints and writes."""

import json
import subprocess
import sys

import pytest
from cases import looped
from commands import call, figures
from repository import ROOT
from typer.testing import CliRunner

from crowd_env import MANNERS, SCENARIOS, SCHEMES
from crowd_env.agents import POLICIES, PRETRAINED
from crowd_env.analysis.figures import doubts, report
from crowd_env.cli.main import app
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.tasks.task import TASKS
from crowd_env.scenarios import make_scenario

FILES = {
    "plan.wkt": "POLYGON ((0 0, 6 0, 6 5, 0 5, 0 0), (2 2, 3 2, 3 3, 2 3, 2 2))",
    "starts.csv": "# recorded\nx,y\n1.0,1.0\n1.0,4.0\n4.0,4.0\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder with a floor plan and positions."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --------------------------------------------------------------------------------------------------------------- run

# What programs may rely on.
KEYS = {
    "scenario": None,
    "scheme": None,
    "manner": None,
    "outline": None,
    "strategy": None,
    "seed": None,
    "dt": None,
    "time_limit": None,
    "version": None,
    "population": None,
    "runs": None,
    "unfinished": None,
    "evacuation_time": {"mean", "sd", "ci95"},
    "flow": {"mean", "sd", "ci95"},
    "mean_exit_time": {"mean", "sd", "ci95"},
    "t50": {"mean", "sd", "ci95"},
    "t95": {"mean", "sd", "ci95"},
    "exits": {"door"},
    "sections": None,
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
    "by_hand": {"words", "people", "time", "response", "walk", "queue", "effective_width", "at"},
    "doubts": None,
}


@pytest.mark.more
@looped("scheme", SCHEMES)
def test_run_prints_one_json_object_with_the_documented_keys(scheme):
    told = figures(f"run room-v0 --scheme {scheme} --runs 3 --seed 5 --time-limit 30")
    assert set(told) == set(KEYS)
    for name, parts in KEYS.items():
        assert parts is None or set(told[name]) == parts
    assert (told["scenario"], told["scheme"], told["runs"], told["people"]) == ("room-v0", scheme, 3, 20)
    place = make_scenario("room-v0", time_limit=30.0)
    del told["doubts"], told["by_hand"], told["sections"]
    assert told == json.loads(json.dumps(report(place, scheme, run_episodes(place, 3, scheme=scheme, seed=5))))


def test_run_says_when_its_figures_are_doubtful():
    assert call("run --runs 1 --people 5").stdout.count("check:") == 0
    short = call("run --runs 2 --people 5 --time-limit 1").stdout
    assert "check: 9 people are left inside; 2 runs were cut by the time limit" in short
    gives_up = call("run --runs 1 --people 20 --time-limit 10 --set max_iterations=1").stdout
    assert "the contact solver ended above its tolerance in" in " ".join(gives_up.split())
    fast = {"exits": {"door": {"flow_per_meter": {"mean": 3.1}}}, "unfinished": 0, "runs": 2, "interrupted_of": 5}
    assert doubts(fast) == (
        "3.1 people per second and meter pass exit door; crowds in experiments reach 2.8 at most; "
        "only 2 of 5 runs were finished"
    )


@pytest.mark.parametrize("manner", MANNERS)
def test_a_flow_is_compared_with_that_of_such_people(manner):
    """Walking people pass 1.9 /(s m) (Seyfried et al. 2009), no crowd more than 2.8; the papers' crowd is faster than any."""

    def said(flow):
        exits = {"door": {"flow_per_meter": {"mean": flow}}}
        return doubts({"exits": exits, "unfinished": 0, "runs": 1, "manner": manner})

    walks = MANNERS[manner] is not None and MANNERS[manner].time_gap >= 0.3
    assert said(1.9) == "" and ("reach 1.9" in said(2.1)) == walks
    assert ("reach 1.9" if walks else "reach 2.8 at most") in said(3.0)
    assert "of the papers" not in said(3.2) and ("of the papers" in said(3.5)) == (manner == "competitive")


def test_run_prints_a_table():
    result = call("run --runs 2 --people 5 --scheme dem")
    assert result.exit_code == 0 and result.stderr == ""
    for words in ("room-v0: 5 people, dem, 2 runs", "evacuation time", "flow", "0 people in 0 runs", "overlap", "1/s"):
        assert words in result.stdout
    assert "nan" not in result.stdout


def test_one_run_of_few_people_has_no_spread_and_says_so():
    told = figures("run --runs 1 --people 2")
    assert told["evacuation_time"]["sd"] is None and told["flow"]["mean"] is None
    assert "nan" not in call("run --runs 1 --people 2").stdout


def test_options_reach_the_population():
    slow = figures("run --runs 2 --people 4 --set speed=0.5 --set radius=0.2")["evacuation_time"]["mean"]
    fast = figures("run --runs 2 --people 4 --set speed=2 --set radius=0.2,0.25")["evacuation_time"]["mean"]
    assert slow > 2 * fast


def test_a_floor_plan_of_ones_own(folder):
    told = figures("run plan.wkt --exit 6,2,6,3 --people 10 --runs 2")
    assert (told["scenario"], told["people"], told["unfinished"]) == ("plan", 10, 0)
    assert told["outside_mm"] < 100
    assert 1.0 < told["max_speed"] < 12.5 and told["escaped"] == 0
    by_line = call("run plan.wkt --exit POLYGON((6\u00a02))".replace("\u00a0", " ") + " --people 3")
    assert by_line.exit_code == 2  # half a polygon
    args = ["run", "plan.wkt", "--exit", "LINESTRING (6 2, 6 3)", "--exit", "0,1,0,2", "--runs", "1", "--json"]
    assert json.loads(CliRunner().invoke(app, args).stdout)["unfinished"] == 0


def test_recorded_starting_positions(folder):
    told = figures("run room-v0 --starts starts.csv --runs 2")
    assert told["people"] == 3 and told["unfinished"] == 0
    assert figures("run plan.wkt --exit 6,2,6,3 --starts starts.csv --people 3 --runs 1")["people"] == 3


# ------------------------------------------------------------------------------------------------------ the other ones


def test_list_names_everything():
    told = json.loads(call("list --json").stdout)
    assert set(told["scenarios"]) == set(SCENARIOS) and set(told["schemes"]) == set(SCHEMES)
    assert set(told["policies"]) == {*POLICIES, *PRETRAINED}
    assert told["tasks"] == {task.id: task.about for task in TASKS.values()}
    names = [name for found in told.values() for name in found]
    assert len(names) == len(set(names))
    table = call("list").stdout
    assert all(name in table for name in names)


@pytest.mark.more
def test_warmup_compiles_what_is_asked_for():
    told = json.loads(call("warmup --scheme nsm2 --json").stdout)
    assert set(told) == {"seconds"} and set(told["seconds"]) == {"nsm2"} and told["seconds"]["nsm2"] >= 0
    assert call("warmup --scheme dem").stdout.startswith("dem")


@pytest.mark.more
def test_help_and_module():
    told = subprocess.run([sys.executable, "-m", "crowd_env", "--help"], capture_output=True, text=True, cwd=ROOT)
    assert told.returncode == 0
    assert all(command in told.stdout for command in ("run", "list", "warmup"))
    assert "--exit" in call("run --help").stdout
