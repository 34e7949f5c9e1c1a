"""Groups of Moussaïd et al. 2010: speed, spacing and shape by size, and what the gaze is for."""

import numpy as np
import pytest

from crowd_env.reproduce.moussaid2010 import groups
from crowd_env.reproduce.moussaid2010.groups import MoussaidSettings, lag, walk

pytestmark = pytest.mark.more


def test_the_more_walk_together_the_slower_they_are_in_a_v_and_a_u():
    settings = MoussaidSettings(runs=12, scheme="dem")
    result = groups.reproduce(settings)
    rows = {row.quantity: row for row in result.rows}
    speeds = [rows[f"speed, {n} together"].here for n in groups.SIZES]
    assert speeds[0] > speeds[2] > speeds[4] and rows["speed by size"].here < -0.03
    assert rows["speed, 3 together"].paper == "1.14"  # 1.26 - 0.04 * 3
    assert 0.8 < rows["spacing, 2 together"].here < 1.0 < rows["spacing, 5 together"].here < 1.5
    for n in (3, 4):
        assert rows[f"lag of the middle, {n} together"].here > 0.1
    assert len(list(result.raw["places"].rows)) == 12 * 15
    figure = result.draw()
    assert len(figure.axes) == 6


def test_without_the_gaze_groups_are_wider_and_faster():
    seeing, blind = (walk(3, MoussaidSettings(runs=12, scheme="dem", gaze=gaze)) for gaze in (4.0, 0.0))
    assert blind.spacing.mean() > seeing.spacing.mean() + 0.3
    assert blind.speed.mean() > seeing.speed.mean() + 0.1


def test_the_lag_is_that_of_the_middle_behind_the_ends():
    shape = np.array([[[1.0, -1.0], [0.25, 0.0], [0.0, 1.0]]])
    assert lag(shape).tolist() == [0.25]
