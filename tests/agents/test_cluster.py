"""Evaluations and papers on a Ray cluster: the rows of the local run, whatever happens to a worker, and a clean stop."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from repository import ROOT

ray = pytest.importorskip("ray", reason="Ray is not installed: an environment of its own has it, see docs/ray.md")
pytestmark = pytest.mark.nightly

POLICIES = ("rule", "rule-best-speed", "random", "follow")
EVALUATE = (
    "-m",
    "crowd_env",
    "evaluate",
    "--task",
    "narrow-door",
    "--people",
    "30",
    "--policies",
    *POLICIES,
    "--runs",
    "60",
)
ALONE = {"RAY_ADDRESS": "local"}  # a cluster of this test, whatever else runs on the machine


def started(*words):
    return subprocess.Popen(
        [sys.executable, *map(str, words)],
        cwd=ROOT,
        env=os.environ | ALONE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # in case we run in the background ourselves
    )


def told(*words):
    process = started(*words)
    out, said = process.communicate(timeout=600)
    assert process.returncode == 0, said
    return json.loads(out)


def without_times(told):
    """Return what a command printed but times of computing."""
    rows = [{name: value for name, value in row.items() if "second" not in name} for row in told["rows"]]
    return told | {"rows": rows}


@pytest.fixture(scope="module")
def local():
    return without_times(told(*EVALUATE, "--json"))


def test_an_evaluation_is_the_same_bit_by_bit(local):
    assert without_times(told(*EVALUATE, "--json", "--ray")) == local


def test_an_interrupted_evaluation_goes_on_elsewhere(local, tmp_path):
    process = started(*EVALUATE, "--ray", "--out", tmp_path / "out")
    while process.poll() is None and not list(tmp_path.glob("out/kept/[!.]*.npz")):
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
    _, said = process.communicate(timeout=600)
    assert process.returncode == 130, said
    assert said.splitlines()[-1] == "interrupted: the same command goes on" and "Traceback" not in said
    kept = {path: path.read_bytes() for path in (tmp_path / "out/kept").iterdir()}
    assert kept
    assert without_times(told(*EVALUATE, "--json", "--out", tmp_path / "out")) == local
    assert {path: path.read_bytes() for path in kept} == kept


def test_tables_of_papers_are_the_same(tmp_path):
    for name in ("table5 --runs 6 --n 8", "lin-fig5 --runs 1"):
        words = ["-m", "crowd_env", "reproduce", *name.split(), "--json", "--out"]
        assert told(*words, tmp_path / "ray", "--ray") == told(*words, tmp_path / "here")


def test_a_cluster_that_is_not_there_is_one_sentence(monkeypatch):
    monkeypatch.setitem(ALONE, "RAY_ADDRESS", "127.0.0.1:1")
    process = started(*EVALUATE, "--ray")
    _, said = process.communicate(timeout=600)
    assert process.returncode == 2 and "cannot connect to a Ray cluster at RAY_ADDRESS 127.0.0.1:1" in said
    assert "Traceback" not in said
