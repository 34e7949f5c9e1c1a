"""Pieces of work on a Ray cluster of this machine: the same outcomes, whoever dies meanwhile, and a clean stop."""

import os

import pytest
from pieces_of_work import die, die_at_first, process, square, wait
from repository import ROOT

from crowd_env.core.executors import RayCluster, Serial, WorkerDied
from crowd_env.core.files.store import Store
from crowd_env.envs.rollout import run_episodes
from crowd_env.reproduce.evacuations import evacuate
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.scenarios import make_scenario

ray = pytest.importorskip("ray", reason="Ray is not installed: an environment of its own has it, see docs/ray.md")
pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def nodes():
    """A cluster of a head, where nothing is done, and of two nodes of one core each."""
    from ray.cluster_utils import Cluster

    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setenv(
        "PYTHONPATH", str(ROOT / "tests"), prepend=os.pathsep
    )  # where the work is that nodes have to import
    memory = {"object_store_memory": 100_000_000}
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **memory})
    for _ in range(2):
        cluster.add_node(num_cpus=1, **memory)
    ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
    yield cluster
    ray.shutdown()
    cluster.shutdown()
    monkeypatch.undo()


@pytest.fixture
def executor(nodes):
    with_ray = RayCluster()
    yield with_ray
    with_ray.close()
    assert ray.is_initialized()  # it was before


def collected(executor, work, pieces):
    found = {}
    executor.run(work, pieces, lambda k, outcome: found.setdefault(k, outcome))
    return [found[k] for k in sorted(found)]


def test_pieces_are_done_on_all_nodes(executor):
    assert executor.workers == 2
    assert collected(executor, square, range(20)) == [k**2 for k in range(20)]
    assert os.getpid() not in collected(executor, process, [1, 2])


def test_what_a_piece_raises_arrives_as_it_is(executor):
    with pytest.raises(ValueError, match=r"^-2 is negative$"):
        collected(executor, square, [1, -2])


def test_a_piece_whose_process_dies_is_done_again(executor, tmp_path):
    pieces = ["", str(tmp_path / "one"), str(tmp_path / "two")]
    assert collected(executor, die_at_first, pieces) == ["", "one", "two"]


def test_a_piece_that_kills_every_process_is_given_up(executor):
    with pytest.raises(WorkerDied, match="4 times on one piece of work"):
        collected(executor, die, [1])


def test_an_interruption_ends_what_is_under_way(executor, tmp_path):
    def interrupted(k, outcome):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        executor.run(wait, ["", str(tmp_path)], interrupted)
    assert collected(executor, square, [1, 2]) == [1, 4]  # both cores are free again, or this would wait for ever


def test_a_node_with_other_code_is_named(executor, monkeypatch):
    monkeypatch.setattr("crowd_env.core.executors.cluster.np.__version__", "0.1")
    with pytest.raises(
        ValueError, match=r"node .* has other code .* instead of NumPy 0\.1; install the same everywhere"
    ):
        collected(executor, square, [1])


def test_more_cores_than_a_node_has_are_refused(nodes):
    with pytest.raises(ValueError, match="takes 3 cores; the largest node of the Ray cluster has 1"):
        RayCluster(3)


def test_runs_are_the_same_runs_when_a_node_is_killed_meanwhile(nodes, executor):
    place = make_scenario("room-v0", people=8)
    expected = run_episodes(place, 12, scheme="dem", seed=3)
    doomed, counts = nodes.add_node(num_cpus=1, object_store_memory=100_000_000), []

    def keep(episodes):
        if not counts:
            nodes.remove_node(doomed, allow_graceful=False)
        counts.append(len(episodes))

    wide = RayCluster()
    found = run_episodes(place, 12, scheme="dem", seed=3, executor=wide, keep=keep)
    assert repr(found) == repr(expected) and sum(counts) == 12 and len(counts) > 1


def test_kept_runs_are_the_same_runs(executor, tmp_path):
    cases = {speed: LinSettings(2).case(6, speed) for speed in (1.0, 2.0)}
    alone = evacuate(cases, Store(tmp_path / "alone"), Serial())
    assert repr(evacuate(cases, Store(tmp_path / "ray"), executor)) == repr(alone)
    names = [
        {path.relative_to(tmp_path / one) for path in (tmp_path / one).rglob("*.json")} for one in ("alone", "ray")
    ]
    assert names[0] == names[1] and len(names[0]) == 4
