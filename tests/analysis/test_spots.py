"""Places are named with their storey and true coordinates where sheets lie side by side."""

import numpy as np
import pytest
from shapely.geometry import box
from storeys import with_stair

from crowd_env import Geometry, Scenario
from crowd_env.analysis.plan_check import cells, check_place, spot
from crowd_env.scenarios.buildings import Level, Stair, building

FLOOR = box(0, 0, 14, 6)


def wall(gap):
    return [f"MULTILINESTRING ((9 0, 9 {3 - 0.5 * gap}), (9 {3 + 0.5 * gap}, 9 6))"]


def test_the_same_place_of_two_storeys_has_two_names():
    house = with_stair()
    for name, offset in zip(("ground", "upper", "stair"), house.building.offsets, strict=True):
        assert spot(house, np.add(offset, (5.0, 1.0))) == f"{name} (5.00, 1.00)"
    room = Geometry.from_polygon(box(0, 0, 6, 4), exits={"out": [[0, 1], [0, 2]]})
    assert spot(room, np.array([[1.0, 2.0], [3.0, 2.0]])) == "(2.00, 2.00)"


def test_a_narrow_passage_upstairs_is_named_by_its_storey():
    levels = [
        Level("low", 0.0, FLOOR, thin_walls=wall(0.8), exits={"street": [[0, 0.5], [0, 5.5]]}),
        Level("high", 3.15, FLOOR, thin_walls=wall(0.7), exits={"bridge": [[0, 0.5], [0, 5.5]]}),
    ]
    place = Scenario(
        "house", building(levels, [Stair("stair", "low", "high", (3, 4.5), 0)], []), [{"people": 10}], 60.0
    )
    check = check_place(place)
    assert {name: spot(check.geometry, found.gap.line) for name, found in check.passages.items()} == {
        "street": "high (9.00, 3.00)",  # on the way of half of the people
        "bridge": "high (9.00, 3.00)",
    }
    rows = cells(check)["narrowest passage"]
    assert "to bridge: 0.70 m" in rows and "at high (9.00, 3.00)" in rows


@pytest.mark.more
def test_worst_places_of_a_report_are_on_a_storey_with_the_exits_of_that_storey():
    from crowd_env.rendering.report.maps import _largest

    house = with_stair()
    points = np.add(house.building.offsets, (5.0, 1.0))
    ground, upper, _ = _largest(house, points, np.array([3.0, 2.0, 1.0]))
    assert (ground.where, ground.exit) == ("ground (5.00, 1.00)", "door") and ground.distance == pytest.approx(
        5.59, abs=0.01
    )
    assert (upper.where, upper.exit, upper.distance) == ("upper (5.00, 1.00)", "", None)
