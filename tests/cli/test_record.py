"""``crowd-env run --record``: runs in files, which changes nothing of what is run."""

import json

import numpy as np
import pytest
from cases import looped
from commands import call, figures

from crowd_env.cli import run as running
from crowd_env.recording import load

RUN = "run room-v0 --people 8 --scheme dem --seed 4"


def test_the_first_run_is_recorded_and_the_figures_stay(tmp_path):
    result = call(f"{RUN} --runs 2 --json --out {tmp_path}")
    path = tmp_path / "recordings" / "run-0.sqlite"
    assert result.exit_code == 0 and f"recording: {path}" in result.stderr
    assert json.loads(result.stdout) == figures(f"{RUN} --runs 2")
    kept = load(path)
    assert (kept.facts["seed"], kept.facts["scheme"], kept.facts["rules"]) == (4, "dem", True)
    assert kept.contacts is not None
    table = np.genfromtxt(tmp_path / "exits.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    of_first = np.sort(table[table["run"] == 0], order="person")
    assert of_first["time"] == pytest.approx(kept.exit_time)


@pytest.mark.more
def test_runs_are_recorded_wherever_they_are_made(tmp_path, monkeypatch):
    """Those that processes make are recorded there, and are what they are without."""
    monkeypatch.setattr(running, "_WORTH_A_PROCESS", 0.0)
    line = f"{RUN} --runs 4 --workers 2"
    told = call(f"{line} --json --out {tmp_path} --record 3 --no-contacts")
    assert told.exit_code == 0 and json.loads(told.stdout) == figures(line)
    names = [tmp_path / "recordings" / f"run-{run}.sqlite" for run in range(3)]
    assert told.stderr.splitlines()[1:] == [f"recording: {name}" for name in names]
    assert sorted((tmp_path / "recordings").iterdir()) == names
    for run, name in enumerate(names):
        kept = load(name)
        assert (kept.facts["run"], kept.facts["seed"], kept.facts["finished"]) == (run, 4 + run, True)
        assert kept.contacts is None


@pytest.mark.more
def test_a_full_disk_loses_recordings_alone(tmp_path, monkeypatch):
    def full(self, part):
        raise OSError("cannot write it: disk is full")

    def fails(*args):
        raise OSError("this one too")

    monkeypatch.setattr("crowd_env.recording.sqlite.SqliteWriter.append", full)
    told = call(f"{RUN} --runs 3 --json --out {tmp_path} --record 2")
    assert told.exit_code == 0 and json.loads(told.stdout) == figures(f"{RUN} --runs 3")
    assert len(list((tmp_path / "runs").iterdir())) == 3
    for run in range(2):
        assert f"note: run {run} is not recorded: cannot write it: disk is full\n" in told.stderr
    monkeypatch.setattr(running, "write_results", fails)
    told = call(f"{RUN} --runs 3 --json --out {tmp_path} --record 2")
    assert told.exit_code == 2 and json.loads(told.stdout) and told.stderr.count("is not recorded: ") == 2
    assert told.stderr.endswith("error: this one too\n")


@looped(
    ("options", "words"),
    [
        ("--record 1", "--record needs a folder: give --out too"),
        ("--out out --record first", "--record is 'first'; it must be all, or how many of the 50 runs"),
        ("--out out --record 51", "--record is '51'"),
    ],
)
def test_a_mistake_is_said_before_anything_is_run(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(f"run {options}")
    assert result.exit_code == 2 and words in result.stderr and result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
