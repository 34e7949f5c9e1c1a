"""The ground outside of exits."""

import numpy as np
import shapely
from shapely.geometry import Point, box

from crowd_env import Geometry
from crowd_env.geometry.aprons import add_aprons


def test_every_exit_has_ground_outside_as_wide_as_it_is():
    place = Geometry.from_polygon(box(0, 0, 4, 3), exits={"a": [(0, 1), (0, 2)], "b": [(4, 0.5), (4, 1.3)]})
    area = add_aprons(place.walkable, place.exits, 0.6)
    assert area.geom_type == "Polygon" and area.is_valid
    assert abs(area.area - 12.0 - 0.6 * 1.8) < 1e-9
    for inside in [(-0.59, 1.01), (-0.01, 1.99), (4.59, 0.51), (4.0, 1.0)]:
        assert area.contains(Point(inside))
    for outside in [(-0.61, 1.5), (-0.1, 0.99), (4.1, 1.31)]:
        assert not area.contains(Point(outside))


def test_slanting_and_curved_places_stay_in_one_piece():
    """The exit of a circle has many lines; each has its ground, and no gap of rounding parts it from the place."""
    ring = Point(0, 0).buffer(5, quad_segs=40)
    place = Geometry.from_polygon(ring, exits={"cut": box(3, -1, 6, 1)})
    arc = Geometry.from_polygon(ring, exits={"arc": shapely.get_coordinates(ring.exterior)[3:9]})
    for one in (place, arc):
        area = add_aprons(one.walkable, one.exits, 0.6)
        assert area.geom_type == "Polygon" and area.is_valid
        middles = one.exits.mean(axis=1)
        along = one.exits[:, 1] - one.exits[:, 0]
        outward = np.stack([along[:, 1], -along[:, 0]], 1) / np.hypot(*along.T)[:, None]
        assert shapely.contains_xy(area, middles + 0.59 * outward).all()


def test_ways_end_at_the_lines_of_a_bent_exit_and_behind_those_of_a_straight_one():
    """Around an area aprons cross, and get too narrow for bodies: straight lines have floor behind for their ways."""
    hall = box(0, 0, 8, 6)
    for area in (box(3, 2, 4, 4), Point(0, 0).buffer(1.0), Point(4, 3).buffer(0.5)):
        place = Geometry.from_polygon(hall, exits=[area]).with_apron(2.0)
        assert not place.ways_behind.any()
        np.testing.assert_array_equal(place.boundary.aim, place.exits)
    halves = Geometry.from_polygon(hall, exits={"a": [(8, 1), (8, 2), (8, 4)], "b": [(0, 1), (0, 2)]}).with_apron(1.5)
    assert set(halves.ways_behind) == {1.5}
    np.testing.assert_allclose(np.abs(halves.boundary.aim - halves.exits), [[[1.5, 0.0]] * 2] * len(halves.exits))
    seen = halves.with_ways_to(["a"])
    assert seen.bounds == (0.0, 0.0, 9.5, 6.0) and halves.bounds == (0.0, 0.0, 8.0, 6.0)
