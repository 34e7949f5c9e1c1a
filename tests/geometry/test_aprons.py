"""The ground outside of exits."""

import numpy as np
import shapely
from cases import looped
from shapely.affinity import rotate
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


def test_lines_of_an_exit_that_meet_without_a_wall_are_one_opening():
    hall, exits = box(0, 0, 8, 6), {"a": box(3, 2, 4, 4), "b": [(8, 1), (8, 2)]}
    assert Geometry.from_polygon(hall).openings() == []
    place = Geometry.from_polygon(hall, exits=exits)
    assert [(name, len(rows)) for name, rows in place.openings()] == [("a", 4), ("b", 1)]
    assert [(name, len(rows)) for name, rows in place.openings(0.5)] == [("a", 1)] * 4 + [("b", 1)]
    parted = Geometry.from_polygon(hall, exits=exits, thin_walls=[[(0, 2), (3, 2)], [(3, 4), (0, 4)]])
    assert sorted(len(rows) for name, rows in parted.openings() if name == "a") == [1, 3]


@looped("angle", [0.0, 31.0])
@looped("gap", [0.0, 0.1])
@looped("thick", [0.0, 0.3])
@looped("deep, aside", [(0.5, 0.5), (1.0, 0.5), (2.0, 0.0), (1.0, 3.4)])
def test_no_wall_of_an_apron_stands_across_an_exit(angle, gap, thick, deep, aside):
    """Aprons of an area at the outer face of a wall meet in the door behind which it lies."""
    face = 10.0 + thick
    floor = shapely.union_all([box(0, 0, 10, 10), box(10, 4.4, face, 5.6), box(face, 0, 15, 10)])
    if not thick:
        floor = floor.difference(shapely.union_all([box(9.9, 0, 10, 4.4), box(9.9, 5.6, 10, 10)]))
    area = box(face + gap, 4.4 - aside, face + gap + deep, 5.6 + aside)
    floor, area = (rotate(shape, angle, origin=(0, 0)) for shape in (floor, area))
    place = Geometry.from_polygon(floor, exits=[area]).with_apron(2.0)
    sides = shapely.linestrings(place.boundary.wall[len(place.walls) :])
    lines = shapely.multilinestrings(place.exits).buffer(1e-5, cap_style="flat")
    assert shapely.length(shapely.intersection(sides, lines)).max(initial=0.0) < 1e-4
