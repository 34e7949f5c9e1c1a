"""Shipped policies: found by name, fit for their task as it stands, and shipped by one command from a finished run."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import call as evaluate
from evaluations import random_network
from training_runs import QUICK, with_ppo
from typer import Typer
from typer.testing import CliRunner

from crowd_env import ObservationLayout, agents
from crowd_env.agents import PRETRAINED, load, make_policy, shipping
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.networks import network_digest
from crowd_env.agents.tasks import TASKS, make_task
from crowd_env.agents.trained import LearnedController, LearnedPolicy
from crowd_env.cli.agents.ship import main
from crowd_env.core.files.json_file import read_json, write_json

LAYOUT = ObservationLayout(terms=("direction", "neighbors"), neighbors=2)
ROOM = TASKS["room"]

app = Typer(pretty_exceptions_enable=False)
app.command()(main)


def call(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def policy(task=ROOM, seed=0):
    options = {"frame": "path", "action": "continuous", "observation": LAYOUT}
    return LearnedPolicy(random_network(LAYOUT.size, 2, seed), options, {"task": task and task.identity(), "seed": 3})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder of shipped policies of its own, in which there are none."""
    monkeypatch.setattr(shipping, "FOLDER", tmp_path / "pretrained")
    return tmp_path / "pretrained"


@pytest.fixture
def run(tmp_path):
    """Return the folder of a finished run, as train.py leaves it; its network is an untrained one."""
    found = tmp_path / "runs/mine"
    found.mkdir(parents=True)
    policy().save(found / "best.safetensors")
    rows = [
        {"policy": name, "clearing_time": {"mean": time}} for name, time in (("rule", 9), ("follow", 7), ("learned", 8))
    ]
    results = {
        "config": {"seed": 3, "observation": LAYOUT.as_table()},
        "task": ROOM.identity(),
        "network": network_digest(found / "best.safetensors"),
        "spent": {"steps": 5000.0, "seconds": 10.0, "cpu_seconds": 19.0},
        "validation": {"evacuation_time": 8.1},
        "confirmation": None,
        "rows": rows,
    }
    write_json(found / "results.json", results)
    return found


def changed(run, **changes):
    write_json(run / "results.json", read_json(run / "results.json") | changes)


# ---------------------------------------------------------------------------------------------------- what is shipped


@looped("name", [name for name in PRETRAINED if "/" in name])
def test_a_shipped_policy_fits_its_task_as_it_stands(name):
    """Its network and its card are of one version of the task, maybe a former one, and people walk by it."""
    task, found, card = make_task(name.partition("/")[0]), load(name), read_json(PRETRAINED[name].with_suffix(".json"))
    assert found.name == card["policy"] == name
    assert found.trained["task"] == card["task"] and card["task"]["name"] == task.name
    assert card["network"] == network_digest(PRETRAINED[name])
    assert card["config"]["seed"] == found.trained["seed"] and card["spent"]["cpu_seconds"] > 0
    assert isinstance(found, LearnedPolicy) or task.decides == "routing"
    if isinstance(found, LearnedPolicy):
        assert ObservationLayout(**card["config"]["observation"]) == found.env_options["observation"]
        assert card["config"]["frame"] == found.env_options["frame"]
    (entry,) = make_entries([name], task.place(), task)
    assert entry.name == name
    batch = entry.driver(task.place())(1)
    batch.reset([0])
    start = batch.env.simulation.state.position.copy()
    batch.step()
    moved = np.hypot(*(batch.env.simulation.state.position - start).T)
    assert 0.0 < moved.max() < 1.0


