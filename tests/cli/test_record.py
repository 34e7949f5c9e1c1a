"""``crowd-env run --record``: the first run in a file, which changes nothing of what is run."""

import json

import numpy as np
import pytest
from commands import call, figures

from crowd_env.recording import load

RUN = "run room-v0 --n 8 --runs 2 --scheme dem --seed 4"


@pytest.mark.parametrize("suffix", [".sqlite", ".h5", ".parquet"])
def test_the_first_run_is_recorded_and_the_figures_stay(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    result = call(f"{RUN} --json --record {path} --record-contacts --every 0.2")
    assert result.exit_code == 0 and f"recording: {path}" in result.stderr
    assert json.loads(result.stdout) == figures(RUN)
    kept = load(path)
    assert (kept.facts["seed"], kept.facts["scheme"], kept.facts["rules"]) == (4, "dem", True)
    assert np.diff(kept.times)[:-2] == pytest.approx(0.2) and kept.contacts is not None


def test_the_exit_times_are_those_of_the_table(tmp_path):
    assert call(f"{RUN} --out {tmp_path / 'out'} --record {tmp_path / 'run.sqlite'}").exit_code == 0
    table = np.genfromtxt(tmp_path / "out" / "exits.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    of_first = np.sort(table[table["run"] == 0], order="person")
    assert of_first["time"] == pytest.approx(load(tmp_path / "run.sqlite").exit_time)


def test_a_recording_can_be_made_of_a_folder_that_is_whole(tmp_path):
    assert call(f"{RUN} --out {tmp_path / 'out'}").exit_code == 0
    assert call(f"{RUN} --out {tmp_path / 'out'} --record {tmp_path / 'run.h5'}").exit_code == 0
    assert load(tmp_path / "run.h5").facts["finished"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--record run.txt", "must end in .sqlite, .h5, .parquet"),
        ("--record none/run.h5", "--record none/run.h5: there is no folder"),
        ("--record run.h5 --every 0.25", "--every = 0.25 s is not a whole number"),
        ("--record run.h5 --every -1", "--every is -1"),
        ("--every 0.2", "--every belongs to --record"),
        ("--record-contacts", "--record-contacts belongs to --record"),
    ],
)
def test_a_mistake_is_said_before_anything_is_run(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(f"run {options}")
    assert result.exit_code == 2 and words in result.stderr and result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
