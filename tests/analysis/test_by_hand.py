"""The hand calculation: closed forms of a room, of rooms in a row and side by side, and what is told beside a result."""

import pytest
from shapely.geometry import box

from crowd_env import Cohorts, DoorEvent, Geometry, Population, Route, Scenario, Uniform
from crowd_env.analysis.by_hand import by_hand
from crowd_env.analysis.figures import doubts
from crowd_env.scenarios.buildings import Level, Stair, building, speed_on_stairs


def place(walkable, exits, people=60, **fields):
    return Scenario("place", Geometry.from_polygon(walkable, exits=exits), Population(people, **fields), 300.0)


def test_a_queue_at_one_door():
    found = by_hand(place(box(0, 0, 10, 8), {"door": [(10, 3.5), (10, 4.5)]}, response_time=Uniform(5.0, 20.0)))
    queue = 60 / (1.32 * (1.0 - 0.3))  # SFPE: 1.32 people a second and meter of effective width
    assert found["queue"] == pytest.approx(queue) and found["at"] == "the exits"
    first, last = found["walk"]
    assert 0.0 < first < 2.0 and 10.0 < 1.19 * last < 11.0  # the furthest start is in a corner
    typical, latest = found["response"]
    assert 10.0 < typical < 15.0 and 18.0 < latest < 20.0
    assert found["time"] == pytest.approx(typical + first + queue)
    assert found["words"].startswith(f"{found['time']:.0f} s: responses of {typical:.0f} to {latest:.0f} s, walks of ")


def test_a_passage_counts_where_people_have_to_pass_it():
    """A door of 0.8 m between two halves holds half of the people; two exits of 1 m hold all of them."""
    halves = [box(0, 0, 5, 8), box(5.2, 0, 10, 8), box(4.9, 4, 5.3, 4.8)]
    exits = {"a": [(10, 1), (10, 2)], "b": [(10, 6), (10, 7)]}
    found = by_hand(place(halves, exits))
    assert found["at"].startswith("(5.1") and found["effective_width"] == pytest.approx(0.5, abs=1e-6)
    assert found["queue"] == pytest.approx(30 / (1.32 * 0.5), rel=0.3)  # a draw of who is behind it
    beside = [
        box(0, 0, 5, 8),
        box(5.2, 0, 10, 8),
        box(4.9, 4, 5.3, 4.8),
        box(2, -2.2, 8, -0.2),
        box(2, -0.3, 3, 0.1),
        box(7, -0.3, 8, 0.1),
    ]
    two_ways = by_hand(place(beside, {"out": [(2, -2.2), (2, -0.2)]}))
    assert two_ways["at"] == "the exits"  # neither of the two doors alone holds anybody up


HALL = Geometry.from_polygon(
    box(0, 0, 20, 10), exits={"west": [(0, 3), (0, 7)], "east": [(20, 4), (20, 5.2)]}, doors={"d": "west"}
)
SHUT = {"closed_doors": ("d",)}
EAST = 1 / (1.32 * (1.2 - 0.3))  # s a person


@pytest.mark.parametrize(
    ("people", "fields", "strategy"),
    [
        (Population(100), SHUT, None),
        (Population(100, exits=("east",)), {}, None),
        (Population(100, route="east"), {}, None),
        (Population(100, route="r"), {"routes": (Route("r", ("east",)),)}, None),
        (Population(100), {}, "east"),
    ],
)
def test_only_exits_count_that_people_may_take(people, fields, strategy):
    found = by_hand(Scenario("hall", HALL, people, 300.0, **fields), strategy=strategy)
    assert found["queue"] == pytest.approx(100 * EAST) and found["at"] == "exit east"
    first, last = found["walk"]
    assert 15.0 < 1.19 * last < 23.0 and found["time"] == pytest.approx(first + found["queue"])


def test_a_door_that_opens_later_counts():
    place = Scenario("hall", HALL, Population(100), 300.0, **SHUT, door_events=(DoorEvent("d", True, at=5.0),))
    assert by_hand(place)["at"] == "the exits"


@pytest.mark.parametrize("thin", [False, True])
def test_an_exit_behind_a_wall_does_not_count(thin):
    floor = box(0, 0, 20, 10) if thin else [box(0, 0, 9, 10), box(10, 0, 20, 10)]
    walls = [[(9.5, 0), (9.5, 10)]] if thin else []
    exits = {"west": [(0, 3), (0, 7)], "east": [(20, 4), (20, 5.2)]}
    halls = Geometry.from_polygon(floor, exits=exits, thin_walls=walls, regions={"r": box(12, 2, 17, 8)})
    found = by_hand(Scenario("halls", halls, Population(60, start_region="r"), 300.0))
    assert found["queue"] == pytest.approx(60 * EAST) and found["at"] == "exit east"


