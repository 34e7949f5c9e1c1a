"""Submissions: what a file holds, and that nothing that is of another task or that contradicts itself gets into a table."""

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace

import pytest
from cases import looped
from evaluations import random_policy
from repository import ROOT
from typer.testing import CliRunner

from crowd_env.agents import PRETRAINED
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import FINAL_SEED, OWN_SEED
from crowd_env.agents.evaluation.protocol import task_rows
from crowd_env.agents.evaluation.same_draws import compare
from crowd_env.agents.evaluation.submission import REFERENCES, own_seed, read_submission, write_content
from crowd_env.agents.networks import network_digest
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.cli.agents import submit
from crowd_env.envs.tasks.task import HELD_OUT_SEED

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
    assert paths == [str(folder / "out/small/follow.json"), str(folder / "out/small/mine.json")]
    return folder / "out/small/follow.json", folder / "out/small/mine.json", folder / "mine.safetensors"


@pytest.mark.more
def test_a_submission_that_is_asked_for_again_goes_on_and_comes_to_the_same(files, monkeypatch):
    folder = files[2].parent
    monkeypatch.setitem(TASKS, "small", SMALL)
    kept, left = folder / "kept/all/kept/rule-nsm2.npz", files[:2]
    stamp, before = kept.stat().st_mtime_ns, [path.read_text() for path in left]
    asked = ("--task", "small", "--policy", "follow", files[2], "--robustness-runs", 2)
    assert call(*asked, "--out", folder / "out", "--folder", folder / "kept")[0] == 0
    assert stamp == kept.stat().st_mtime_ns and before == [path.read_text() for path in left]


@pytest.mark.more
def test_a_file_holds_every_run_of_a_policy_beside_the_rule(files):
    rule, mine, network = files
    content = read_submission(rule)
    assert content["task"] == SMALL.identity() and content["policy"] == {"name": "follow", "sha256": None}
    assert content["seeds"] == {"first": 1_000_000, "runs": 3}
    assert [row["policy"] for row in content["rows"]] == ["rule", "rule-best-speed", "follow"]
    assert content["rows"][2]["credible"] == {"ok": True, "reasons": []}
    variations = {"task", "twice", "slow", "unfollowing", "turned", "mirrored", "noise", "delay"}
    assert {row["variation"] for row in content["robustness"]["rows"]} == variations
    assert {row["runs"] for row in content["robustness"]["rows"]} == {2}
    assert {one["policy"] for one in content["runs"]} == {"rule", "rule-best-speed", "follow"}
    draws = {"task": 3, "own-draws": 1}
    assert all(len(one["last_time"]) == draws.get(one["variation"], 2) for one in content["runs"])
    assert [(row["policy"], row["runs"]) for row in content["own"]] == [("rule", 1), ("follow", 1)]
    learned = read_submission(mine)
    assert learned["policy"] == {"name": "mine", "sha256": network_digest(network)}
    assert learned["rows"][0] == content["rows"][0]  # the same rule on the same draws
    assert not re.search(r"second|machine_speed", rule.read_text())
    held = json.loads(mine.read_text())["networks"]
    assert {name: base64.b64decode(one) for name, one in held.items()} == {"mine": network.read_bytes()}
    assert json.loads(rule.read_text())["networks"] == {}


def test_draws_of_its_own_follow_from_a_policy_and_were_never_seen():
    digests = [network_digest(path) for path in PRETRAINED.values()]
    constants = [{"spacing": 0.53, "time": 0.3}, {"spacing": 0.54, "time": 0.3}, {}]
    asked = [("a", digest, {}) for digest in digests] + [(name, None, one) for name in ("a", "b") for one in constants]
    seeds = [own_seed(*one) for one in asked]
    assert seeds == [own_seed(*one) for one in asked] and len(set(seeds)) == len(asked)
    assert own_seed("b", digests[0], {}) == seeds[0]  # a network by another name is the same one
    assert min(seeds) >= OWN_SEED > FINAL_SEED and max(seeds) < OWN_SEED + 2**40
    assert own_seed("a", None, {"time": 0.1 + 0.2}) == own_seed("a", None, {"time": 0.3})  # as a file holds it


