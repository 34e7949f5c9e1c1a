"""The figures of the map are written for rows with and without recordings, of runs that got stuck too."""

import numpy as np
import pytest
from cases import looped

from validation.cases import corridor, panels, ring
from validation.cases.case import Setting, row
from validation.cases.panels import COLORS

SETTINGS = [Setting(scheme, manner) for scheme in ("dem", "hertz-literal") for manner in ("hurried", "calm")]


def is_picture(path):
    return path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.more
@looped("recorded", [None, np.arange(1.0, 76.0)])
def test_the_gate_has_counts_and_gaps(tmp_path, recorded):
    passages = [np.arange(75.0), np.append(np.arange(5.0), np.full(70, np.nan)), np.full(75, np.nan)]
    rows = [
        row("gate", one, True, "1 /s; x", "c", "s", passages=passages, recorded=recorded, position=np.zeros((75, 2)))
        for one in SETTINGS
    ]
    panels.gate(tmp_path, rows)
    assert is_picture(tmp_path / "gate.png") and is_picture(tmp_path / "gate-gaps.png")


def test_the_share_of_longer_gaps_falls_from_one_to_none():
    gap, share = panels.longer(np.array([2.0, 1.0, 4.0, 3.0]))
    np.testing.assert_allclose(gap, [0, 1, 2, 3, 4])
    np.testing.assert_allclose(share, [1, 0.75, 0.5, 0.25, 0])


@pytest.mark.more
def test_the_ring_has_speeds_beside_the_band(tmp_path):
    speed = {density: (np.nan if density > 2.0 else 0.5) for density in ring.BANDS}
    panels.ring(tmp_path, [row("ring", one, True, "", "c", "s", speed=speed, band=ring.BANDS) for one in SETTINGS])
    assert is_picture(tmp_path / "ring.png")


@pytest.mark.more
@looped("diagram", [None, {0.5: 1.3, 1.5: 1.0}])
def test_the_corridor_has_a_fundamental_diagram(tmp_path, diagram):
    runs = [{"density": 0.5, "speed": 1.2}, {"density": np.nan, "speed": np.nan}]
    more = {"runs": runs, "diagram": {0.5: 1.2}, "recorded_diagram": diagram}
    more |= {"recorded": [one._asdict() for one in corridor.RUNS]}
    panels.corridor(tmp_path, [row("corridor", one, True, "", "c", "s", **more) for one in SETTINGS])
    assert is_picture(tmp_path / "corridor.png")


def test_every_scheme_has_a_color_of_its_own():
    assert len(set(COLORS.values())) == len(COLORS)
