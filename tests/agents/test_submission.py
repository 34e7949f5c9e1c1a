"""Submissions: what a file holds, and that nothing that is of another task or that contradicts itself gets into a table."""

import json
import re
from dataclasses import replace

import pytest
from evaluations import random_policy
from typer.testing import CliRunner

from crowd_env.agents.evaluation.submission import read_submission, write_submission
from crowd_env.agents.networks import network_digest
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.cli.agents import submit

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
SMALL = Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, runs=3, frozen="")


def call(*arguments):
    result = CliRunner().invoke(submit.app, [str(argument) for argument in arguments])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(TASKS, "small", SMALL)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return the files of a rule and of a network, and the network."""
    folder = tmp_path_factory.mktemp("submissions")
    random_policy(0).save(folder / "mine.safetensors")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(TASKS, "small", SMALL)
        asked = ("--task", "small", "--policy", "follow", folder / "mine.safetensors", "--robustness-runs", 2)
        code, out, _ = call(*asked, "--out", folder / "out", "--folder", folder / "kept")
        assert code == 0
        paths = out.split()
        stamp = (folder / "kept/all/kept/rule-nsm2.npz").stat().st_mtime_ns
        before = [(folder / "out/small" / name).read_text() for name in ("follow.json", "mine.json")]
        assert call(*asked, "--out", folder / "out", "--folder", folder / "kept")[0] == 0
        assert stamp == (folder / "kept/all/kept/rule-nsm2.npz").stat().st_mtime_ns  # it went on, and comes to the same
        assert before == [(folder / "out/small" / name).read_text() for name in ("follow.json", "mine.json")]
    assert paths == [str(folder / "out/small/follow.json"), str(folder / "out/small/mine.json")]
    return folder / "out/small/follow.json", folder / "out/small/mine.json", folder / "mine.safetensors"


def test_a_file_holds_the_policy_beside_the_rule_and_every_run(files):
    rule, mine, network = files
    content = read_submission(rule)
    assert content["task"] == SMALL.identity() and content["policy"] == {"name": "follow", "sha256": None}
    assert content["seeds"] == {"first": 1_000_000, "runs": 3}
    assert [row["policy"] for row in content["rows"]] == ["rule", "rule-best-speed", "follow"]
    assert content["rows"][2]["credible"] == {"ok": True, "reasons": []}
    assert {row["variation"] for row in content["robustness"]["rows"]} == {
        "task",
        "twice",
        "slow",
        "half-learned",
        "half-hurried",
    }
    assert {one["policy"] for one in content["runs"]} == {"rule", "rule-best-speed", "follow"}
    assert all(len(one["last_time"]) == (3 if one["variation"] == "task" else 2) for one in content["runs"])
    learned = read_submission(mine)
    assert learned["policy"] == {"name": "mine", "sha256": network_digest(network)}
    assert learned["rows"][0] == content["rows"][0]  # the same rule on the same draws
    assert not re.search(r"second|machine_speed", json.dumps(content["rows"]))


def changed(files, tmp_path, change):
    content = json.loads(files[0].read_text())
    change(content)
    path = tmp_path / "changed.json"
    write_submission(path, content)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["task"].update(version=2), r"is of small version 2 .* which is version 1 .* submit again"),
        (lambda c: c["task"].update(digest="0"), r"is of small version 1 \(digest 0\), which is version 1"),
        (lambda c: c["task"].update(name="moon"), "is of the task 'moon'; known: competitive-door"),
        (lambda c: c["seeds"].update(first=7), "holds 3 draws from seed 7; the task has 3 from 1000000"),
        (lambda c: c["rows"][2].update(blocked=1), "follow on 'task' says blocked 1, its runs say 0"),
        (lambda c: c["rows"][2]["clearing_time"].update(mean=1.0), "says clearing_time 1.0, its runs say"),
        (lambda c: c["robustness"]["rows"][-1].update(escaped=2), "'half-hurried' says escaped 2, its runs say 0"),
        (
            lambda c: c["robustness"]["variations"][1].update(digest="0"),
            "the variation 'twice' of small is another now",
        ),
        (lambda c: c["robustness"]["variations"].pop(), "holds 4 variations of small, which has 5 now"),
        (lambda c: c["runs"].pop(0), "rule on 'task' has no runs of its own"),
        (
            lambda c: c["policy"].update(name="competitive-door/ppo"),
            "names the shipped policy competitive-door/ppo, but",
        ),
        (lambda c: c["policy"].update(name="nobody"), "has no row of its policy 'nobody'"),
        (lambda c: c["robustness"]["rows"][0].update(unfinished=1), "rule on 'task' says unfinished 1, its runs say 0"),
        (lambda c: c["rows"][1].update(runs=2), "has a row of 2 draws; the task has 3"),
        (lambda c: c["rows"][1].pop("runs"), "is damaged: KeyError 'runs'"),
        (lambda c: c.pop("runs"), "is no submission"),
    ],
)
def test_what_does_not_fit_is_refused(files, tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        read_submission(changed(files, tmp_path, change))


def test_a_new_version_of_the_task_refuses_files_of_the_old_one(files, monkeypatch):
    monkeypatch.setitem(TASKS, "small", replace(SMALL, version=2))
    with pytest.raises(ValueError, match="is of small version 1"):
        read_submission(files[0])


def test_fewer_draws_are_a_trial(tmp_path):
    code, _, _ = call("--task", "small", "--policy", "rule", "--runs", 2, "--robustness-runs", 0, "--out", tmp_path)
    assert code == 0
    with pytest.raises(ValueError, match="holds 2 draws"):
        read_submission(tmp_path / "small/rule.json")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--task", "moon", "--policy", "rule"), "unknown task 'moon'"),
        (("--task", "small", "--policy", "dance"), "unknown policy 'dance'"),
        (("--task", "small", "--policy", "rule", "--runs", "0"), "--runs is 0"),
        (("--task", "small", "--policy", "rule", "--robustness-runs", "-1"), "--robustness-runs is -1"),
        (("--task", "small", "--policy", "rule", "--robustness-runs", "9"), "the first of the draws of the task"),
    ],
)
def test_mistakes_are_said_in_one_line(tmp_path, arguments, message):
    code, out, err = call("--out", tmp_path, *arguments)
    assert code == 2 and out == ""
    assert message in err and len(err.strip().splitlines()) == 1 and err.startswith("error: ")
