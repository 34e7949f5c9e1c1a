"""Ctrl-C and SIGTERM: what is finished is reported, and nothing else is claimed."""

import csv
import json
import os
import signal
import sys
import warnings
from contextlib import contextmanager

import pytest
import typer
from commands import call

from crowd_env.analysis.results.tally import Tally
from crowd_env.cli import evacuations
from crowd_env.cli import reproduce as command
from crowd_env.core.checks import counted
from crowd_env.core.console import friendly_errors


def ctrl_c():
    raise KeyboardInterrupt


def sigterm():
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.fixture
def stop_after(monkeypatch):
    """Make every command meet ``stop`` when so many runs are finished."""

    def prepare(count, stop=ctrl_c):
        done, take = 0, Tally.take

        def told(more):
            nonlocal done
            done += more
            if done >= count:
                stop()

        @contextmanager
        def bar(title, total):
            yield told

        monkeypatch.setattr(command, "progress_bar", bar)
        monkeypatch.setattr(Tally, "take", lambda tally, episode: take(tally, episode) or told(1))

    return prepare


@pytest.mark.parametrize("stop", [ctrl_c, sigterm])
def test_run_reports_what_is_finished(stop_after, stop):
    stop_after(3, stop)
    before = signal.getsignal(signal.SIGTERM)
    result = call("run --scheme dem --n 4 --runs 8 --seed 2 --json")
    assert result.exit_code == 130, result.output
    told = json.loads(result.stdout)
    assert 3 <= told["runs"] < 8 and told["interrupted_of"] == 8
    assert (
        result.stderr.startswith(f"interrupted: {told['runs']} of 8 runs are finished")
        and result.stderr.count("\n") == 1
    )
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("line", ["run --scheme dem --n 4 --runs 2", "clogging room-v0 --scheme dem --n 4 --runs 2"])
def test_without_a_finished_run_there_are_no_figures(line, monkeypatch):
    monkeypatch.setattr("crowd_env.envs.crowd.CrowdEnv.step", lambda *_: ctrl_c())
    for options in ("", " --json"):
        result = call(line + options)
        assert result.exit_code == 130 and result.stdout == ""
        assert result.stderr == "interrupted: 0 of 2 runs were finished\n"


def test_an_interrupted_run_draws_no_picture(stop_after, tmp_path):
    stop_after(1)
    result = call(f"run --scheme dem --n 4 --runs 8 --film {tmp_path / 'a.gif'}")
    assert result.exit_code == 130 and "evacuation time" in result.stdout
    assert not list(tmp_path.iterdir())


def test_clogging_reports_what_is_finished(stop_after, tmp_path):
    stop_after(3)
    result = call(f"clogging room-v0 --scheme dem --n 4 --runs 8 --seed 5 --json --out {tmp_path}")
    assert result.exit_code == 130, result.output
    (only,) = json.loads(result.stdout)["sets"]
    assert 3 <= only["runs"] < 8 and f"interrupted: {only['runs']} of 8 runs are finished" in result.stderr
    with (tmp_path / "exits.csv").open() as file:
        assert len({row["run"] for row in csv.DictReader(file)}) == only["runs"]


def test_reproduce_keeps_its_runs_and_the_figures_before(stop_after, tmp_path):
    stop_after(8)
    result = call(f"reproduce pecol --runs 2 --set people=5 --workers 1 --out {tmp_path}")
    assert result.exit_code == 130 and "Traceback" not in result.output
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith("interrupted: ") and "runs are kept in" in last and "whole: table3" in last
    assert (tmp_path / "table3.csv").exists() and not (tmp_path / "runs" / ".lock").exists()


# ------------------------------------------------------------------------------------------- what else can go wrong


def test_a_film_that_cannot_be_written_loses_no_figures(monkeypatch, tmp_path):
    def full(path, *_, **__):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("crowd_env.rendering.write_film", full)
    result = call(f"run --scheme dem --n 3 --runs 2 --film {tmp_path / 'a.gif'} --json")
    assert result.exit_code == 2 and json.loads(result.stdout)["runs"] == 2
    assert result.stderr == f"error: {tmp_path / 'a.gif'}: No space left on device\n"


def test_a_missing_library_of_films_is_said_before_the_work(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setattr(evacuations, "run_episodes", None)
    result = call(f"run --film {tmp_path / 'a.gif'}")
    assert result.exit_code == 2 and result.stdout == "" and result.stderr.count("\n") == 1
    assert "needs PIL" in result.stderr and "pip install pygame matplotlib pillow imageio-ffmpeg" in result.stderr


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError("Unable to allocate 74.6 GiB"), "error: not enough memory: Unable to allocate 74.6 GiB"),
        (OverflowError("int too large to convert"), "error: a number is too large: int too large to convert"),
        (NotImplementedError("curves"), "error: curves"),
        (PermissionError(13, "Permission denied", "a.png"), "error: a.png: Permission denied"),
        (ValueError("two\nlines"), "error: two lines"),
    ],
)
def test_errors_are_one_sentence(error, said, capsys):
    with pytest.raises(typer.Exit) as left, friendly_errors():
        raise error
    assert left.value.exit_code == 2 and capsys.readouterr().err.rstrip("\n") == said


def test_warnings_are_notes_without_lines_of_code(capsys):
    with friendly_errors():
        for _ in range(2):
            warnings.warn("the way is narrow", stacklevel=1)
    assert capsys.readouterr().err == "note: the way is narrow\n"


def test_one_is_one(capsys):
    assert (counted(1, "run", "runs"), counted(0, "run", "runs")) == ("1 run", "0 runs")
    assert "room-v0: 1 person, dem, 1 run" in call("run --scheme dem --n 1 --runs 1").stdout
