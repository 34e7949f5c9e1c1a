"""An evaluation does not depend on where, and in what order, its batches are simulated."""

import importlib.util
import pickle

import numpy as np
import pytest
from cases import looped
from evaluations import SMALL, call

from crowd_env.agents.evaluation import same_draws
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.evaluation.same_draws import compare


class Elsewhere:
    """Does the pieces in the opposite order, each with what a process far away gets of it: a copy."""

    workers, apart = 3, True

    def __init__(self):
        self.pieces = 0

    def run(self, work, pieces, done):
        for k in reversed(range(len(pieces))):
            self.pieces += 1
            done(k, pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(work))(pieces[k], bool))))


@pytest.fixture(autouse=True)
def three_at_once(monkeypatch):
    monkeypatch.setattr("crowd_env.envs.rollout._RUNS_AT_ONCE", 3)


def without_times(result):
    return {name: value for name, value in result.row().items() if "second" not in name}


@pytest.mark.more
def test_results_do_not_depend_on_who_simulates(tmp_path):
    names = ("shortest", "random", "rule-best-speed")  # the second draws numbers, the third looks for its best constant
    entries, executor = make_entries(names, SMALL), Elsewhere()
    here = compare(entries, SMALL, ["nsm2", "dem"], runs=7)
    folder = EvaluationFolder(tmp_path, settings_of(SMALL, 7, 0))
    there = compare(entries, SMALL, ["nsm2", "dem"], runs=7, executor=executor, folder=folder)
    assert executor.pieces == 6 + 6 * 3
    for one, other in zip(here, there, strict=True):
        assert (one.policy, one.scheme) == (other.policy, other.scheme)
        assert repr(without_times(one)) == repr(without_times(other))
        for ours, theirs in zip(one.measured.maps, other.measured.maps, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    kept = compare(entries, SMALL, ["nsm2", "dem"], runs=7, executor=executor, folder=folder)
    assert executor.pieces == 6 + 6 * 3 and [repr(one.row()) for one in kept] == [repr(one.row()) for one in there]


@looped(("threads", "worth", "apart"), [(2, 6, True), (2, 7, False), (1, 6, False)])
def test_many_runs_are_shared_out_to_processes(monkeypatch, threads, worth, apart):
    executor = Elsewhere()
    monkeypatch.setattr(same_draws, "Processes", lambda workers: executor)
    monkeypatch.setattr(same_draws, "_WORTH_PROCESSES", worth)
    entries = make_entries(("shortest", "west"), SMALL)
    compare(entries, SMALL, ["nsm2"], runs=3, threads=threads)
    assert (executor.pieces > 0) == apart


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="Ray is installed")
def test_without_ray_a_sentence_says_what_to_install(small):
    code, _, said = call("--scenario", "hall", "--policies", "shortest", "--runs", 1, "--ray")
    assert code == 2 and "a Ray cluster needs ray, which is not installed: pip install" in said
