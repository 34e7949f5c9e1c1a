"""Cohorts of people."""

import hashlib

import numpy as np
import pytest
from cases import looped
from crowds import HALL, clear
from evacuations import evacuated

from crowd_env import FULL_SPEED, TABLE_4, Cohorts, Geometry, LogNormal, Normal, Population, Scenario, Uniform
from crowd_env.geometry.geometry import box
from crowd_env.routing.spec import Route
from crowd_env.routing.speed_map import Comfort, SpeedZone


def test_a_plain_population_draws_what_it_always_drew():
    # The hash was made before there were cohorts.
    digest = hashlib.sha256()
    crowds = [
        Population(20, **TABLE_4),
        Population(200, **TABLE_4),
        Population(300, **TABLE_4),
        Population(
            30,
            radius=Normal(0.22, 0.02, 0.15, 0.3),
            desired_speed=Normal(1.34, 0.26, 0.8, 2.2),
            response_time=Uniform(0, 5),
            start_region="stage",
        ),
        Population(45, start_region="stage", **TABLE_4),
        Population(2, starts=np.array([[1.0, 1.0], [4.0, 3.0]]), **TABLE_4),
        Population(60, **{**TABLE_4, "radius": Uniform(0.05, 0.5)}),
    ]
    for seed, crowd in enumerate(crowds):
        bodies, position = crowd.draw(np.random.default_rng(seed), HALL)
        for array in (*bodies[:6], bodies.env_start, position):  # there was no motivation then
            digest.update(np.ascontiguousarray(array).tobytes())
    assert digest.hexdigest() == "9ce1c9b9a82414ce1f29b6a0cd50da1170383ed7a4a7de5502e3c2eee98b61bb"


def test_a_cohort_of_one_draws_as_the_population_itself():
    people = Population(25, start_region="stage", **TABLE_4)
    one, other = (crowd.draw(np.random.default_rng(3), HALL) for crowd in (people, Cohorts((people,))))
    np.testing.assert_array_equal(one[1], other[1])
    np.testing.assert_array_equal(one[0].mass, other[0].mass)


@looped("seed", range(4))
def test_cohorts_stand_apart_in_their_places(seed):
    cohorts = Cohorts(
        (
            Population(50, **TABLE_4),
            Population(40, start_region="stage", **{**TABLE_4, "radius": Uniform(0.15, 0.2)}),
            Population(3, starts=np.array([[9.0, 6.0], [1.0, 1.0], [9.6, 6.0]]), **TABLE_4),
            Population(50, **{**TABLE_4, "desired_speed": Uniform(0.5, 0.6)}),
        )
    )
    bodies, position = cohorts.draw(np.random.default_rng(seed), HALL)
    assert len(position) == cohorts.people == 143 == bodies.env_start[-1]
    assert clear(HALL, position, bodies.radius) >= -1e-9
    assert HALL.contains(position[50:90], "stage").all() and (bodies.radius[50:90] <= 0.2).all()
    np.testing.assert_array_equal(position[90:93], cohorts.parts[2].starts)
    assert (bodies.desired_speed[93:] <= 0.6).all() and (bodies.desired_speed[:93] >= 1.2).all()
    # The two that start anywhere are mixed.
    assert abs(position[:50, 0].mean() - position[93:, 0].mean()) < 2.5


def test_cohorts_that_share_a_full_place_are_packed_together():
    # Each alone would jam what is left for the other.
    cohorts = Cohorts(tuple(Population(20, start_region="stage", radius=Uniform(0.25, 0.25)) for _ in range(2)))
    bodies, position = cohorts.draw(np.random.default_rng(0), HALL)
    assert clear(HALL, position, bodies.radius) >= -1e-9


def test_bounds_of_cohorts_hold_all_of_them():
    cohorts = Cohorts(
        (Population(3, mass=Uniform(50, 60), **TABLE_4), Population(3, response_time=LogNormal(5, 1, 60), **TABLE_4))
    )
    assert cohorts.mass == (50, 100) and cohorts.response_time == (0, 60) and cohorts.radius == (0.2, 0.25)


def test_another_number_is_shared_out_in_proportion():
    cohorts = Cohorts((Population(100, **TABLE_4), Population(10, **TABLE_4), Population(1, **TABLE_4)))
    for count in (3, 4, 50, 110, 111, 112, 1000):
        assert sum(part.people for part in cohorts.changed(people=count).parts) == count
    assert [part.people for part in cohorts.changed(people=111).parts] == [100, 10, 1]
    assert [part.people for part in cohorts.changed(people=222).parts] == [200, 20, 2]
    assert [part.people for part in cohorts.changed(people=3).parts] == [1, 1, 1]
    assert cohorts.changed(radius=Uniform(0.1, 0.1)).radius == (0.1, 0.1)
    with pytest.raises(ValueError, match="cohorts cannot share 'starts'"):
        cohorts.changed(starts=np.zeros((2, 2)))


