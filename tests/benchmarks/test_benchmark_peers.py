"""Other programs in the benchmarks: left out with one line if absent, measured in small if they are there."""

import importlib
from dataclasses import replace

import pytest

from benchmarks import crowds, peers, scenes
from benchmarks.measuring import Effort, Sample

PACKAGES = {"cromosim", "jupedsim", "magent2", "mpe2", "pymunk", "vmas"}
TINY = Effort(seconds=0.001, blocks=1)


def small_jam():
    return scenes.jam(40)._replace(settle=0.02, horizon=0.02)


def test_no_peer_is_loaded_unless_asked_for():
    assert peers.rivals("room20", scenes.room20(), TINY) == []
    assert peers.batch_rivals(2, 20, TINY) == []


def test_an_absent_peer_is_one_line_that_says_how_to_get_it(monkeypatch, capsys):
    real = importlib.import_module

    def import_module(name):
        if name.partition(".")[0] in PACKAGES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name)

    monkeypatch.setattr(importlib, "import_module", import_module)
    for function in (peers.installed, peers.say):
        function.cache_clear()
    asked = replace(TINY, peers=True)
    for _ in range(2):
        assert peers.rivals("jam", small_jam(), asked) == []
        assert peers.rivals("big", small_jam(), asked) == []
        assert peers.batch_rivals(2, 20, asked) == []
    lines = capsys.readouterr().err.splitlines()
    assert sorted(line.split()[0] for line in lines) == sorted(PACKAGES)
    assert all("is not installed and is left out: pip install -e '.[train,bench]'" in line for line in lines)
    peers.installed.cache_clear()


class Other:
    name, peer, whole = "other", "other 1.0", 0.02

    def block(self, effort):
        return Sample(3.0, 3.0, 0.02, 80.0)


def test_ratios_to_a_peer_are_of_its_cost_and_ours():
    scene = small_jam()
    rows = crowds.measure(scene, TINY, [("dem", 0.01)], [Other()])
    (ratio,) = (row for row in rows if row.ratio is not None)
    assert ratio.peer == "other (other 1.0)"
    assert ratio.ratio == pytest.approx(3.0 / 0.02 / ratio.value, rel=0.02)


@pytest.mark.parametrize("case", sorted(peers.CROWDS))
def test_crowds_of_peers(case):
    for package, module, _ in peers.CROWDS[case]:
        pytest.importorskip(package)
        asked = replace(TINY, peers=True, peer_seconds=0.2)
        scene = (small_jam() if case == "jam" else scenes.room20())._replace(horizon=0.05)
        makers = importlib.import_module(f"benchmarks.peers.{module}").crowds(scene, asked)
        for _, make in makers:
            rival = make()
            sample = rival.block(asked)
            assert sample.cpu > 0 and sample.simulated > 0 and sample.steps > 0
            bodies, position = rival.now()
            assert len(bodies.radius) == len(position) == rival.inside
            assert rival.peer.startswith(package)


@pytest.mark.parametrize("package", peers.BATCHES)
def test_batches_of_peers(package):
    pytest.importorskip(package)
    found = peers.batch_rivals(2, 4, replace(TINY, peers=True))
    assert [one for one in found if one.peer.startswith(package)]
    assert all(one.block(TINY).rate > 0 for one in found)
