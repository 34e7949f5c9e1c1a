"""The way out does not depend on how a place lies to the axes of the grid, and is the one that a taut string takes."""

import functools

import numpy as np
import pytest
import shapely
from cases import looped
from navigation_plans import RADIUS, ROOM, exit_targets, shortest_ways
from shapely.affinity import rotate
from shapely.geometry import Point, Polygon, box

from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at, travel_time_at

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
def test_ways_are_those_of_a_taut_string(name):
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
