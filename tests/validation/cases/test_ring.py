"""The single-file case of the validation map: its lane, how people are led along it, and how speeds are measured."""

import numpy as np
import pytest

from validation.cases import Setting, ring
from validation.cases.case import adults
from validation.cases.crowds import Moment, generator

ALONE = 1.0 / 27.0  # 1/m


def test_the_lane_is_27_m_long_and_too_narrow_to_overtake():
    place = ring.ring()
    width = 2.0 * float(place.clearance([(27.0 / (2.0 * np.pi), 0.0)])[0])
    assert width == pytest.approx(0.6, abs=0.01) and width < 4.0 * 0.15 + 1e-9
    assert place.area == pytest.approx(27.0 * 0.6, rel=0.01)


def test_turns_are_counted_with_their_sign_across_the_seam():
    angle = np.array([0.0, 1.0, np.pi - 0.05, -3.0])
    later = angle + np.array([0.1, -0.2, 0.1, 0.3])
    on = [3.0 * np.column_stack([np.cos(a), np.sin(a)]) for a in (angle, later)]
    np.testing.assert_allclose(ring.turned(*on), [0.1, -0.2, 0.1, 0.3])


def test_people_are_led_along_the_lane_and_back_to_its_middle():
    radius = 27.0 / (2.0 * np.pi)
    position = np.array([(radius, 0.0), (0.0, radius + 0.1), (0.0, radius - 0.1)])
    command = ring.onward(Moment(0.0, position, np.ones(3, dtype=bool)))
    np.testing.assert_allclose(np.hypot(*command.T), 1.0)
    np.testing.assert_allclose(command[0], (0.0, 1.0), atol=1e-12)
    assert command[1, 0] < -0.9 and command[1, 1] < -0.1 < 0.1 < command[2, 1]


@pytest.mark.more
def test_someone_alone_walks_at_the_own_desired_speed():
    setting = Setting("dem", "calm", draws=2)
    desired = np.mean([adults(1).draw_bodies(generator(setting, d)).desired_speed[0] for d in range(2)])
    assert ring.speeds(setting, (ALONE,))[ALONE] == pytest.approx(desired, rel=0.02)  # a bit outside of the middle


def test_the_row_counts_densities_within_the_band(monkeypatch):
    median = {density: band[1] for density, band in ring.BANDS.items()}
    monkeypatch.setattr(ring, "speeds", lambda setting: median)
    assert ring.run(Setting())[0].passed
    fast = {density: band[2] + 0.01 * (density > 1.0) for density, band in ring.BANDS.items()}
    monkeypatch.setattr(ring, "speeds", lambda setting: fast)
    row = ring.run(Setting())[0]
    assert not row.passed and row.figure.startswith("3 of 11 inside; outside: 0.99 m/s at 1.1 /m")
