"""The command line in generated places: a table, JSON, a folder that goes on, and refusals."""

import json

import pytest
from typer.testing import CliRunner

from crowd_env.agents.evaluation import plans
from crowd_env.cli.main import app


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(plans, "BLOCK", 2)
    monkeypatch.setattr(plans, "judge_plan", lambda policy, seed, most, stopped: plans.Outcome(5.0, 0.0, 0.0, 1.0, 2.0))


def invoke(*words):
    return CliRunner().invoke(app, ["evaluate", "--task", "generated", *words])


def test_policies_are_judged_and_kept(tmp_path):
    words = ("--policies", "rule", "follow", "--runs", "3", "--out", str(tmp_path))
    done = invoke(*words, "--json")
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["rows"]
    assert [row["policy"] for row in rows] == ["rule", "follow", plans.HINDSIGHT]
    assert rows[0]["plans"] == 3 and rows[0]["time"] == 5.0
    assert json.loads((tmp_path / "rows.json").read_text())["rows"] == rows
    assert "3 generated places" in invoke(*words).stdout


@pytest.mark.parametrize("words", [("--people", "20"), ("--scheme", "dem"), ("--robustness",), ("--seed", "3")])
def test_what_a_place_draws_itself_is_refused(words):
    done = invoke(*words)
    assert done.exit_code != 0 and words[0] in done.output and "Traceback" not in done.output