def test_more_seats_than_people():
    seats = np.array([[x, y] for x in (1.0, 3.0) for y in (1.0, 2.0, 6.0)])
    taken = {
        tuple(p)
        for seed in range(30)
        for p in Population(2, starts=seats, **TABLE_4).draw(np.random.default_rng(seed), HALL)[1]
    }
    assert taken == {tuple(p) for p in seats}


def test_starts_of_two_cohorts_may_not_overlap():
    cohorts = Cohorts(tuple(Population(1, starts=np.array([[1.0, y]]), **TABLE_4) for y in (1.0, 1.2)))
    with pytest.raises(ValueError, match="starts 0 and 1 overlap"):
        cohorts.draw(np.random.default_rng(0), HALL)


def hall(*parts, **options):
    exits = {"west": [(0, 1), (0, 3)], "east": [(10, 1), (10, 3)], "north": [(4, 4), (6, 4)]}
    geometry = Geometry.from_polygon(
        box(0, 0, 10, 4), exits=exits, regions={"left": box(0, 0, 3, 4), "middle": box(3, 0, 7, 3)}
    )
    return Scenario("hall", geometry, Cohorts(parts) if len(parts) > 1 else parts[0], 60.0, **{**FULL_SPEED, **options})


@looped(
    ("strategy", "expected"),
    [
        ("shortest", [["east"], ["loop"], ["east or north"], ["out"]]),
        ("fastest", [["east"], ["loop"], ["fastest to east or north"], ["fastest"]]),
        ("comfortable", [["east"], ["loop"], ["comfortable to east or north"], ["comfortable"]]),
        ("nearest", [["east"], ["loop"], ["north"], ["west"]]),
        ("west", [["east"], ["loop"], ["east or north"], ["west"]]),
        ("loop", [["east"], ["loop"], ["east or north"], ["loop"]]),
    ],
    quick=3,
)
def test_every_cohort_means_to_take_its_own_way(strategy, expected):
    place = hall(
        Population(3, route="east", start_region="left", **TABLE_4),
        Population(4, route="loop", start_region="left", **TABLE_4),
        Population(5, exits=("east", "north"), start_region="left", **TABLE_4),
        Population(2, start_region="left", **TABLE_4),
        routes=(Route("loop", ("west", "east"), via="left"),),
    )
    route_set = place.route_set(strategy)
    _, position = place.population.draw(np.random.default_rng(0), place.geometry)
    position[-2:, 0] = 0.3
    chosen = place.choose(route_set, strategy, position)
    names = [route_set.routes[k].name for k in chosen]
    assert [sorted(set(names[a:b])) for a, b in ((0, 3), (3, 7), (7, 12), (12, 14))] == expected


def test_cohorts_leave_by_their_own_exits():
    route_set = ({"route": "east"}, {"exits": ("north",)}, {"route": "west"})
    place = hall(*(Population(8, start_region="middle", **{**TABLE_4, **way}) for way in route_set))
    env = evacuated(place)
    left_by = np.array(place.geometry.exit_names)[env.simulation.state.exit_index]
    assert left_by.tolist() == ["east"] * 8 + ["north"] * 8 + ["west"] * 8


def test_what_comfort_costs_reaches_the_way():
    times = []
    for comfort in (Comfort(stairs=0.0), Comfort(stairs=20.0)):
        place = hall(Population(2, **TABLE_4), zones=(SpeedZone("left", factor=0.5),), comfort=comfort)
        route_set = place.route_set("comfortable")
        times.append(route_set.routes[route_set.number("comfortable")].field.travel_time)
    assert np.nanmax(times[1]) > np.nanmax(times[0]) + 1.0


def test_a_plain_population_may_have_a_way_too():
    place = hall(Population(5, route="north", **TABLE_4))
    route_set = place.route_set()
    assert place.choose(route_set, "shortest", np.ones((7, 2))).tolist() == [route_set.number("north")] * 7


def test_cohorts_choose_for_as_many_as_they_are():
    with pytest.raises(ValueError, match="3 positions for cohorts of 4"):
        hall(Population(2, **TABLE_4), Population(2, **TABLE_4)).choose(None, "shortest", np.zeros((3, 2)))
