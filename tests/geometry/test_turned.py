"""Places that are turned or mirrored: the same walls, seen from another side."""

from dataclasses import fields

import numpy as np
import pytest
import shapely
from cases import looped

from crowd_env import Geometry, OneWay, Population, Scenario, make_scenario
from crowd_env.geometry.geometry import box, turning


def rooms(jamb_radius=0.0):
    """Return two rooms with a door between them that is passed one way, a post, a pillar, an exit door and a region."""
    return Geometry.from_polygon(
        [box(0, 0, 6, 5), box(6, 2, 6.2, 3), box(6.2, 0, 10, 5)],
        exits={"south": [(7, 0), (8.5, 0)], "west": [(0, 1), (0, 2.2)]},
        obstacles=[box(2, 2, 3, 3.5)],
        thin_walls=[[(7.5, 2.5), (9.0, 3.5)]],
        doors={"middle": [(6.1, 2), (6.1, 3)], "gate": [(0, 1), (0, 2.2)]},
        regions={"left": box(0, 3, 4, 5)},
        jamb_radius=jamb_radius,
    )


GEOMETRIES = {"sharp": rooms(), "round": rooms(0.1)}


def arrays(geometry):
    """Return everything of a geometry as arrays, by name."""
    found = dict(zip(geometry.boundary._fields, geometry.boundary, strict=True))
    shapes = {"walkable": geometry.walkable, **geometry.regions}
    found |= {name: shapely.get_coordinates(shape) for name, shape in shapes.items()}
    return found | dict(zip(geometry.arcs._fields, geometry.arcs, strict=True))


@looped("name", GEOMETRIES)
def test_a_turn_by_nothing_is_bitwise_the_same(name):
    before, after = arrays(GEOMETRIES[name]), arrays(GEOMETRIES[name].turned(0.0))
    for key, value in before.items():
        np.testing.assert_array_equal(after[key], value, strict=True, err_msg=key)


@looped(("name", "mirrored"), [(name, mirrored) for name in GEOMETRIES for mirrored in (False, True)])
def test_two_half_turns_or_two_mirrors_are_the_same_place(name, mirrored):
    geometry, angle = GEOMETRIES[name], 0.0 if mirrored else np.pi
    back = geometry.turned(angle, mirrored).turned(angle, mirrored)
    for key, value in arrays(geometry).items():
        np.testing.assert_allclose(arrays(back)[key], value, rtol=0.0, atol=1e-9, err_msg=key)


@looped(("name", "mirrored"), [(name, mirrored) for name in GEOMETRIES for mirrored in (False, True)])
def test_what_lies_to_the_left_of_a_wall_lies_there_still(name, mirrored):
    geometry = GEOMETRIES[name]
    turn, moved = turning(2.4, mirrored), geometry.turned(2.4, mirrored)
    for before, after in ((geometry.walls, moved.walls), (geometry.exits, moved.exits)):
        np.testing.assert_allclose(after, turn(before)[:, ::-1] if mirrored else turn(before))
        along = after[:, 1] - after[:, 0]
        left = after.mean(axis=1) + 1e-3 * np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
        assert moved.contains(left).mean() > 0.9  # but behind leaves of exits
    before, after = geometry.boundary, moved.boundary
    for key in ("length", "depth", "two_sided", "wall_door", "corner_radius"):
        np.testing.assert_allclose(getattr(after, key), getattr(before, key), atol=1e-9, err_msg=key)
    assert sorted(after.corner_turn.round(9)) == sorted(before.corner_turn.round(9))
    assert moved.area == pytest.approx(geometry.area) and moved.exit_widths == pytest.approx(geometry.exit_widths)
    assert moved.area_of("left") == pytest.approx(geometry.area_of("left"))
    # Each arc lies between the same two walls, at the ends that touch it.
    ends = moved.walls.reshape(-1, 2)[moved.arcs.ends]
    on_post = moved.arcs.ends[:, 1] < 0
    distance = np.hypot(*np.moveaxis(ends - moved.arcs.center[:, None], -1, 0))
    np.testing.assert_allclose(distance[~on_post], moved.arcs.radius)
    np.testing.assert_allclose(distance[on_post, 0], 0.0, atol=1e-9)
    assert (moved.arcs.ends[~on_post] % 2 == [1, 0]).all()


@looped("mirrored", [False, True])
def test_a_door_is_passed_from_the_same_room(mirrored):
    way = OneWay("middle", to="left")
    (before,), (after,) = way.lines(GEOMETRIES["sharp"]), way.lines(GEOMETRIES["sharp"].turned(2.4, mirrored))

    def comes_out_at(line):
        along = line[1] - line[0]
        return line.mean(axis=0) + 0.5 * np.array([-along[1], along[0]])

    np.testing.assert_allclose(comes_out_at(after), turning(2.4, mirrored)(comes_out_at(before)))


def test_recorded_starts_turn_with_their_place():
    place = make_scenario("theatre-v0")
    moved = place.turned(2.4, True)
    np.testing.assert_allclose(moved.population.starts, turning(2.4, True)(place.population.starts))
    assert moved.geometry.contains(moved.population.starts).all()
    two = Scenario("two", rooms(), [Population(2, starts=[(1, 1), (2, 1)]), Population(3, start_region="left")], 60.0)
    parts = two.turned(np.pi).population.parts
    assert parts[0].starts == pytest.approx(np.array([(-1, -1), (-2, -1)])) and parts[1].start_region == "left"
    same = {one.name for one in fields(two)} - {"geometry", "population"}
    assert all(getattr(two.turned(np.pi), name) == getattr(two, name) for name in same)
