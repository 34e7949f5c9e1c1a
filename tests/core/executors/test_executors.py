"""What every executor has to do: hand over every outcome once, in this process, and leave nothing under way."""

import os

import pytest
from pieces_of_work import die, note, process, square, wait

from crowd_env.core.executors import Processes, Serial, WorkerDied

pytestmark = pytest.mark.more


@pytest.fixture(params=[Serial(), Processes(2)], ids=["serial", "processes"])
def executor(request):
    """Return one of this machine; tests/core/executors/test_cluster.py is about the other."""
    return request.param


def test_every_outcome_is_handed_over_with_the_number_of_its_piece(executor):
    found = []
    executor.run(square, [3, 1, 4, 1, 5], lambda *one: found.append(one))
    assert sorted(found) == [(0, 9), (1, 1), (2, 16), (3, 1), (4, 25)]
    executor.run(square, [], lambda *one: found.append(one))
    assert len(found) == 5


def test_work_apart_is_in_other_processes(executor):
    found = []
    executor.run(process, [1, 2], lambda _, pid: found.append(pid))
    assert all((pid != os.getpid()) == executor.apart for pid in found)


def test_what_a_piece_raises_arrives(executor):
    with pytest.raises(ValueError, match="-2 is negative"):
        executor.run(square, [1, -2], lambda *_: None)


def test_other_processes_leave_notes_to_this_one(capfd):
    Processes(1).run(note, ["the way is narrow"], lambda *_: None)
    assert capfd.readouterr().err == ""


def test_an_interruption_ends_what_is_under_way(tmp_path):
    found = []

    def interrupted(*one):
        found.append(one)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Processes(2).run(wait, ["", str(tmp_path)], interrupted)
    assert set(found) == {(0, "")}  # handing over was interrupted, so it was tried again


def test_a_process_that_dies_is_told():
    with pytest.raises(WorkerDied, match="a process that computed runs has died"):
        Processes(1).run(die, [1], lambda *_: None)