def test_the_runs_on_draws_of_its_own_are_those_of_that_seed(files):
    content = json.loads(files[0].read_text())
    trial = content["trials"][1]
    assert trial["first_seed"] == own_seed("follow", None, trial["of"]["follow"]["constants"])
    place = SMALL.place()
    entries = make_entries(["rule", "follow"], place, SMALL)
    found = compare(entries, place, ["nsm2"], runs=1, seed=trial["first_seed"] - HELD_OUT_SEED)
    own = read_submission(files[0])["own"]
    assert [row["clearing_time"]["mean"] for row in own] == pytest.approx(
        [one.column("evacuation_time")[0] for one in found], rel=1e-4
    )


def test_its_figures_are_those_of_an_evaluation(files):
    """To the digits that a line holds."""
    place = SMALL.place()
    entries = make_entries([*REFERENCES, "follow"], place, SMALL)
    results = compare(entries, place, ["nsm2"], runs=3)
    for expected, found in zip(task_rows(SMALL, place, results), read_submission(files[0])["rows"], strict=True):
        for name, value in found.items():
            if name not in ("variation", "constants"):
                _near(value, expected[name], name)


def _near(value, expected, name):
    if isinstance(expected, dict):
        for key in value:
            _near(value[key], expected[key], f"{name} {key}")
    elif isinstance(expected, list):
        for one, other in zip(value, expected, strict=True):
            _near(one, other, name)
    else:
        assert value == (
            expected if not isinstance(expected, float) else pytest.approx(expected, rel=2e-3, abs=2e-4)
        ), name


def changed(files, folder, change):
    content = json.loads(files[0].read_text())
    change(content)
    path = folder / "small" / "changed.json"
    write_content(path, content)
    shutil.copy(files[0].parent.with_suffix(".json"), folder / "small.json")
    return path


def _cut(trial, by=1):
    trial["of"]["follow"]["runs"] = trial["of"]["follow"]["runs"][:-by]


