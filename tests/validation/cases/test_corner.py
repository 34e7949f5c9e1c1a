"""The corner case of the validation map: what counts as falling speed, the place, and one small run."""

import numpy as np
import pytest
from cases import looped

from validation.cases import Setting, corner

DENSITY = np.array([0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])


def test_speed_falls_only_if_it_does_so_nearly_everywhere_and_by_half():
    falling = 1.3 - 0.28 * DENSITY
    assert corner.falls(DENSITY, falling)
    assert corner.falls(DENSITY[::-1], falling[::-1])  # whatever the order of the runs
    assert not corner.falls(DENSITY, 1.3 - 0.1 * DENSITY)  # not by half
    assert not corner.falls(DENSITY, np.full(7, 1.0) + 1e-3 * DENSITY)
    assert not corner.falls(DENSITY, falling[[0, 4, 5, 3, 1, 2, 6]])  # up and down
    assert not corner.falls(DENSITY, np.where(DENSITY > 3.5, np.nan, falling))


def test_rank_correlation_is_spearmans():
    assert corner.rank_correlation(DENSITY, np.exp(-DENSITY)) == pytest.approx(-1.0)
    assert corner.rank_correlation(DENSITY, np.array([1, 2, 3, 4, 5, 7, 6.0])) == pytest.approx(1 - 6 * 2 / (7 * 48))


def test_the_corner_is_where_it_says():
    place = corner.corner(corner.RUNS[0]).geometry
    points = [(7.0, 1.0), (6.1, 2.3), (5.9, 2.5), (7.0, 5.0), (8.5, 1.0), (-0.1, 1.44), (-0.1, 1.46)]
    assert place.contains(points).tolist() == [True, True, False, True, False, True, False]


@pytest.mark.more
def test_a_run_is_measured():
    (found,) = corner.measure(Setting("dem", "calm", draws=1), (corner.Run(1.2, 2.4, 24),))
    assert 0.05 < found["density"] < 4.0 and 0.3 < found["speed"] < 1.9 and 0.3 < found["flow"] < 8.0


@pytest.mark.more
def test_a_queue_goes_around_the_corner_abreast():
    """Not in one file along the inner wall, which leaves most of the corner empty."""
    (found,) = corner.measure(Setting("dem", "hurried", draws=1), corner.RUNS[-1:])
    assert found["density"] > 2.0 and not found["stuck"]  # 1/m2; in one file 0.5


def test_a_turn_costs_little_if_it_does_so_at_every_width():
    straight = np.full(len(corner.WIDTHS), 25.0)
    assert corner.costs_little(1.1 * straight, straight)
    assert not corner.costs_little(np.where(straight == straight[0], 29.0, 25.0), straight)
    assert not corner.costs_little(np.linspace(25.0, 28.0, len(straight)), straight)  # a wider one is slower
    assert not corner.costs_little(straight * np.nan, straight)


@looped(
    "manner, degrees", [("hurried", 0.0), ("calm", 0.0), ("eager", 0.0), ("hurried", 25.0), ("calm", 45.0)], quick=1
)
def test_a_turn_costs_a_crowd_little(manner, degrees):
    """By the way that people take by default; when the outer ones cut across, 15 to 55 %.

    However it is drawn: widths that squares of nodes measured sent people of corridors off the axes in one file.
    """
    turned, straight = corner.times(Setting("dem", manner, draws=12), degrees)
    assert corner.costs_little(turned, straight), (turned / straight, turned)
