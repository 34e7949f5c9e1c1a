"""The time limit that follows from a place, and the width of exits: both against figures by hand."""

import numpy as np
import pytest
from commands import call
from shapely.geometry import Point, box

from crowd_env import Geometry, Population, Scenario, Uniform, make_scenario

EAST = {"east": [(40, 0), (40, 2)]}


def test_the_longest_walk_is_that_of_the_slowest_who_starts_furthest():
    corridor = Geometry.from_polygon(box(0, 0, 40, 2), exits=EAST, regions={"middle": box(19, 0, 21, 2)})
    place = Scenario("corridor", corridor, Population(5, desired_speed=Uniform(0.5, 2.0)), 60.0)
    walk, start = place.longest_walk()
    assert walk == pytest.approx(40 / 0.5, rel=0.01) and start[0] < 0.5
    late = Population(5, desired_speed=1.0, response_time=(0, 30), start_region="middle")
    walk, start = Scenario("late", corridor, late, 60.0).longest_walk()
    assert walk == pytest.approx(21 + 30, rel=0.01) and 18.9 < start[0] < 19.3
    seats = Population(2, desired_speed=1.0, starts=[[30.0, 1.0], [10.0, 1.0]])
    walk, start = Scenario("seats", corridor, seats, 60.0).longest_walk()
    assert walk == pytest.approx(30, rel=0.01) and start.tolist() == [10.0, 1.0]


def test_the_time_limit_of_a_plan_lets_people_walk_out_and_queue(tmp_path):
    for name, area, people, least, most in (
        ("room", box(0, 0, 40, 2), 5, 300, 300),
        ("long", box(-560, 0, 40, 2), 5, 1.5 * 600 / 0.8, 1.5 * 600 / 0.8 + 200),  # 600 m at 0.8 m/s
        ("full", box(0, -20, 40, 20), 1000, 1000 / (0.5 * 2), 1200),  # 1000 people by an exit of 2 m
    ):
        (tmp_path / f"{name}.wkt").write_text(area.wkt)
        place = make_scenario(tmp_path / f"{name}.wkt", exits=["40,0,40,2"], people=people)
        assert least <= place.time_limit <= most, name
    assert make_scenario(tmp_path / "long.wkt", exits=["40,0,40,2"], time_limit=7.0).time_limit == 7.0


@pytest.mark.more
def test_a_limit_shorter_than_the_walk_is_said(tmp_path):
    (tmp_path / "long.wkt").write_text(box(-160, 0, 40, 2).wkt)
    result = call(f"run {tmp_path / 'long.wkt'} --exit 40,0,40,2 --people 2 --runs 1 --time-limit 20")
    assert "takes up to 250 s to walk out; the time limit is 20 s" in " ".join(result.stderr.split())


def test_a_zone_is_as_wide_as_its_longer_side():
    exits = {
        "zone": box(14, 3, 17, 5),
        "niche": box(0, 3, 1, 5),
        "hatch": Point(18, 6).buffer(0.5),
        "door": [(20, 1), (20, 3)],
    }
    place = Geometry.from_polygon(box(0, 0, 20, 8), exits=exits)
    assert place.exit_widths == pytest.approx({"zone": 3.0, "niche": 2.0, "hatch": 1.0, "door": 2.0}, abs=0.01)
    sides = {"zone": 10.0, "niche": 4.0, "hatch": np.pi, "door": 2.0}  # through which people come
    assert place.exit_lengths == pytest.approx(sides, abs=0.02)
    clear = {"zone": 3.34, "niche": 2.34, "hatch": 1.34, "door": 2.0}
    assert place.clear_widths(0.34) == pytest.approx(clear, abs=0.01)  # a zone has no jambs that keep bodies off
    assert np.isfinite(Scenario("zones", place, Population(3), 60.0).longest_walk()[0])
