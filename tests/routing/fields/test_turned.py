"""The way out does not depend on how a place lies to the axes of the grid, and is the one that a taut string takes."""

import functools
from dataclasses import replace

import numpy as np
import pytest
import shapely
from cases import looped
from evacuations import evacuated
from navigation_plans import RADIUS, ROOM, exit_targets, shortest_ways
from shapely.affinity import rotate
from shapely.geometry import Point, Polygon, box

from crowd_env import make_scenario
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at, travel_time_at
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import Route

PLACES = {  # area, exit, obstacles
    "a door of 1 m": (ROOM, [(5, 2), (5, 3)], []),
    "a door at a corner": (ROOM, [(5, 4), (5, 5)], []),
    "a corridor around a corner": (Polygon([(0, 0), (6, 0), (6, 6), (4, 6), (4, 2), (0, 2)]), [(4, 6), (6, 6)], []),
    "a column before the door": (ROOM, [(5, 2), (5, 3)], [Point(3.5, 2.4).buffer(0.3)]),
    "walls in the way": (box(0, 0, 8, 5), [(8, 2), (8, 3)], [box(2.5, 0, 2.7, 3.5), box(5, 1.4, 5.2, 5)]),
}


def turned(points, degrees):
    turn = np.radians(degrees)
    return np.asarray(points) @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]


@functools.cache
def place(name, degrees=0):
    area, door, obstacles = PLACES[name]
    area, *obstacles = (rotate(shape, degrees, origin=(0, 0)) for shape in (area, *obstacles))
    return Geometry.from_polygon(area, exits=[turned(door, degrees)], obstacles=obstacles)


def floor(name, clearance):
    """Return places all over the floor, this far from the walls or further."""
    area = PLACES[name][0]
    points = np.random.default_rng(1).uniform(area.bounds[:2], area.bounds[2:], (300, 2))
    points = points[shapely.contains_xy(area, *points.T)]
    return points[place(name).contains(points) & (place(name).clearance(points) > clearance)]


def ways(name, points, radius, degrees=0):
    """Return the directions at ``points``, turned back, and the lengths of the ways."""
    geometry = place(name, degrees)
    arrays = join_fields([travel_time_field(geometry, radius)], geometry.boundary)
    there = turned(points, degrees)
    ahead = [direction_at(arrays, geometry.boundary, 0, x, y, radius) for x, y in there]
    length = [travel_time_at(arrays, geometry.boundary, 0, x, y, radius) for x, y in there]
    return turned(ahead, -degrees), np.array(length)


def between(one, other):
    """Return the angles [degrees] between unit vectors."""
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0)))


@looped("degrees", [30, 15, 45], quick=1)
@pytest.mark.parametrize("radius", [0.2, RADIUS])
@pytest.mark.parametrize("name", PLACES)
def test_ways_in_a_turned_place_are_those_of_the_place(name, radius, degrees):
    points = floor(name, 0.02)
    ahead, length = ways(name, points, radius)
    ahead_there, length_there = ways(name, points, radius, degrees)
    assert between(ahead, ahead_there).mean() < 0.5
    clear = place(name).clearance(points) > radius + 0.05
    np.testing.assert_allclose(length_there[clear], length[clear], rtol=0.01)


@pytest.mark.parametrize("name", PLACES)
def test_ways_are_those_of_string_pulling(name):
    geometry, points = place(name), floor(name, RADIUS + 1e-3)
    points = points[
        np.hypot(*(points - np.mean(PLACES[name][1], axis=0)).T) > 1.0
    ]  # nearer by, the aim moves through the door
    lines = list(geometry.walls)
    exact, bend = shortest_ways(geometry, points, exit_targets(geometry), lines=lines, quad_segs=48)
    toward = (bend - points) / np.hypot(*(bend - points).T)[:, None]
    ahead, length = ways(name, points, RADIUS)
    np.testing.assert_allclose(length, exact, rtol=0.01)
    assert between(ahead, toward).mean() < 0.5


@looped("degrees", [45, 137, 20, 250], quick=1)
def test_nobody_stays_at_the_end_of_a_seat_row_however_it_lies(degrees):
    place = make_scenario("theatre-v0", stair_speed=0.5).turned(np.radians(degrees))
    place = replace(place, time_limit=100.0, blocked_after=20.0)
    env = evacuated(place, physics="nsm2", walking="competitive", routing="fastest")
    assert env.metrics(0).unfinished == 0


@looped("degrees", [20, 0, 45, 137], quick=1)
def test_in_an_empty_theatre_the_fastest_way_along_the_rows_is_the_shortest(degrees):
    routes = make_scenario("theatre-v0").turned(np.radians(degrees)).route_set("fastest").routes
    congestion = next(route.congestion for route in routes if route.congestion)
    rows = congestion._narrow & congestion._free
    same = (congestion.march().direction == congestion._shortest).all(axis=-1)[rows]
    assert same.mean() > 0.985  # 0.964 to 0.975 by the slope from node to node alone


@looped("degrees", [0, 20, 45, 137])
def test_tight_are_passages_between_walls_and_no_corners_or_exits(degrees):
    def is_tight(width, niche=0.0):
        exit_ahead = box(0, 0, 8, 5).union(box(7.9, 2, 8 + niche, 2.6 if niche else 3))
        area, *walls = (rotate(shape, degrees, origin=(0, 0)) for shape in (
            exit_ahead, box(4, 0, 4.3, 2.1), box(4, 2.1 + width, 4.3, 5)))  # fmt: skip
        exits = [turned([(8 + niche, 2), (8 + niche, 2.6 if niche else 3)], degrees)]
        geometry = Geometry.from_polygon(area, exits=exits, obstacles=walls)
        route_set = RoutePlan(geometry, RADIUS, routes=[Route("quick", strategy="fastest")]).build()
        return route_set.routes[-1].congestion.spacing < 0.15

    assert is_tight(0.58)
    assert not is_tight(0.9)
    assert not is_tight(0.9, niche=0.3)  # a door of 0.6 m in a wall of 0.3 m