def test_there_is_a_card_beside_every_network_and_no_other_file():
    files = {path for path in shipping.FOLDER.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")}
    assert files == {path.with_suffix(suffix) for path in PRETRAINED.values() for suffix in (".safetensors", ".json")}


@pytest.mark.more
def test_shipped_names_stand_beside_those_of_rules(tmp_path, monkeypatch):
    path = tmp_path / "room/mine.safetensors"
    policy().save(path)
    monkeypatch.setitem(PRETRAINED, "room/mine", path)
    assert isinstance(agents.load("room/mine"), LearnedPolicy) and make_policy("room/mine").name == "room/mine"
    code, told, _ = evaluate("--task", "room", "--policies", "rule", "room/mine", path, "--runs", 2, "--json")
    rows = json.loads(told)["rows"]
    assert code == 0 and [row["policy"] for row in rows] == ["rule", "room/mine", "mine"]
    assert rows[1]["clearing_time"] == rows[2]["clearing_time"] != rows[0]["clearing_time"]
    for ask in (load, make_policy, lambda name: make_entries([name], ROOM.place(), ROOM)):
        with pytest.raises(ValueError, match=r"unknown .*policy 'room/yours'; .*room/mine.*, or the path"):
            ask("room/yours")


def test_a_shipped_controller_is_no_policy_of_peoples_own_steps(tmp_path, monkeypatch):
    path = tmp_path / "theatre/ppo.safetensors"
    LearnedController(random_network(5, 7), np.array([3, 4]), {}, {"task": TASKS["theatre"].identity()}).save(path)
    monkeypatch.setitem(PRETRAINED, "theatre/ppo", path)
    assert load("theatre/ppo").trained["task"]["name"] == "theatre"
    with pytest.raises(ValueError, match="theatre/ppo is a controller"):
        make_policy("theatre/ppo")


# ------------------------------------------------------------------------------------------------------------- to ship


def test_shipping_copies_the_network_and_writes_its_card(run, folder):
    told = call(run, "--as", "room/mine")
    assert told.exit_code == 0, told.output
    assert sorted(path.name for path in (folder / "room").iterdir()) == ["mine.json", "mine.safetensors"]
    assert (folder / "room/mine.safetensors").read_bytes() == (run / "best.safetensors").read_bytes()
    card, results = read_json(folder / "room/mine.json"), read_json(run / "results.json")
    assert card["policy"] == "room/mine" and card["task"] == ROOM.identity()
    assert card["network"] == network_digest(folder / "room/mine.safetensors")
    for key in ("config", "spent", "validation", "confirmation"):
        assert card[key] == results[key]


def test_a_name_is_taken_once_unless_it_is_to_be_replaced(run, folder):
    assert call(run, "--as", "room/mine").exit_code == 0
    policy(seed=1).save(run / "best.safetensors")
    changed(run, network=network_digest(run / "best.safetensors"))
    told = call(run, "--as", "room/mine")
    assert told.exit_code == 2 and "room/mine is shipped already; give --replace" in told.stderr
    assert call(run, "--as", "room/mine", "--replace").exit_code == 0
    assert (folder / "room/mine.safetensors").read_bytes() == (run / "best.safetensors").read_bytes()


@pytest.mark.parametrize(
    ("name", "harm", "words"),
    [
        ("room", lambda run: None, "--as room: it must be TASK/POLICY"),
        ("room/../x", lambda run: None, "it must be TASK/POLICY"),
        ("attic/ppo", lambda run: None, "unknown task 'attic'; known: competitive-door"),
        ("crossing/ppo", lambda run: None, "best.safetensors was made for task room, not crossing"),
        (
            "room/ppo",
            lambda run: policy(None).save(run / "best.safetensors"),
            "was made for no task; train with --task room",
        ),
        (
            "room/ppo",
            lambda run: policy(replace(ROOM, version=0)).save(run / "best.safetensors"),
            "was made for version 0 of room",
        ),
        (
            "room/ppo",
            lambda run: policy(replace(ROOM, time_limit=59.0)).save(run / "best.safetensors"),
            "which is at version 3 now",
        ),
        (
            "room/ppo",
            lambda run: changed(run, task=replace(ROOM, version=0).identity()),
            "results.json was made for version 0 of room",
        ),
        (
            "room/ppo",
            lambda run: policy(seed=1).save(run / "best.safetensors"),
            "results.json is about another network",
        ),
        ("room/ppo", lambda run: write_json(run / "results.json", [1]), "results.json lacks 'task'"),
        ("room/ppo", lambda run: (run / "results.json").unlink(), "cannot read"),
        ("room/ppo", lambda run: (run / "best.safetensors").unlink(), "cannot read the network"),
        ("room/ppo", lambda run: (run / "best.safetensors").write_bytes(b"x" * 50), "is not a network"),
    ],
)
def test_what_cannot_be_shipped_is_refused_in_one_sentence(run, folder, name, harm, words):
    harm(run)
    told = call(run, "--as", name)
    assert told.exit_code == 2 and words in told.stderr and len(told.stderr.splitlines()) == 1, told.stderr
    assert not folder.exists()


@pytest.mark.more
def test_a_run_of_train_py_can_be_shipped(tmp_path, folder, monkeypatch):
    pytest.importorskip("stable_baselines3")
    from crowd_env.agents.evaluation import trained_run
    from crowd_env.agents.training_config import task_config
    from crowd_env.cli.agents import learn

    monkeypatch.setattr(trained_run.shipped, "OF_TASK", ("rule",))
    run = tmp_path / "runs/room"
    run.mkdir(parents=True)
    config = replace(task_config("room", 3, envs=2, steps=1500), eval_every=10**6, eval_runs=2)
    config = with_ppo(config, **QUICK)
    assert learn.train(run, config)
    trained_run.judge(run, config, 2, 1)
    path = shipping.ship(run, "room/ppo")
    card, found = read_json(path.with_suffix(".json")), LearnedPolicy.load(path)
    assert found.trained["task"] == card["task"] == ROOM.identity() and card["config"] == config.as_table()
    assert card["spent"]["steps"] >= 1500 and card["spent"]["cpu_seconds"] > 0
    assert card["validation"]["evacuation_time"] > 0
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(trained_run.shipped, "FOLDER", tmp_path / "rules")
    trained_run.shipped.ship(ROOM, runs=2)
    shutil.rmtree(run / "held-out-2")
    for fresh in (False, True):  # what ships is not computed, unless that is asked for
        again = trained_run.judge(run, config, 2, 1, fresh=fresh)
        assert [result.policy for result in again] == ["rule", "learned:sampled", "learned"]
        assert (run / "held-out-2/kept/rule-nsm2.npz").exists() == fresh
        assert again[0].row()["flow"]["mean"] == pytest.approx(
            read_json(run / "results.json")["rows"][0]["flow"], rel=1e-6
        )
