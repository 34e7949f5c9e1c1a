"""Ctrl-C and SIGTERM: what is finished is reported, and nothing else is claimed."""

import json
import os
import signal
import warnings
from contextlib import contextmanager

import pytest
import typer
from cases import looped
from commands import call

from crowd_env.cli import reproduce as command
from crowd_env.cli import run as running
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
        done = 0

        def told(more):
            nonlocal done
            done += more
            if done >= count:
                stop()

        @contextmanager
        def bar(title, total):
            yield told

        for module in (command, running):
            monkeypatch.setattr(module, "progress_bar", bar)

    return prepare


@pytest.mark.parametrize("stop", [ctrl_c, sigterm])
def test_run_reports_what_is_finished(stop_after, stop):
    stop_after(3, stop)
    before = signal.getsignal(signal.SIGTERM)
    result = call("run --scheme dem --people 4 --runs 8 --seed 2 --json")
    assert result.exit_code == 130, result.output
    told = json.loads(result.stdout)
    assert 3 <= told["runs"] < 8 and told["interrupted_of"] == 8
    assert (
        result.stderr.startswith(f"interrupted: {told['runs']} of 8 runs are finished")
        and result.stderr.count("\n") == 1
    )
    assert signal.getsignal(signal.SIGTERM) is before


def test_without_a_finished_run_there_are_no_figures(monkeypatch):
    monkeypatch.setattr("crowd_env.envs.crowd.CrowdEnv.step", lambda *_: ctrl_c())
    for options in ("", " --json"):
        result = call("run --scheme dem --people 4 --runs 2" + options)
        assert result.exit_code == 130 and result.stdout == ""
        assert result.stderr == "interrupted: 0 of 2 runs were finished\n"


@pytest.mark.more
def test_reproduce_keeps_its_runs_and_the_figures_before(stop_after, tmp_path):
    stop_after(8)
    result = call(f"reproduce pecol --runs 2 --set people=5 --workers 1 --out {tmp_path}")
    assert result.exit_code == 130 and "Traceback" not in result.output
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith("interrupted: ") and "runs are kept in" in last and "whole: table3" in last
    assert (tmp_path / "table3.csv").exists() and not (tmp_path / "runs" / ".lock").exists()


# ------------------------------------------------------------------------------------------- what else can go wrong


@looped(
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
    assert "room-v0: 1 person, dem, 1 run" in call("run --scheme dem --people 1 --runs 1").stdout
