"""Places of more than 100 m x 100 m get a coarser grid, unless it would hide a passage."""

import functools

import numpy as np
import pytest
from cases import looped
from navigation_plans import RADIUS
from shapely.geometry import Point, box

from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at, travel_time_at

SIDE = 180.0
EXIT = [[0, 88], [0, 92]]


def hall(obstacles=(), thin_walls=(), **kwargs):
    return travel_time_field(geometry(obstacles, thin_walls), RADIUS, min_radius=0.2, **kwargs)


def geometry(obstacles=(), thin_walls=()):
    area = box(0, 0, SIDE, SIDE)
    return Geometry.from_polygon(area, exits={"west": EXIT}, obstacles=list(obstacles), thin_walls=list(thin_walls))


@functools.cache
def open_hall():
    """Return a hall with a wall and a round column in the way, its field and the arrays of that."""
    place = geometry([Point(30, 91).buffer(2.0)], [[(100, 0), (100, 130)]])
    field = travel_time_field(place, RADIUS, min_radius=0.2)
    return place, field, join_fields([field], place.boundary)


def test_a_large_place_without_narrow_passages_needs_no_more_nodes_than_one_of_100_m():
    assert open_hall()[1].travel_time.size < 1.1e6


def test_straight_ways_in_a_large_place_are_exact():
    place, _, arrays = open_hall()
    jamb, (inside, beside) = np.array(EXIT[0]), np.random.default_rng(0).uniform((0.4, 0), (25, 1), (2, 200, 2))
    inside[:, 1], beside[:, 1] = 88 + RADIUS + (4 - 2 * RADIUS) * inside[:, 1], 60 + 26 * beside[:, 1]
    for point in (*inside, *beside):
        if point[1] > jamb[1]:
            exact, length = (-1.0, 0.0), point[0]
        else:  # past the jamb, around it into the exit
            to = jamb - point
            exact = tangent(to)
            turn = np.arccos(-exact[0])  # to the west
            length = np.sqrt(to @ to - RADIUS**2) + RADIUS * turn
        np.testing.assert_allclose(direction_at(arrays, place.boundary, 0, *point, RADIUS), exact, atol=0.003)
        assert travel_time_at(arrays, place.boundary, 0, *point, RADIUS) == pytest.approx(length, abs=0.03)


def tangent(to):
    """Return the unit vector of the line that leaves what lies at ``to`` a body radius to its left."""
    lean = np.arcsin(RADIUS / np.hypot(*to))
    return np.array([[np.cos(lean), np.sin(lean)], [-np.sin(lean), np.cos(lean)]]) @ to / np.hypot(*to)


def test_ways_around_a_wall_end_keep_a_body_radius_off_it_in_a_large_place():
    place, _, arrays = open_hall()
    end, goal = np.array([100.0, 130.0]), np.array([0.0, 92.0 - RADIUS])
    for point in np.random.default_rng(1).uniform((101, 20), (170, 110), (100, 2)):
        to, on = end - point, goal - end
        straight = [np.sqrt(way @ way - RADIUS**2) for way in (to, on)]
        # Both ways part from the circle on its far side: the angle between them is what the arc turns, and a bit less.
        turn = np.arccos(to @ on / np.hypot(*to) / np.hypot(*on)) + sum(
            np.arcsin(RADIUS / np.hypot(*w)) for w in (to, on)
        )
        way = travel_time_at(arrays, place.boundary, 0, *point, RADIUS)
        assert way == pytest.approx(sum(straight) + RADIUS * turn, rel=1e-3)
        ahead = direction_at(arrays, place.boundary, 0, *point, RADIUS)
        np.testing.assert_allclose(ahead, tangent(to), atol=0.01)


@looped(
    ("obstacles", "thin_walls", "start", "length"),
    [
        ([], [[(90, 0), (90, 89.5)], [(90, 90.3), (90, 170)]], (95, 90), 95),
        ([box(90, 0, 91, 89.5), box(90, 90.3, 91, 170)], [], (95, 90), 95),
        # A dead end in which nobody of the coarse grid would find room.
        ([box(100, 40, 170, 42), box(100, 42.9, 170, 45), box(168, 42, 170, 42.9)], [], (160, 42.45), 60 + 110.2),
        ([Point(90, 88.5).buffer(1.0), Point(90, 91.4).buffer(1.0)], [[(90, 0), (90, 87.5)], [(90, 92.4), (90, 170)]],
         (95, 89.95), 95),
    ],
    quick=1,
)  # fmt: skip
def test_passages_of_less_than_a_meter_are_found_in_a_large_place(obstacles, thin_walls, start, length):
    field = hall(obstacles, thin_walls)
    assert field.travel_time_near(np.array(start)) == pytest.approx(length, rel=0.01)


def test_a_small_region_is_led_to_in_a_large_place():
    place = Geometry.from_polygon(box(0, 0, SIDE, SIDE), exits=[EXIT], regions={"desk": box(90, 90, 90.15, 90.15)})
    field = travel_time_field(place, RADIUS, goal="desk")
    assert field.travel_time_near(np.array((30.0, 90.0))) == pytest.approx(60.0, rel=0.01)
