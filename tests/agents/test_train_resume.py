"""Training runs that are stopped, gone on with, and damaged in between."""

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from late import late
from repository import ROOT
from training_runs import call, checkpoint, curve, tiny

from crowd_env import CrowdEnv
from crowd_env.agents import make_policy
from crowd_env.cli.agents import learn
from crowd_env.core.files.json_file import write_json

torch = late("torch")


@pytest.mark.more
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
    assert learn.train(folder, config)
    first, used = curve(folder), starts[-1]
    marked = checkpoint(folder)
    assert marked["steps"] == first[-1]["steps"] >= 5000 and marked["optimizer"]["state"]
    marked["policy"]["value_net.bias"] += 50.0  # no fresh network has this
    torch.save(marked, folder / "checkpoint.pt")

    assert learn.train(folder, replace(config, steps=9000))
    assert not np.array_equal(starts[-1], used)  # it does not train on the same draws again
    second = curve(folder)
    assert repr(second[: len(first)]) == repr(first)  # nan before the first episode ends
    assert all(row["steps"] > marked["steps"] for row in second[len(first) :]) and second[-1]["steps"] >= 9000
    assert second[-1]["seconds"] > first[-1]["seconds"]
    now = checkpoint(folder)
    assert now["steps"] == second[-1]["steps"]
    assert now["optimizer"]["state"][0]["step"] > marked["optimizer"]["state"][0]["step"]
    assert 40 < float(now["policy"]["value_net.bias"]) < 60


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return the folder of a finished run; look at it, and change copies."""
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    config = tiny(folder)
    write_json(folder / "config.json", config.as_table())
    assert learn.train(folder, config)
    return folder


@pytest.fixture
def root(finished, tmp_path):
    """Return a root with a copy of the finished run."""
    shutil.copytree(finished, tmp_path / "runs" / "tiny")
    return tmp_path / "runs"


def test_a_budget_beside_resume_is_honoured(root, monkeypatch):
    trained = []
    monkeypatch.setitem(learn.BACKENDS, "native", lambda folder, config, threads: trained.append(config) or False)
    assert call("--resume", root / "tiny", "--steps", 9000, "--minutes", 6).exit_code == 130
    kept = json.loads((root / "tiny" / "config.json").read_text())
    assert kept == trained[0].as_table() and (kept["steps"], kept["minutes"], kept["envs"]) == (9000, 6.0, 2)
    assert call("--resume", root / "tiny", "--scheme", "nsm2", "--envs", 2).exit_code == 130  # as it was begun


@looped(
    ("args", "words"),
    [
        (("--envs", 4), "--envs 4 2 another run"),
        (("--scheme", "dem"), "--scheme dem nsm2 another run"),
        (("--scenario", "bottleneck-v0"), "--scenario bottleneck-v0 room-v0 another run"),
        (("--seed", 8), "--seed 8 3 another run"),
        (("--set", "dt=0.005"), "--set dt 0.005 0.01 another run"),
        (("--out", "other"), "--out --resume"),
        (("--steps", 4000), "5120 --steps 4000 nothing is left"),
        (("--minutes", 7), "5120 --steps 5000 nothing is left"),
        (("--minutes", 0.00001, "--steps", 9000), "--minutes nothing is left"),
    ],
)
def test_what_resume_cannot_honour_is_refused_and_nothing_is_written(root, args, words):
    before = {path: path.stat().st_mtime_ns for path in root.rglob("*.*")}
    result = call("--resume", root / "tiny", *args)
    assert result.exit_code == 2, result.output
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words.split():
        assert word in result.stderr
    assert {path: path.stat().st_mtime_ns for path in root.rglob("*.*")} == before


@pytest.mark.parametrize(
    ("file", "harm", "words"),
    [
        ("config.json", lambda text: b"[1]", "config.json does not hold"),
        ("config.json", lambda text: b"{}", "config.json lacks 'backend'"),
        ("config.json", lambda text: text.replace(b'"ppo"', b'"other"'), "config.json lacks 'ppo'"),
        (
            "config.json",
            lambda text: text.replace(b'"n_steps"', b'"smell"'),
            "cannot resume from config.json smell",
        ),
        (
            "config.json",
            lambda text: text.replace(b'"envs": 2', b'"envs": "two"'),
            "cannot resume from config.json envs",
        ),
        ("config.json", lambda text: text.replace(b'"nsm2"', b'"glue"'), "config.json unknown contact scheme 'glue'"),
        ("learning_curve.csv", lambda text: b"steps\n1\n", "cannot resume from learning_curve.csv columns"),
        ("learning_curve.csv", lambda text: text[:-9], "learning_curve.csv"),
        ("checkpoint.pt", lambda text: text[:1000], "checkpoint.pt is not a checkpoint"),
        ("checkpoint.pt", lambda text: b"no zip", "checkpoint.pt is not a checkpoint"),
        ("checkpoint.pt", lambda text: pickle.dumps(Path("x")), "checkpoint.pt is not a checkpoint"),
        ("checkpoint.pt", None, "checkpoint.pt is not a checkpoint"),
        ("best.safetensors", lambda text: text[:500], "best.safetensors is not a network"),
    ],
)
def test_damaged_files_are_named_in_one_sentence(root, file, harm, words):
    path = root / "tiny" / file
    content = path.read_bytes()
    path.unlink() if harm is None else path.write_bytes(harm(content))
    steps = () if file == "best.safetensors" else ("--steps", 9000)  # a finished run is judged again
    result = call("--resume", root / "tiny", "--runs", 1, *steps)
    assert result.exit_code == 2, (result.output, result.exception)
    assert "Traceback" not in result.stderr
    for word in words.split():
        assert word in result.stderr.replace("\n", " ")


def test_a_checkpoint_executes_nothing(root, tmp_path):
    mark = tmp_path / "executed"

    class Payload:
        def __reduce__(self):
            return os.mkdir, (str(mark),)

    torch.save(checkpoint(root / "tiny") | {"more": Payload()}, root / "tiny" / "checkpoint.pt")
    assert call("--resume", root / "tiny", "--steps", 9000).exit_code == 2
    assert not mark.exists()


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="sends signals")
@looped("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_a_request_to_end_save_a_checkpoint_and_say_how_to_go_on(tmp_path, number):
    folder = tmp_path / f"stopped-{number}"
    options = ["--scenario", "room-v0", "--envs", "2", "--runs", "2", "--out", str(folder)]
    command = [sys.executable, "train.py", *options]
    job = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 600
    while not (folder / "learning_curve.csv").exists():  # the first evaluation is over: it trains
        assert time.monotonic() < deadline and job.poll() is None
        time.sleep(0.2)
    time.sleep(1.0)
    job.send_signal(number)
    _, told = job.communicate(timeout=600)
    assert job.returncode == 130, told
    assert f"--resume {folder}" in told and "Traceback" not in told
    rows = curve(folder)
    assert len(rows) == 2 and rows[-1]["steps"] > 0
    assert checkpoint(folder)["steps"] == rows[-1]["steps"]
    assert make_policy(str(folder / "best.safetensors"))


def test_an_interrupt_while_policies_are_compared_says_how_to_go_on(tmp_path, monkeypatch):
    """The signal a service manager sends arrives as Ctrl-C does, in any part of the program."""
    monkeypatch.setitem(
        learn.BACKENDS, "native", lambda *args: os.kill(os.getpid(), signal.SIGTERM) or time.sleep(5) or True
    )
    before = signal.getsignal(signal.SIGTERM)
    result = call("--out", tmp_path / "x", "--envs", 1)
    assert result.exit_code == 130 and f"--resume {tmp_path}" in result.stderr.replace("\n", "")
    assert signal.getsignal(signal.SIGTERM) == before
