"""Smoke: speeds and doses beside values by hand."""

import numpy as np
import pytest

from crowd_env.analysis.smoke import dose, speed_in_smoke


def test_people_are_slower_the_thicker_the_smoke_but_never_stand():
    # Frantzich, Nilsson 2003: 0.706 - 0.057 K, over 0.706.
    np.testing.assert_allclose(speed_in_smoke([0.0, 1.0, 5.0, 30.0]), [1.0, 0.649 / 0.706, 0.421 / 0.706, 0.1])


def test_doses_are_those_by_hand():
    """Per minute: 2.764e-5 (CO in ppm)^1.036 exp(0.1903 CO2 + 2.0004) / 7.1 + 1 / exp(8.13 - 0.54 (20.9 - O2)), in per cent."""
    # 1000 ppm: 1282 x 2.764e-5 = 0.03544, times 19.14 / 7.1 at 5 %, = 0.09556; 12 %: 1 / exp(3.324) = 0.03601
    assert dose([0.0, 60.0, 120.0], 0.001, 0.05, 0.12) == pytest.approx([0.0, 0.13157, 0.26314], rel=1e-3)
    # Clean air for a minute, then no CO and 10 % of oxygen: 1 / exp(2.244) = 0.106 a minute
    changing = dose([0.0, 60.0, 120.0], 0.0, 0.0, [0.209, 0.10, 0.10])
    assert changing == pytest.approx([0.0, 0.0003, 0.1063], abs=2e-4)