@looped(
    "change, message",
    [
        (lambda c: c["task"].update(version=2), r"is of small version 2 .* which is version 1 .* submit again"),
        (lambda c: c["task"].update(digest="0"), r"is of small version 1 \(digest 0\), which is version 1"),
        (lambda c: c["task"].update(name="moon"), "is of the task 'moon'; known: competitive-door"),
        (lambda c: c["trials"][2].update(digest="0"), "the variation 'twice' of small is another now"),
        (lambda c: c["trials"].pop(), "holds other variations than small has now: task, own-draws, twice"),
        (lambda c: c["trials"].pop(1), "holds other variations than small has now: task, own-draws, twice"),
        (lambda c: _cut(c["trials"][0]), "holds 2 draws; the task as it stands has 3"),
        (lambda c: _cut(c["trials"][1]), "holds 0 draws; draws of its own has 1"),
        (lambda c: _cut(c["trials"][2]), "twice has other numbers of draws than small.json"),
        (lambda c: c["trials"][1].update(first_seed=OWN_SEED), "the draws of its own are not those of follow"),
        (lambda c: c["trials"][0]["of"]["follow"]["constants"].update(time=0.31), "its own are not those of follow"),
        (lambda c: c["trials"][1]["of"].pop("rule"), "no runs of rule in own-draws"),
        (lambda c: c["columns"].pop(), "has other columns than unfinished, blocked"),
        (
            lambda c: c.update(policies={"competitive-door/ppo": "0"}),
            "names the shipped policy competitive-door/ppo, but",
        ),
        (
            lambda c: c["trials"][1]["of"]["follow"].update(constants={"x": 1}),
            "holds other constants of follow; a network has none, a rule the same",
        ),
        (lambda c: c.update(columns=c["columns"][:12]), "has other columns than unfinished"),
        (lambda c: c["trials"][0]["of"].clear(), "holds 0 draws; the task as it stands has 3"),
        (lambda c: c["trials"][0]["of"].update(other=c["trials"][0]["of"].pop("follow")), "no runs of follow in task"),
        (lambda c: c.pop("trials"), "is no submission"),
        (lambda c: c.update(format=2), "is no submission"),
    ],
)
def test_what_does_not_fit_is_refused(files, tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        read_submission(changed(files, tmp_path, change))


@looped(
    "column, value, message",
    [
        ("last_time", "1", "mean_exit must not be above last_time"),
        ("last_time", "-5", "last_time must not be negative"),
        ("last_time", "-", "a last time, a mean exit time and a flow, all finite"),
        ("last_time", "inf", "last_time must be finite"),
        ("unfinished", "-3", "unfinished must be whole numbers from 0 to"),
        ("unfinished", "0.5", "unfinished must be whole numbers"),
        ("crushed_time", "2", "crushed must be 0 where crushed_time is 0"),
        ("crushed", "1e9", "crushed must be whole numbers"),
        ("blocked", "2", "blocked must be whole numbers from 0 to 1"),
        ("mean_exit", "500", "mean_exit must not be above last_time"),
        ("flow", "0.001", "flow must not be below half of the people over last_time"),
        *((name, "-", f"{name} must be a number in every run") for name in ("max_pressure", "walked", "hurry")),
        (None, None, "two runs are the same"),
    ],
)
def test_runs_that_contradict_themselves_are_refused(files, tmp_path, column, value, message):
    def change(content):
        runs = content["trials"][0]["of"]["follow"]["runs"]
        if column is None:
            runs[1] = runs[0]
            return
        cells = runs[0].split(",")
        cells[content["columns"].index(column)] = value
        runs[0] = ",".join(cells)

    with pytest.raises(ValueError, match=f"runs of follow in task contradict themselves: .*{message}"):
        read_submission(changed(files, tmp_path, change))


def test_a_network_that_is_not_the_one_that_was_judged_is_refused(files, tmp_path):
    content = json.loads(files[1].read_text())
    random_policy(1).save(tmp_path / "other.safetensors")
    content["networks"]["mine"] = base64.b64encode((tmp_path / "other.safetensors").read_bytes()).decode()
    write_content(tmp_path / "small" / "mine.json", content)
    shutil.copy(files[0].parent.with_suffix(".json"), tmp_path / "small.json")
    with pytest.raises(ValueError, match="holds another network than its digest says"):
        read_submission(tmp_path / "small" / "mine.json")
    del content["networks"]["mine"]
    write_content(tmp_path / "small" / "mine.json", content)
    with pytest.raises(ValueError, match="is damaged"):
        read_submission(tmp_path / "small" / "mine.json")


def test_figures_that_are_written_beside_the_runs_count_for_nothing(files, tmp_path):
    """Every figure of a row is made of the runs, and who is credible of the rows: also of forged ones of the rule."""
    expected = read_submission(files[0])

    def forged(content):
        for trial in content["trials"]:
            for figures in trial["of"].values():
                nothing = {"mean": 0.0, "sd": 0.0, "ci95": [0.0, 0.0], "max": 0.0}
                figures |= dict.fromkeys(set(expected["rows"][0]) - {"constants", "runs"}, nothing)
            if trial["variation"] != "own-draws":
                trial["of"]["rule"] = {"runs": [run.replace(",", ",1", 1) for run in trial["of"]["follow"]["runs"]]}

    found = read_submission(changed(files, tmp_path, forged))
    for part in ("rows", "robustness"):
        assert repr(found[part]) == repr(expected[part])


@looped(
    ("column", "value", "why"),
    [
        ("hurry", "1.3", "someone's mean speed over the desired is 1.3"),
        ("max_overlap", "1", "the deepest overlap is 1e+03 mm"),
        ("max_speed", "99", "the largest speed is 99 m/s"),
        ("escaped", "1", "1 people were outside of the walls"),
    ],
)
def test_who_is_credible_is_said_by_the_runs(files, tmp_path, column, value, why):
    def change(content):
        runs, at = content["trials"][0]["of"]["follow"]["runs"], content["columns"].index(column)
        runs[0] = ",".join(value if k == at else one for k, one in enumerate(runs[0].split(",")))

    row = read_submission(changed(files, tmp_path, change))["rows"][2]
    assert row["credible"]["ok"] is False and row["credible"]["reasons"][0].startswith(why)


@looped(("name", "variation"), [("rule", 0), ("rule-best-speed", 0), ("rule", 1)])  # of the references: no own draws
def test_both_rules_have_to_stand_beside_a_policy(files, tmp_path, name, variation):
    path = changed(files, tmp_path, lambda content: None)
    rules = json.loads((tmp_path / "small.json").read_text())
    del rules["trials"][variation]["of"][name]
    write_content(tmp_path / "small.json", rules)
    with pytest.raises(
        ValueError, match=f"there are no runs of {name} in {('task', 'twice')[variation]}; submit again"
    ):
        read_submission(path)


def test_files_of_the_rules_are_those_that_tasks_name():
    for name, task in TASKS.items():
        path = ROOT / f"docs/tasks/submissions/{name}.json"
        if path.exists():
            digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
            assert task.references == digest, f"tasks.toml, {name}: references = {digest!r}"
        else:
            assert not task.references or name == "small"


def test_a_file_of_rules_that_was_changed_is_refused(files, tmp_path, monkeypatch):
    path = changed(files, tmp_path, lambda content: None)
    rules = tmp_path / "small.json"
    digest = hashlib.sha256(rules.read_bytes()).hexdigest()[:16]
    monkeypatch.setitem(TASKS, "small", replace(SMALL, references=digest))
    read_submission(path)
    content = json.loads(rules.read_text())
    run = content["trials"][0]["of"]["rule"]["runs"]
    run[0] = run[0].replace(",,,", ",,1,", 1) if ",,," in run[0] else run[0] + " "
    write_content(rules, content)
    with pytest.raises(
        ValueError, match=rf"is not the file of rules of small version 1: its digest is \w+, not {digest};"
    ):
        read_submission(path)


def test_a_new_version_of_the_task_refuses_files_of_the_old_one(files, monkeypatch):
    monkeypatch.setitem(TASKS, "small", replace(SMALL, version=2))
    with pytest.raises(ValueError, match="is of small version 1"):
        read_submission(files[0])


@pytest.mark.more
def test_a_policy_that_comes_later_is_submitted_alone_and_is_the_same_as_beside_the_references(
    files, tmp_path, monkeypatch
):
    rule, walked = files[0], []
    write_content(tmp_path / "small.json", json.loads(rule.parent.with_suffix(".json").read_text()))
    before = (tmp_path / "small.json").stat().st_mtime_ns

    def seen(entries, *args, **options):
        walked.extend((entry.name, options["runs"]) for entry in entries)
        return compare(entries, *args, **options)

    monkeypatch.setattr("crowd_env.agents.evaluation.robustness.compare", seen)
    code, _, err = call("--task", "small", "--policy", "follow", "--robustness-runs", 2, "--out", tmp_path)
    assert code == 0, err
    assert walked.count(("follow", 2)) == 7  # the variations, and not the task as it stands once more
    assert walked.count(("rule", 3)) == 1 and ("rule-best-speed", 3) not in walked and ("rule", 2) not in walked
    assert (tmp_path / "small.json").stat().st_mtime_ns == before
    ours, theirs = (json.loads(path.read_text()) for path in (tmp_path / "small" / "follow.json", rule))
    assert ours["trials"] == theirs["trials"]


def test_another_rule_in_the_folder_is_refused(files, tmp_path):
    content = json.loads(files[0].parent.with_suffix(".json").read_text())
    runs = content["trials"][0]["of"]["rule"]["runs"]
    runs[0] = runs[0].replace(",", ",9", 5)
    write_content(tmp_path / "small.json", content)
    code, _, err = call("--task", "small", "--policy", "follow", "--robustness-runs", 0, "--out", tmp_path)
    assert code == 2 and "the rule does other things here" in err


@looped(
    "arguments, message",
    [
        (("--task", "moon", "--policy", "rule"), "unknown task 'moon'"),
        (("--task", "small", "--policy", "dance"), "unknown policy 'dance'"),
        (("--task", "small", "--policy", "random"), "--policy random: what a run draws depends on the runs beside it"),
        (("--task", "small", "--policy", "rule", "--runs", "0"), "--runs is 0"),
        (("--task", "small", "--policy", "rule", "--robustness-runs", "-1"), "--robustness-runs is -1"),
        (("--task", "small", "--policy", "rule", "--robustness-runs", "9"), "the first of the draws of the task"),
    ],
)
def test_mistakes_are_said_in_one_line(tmp_path, arguments, message):
    code, out, err = call("--out", tmp_path, *arguments)
    assert code == 2 and out == ""
    assert message in err and len(err.strip().splitlines()) == 1 and err.startswith("error: ")