def test_slow_people_walk_at_their_own_speed():
    walks = {
        speed: by_hand(Scenario("hall", HALL, Population(9, desired_speed=Uniform(speed, speed)), 300.0))["walk"][1]
        for speed in (0.5, 1.19, 1.6)
    }
    assert walks[0.5] == pytest.approx(walks[1.19] * 1.19 / 0.5) and walks[1.6] == walks[1.19]


def test_cohorts_respond_and_queue_each_at_its_exits():
    parts = Population(50, exits=("east",)), Population(50, exits=("west",), response_time=Uniform(30.0, 60.0))
    found = by_hand(Scenario("hall", HALL, Cohorts(parts), 300.0))
    assert found["response"][0] == 0.0 and "responses of 0 to " in found["words"]
    assert found["queue"] == pytest.approx(50 * EAST) and found["at"] == "exit east"
    assert found["time"] == pytest.approx(found["response"][1] + found["walk"][1], rel=0.02)
    both = (part.changed(exits=()) for part in parts)
    late = by_hand(Scenario("hall", HALL, Cohorts(tuple(both)), 300.0, **SHUT))
    assert 45.0 + 50 * EAST < late["time"] < 50.0 + 50 * EAST + 3.0 < 100 * EAST + 15.0  # the first are out by then


def test_people_without_an_open_exit_are_never_out():
    found = by_hand(Scenario("hall", HALL, Population(5, exits=("west",)), 300.0, **SHUT))
    assert found["time"] is None and found["words"].startswith("never: ")


def test_a_long_walk_counts_where_nobody_waits():
    found = by_hand(place(box(0, 0, 60, 2), {"end": [(60, 0), (60, 2)]}, people=2))
    assert found["time"] == pytest.approx(60 / 1.19, rel=0.02) == found["walk"][1]


def test_a_door_without_effective_width_has_no_time():
    found = by_hand(place(box(0, 0, 5, 5), {"slit": [(5, 2), (5, 2.3)]}, people=2, radius=Uniform(0.1, 0.1)))
    assert found["time"] is None is found["queue"]


@pytest.mark.parametrize(("mean", "doubtful"), [(50.0, True), (70.0, False), (None, False)])
def test_a_crowd_that_is_faster_by_a_third_is_doubted(mean, doubtful):
    figures = {
        "exits": {}, "unfinished": 0, "evacuation_time": {"mean": mean}, "by_hand": {"time": 90.0}, "manner": "calm",
    }  # fmt: skip
    assert ("by hand" in doubts(figures)) is doubtful
    assert "by hand" not in doubts(figures | {"manner": None})  # crowds that press are faster than people who walk


@pytest.mark.parametrize(("people", "seconds"), [(10, 23.55), (100, 150.6), (1000, 1421.0)])
def test_a_stair_takes_as_long_as_the_handbook_computes(people, seconds):
    """SFPE: 10 m along the slope of a stair of 1 m, risers of 180 mm and treads of 280 mm, as others have computed it."""
    rise, run = 5.4, 30 * 0.28
    levels = [
        Level("low", 0.0, box(-3, -9, 0, 10), exits={"out": [(-3, -4), (-3, 6)]}),
        Level("high", rise, box(run, 0, run + 30, 30)),
    ]
    stair = Stair("stair", "low", "high", (0.0, 1.0), 0.0, width=1.0, riser=0.18)
    found = by_hand(Scenario("hall", building(levels, [stair]), Population(people, start_region="high"), 3000.0))
    assert found["at"] == "'stair'" and found["effective_width"] == pytest.approx(0.7)
    assert found["queue"] / people == pytest.approx(1 / (1.012 * 0.7), rel=0.005)
    alone = 10.0 / (1.4 * (1 - 0.266 * 0.54) * speed_on_stairs(0.18, 0.28))  # the least density of the handbook
    assert alone == pytest.approx(10.84, rel=0.001)
    assert alone + found["queue"] * (people - 1) / people == pytest.approx(seconds, rel=0.005)


def test_stairs_between_the_same_levels_are_one_passage():
    levels = [
        Level("low", 0.0, box(-9, 0, 30, 10), exits={"out": [(-9, 0), (-9, 10)]}),
        Level("mid", 3.06, box(0, 0, 20, 10)),
        Level("high", 6.12, box(0, 0, 20, 10)),
    ]
    stairs = [
        Stair(f"{name} {lower}", lower, upper, (6.0, y), 0.0, turns="u-left", riser=0.17)
        for lower, upper in (("low", "mid"), ("mid", "high"))
        for name, y in (("a", 1.5), ("b", 6.5))
    ]
    parts = tuple(Population(n, start_region=level) for n, level in ((40, "low"), (60, "mid"), (50, "high")))
    found = by_hand(Scenario("tower", building(levels, stairs), Cohorts(parts), 900.0))
    assert found["at"] == "'a low' and 'b low'" and found["effective_width"] == pytest.approx(1.8)
    assert found["queue"] == pytest.approx(110 / (1.32 * 1.8 * speed_on_stairs(0.17, 0.28)))
