"""Two commands that write to one place: the second is told, before anything is run."""

import errno
import fcntl
import subprocess
import sys

import pytest
from cases import looped
from commands import call
from typer.testing import CliRunner

from crowd_env.cli import run as running
from crowd_env.cli.agents import evaluate as evaluating
from crowd_env.cli.agents import learn as learning
from crowd_env.cli.main import app
from crowd_env.core.files.store import claimed

RUN = "run room-v0 --people 3 --runs 1 --scheme dem"
EVALUATE = "evaluate --scenario room-v0 --people 3 --policies shortest --runs 1"
# Takes a lock, says so, and waits until it is killed.
HOLDS = """
import sys, time
from pathlib import Path
from crowd_env.core.files.store import claimed
with claimed(Path(sys.argv[1])) as ours:
    print(ours, flush=True)
    time.sleep(600)
"""


@pytest.mark.more
def test_a_claim_falls_with_a_process_that_is_killed(tmp_path):
    lock = tmp_path / "out" / ".lock"
    with subprocess.Popen([sys.executable, "-c", HOLDS, str(lock)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "True\n"
        with claimed(lock) as ours:
            assert not ours
        other.kill()
    assert lock.exists()
    with claimed(lock) as ours:
        assert ours
    assert not lock.exists()


@looped("next_one", [True, False])
def test_a_lock_on_a_file_that_its_owner_has_removed_is_none(tmp_path, monkeypatch, next_one):
    """Its owner leaves, and perhaps another command comes, between our opening of the file and our locking of it."""
    lock, real = tmp_path / f"{next_one}.lock", fcntl.flock
    others = []

    def slow(file, operation):
        if not others:
            lock.unlink()
            others.append(lock.open("w") if next_one else None)
            if next_one:
                real(others[0], operation)
        real(file, operation)

    monkeypatch.setattr(fcntl, "flock", slow)
    with claimed(lock) as ours:
        assert ours is not next_one and lock.exists()
        if ours:  # who comes later sees it
            with claimed(lock) as too:
                assert not too


def test_a_claim_leaves_nothing_behind_but_what_was_written(tmp_path):
    with claimed(tmp_path / "a" / "b" / ".lock"):
        assert (tmp_path / "a" / "b" / ".lock").exists()
    assert not list(tmp_path.iterdir())
    with claimed(tmp_path / "a" / "b" / ".lock"):
        (tmp_path / "a" / "x").write_text("")
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["x"]


def test_a_lock_file_that_is_a_link_is_refused_and_what_it_points_to_is_left_alone(tmp_path):
    (tmp_path / "thesis").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".lock").symlink_to("../thesis")
    told = call(f"{RUN} --out {tmp_path / 'out'}")
    assert told.exit_code == 2 and "out/.lock" in told.stderr and told.stderr.count("\n") == 1
    assert (tmp_path / "thesis").read_text() == "mine"


def test_what_is_in_a_lock_file_stays(tmp_path):
    (tmp_path / ".lock").write_text("mine")
    with claimed(tmp_path / ".lock") as ours:
        assert ours and (tmp_path / ".lock").read_text() == "mine"


def test_the_second_command_is_told_and_runs_nothing(tmp_path, monkeypatch):
    path = tmp_path / "out"
    with monkeypatch.context() as patch, claimed(path / ".lock") as ours:
        assert ours
        before = sorted(tmp_path.rglob("*"))
        patch.setattr(running, "run_episodes", None)
        told = call(f"{RUN} --out {path}")
        assert (told.exit_code, told.stdout) == (2, "") and sorted(tmp_path.rglob("*")) == before
        said = f"error: {path}: another command is writing there; let it end, or name another folder\n"
        assert told.stderr == said
    assert call(f"{RUN} --out {path}").exit_code == 0
    assert path.exists() and not (path / ".lock").exists()


def test_a_command_that_ends_in_a_mistake_leaves_no_folder(tmp_path):
    assert call(f"{RUN} --people 100000 --out {tmp_path / 'out'}").exit_code == 2
    assert not list(tmp_path.iterdir())


def test_an_evaluation_has_its_folder_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluating, "compare", None)
    with claimed(tmp_path / ".lock") as ours:
        assert ours
        for line in (EVALUATE, "evaluate --task narrow-door --robustness --runs 1"):
            told = call(f"{line} --out {tmp_path}")
            assert told.exit_code == 2 and "another command is writing there" in told.stderr, line
    assert not list(tmp_path.iterdir())


@pytest.mark.more
def test_a_training_has_its_folder_alone(tmp_path):
    (tmp_path / "config.json").write_text("{}")
    with claimed(tmp_path / ".lock") as ours:
        assert ours
        told = call(f"train --resume {tmp_path} --minutes 1")
    assert told.exit_code == 2
    assert told.stderr == f"error: {tmp_path}: another command is writing there; let it end, or name another folder\n"
    assert (tmp_path / "config.json").read_text() == "{}"


@pytest.mark.more
def test_a_new_training_has_its_folder_alone(tmp_path, monkeypatch):
    def train(folder, config, threads):
        with claimed(folder / ".lock") as ours:
            raise ValueError(f"alone: {not ours}")

    monkeypatch.setitem(learning.BACKENDS, "native", train)
    told = call(f"train --task narrow-door --minutes 1 --out {tmp_path / 'run'}")
    assert told.stderr.endswith("error: alone: True\n") and not (tmp_path / "run" / ".lock").exists()


@looped(
    ("line", "name"),
    [
        (RUN, "summary.json"), (RUN, "nt.csv"), (RUN, "nt.png"), (RUN, "recordings"),
        (RUN, "crowding"), (RUN, "evaluation.json"),
        (EVALUATE, "rows.json"), (EVALUATE, "runs.csv"), (EVALUATE, "egress-nsm2.png"), (EVALUATE, "config.json"),
    ],
)  # fmt: skip
def test_what_was_written_by_something_else_is_not_written_over(line, name, tmp_path, monkeypatch):
    monkeypatch.setattr(running, "run_episodes", None)
    monkeypatch.setattr(evaluating, "compare", None)
    folder = tmp_path / f"{line.split()[0]} {name}"
    folder.mkdir()
    (folder / name).write_text("mine")
    told = CliRunner().invoke(app, [*line.split(), "--out", str(folder)])
    assert told.exit_code == 2 and told.stderr.count("\n") == 1 and told.stdout == ""
    assert f"holds {name}, which this command did not write; name another folder" in told.stderr
    assert [path.name for path in folder.iterdir()] == [name] and (folder / name).read_text() == "mine"


def test_where_there_are_no_locks_it_is_said_and_gone_on(tmp_path, monkeypatch):
    def no_locks(file, operation):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    told = call(f"{RUN} --out {tmp_path / 'out'}")
    assert told.exit_code == 0 and (tmp_path / "out" / "runs.csv").exists()
    expected = f"note: {tmp_path / 'out'} has no file locks: see to it that no other command writes there"
    assert told.stderr.splitlines()[0] == expected
