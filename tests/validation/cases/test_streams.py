"""Cases of the validation map with two streams: lane order and crossing times, against constructed crowds."""

import numpy as np
import pytest

from validation.cases import Setting, counterflow, crossing

ONE = Setting("dem", "hurried", draws=1)


def places(count, lane):
    """Return ``count`` people one behind the other in the middle of a row."""
    return np.column_stack([np.linspace(6.0, 14.0, count), np.full(count, (lane + 0.5) * 0.5)])


def test_lanes_are_in_order_and_mixed_rows_are_not():
    position = np.concatenate([places(6, 0), places(6, 1)])
    lanes = np.arange(12) < 6
    assert counterflow.lane_order(position, lanes) == 1.0
    assert counterflow.lane_order(position, np.arange(12) % 2 == 0) == 0.0
    three_to_one = np.arange(12) % 4 > 0  # of each row half as many more one way: ((4.5 - 1.5) / 6)^2 on average
    assert counterflow.lane_order(position, three_to_one) == pytest.approx(((5 - 1) ** 2 + (4 - 2) ** 2) / 72)


def test_order_is_reduced_by_that_of_shuffled_directions():
    rng = np.random.default_rng(0)
    position = np.concatenate([places(8, lane) for lane in range(8)])
    order, above = counterflow.reduced_order(position, np.arange(64) < 32, rng)
    assert order == pytest.approx(1.0) and above
    found = [counterflow.reduced_order(position, rng.permutation(64) < 32, rng) for _ in range(60)]
    assert abs(np.mean([order for order, _ in found])) < 0.05  # random directions have none
    assert np.mean([above for _, above in found]) < 0.2


def test_streams_walk_towards_each_other_at_half_the_density():
    one, two = (counterflow.corridor(two_ways) for two_ways in (False, True))
    assert one.population.people == two.population.people == 200
    area = one.geometry.area_of("in west")
    assert 200 / area == pytest.approx(1.5) and two.geometry.area_of("in east") == pytest.approx(area)
    _, position = two.population.draw(np.random.default_rng(0), two.geometry)
    assert (position[:100, 0] < 0.0).all() and (position[100:, 0] > 20.0).all()


@pytest.mark.more
def test_crossing_counts_the_last_of_the_hundred(monkeypatch):
    monkeypatch.setattr(crossing, "AGAINST", (0, 50))
    (row,) = crossing.run(ONE)
    alone, against = row.more["last"]
    assert 20.0 / 1.9 < alone < against or row.more["deadlocks"] == [0, 1]
    assert row.passed == (row.more["deadlocks"] == [0, 0] and alone < against)
    place = crossing.rooms(0).geometry
    assert place.contains([(15.0, 0.99), (15.0, 1.01), (1.0, 4.9)]).tolist() == [True, False, True]
