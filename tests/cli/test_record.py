"""``crowd-env run --record``: runs in files, which changes nothing of what is run."""

import json

import numpy as np
import pytest
from commands import call, figures

from crowd_env import make_scenario
from crowd_env.cli import evacuations
from crowd_env.envs.rollout import run_episodes
from crowd_env.recording import load

RUN = "run room-v0 --n 8 --runs 2 --scheme dem --seed 4"


@pytest.mark.parametrize("suffix", [".sqlite", ".h5"])
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


def test_any_runs_can_be_recorded_wherever_they_are_made(tmp_path, monkeypatch):
    """Those that processes make are recorded there, and are what they are without."""
    monkeypatch.setattr(evacuations, "_START", -1e6)  # processes are worth it
    line = f"{RUN.replace('--runs 2', '--runs 4')} --workers 2"
    path = tmp_path / "run.h5"
    told = call(f"{line} --json --record {path} --record-runs 0,2-3")
    assert told.exit_code == 0 and json.loads(told.stdout) == figures(line)
    names = [tmp_path / f"run-{run}.h5" for run in (0, 2, 3)]
    assert told.stderr.splitlines() == [f"recording: {name}" for name in names]
    assert sorted(tmp_path.iterdir()) == names
    episodes = run_episodes(make_scenario("room-v0", people=8), 4, seed=4, scheme="dem")
    for name, run in zip(names, (0, 2, 3), strict=True):
        kept = load(name)
        assert (kept.facts["run"], kept.facts["seed"], kept.facts["finished"]) == (run, 4 + run, True)
        np.testing.assert_array_equal(kept.exit_time, episodes[run].exit_time)


@pytest.mark.parametrize(("which", "names"), [("1", ["run.sqlite"]), ("all", ["run-0.sqlite", "run-1.sqlite"])])
def test_one_run_keeps_the_name_and_several_get_their_numbers(which, names, tmp_path):
    assert call(f"{RUN} --record {tmp_path / 'run.sqlite'} --record-runs {which}").exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert load(tmp_path / names[-1]).facts["seed"] == 5


def test_a_run_of_a_folder_is_made_again_to_record_it(tmp_path):
    for options in ("", f" --record {tmp_path / 'run.sqlite'} --record-runs 1"):
        assert call(f"{RUN} --out {tmp_path / 'out'}{options}").exit_code == 0
    table = np.genfromtxt(tmp_path / "out" / "exits.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    of_second = np.sort(table[table["run"] == 1], order="person")
    assert of_second["time"] == pytest.approx(load(tmp_path / "run.sqlite").exit_time)


def test_a_recording_can_be_made_of_a_folder_that_is_whole(tmp_path):
    assert call(f"{RUN} --out {tmp_path / 'out'}").exit_code == 0
    assert call(f"{RUN} --out {tmp_path / 'out'} --record {tmp_path / 'run.h5'}").exit_code == 0
    assert load(tmp_path / "run.h5").facts["finished"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--record run.txt", "must end in .sqlite, .h5"),
        ("--record none/run.h5", "--record none/run.h5: there is no folder"),
        ("--record run.h5 --every 0.25", "--every = 0.25 s is not a whole number"),
        ("--record run.h5 --every -1", "--every is -1"),
        ("--record run.h5 --record-runs first", "--record-runs is 'first'; it must be numbers such as 3, 0,3,7 or 0-9"),
        ("--record run.h5 --record-runs 3-1", "--record-runs is '3-1', but the runs are numbered from 0 to 49"),
        ("--record run.h5 --record-runs 50", "--record-runs is '50', but the runs are numbered from 0 to 49"),
        ("--record-runs 2", "--record-runs belongs to --record"),
        ("--every 0.2", "--every belongs to --record"),
        ("--record-contacts", "--record-contacts belongs to --record"),
    ],
)
def test_a_mistake_is_said_before_anything_is_run(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(f"run {options}")
    assert result.exit_code == 2 and words in result.stderr and result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
