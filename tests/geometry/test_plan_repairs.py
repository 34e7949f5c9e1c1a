"""What a plan may have wrong and is used all the same, each time with a note: gaps, closed-off parts, exits in the wall."""

import warnings

import numpy as np
import pytest
import shapely
from cases import looped

from crowd_env import FULL_SPEED, Geometry, Population, Scenario, make_scenario
from crowd_env.geometry.parsing import place

ROOM = shapely.box(0, 0, 6, 5)
DOOR = [(6, 2), (6, 3)]


def quietly(*args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Geometry.from_polygon(*args, **options)


def written(path, shape):
    path.write_text(shape.wkt)
    return path


# ------------------------------------------------------------------------------------------------------------ parts


@looped("gap", [1e-4, 1e-3, 0.009])
@looped("angle", [0.0, 33.0])
def test_parts_that_were_meant_to_touch_are_joined(gap, angle):
    door = shapely.box(6 + gap, 2, 8, 3)
    other = shapely.box(-4, -3, -gap, 2)  # beside a part of the edge only
    shapes = [shapely.affinity.rotate(part, angle, origin=(0, 0)) for part in (ROOM, door, other)]
    exit_line = shapely.affinity.rotate(shapely.LineString([(8, 2), (8, 3)]), angle, origin=(0, 0))
    with pytest.warns(UserWarning, match="parts that lie less than 1 cm apart are joined"):
        geometry = Geometry.from_polygon(shapely.MultiPolygon(shapes), exits=[exit_line])
    assert geometry.walkable.geom_type == "Polygon" and not geometry.left_out
    assert geometry.area == pytest.approx(ROOM.area + 2 + 20, abs=0.1)
    assert (
        Scenario("joined", geometry, Population(3), 60.0, **FULL_SPEED).field().travel_time.size
    )  # every place has a way out
    # The passages are as wide as they were drawn: no thread of wall is left in them.
    for inside in ([(5.5, 2.5), (7, 2.5)], [(0.5, 1), (-1, 1)], [(0.5, 0.2), (-1, 0.2)]):
        line = shapely.affinity.rotate(shapely.LineString(inside), angle, origin=(0, 0))
        assert geometry.walkable.contains(line)


def test_parts_further_apart_stay_apart():
    with pytest.warns(UserWarning, match=r"no exit can be reached from a part of 4 m2 around \(7\.0\d*, 2\): left out"):
        geometry = Geometry.from_polygon(
            shapely.MultiPolygon([ROOM, shapely.box(6.02, 1, 8.02, 3)]), exits=[[(0, 2), (0, 3)]]
        )
    assert geometry.area == ROOM.area and len(geometry.left_out) == 1


def test_touching_parts_and_good_plans_are_left_alone():
    geometry = quietly([ROOM, shapely.box(6, 2, 8, 3)], exits=[[(8, 2), (8, 3)]])
    assert geometry.area == ROOM.area + 2 and geometry.left_out == ()
    assert quietly(shapely.MultiPolygon([ROOM, shapely.box(7, 0, 9, 5)]), exits=[DOOR, [(9, 2), (9, 3)]]).area == 40


def test_parts_without_an_exit_are_left_out():
    shafts = [shapely.box(20 + 5 * k, 0, 22 + 5 * k, 2) for k in range(3)]
    walls = [[(1, 1), (1, 2)], [(20.5, 0.5), (20.5, 1.5)]]
    with pytest.warns(UserWarning, match=r"from 3 parts of 12 m2 in all, the largest around .*: left out"):
        geometry = Geometry.from_polygon(shapely.MultiPolygon([ROOM, *shafts]), exits=[DOOR], thin_walls=walls)
    assert geometry.bounds == (0, 0, 6, 5) and geometry.two_sided.sum() == 1
    assert geometry.is_left_out((21, 1)) and not geometry.is_left_out((1, 1)) and not geometry.is_left_out((50, 50))


def test_who_starts_in_a_part_without_an_exit_is_told_so():
    both = shapely.MultiPolygon([ROOM, shapely.box(7, 0, 9, 5)])
    with (
        pytest.warns(UserWarning, match="left out"),
        pytest.raises(ValueError, match=r"region 'cell' around .* no exit reaches"),
    ):
        Geometry.from_polygon(both, exits=[DOOR], regions={"cell": shapely.box(7, 0, 9, 2)})
    with pytest.warns(UserWarning, match="left out"):
        geometry = Geometry.from_polygon(both, exits=[DOOR], regions={"wide": shapely.box(5, 0, 9, 2)})
    people = Population(1, starts=np.array([[8.0, 1.0]]))
    with pytest.raises(ValueError, match=r"start 0 at \(8, 1\) is in a part that no exit reaches"):
        people.draw(np.random.default_rng(0), geometry)
    _, position = Population(5, start_region="wide").draw(np.random.default_rng(0), geometry)
    assert (position[:, 0] < 6).all()


def test_a_shaft_behind_a_crack_is_left_out_of_a_floor_plan(tmp_path):
    crack = shapely.union_all([ROOM, shapely.box(-1, 2, 0, 2.1), shapely.box(-3, 1, -1, 4)])
    with pytest.warns(UserWarning, match=r"no exit can be reached from a part of 5\.98 m2 around .*: left out"):
        place = make_scenario(written(tmp_path / "a.wkt", crack), exits=["6,2,6,3"], people=20)
    assert place.geometry.area == pytest.approx(ROOM.area, abs=0.2) and place.geometry.is_left_out((-2, 3))
    assert place.geometry.walkable.geom_type == "Polygon"  # no crumb of the crack is left
    place.field()
    _, position = place.population.draw(np.random.default_rng(0), place.geometry)
    assert (position[:, 0] > 0).all()
    wide = shapely.union_all([ROOM, shapely.box(-1, 2, 0, 2.6), shapely.box(-3, 1, -1, 4)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert make_scenario(written(tmp_path / "b.wkt", wide), exits=["6,2,6,3"], people=3).geometry.area > 36


# ------------------------------------------------------------------------------------------------------------ exits


@looped("off", [0.02, 0.1, 0.29, -0.02, -0.1, -0.29])
def test_exits_on_the_other_face_of_a_wall_are_moved_onto_the_boundary(off):
    with pytest.warns(UserWarning, match=rf"exit 'a' is drawn {abs(off):.2f} m off the boundary .*: moved onto it"):
        geometry = Geometry.from_polygon(ROOM, exits={"a": [(6 + off, 2), (6 + off, 3)]})
    assert np.allclose(np.sort(geometry.exits[0], axis=0), DOOR)
    if off > 0:
        with pytest.warns(UserWarning, match="moved onto it"):
            geometry = Geometry.from_polygon(ROOM, exits={"a": shapely.box(6 + off, 2, 7, 3)})
        assert np.allclose(np.sort(geometry.exits[0], axis=0), DOOR) and len(geometry.exits) == 1


def test_exits_in_corners_and_at_a_slant_are_moved_too():
    with pytest.warns(UserWarning, match="moved"):  # from wall to wall, inside
        corner = Geometry.from_polygon(ROOM, exits={"a": [(5.9, 0), (5.9, 1)]})
    assert np.allclose(np.sort(corner.exits[0], axis=0), [(6, 0), (6, 1)])
    with pytest.warns(UserWarning, match="0.20 m"):
        slanted = Geometry.from_polygon(ROOM, exits={"a": [(6.05, 2), (6.2, 3)]})
    assert np.allclose(np.sort(slanted.exits[0], axis=0), DOOR)


@looped("line", [[(6.4, 2), (6.4, 3)], [(5.6, 2), (5.6, 3)], [(5.9, 2), (4.9, 2)], [(6.1, 4.5), (6.1, 5.5)]])
def test_exits_that_are_nowhere_near_are_refused(line):
    with pytest.raises(ValueError, match=r"exit 'a' .* the boundary .*(must lie within 0\.3|shorten it to 0\.5) m"):
        Geometry.from_polygon(ROOM, exits={"a": line})


@looped(
    ("obstacle", "widths", "words"),
    [
        (shapely.box(5.8, 2.4, 6, 2.6), [0.4, 0.4], "0.20 of 1.00 m; 2 openings of 0.40 m are left"),
        (shapely.box(5.2, 1, 6, 2.5), [0.5], "0.50 of 1.00 m; 1 opening of 0.50 m is left"),
        (
            shapely.box(5.2, 2.1, 6, 2.5),
            [0.5],
            "0.40 of 1.00 m; 1 opening of 0.50 m is left, without 1 narrower than 0.3 m",
        ),
        (shapely.box(5.8, 2.45, 6.2, 2.65), [0.45, 0.35], "2 openings of 0.45 and 0.35 m are left"),
        (shapely.Point(6, 2.5).buffer(0.1), [0.4, 0.4], "2 openings of 0.40 m"),
    ],
    quick=2,
)
@looped("off", [0.0, 0.2])
def test_an_exit_is_cut_to_what_an_obstacle_leaves_of_it(obstacle, widths, words, off):
    """It was refused, as not on the boundary, although it is drawn on it."""
    with pytest.warns(UserWarning) as said:
        geometry = Geometry.from_polygon(ROOM, exits={"a": [(6 + off, 2), (6 + off, 3)]}, obstacles=[obstacle])
    lengths = np.hypot(*(geometry.exits[:, 1] - geometry.exits[:, 0]).T)
    assert np.sort(lengths) == pytest.approx(np.sort(widths), abs=1e-6)
    assert ["moved onto it" in str(one.message) for one in said] == [True] * bool(off) + [False]
    assert "exit 'a': an obstacle covers " in str(said[-1].message) and words in str(said[-1].message)


def test_an_exit_that_obstacles_cover_all_along_is_refused():
    with pytest.raises(ValueError, match=r"exit 'a' at \(6, 2\): an obstacle covers it"):
        Geometry.from_polygon(ROOM, exits={"a": DOOR}, obstacles=[shapely.box(5.5, 1, 6, 4)])
    with pytest.warns(UserWarning, match="0.20 m off the boundary .* moved onto it"):  # a wall drawn as an obstacle
        Geometry.from_polygon(ROOM, exits={"a": DOOR}, obstacles=[shapely.box(5.8, 0, 6, 5)])


def test_an_obstacle_beside_an_exit_leaves_it_as_it_is():
    beside = quietly(ROOM, exits={"a": DOOR}, obstacles=[shapely.box(5.5, 1, 6, 2), shapely.box(5.5, 2.4, 5.9, 2.6)])
    assert np.array_equal(beside.exits, quietly(ROOM, exits={"a": DOOR}).exits)


def test_an_exit_on_the_boundary_is_not_spoken_of():
    assert len(quietly(ROOM, exits={"a": [(6.005, 2), (5.995, 3)], "b": shapely.box(-1, 1, 0, 2)}).exits) == 2


# ------------------------------------------------------------------------------------------------------------ units


@looped(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_units(unit, factor, tmp_path):
    shape = shapely.affinity.scale(ROOM, factor, factor, origin=(0, 0))
    exit_line = ",".join(str(factor * c) for point in DOOR for c in point)
    place = make_scenario(written(tmp_path / "a.wkt", shape), exits=[exit_line], people=3, unit=unit)
    assert np.allclose(place.geometry.bounds, (0, 0, 6, 5)) and np.allclose(
        np.sort(place.geometry.exits[0], axis=0), DOOR
    )


def test_what_comes_first_is_the_unit_not_the_crowd(tmp_path):
    shape = shapely.affinity.scale(ROOM, 1000, 1000, origin=(0, 0))
    with pytest.raises(
        ValueError, match=r"6000 m x 5000 m and an exit 1000 m wide: is it in mm or cm\? .*; --unit mm if"
    ):
        make_scenario(written(tmp_path / "a.wkt", shape), exits=["6000,2000,6000,3000"], people=400_000)


# ----------------------------------------------------------------------------------------------------------- people


def test_more_people_than_there_is_room_for_are_refused_before_any_is_drawn():
    with pytest.raises(ValueError, match=r"400000 people do not fit .* room for at most 384"):
        Scenario("room", quietly(ROOM, exits=[DOOR]), Population(400_000), 60.0, **FULL_SPEED)
    regions = {"west": shapely.box(0, 0, 2, 5)}
    with pytest.raises(ValueError, match=r"200 people do not fit without overlap into 10\.0 m2 of 'west'"):
        Scenario(
            "room",
            quietly(ROOM, exits=[DOOR], regions=regions),
            Population(200, start_region="west"),
            60.0,
            **FULL_SPEED,
        )


@looped(
    ("point", "text"),
    [
        ((3.5, 2.0), "(3.5, 2)"),
        ((1 / 3, -1234.5678), "(0.333333, -1234.57)"),
        ((357_412.3456, 5_612_345.678), "(357412.35, 5612345.68)"),  # of maps in UTM
        ((-10_000.0, 5_600_000.5), "(-10000, 5600000.5)"),
        ((np.nan, 1e300), "(nan, 1e+300)"),
    ],
)
def test_places_in_messages_are_told_to_the_centimeter(point, text):
    assert place(point) == text


def test_a_mistake_far_from_the_origin_of_a_map_can_be_found():
    east, north = 357_412.0, 5_612_345.0
    hall = shapely.box(east, north, east + 10, north + 8)
    with pytest.raises(ValueError, match=r"its point \(357416(\.\d+)?, 5612349\) is"):
        Geometry.from_polygon(hall, exits=[[(east + 4, north + 4), (east + 5, north + 4)]])


def test_rooms_that_touch_are_one_however_they_are_turned():
    """What rounding leaves between them is no gap, and no part of the drawing."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        angle, (x, y, u, v) = rng.uniform(0.0, 6.3), rng.uniform(1.0, 9.0, 4)
        axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        rooms = [
            shapely.transform(shapely.box(*sides), lambda points, axes=axes: points @ axes)
            for sides in ((0, 0, x, y), (x, -v, x + u, y))
        ]
        place = quietly(rooms, exits=[np.array([(x + u, 0.2), (x + u, 0.8)]) @ axes])
        assert len(shapely.get_parts(place.walkable)) == 1
        assert place.walkable.area == pytest.approx(x * y + u * (y + v))


def test_regions_keep_their_area_however_they_are_turned():
    rng = np.random.default_rng(0)
    for _ in range(150):
        angle, (x, y, u) = rng.uniform(0.0, 6.3), rng.uniform(2.0, 9.0, 3)
        axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        room, region = ((points @ axes) + 7.0 for points in (corners(0.0, x + u, y), corners(0.5, x, y)))
        place = quietly(room, exits=[np.array([(x + u, 0.2), (x + u, 0.8)]) @ axes + 7.0], regions={"here": region})
        assert place.area_of("here") == pytest.approx((x - 0.5) * y)


def corners(left, right, top):
    return np.array([(left, 0.0), (right, 0.0), (right, top), (left, top)])
