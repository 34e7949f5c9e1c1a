"""Ways for bodies of every size: nobody is led into a passage that does not fit, wherever else there is another way."""

import functools

import numpy as np
import pytest
from shapely.affinity import rotate
from shapely.geometry import box

from crowd_env import CrowdEnv, Geometry, Population, Scenario, Uniform
from crowd_env.analysis.plan_check import check_place
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at

LARGE = 0.232  # m, radius


@functools.cache
def hall(closet: float, slit: float = 0.454) -> Geometry:
    """Return a hall with a slit and a door of 1.5 m to the exit, and a closet behind a door of this width [m]."""
    doors = [box(10, 2.77, 10.2, 2.77 + slit), box(10, 4, 10.2, 5.5), box(2, 6, 2 + closet, 6.2)]
    rooms = [box(0, 0, 10, 6), box(10.2, 0, 14, 6), box(1, 6.2, 4, 8)]
    return Geometry.from_polygon([*rooms, *doors], exits={"out": [(14, 1), (14, 5)]})


@functools.cache
def field_arrays(geometry: Geometry, radius: float, least: float):
    """Return the arrays of the field of a place."""
    return join_fields([travel_time_field(geometry, radius, min_radius=least)], geometry.boundary)


def way(
    geometry: Geometry, start: tuple[float, float], radius: float, least: float, length: float = 30.0
) -> np.ndarray:
    """Return the places (K, 2) [m] of a point that follows the field, 1 cm apart."""
    arrays = field_arrays(geometry, radius, least)
    places = [np.array(start)]
    for _ in range(int(100 * length)):
        places.append(places[-1] + 0.01 * np.array(direction_at(arrays, geometry.boundary, 0, *places[-1], least)))
        if places[-1][0] > 13.9:
            break
    return np.array(places)


@pytest.mark.filterwarnings("ignore:the way out from")
def test_a_closet_for_slim_people_leads_nobody_else_into_a_slit():
    for closet in (0.6, 0.40):
        for start in ((8.0, 3.0), (1.5, 7.5)):
            places = way(hall(closet), start, LARGE, 0.15)
            inside = places[(places[:, 0] > 10) & (places[:, 0] < 10.2)]
            assert len(inside) and inside[:, 1].min() > 4, (closet, start)
            assert places[-1, 0] > 13.9


def test_where_only_slim_people_get_out_the_way_is_said_to_be_theirs():
    with pytest.warns(UserWarning, match=r"way out from \(.*too narrow for a body of radius 0.232 m.*larger people"):
        field = travel_time_field(hall(0.40), LARGE, min_radius=0.15)
    assert field.radius == LARGE
    closet, door = np.array([[2.5, 7.0]]), np.array([[8.0, 3.0]])
    assert np.isfinite(field.travel_time_for(closet, np.array([0.19]))).all()
    assert np.isinf(field.travel_time_for(closet, np.array([0.21]))).all()
    assert np.isfinite(field.travel_time_for(door, np.array([LARGE]))).all()


def test_people_choose_exits_that_they_fit_through():
    at, sizes = np.array([[2.0, 2.0], [2.0, 2.0]]), np.array([0.16, 0.25])
    for width in (0.40, 0.48):  # the second is so near to the larger body that nodes lie free right in front of it
        hatch = [(0, 2), (0, 2 + width)]
        geometry = Geometry.from_polygon(box(0, 0, 10, 4), exits={"hatch": hatch, "gate": [(10, 1), (10, 3)]})
        place = Scenario("hatch", geometry, Population(2, radius=Uniform(0.15, 0.25)), 60.0)
        routes = place.route_set("nearest")
        chosen = place.choose(routes, "nearest", at, sizes)
        assert [routes.routes[k].name for k in chosen] == ["hatch", "gate"], width


def test_a_zone_in_the_open_is_entered_by_bodies_wider_than_it():
    geometry = Geometry.from_polygon(box(0, 0, 10, 4), exits={"mat": box(5, 2, 5.3, 2.3), "gate": [(10, 1), (10, 3)]})
    field = travel_time_field(geometry, 0.25, exits=["mat"], min_radius=0.15)
    assert field.travel_time_for(np.array([[4.0, 2.15]]), 0.25) == pytest.approx(1.0, abs=0.1)


@pytest.mark.filterwarnings("ignore:the way out from")
def test_a_plan_names_who_cannot_get_out_and_where():
    wide = Scenario("wide", hall(0.6), Population(5), 60.0)
    assert not any("cannot get out" in remark for remark in check_place(wide).remarks)
    narrow = Scenario("narrow", hall(0.40), Population(5, radius=Uniform(0.15, LARGE)), 60.0)
    (said,) = [remark for remark in check_place(narrow).remarks if "cannot get out" in remark]
    x, y = (float(part) for part in said.split("(")[1].split(")")[0].split(", "))
    assert 1 < x < 4 and 6 < y < 8
    assert "is 0.42 m wide or more" in said  # the smallest of five sizes that does not fit through 0.40 m


@pytest.mark.more
def test_people_who_start_beside_a_slanted_exit_know_the_nearest():
    area = rotate(box(0, 0, 16, 10), 30, origin=(0, 0))
    turn = np.array([[np.cos(np.pi / 6), -np.sin(np.pi / 6)], [np.sin(np.pi / 6), np.cos(np.pi / 6)]])
    exits = {"w": np.array([[0, 4], [0, 6]]) @ turn.T, "e": np.array([[16, 4], [16, 6]]) @ turn.T}
    place = Scenario("turned", Geometry.from_polygon(area, exits=exits), Population(100), 20.0)
    env = CrowdEnv(place, routing="nearest")
    for seed in range(100):
        env.reset([seed])
