"""The main job: what a training run leaves behind, and that it can be stopped and gone on with."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import PPO
from typer import Typer
from typer.testing import CliRunner

import train
from agents import make_policy
from agents.evaluation import evaluate
from agents.learned import LearnedPolicy
from agents.learned.training import CURVE_COLUMNS
from crowd_env import CrowdEnv

ROOT = Path(__file__).parents[1]

app = Typer(pretty_exceptions_enable=False)
app.command()(train.main)


def call(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def curve(folder):
    with (folder / "learning_curve.csv").open() as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def tiny(folder, **changes):
    """Return the config of a run of a few seconds in a folder of its own."""
    folder.mkdir()
    config = train.default_config("room-v0", "nsm2", 3, 2, 5000, 5.0)
    config |= {"eval_every": 2500, "eval_runs": 2} | changes
    config["ppo"] |= {"n_steps": 32, "batch_size": 256, "n_epochs": 1}
    return config


# ------------------------------------------------------------------------------------------------------ the whole job


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """A whole run from the command line, as small as can be."""
    root = tmp_path_factory.mktemp("runs")
    options = ("--minutes", 0.2, "--steps", 3000, "--envs", 2, "--runs", 2, "--seed", 7)
    result = call(*options, "--root", root, "--name", "tiny")
    assert result.exit_code == 0, result.output
    return root, result


def test_a_run_leaves_model_config_results_curves_and_film(job):
    root, _ = job
    folder = root / "tiny"
    left = {path.name for path in folder.iterdir()}
    pictures = {"learning_curve.png", "egress_curves.png", "evacuation.gif"}
    assert {"best.zip", "checkpoint.zip", "config.json", "results.json", "learning_curve.csv"} | pictures <= left
    assert not [name for name in left if "part" in name]
    assert list((folder / "tensorboard").glob("events*"))
    assert (folder / "evacuation.gif").read_bytes()[:3] == b"GIF"
    assert all((folder / name).read_bytes()[:4] == b"\x89PNG" for name in pictures if name.endswith("png"))
    assert zipfile.is_zipfile(folder / "best.zip")


def test_the_config_holds_every_parameter(job):
    config = json.loads((job[0] / "tiny" / "config.json").read_text())
    assert (
        config["seed"] == 7 and config["envs"] == 2 and config["scenario"] == "room-v0" and config["scheme"] == "nsm2"
    )
    assert {"dt", "decision_dt", "frame", "action", "observation", "reward", "ppo", "versions", "steps"} <= set(config)
    assert {"learning_rate", "gamma", "gae_lambda", "n_steps", "batch_size"} <= set(config["ppo"])


def test_the_results_compare_all_policies_on_the_same_held_out_draws(job):
    root, result = job
    told = json.loads((root / "tiny" / "results.json").read_text())
    rows = {row["policy"]: row for row in told["rows"]}
    assert set(rows) == {"random", "stand-still", "shortest", "learned"}
    assert rows["stand-still"]["unfinished"] == 40
    assert rows["shortest"] == evaluate(make_policy("shortest"), runs=2).row()
    assert rows["learned"] == evaluate(make_policy(str(root / "tiny" / "best.zip")), runs=2).row()
    ratio = rows["learned"]["evacuation_time"]["mean"] / rows["shortest"]["evacuation_time"]["mean"]
    assert told["learned_over_shortest"] == pytest.approx(ratio)
    assert all(name in result.stdout for name in rows)


def test_the_learning_curve_has_a_row_before_and_after(job):
    rows = curve(job[0] / "tiny")
    assert tuple(rows[0]) == CURVE_COLUMNS
    assert rows[0]["steps"] == 0 and rows[-1]["steps"] >= 3000
    assert (np.diff([row["steps"] for row in rows]) > 0).all()


def test_the_same_name_twice_overwrites_nothing(job, monkeypatch):
    root, _ = job
    monkeypatch.setattr(train, "train", lambda folder, config: False)  # as if interrupted at once
    before = {path: path.stat().st_mtime_ns for path in (root / "tiny").rglob("*")}
    result = call("--root", root, "--name", "tiny")
    assert result.exit_code == 130
    assert (root / "tiny-2" / "config.json").exists()
    assert {path: path.stat().st_mtime_ns for path in (root / "tiny").rglob("*")} == before


def test_a_finished_run_can_be_judged_again(job):
    root, _ = job
    before = (root / "tiny" / "learning_curve.csv").read_bytes()
    result = call("--root", root, "--resume", "tiny", "--runs", 1)
    assert result.exit_code == 0, result.output
    assert (root / "tiny" / "learning_curve.csv").read_bytes() == before
    assert json.loads((root / "tiny" / "results.json").read_text())["rows"][0]["runs"] == 1


# ------------------------------------------------------------------------------------------------------------ going on


def test_training_goes_on_from_the_checkpoint_with_other_draws(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    config = tiny(folder)
    starts = []
    reset = CrowdEnv.reset

    def watched(self, seed=None, mask=None):
        answer = reset(self, seed, mask)
        if self.autoreset:
            starts.append(answer[0].copy())
        return answer

    monkeypatch.setattr(CrowdEnv, "reset", watched)
    assert train.train(folder, config)
    first, used = curve(folder), starts[-1]
    steps = PPO.load(folder / "checkpoint.zip").num_timesteps
    assert steps == first[-1]["steps"] >= 5000
    marked = LearnedPolicy.load(folder / "checkpoint.zip")
    with torch.no_grad():
        marked.model.policy.value_net.bias += 50.0  # no fresh network has this
    marked.save(folder / "checkpoint.zip")

    assert train.train(folder, config | {"steps": 9000})
    assert not np.array_equal(starts[-1], used)  # it does not train on the same draws again
    second = curve(folder)
    assert repr(second[: len(first)]) == repr(first)  # nan before the first episode ends
    assert all(row["steps"] > steps for row in second[len(first) :]) and second[-1]["steps"] >= 9000
    assert second[-1]["seconds"] > first[-1]["seconds"]
    now = PPO.load(folder / "checkpoint.zip")
    assert now.num_timesteps == second[-1]["steps"]
    assert 40 < float(now.policy.value_net.bias) < 60


def test_training_stops_when_its_time_is_up(tmp_path):
    folder = tmp_path / "run"
    config = tiny(folder, minutes=0.02, steps=10**9, eval_every=10**9)
    begin = time.monotonic()
    assert train.train(folder, config)
    assert time.monotonic() - begin < 15
    assert 0 < curve(folder)[-1]["steps"] < 10**9


def test_the_same_seed_trains_the_same_policy(tmp_path):
    for name in ("one", "two"):
        train.train(tmp_path / name, tiny(tmp_path / name))
    one, two = (PPO.load(tmp_path / name / "checkpoint.zip").policy.state_dict() for name in ("one", "two"))
    assert all((one[key] == two[key]).all() for key in one)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_saves_a_checkpoint_and_says_how_to_go_on(tmp_path):
    command = [sys.executable, "train.py", "--envs", "2", "--runs", "2", "--root", str(tmp_path), "--name", "stopped"]
    job = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    folder = tmp_path / "stopped"
    deadline = time.monotonic() + 120
    while not (folder / "learning_curve.csv").exists():  # the first evaluation is over: it trains
        assert time.monotonic() < deadline and job.poll() is None
        time.sleep(0.2)
    time.sleep(1.0)
    job.send_signal(signal.SIGINT)
    _, told = job.communicate(timeout=60)
    assert job.returncode == 130, told
    assert "--resume stopped" in told and "Traceback" not in told
    rows = curve(folder)
    assert len(rows) == 2 and rows[-1]["steps"] > 0
    assert PPO.load(folder / "checkpoint.zip").num_timesteps == rows[-1]["steps"]
    assert make_policy(str(folder / "best.zip"))


# ----------------------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("--scenario", "hall"), "hall room-v0"),
        (("--scheme", "glue"), "glue nsm2"),
        (("--seed", -1), "seed -1"),
        (("--seed", 1_000_000), "seed 999999"),
        (("--minutes", 0), "--minutes > 0"),
        (("--minutes", "nan"), "--minutes > 0"),
        (("--minutes", "inf"), "--minutes finite"),
        (("--steps", 0), "--steps > 0"),
        (("--envs", -2), "--envs > 0"),
        (("--runs", 0), "--runs > 0"),
        (("--resume", "nothing"), "nothing config.json"),
    ],
)
def test_a_mistake_is_answered_plainly_before_anything_is_written(tmp_path, args, words):
    result = call("--root", tmp_path / "runs", *args)
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    for word in words.split():
        assert word in result.stderr.replace("\n", "")
    assert not (tmp_path / "runs").exists()
