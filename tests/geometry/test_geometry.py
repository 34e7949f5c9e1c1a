"""Geometry: what comes out of polygons and exits, and one clear sentence for what cannot."""

import warnings

import numpy as np
import pytest
import shapely
from cases import looped
from shapely.geometry import LineString, MultiPolygon, Point, Polygon, box

from crowd_env.geometry.geometry import Geometry, join_boundaries, parse_exit
from crowd_env.geometry.parsing import from_wkt, read_exits
from crowd_env.scenarios.population import Population

ROOM = box(0, 0, 5, 5)
DOOR = [[5, 2.09], [5, 2.91]]


from_polygon = Geometry.from_polygon


def lengths(segments):
    return np.hypot(*(segments[:, 1] - segments[:, 0]).T)


def left_of(segments, distance=1e-3):
    along = (segments[:, 1] - segments[:, 0]) / lengths(segments)[:, None]
    return segments.mean(axis=1) + distance * np.stack([-along[:, 1], along[:, 0]], axis=1)


def as_set(segments):
    return {tuple(map(tuple, np.round(segment, 9).tolist())) for segment in segments}


def test_room_with_a_door_has_two_jambs_and_five_walls():
    room = from_polygon(ROOM, exits=[DOOR])
    assert as_set(room.walls) == {
        ((0, 0), (5, 0)),
        ((5, 0), (5, 2.09)),
        ((5, 2.91), (5, 5)),
        ((5, 5), (0, 5)),
        ((0, 5), (0, 0)),
    }
    assert as_set(room.exits) == {((5, 2.09), (5, 2.91))}
    assert room.exit_names == ("exit-0",)
    assert (room.area, room.bounds) == (25.0, (0.0, 0.0, 5.0, 5.0))
    assert not room.two_sided.any()


@looped(
    "walkable",
    [
        [(0, 0), (5, 0), (5, 5), (0, 5)],
        [(0, 5), (5, 5), (5, 0), (0, 0)],  # clockwise
        [
            (0, 0),
            (2, 0),
            (5, 0),
            (5, 1),
            (5, 2.5),
            (5, 5),
            (0, 5),
            (0, 5),
            (0, 0),
        ],  # points within edges, doubled points
        "POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0))",
        "GEOMETRYCOLLECTION (POLYGON ((0 0, 3 0, 3 5, 0 5, 0 0)), POLYGON ((3 0, 5 0, 5 5, 3 5, 3 0)))",
        MultiPolygon([box(0, 0, 5, 2.5), box(0, 2.5, 5, 5)]),
        shapely.force_3d(ROOM),
    ],
    ids=["corners", "clockwise", "seams", "wkt", "collection", "parts", "3d"],
)
def test_one_room_written_in_many_ways(walkable):
    expected = from_polygon(ROOM, exits=[DOOR])
    room = from_polygon(walkable, exits=[DOOR])
    assert as_set(room.walls) == as_set(expected.walls)
    assert as_set(room.exits) == as_set(expected.exits)


@looped(
    "door",
    ["5,2.09,5,2.91", "LINESTRING (5 2.91, 5 2.09)", np.array(DOOR), LineString(DOOR), [[5.005, 2.09], [4.995, 2.91]]],
)
def test_one_door_written_in_many_ways(door):
    expected = from_polygon(ROOM, exits=[DOOR])
    np.testing.assert_allclose(from_polygon(ROOM, exits={"out": door}).exits, expected.exits, atol=2e-4)
    np.testing.assert_allclose(from_polygon(ROOM, exits=door).walls, expected.walls, atol=2e-4)


def test_walkable_area_lies_to_the_left_of_everything():
    place = from_polygon(
        Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], holes=[[(1, 1), (2, 1), (2, 2), (1, 2)]]),
        obstacles=[Point(5, 5).buffer(1.0), box(8, 8, 10, 10)],
        exits={"door": [[0, 3], [0, 4]], "pit": box(6, 1, 7, 2)},
    )
    assert place.contains(left_of(place.walls)).all()
    assert not place.contains(left_of(place.walls, -1e-3)).any()
    assert place.contains(left_of(place.exits)).all()
    assert not place.contains(left_of(place.exits, -1e-3)).any()


def test_walls_and_exits_together_are_the_whole_border():
    place = from_polygon(ROOM, obstacles=[box(2, 2, 3, 3)], exits=[DOOR, [[1, 0], [2, 0]], [[3, 3], [3, 2]]])
    assert lengths(place.walls).sum() + lengths(place.exits).sum() == pytest.approx(20 + 4)
    assert lengths(place.exits) == pytest.approx([0.82, 1, 1])
    assert place.exit_names == ("exit-0", "exit-1", "exit-2")


def test_exit_around_a_corner_is_one_exit_of_two_segments():
    place = from_polygon(ROOM, exits={"corner": [(4, 0), (5, 0), (5, 1)], "b": DOOR})
    assert place.exit_names == ("corner", "corner", "b")
    assert as_set(place.exits[:2]) == {((4, 0), (5, 0)), ((5, 0), (5, 1))}


def test_exit_that_fills_a_whole_edge_leaves_no_wall_there():
    place = from_polygon(ROOM, exits=[[[5, 0], [5, 5]]])
    assert len(place.walls) == 3
    assert len(place.boundary.corner) == 4


def test_exit_area_is_cut_out_and_opens_its_border():
    place = from_polygon(ROOM, exits={"lift": box(4, 2, 5, 3)})
    assert place.area == pytest.approx(24)
    assert as_set(place.exits) == {((5, 2), (4, 2)), ((4, 2), (4, 3)), ((4, 3), (5, 3))}
    assert set(place.exit_names) == {"lift"}
    assert not place.contains([[4.5, 2.5]]).any()


def test_exit_area_beside_the_room_opens_the_shared_edge():
    place = from_polygon(ROOM, exits=[box(5, 2, 6, 3)])
    assert as_set(place.exits) == {((5, 2), (5, 3))}
    assert place.area == 25


def test_overlapping_obstacles_leave_no_wall_inside_each_other():
    place = from_polygon(ROOM, obstacles=[box(1, 1, 3, 2), box(2, 1, 4, 2)])
    assert len(place.walls) == 8
    assert place.area == pytest.approx(22)


def test_thin_walls_are_two_sided_and_inside():
    place = from_polygon(ROOM, thin_walls=[[(1, 1), (2, 1), (2, 3)], LineString([(3, 0), (3, 2)])])
    assert as_set(place.walls[place.two_sided]) == {((1, 1), (2, 1)), ((2, 1), (2, 3)), ((3, 0), (3, 2))}
    assert place.area == 25


def test_every_wall_end_is_a_corner_and_knows_its_walls():
    boundary = from_polygon(ROOM, exits=[DOOR], obstacles=[box(1, 1, 2, 2)]).boundary
    degree = np.diff(boundary.corner_wall_start)
    assert sorted(degree.tolist()) == [1, 1, *[2] * 8]  # the two jambs end one wall each
    assert len(boundary.corner_wall) == 2 * len(boundary.wall)
    for v, corner in enumerate(boundary.corner):
        for w in boundary.corner_wall[boundary.corner_wall_start[v] : boundary.corner_wall_start[v + 1]]:
            assert np.abs(boundary.wall[w] - corner).sum(axis=1).min() < 1e-9


def test_nobody_inside_faces_a_corner_where_walls_turn_left():
    slanted = [(0, 0), (5, 0), (6, 3), (3, 2.5), (2, 4), (0, 5)]  # one corner juts in
    place = from_polygon(
        slanted, exits={"door": [(1, 0), (2, 0)]}, obstacles=[box(1, 1, 2, 2)], thin_walls=[[(3, 0), (3, 1)]]
    )
    boundary = place.boundary
    np.testing.assert_allclose(boundary.length, lengths(boundary.wall))
    np.testing.assert_allclose(boundary.wall[:, 0] + boundary.length[:, None] * boundary.tangent, boundary.wall[:, 1])
    hollow = np.flatnonzero(boundary.corner_turn > 0.0)
    assert {tuple(corner) for corner in boundary.corner[hollow]} == {(0, 0), (5, 0), (6, 3), (2, 4), (0, 5)}
    points = np.random.default_rng(0).uniform(0.0, 6.0, (2000, 2))
    inside = points[place.contains(points)]
    for v in hollow:
        here = slice(boundary.corner_wall_start[v], boundary.corner_wall_start[v + 1])
        rows, end = boundary.corner_wall[here], boundary.corner_wall_end[here]
        away = np.where(end == 0, -1.0, 1.0)[:, None] * boundary.tangent[rows]
        assert not ((inside - boundary.corner[v]) @ away.T >= 0.0).all(axis=1).any()


def test_join_boundaries_keeps_each_geometry_and_shifts_the_rows():
    parts = [
        from_polygon(ROOM, exits=[DOOR]),
        from_polygon(ROOM),
        from_polygon(ROOM, exits=[DOOR], obstacles=[box(1, 1, 2, 2)]),
    ]
    joined = join_boundaries(parts)
    assert joined.wall_start.tolist() == [0, 5, 9, 18]
    assert joined.corner_start.tolist() == [0, 6, 10, 20]
    assert joined.exit_start.tolist() == [0, 1, 1, 2]
    for g, part in enumerate(parts):
        np.testing.assert_array_equal(joined.wall[joined.wall_start[g] : joined.wall_start[g + 1]], part.walls)
        for v in range(joined.corner_start[g], joined.corner_start[g + 1]):
            rows = joined.corner_wall[joined.corner_wall_start[v] : joined.corner_wall_start[v + 1]]
            assert ((rows >= joined.wall_start[g]) & (rows < joined.wall_start[g + 1])).all()
            assert all(np.abs(joined.wall[row] - joined.corner[v]).sum(axis=1).min() < 1e-9 for row in rows)
    assert joined.corner_wall_start[-1] == len(joined.corner_wall) == 2 * len(joined.wall)


def test_contains_counts_the_border_and_not_the_obstacles():
    place = from_polygon(ROOM, obstacles=[box(1, 1, 2, 2)])
    assert place.contains([[0.5, 0.5], [1.5, 1.5], [0, 0], [5, 2], [5.001, 2]]).tolist() == [
        True,
        False,
        True,
        True,
        False,
    ]


def test_clearance_is_the_distance_to_walls_and_ignores_exits():
    place = from_polygon(ROOM, exits=[DOOR], thin_walls=[[(1, 2), (2, 2)]])
    clearance = place.clearance([[2.5, 0.3], [4.9, 2.5], [1.5, 2.1], [2.03, 2.04]])
    np.testing.assert_allclose(clearance, [0.3, np.hypot(0.1, 0.41), 0.1, 0.05])
    assert from_polygon(ROOM, exits=[[(0, 0), (5, 0), (5, 5), (0, 5), (0, 0)]]).clearance([[1, 1]]) == np.inf


def test_regions_are_kept_by_name():
    assert from_polygon(ROOM, regions={"stairs": box(1, 1, 2, 3)}).regions["stairs"].area == 2


def test_wkt_constructor():
    place = Geometry.from_wkt(
        "POLYGON ((0 0, 5 0, 5 5, 0 5), (1 1, 1 2, 2 2, 2 1, 1 1))".replace("0 5)", "0 5, 0 0)"), exits=[DOOR]
    )
    assert place.area == 24


def test_names_of_exits_are_stripped_and_so_are_those_that_doors_name():
    room = from_polygon(ROOM, exits={" west\u00a0": DOOR, 7: [[1, 0], [2, 0]]}, doors={"gate": "west "})
    assert room.exit_names == ("west", "7") and room.exits_of_door == ("west",)


@looped("name", ["", " ", "we\nst", "we\u2028st", "we\x85st", "we\x0bst", "we\x00st", "we\tst", "we\ud800st"])
def test_names_that_no_table_can_hold_are_refused(name):
    with pytest.raises(ValueError, match=r"^the name of an exit is '.*'; it must be a text without line breaks"):
        from_polygon(ROOM, exits={name: DOOR})
    with pytest.raises(ValueError, match=r"^population: name is '.*'; it must be a text without line breaks"):
        Population(1, name=name or " ")


def test_two_exits_of_one_name_are_refused():
    with pytest.raises(ValueError, match="two exits have the name 'west'"):
        from_polygon(ROOM, exits={"west": DOOR, "west ": [[1, 0], [2, 0]]})


@looped("read", [Geometry.from_wkt, parse_exit, lambda text: from_polygon(ROOM, obstacles=[text])])
def test_text_that_would_overrun_the_stack_is_refused(read):
    """GEOS reads collections in collections by calling itself, which ended the whole process."""
    with pytest.raises(ValueError, match="nested too deeply"):
        read("GEOMETRYCOLLECTION (POINT (0 0), " * 30_000)
    assert from_wkt("GEOMETRYCOLLECTION (" * 40 + "POINT (1 2)" + ")" * 40, "a point").bounds == (1, 2, 1, 2)


def test_parse_exit():
    assert parse_exit(" 5, 2, 5, 3").equals(LineString([(5, 2), (5, 3)]))
    assert parse_exit("LINESTRING (5 2, 5 3)").equals(LineString([(5, 2), (5, 3)]))
    assert parse_exit("POLYGON ((0 0, 1 0, 1 1, 0 0))").area == 0.5


NAN = float("nan")


@looped(
    ("build", "message"),
    [
        (lambda: from_polygon([(0, 0), (2, 2), (2, 0), (0, 2)]), r"walkable area .*self-intersection at \(1, 1\)"),
        (lambda: from_polygon([(0, 0), (1, 1), (2, 2)]), "walkable area encloses no area"),
        (lambda: from_polygon("POLYGON EMPTY"), "walkable area encloses no area"),
        (lambda: from_polygon([(0, 0), (1, NAN), (2, 2)]), "walkable area has a coordinate that is not finite"),
        (lambda: from_polygon("POLYGON ((0 0, 1 0, 1 inf, 0 0))"), "walkable area has a coordinate that is not finite"),
        (lambda: from_polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)]), r"walkable area .*shape \(3, 3\)"),
        (lambda: from_polygon(None), "walkable area is None; it must be a list of points"),
        (lambda: Geometry.from_wkt("POLYGN ((0 0))"), "walkable area is not well-known text.*POLYGN"),
        (lambda: Geometry.from_wkt("LINESTRING (0 0, 1 1)"), "walkable area is a LineString; it must be a POLYGON"),
        (
            lambda: from_polygon(ROOM.difference(Point(5, 2).buffer(0.15)), exits={"a": [[5, 1], [5, 3]]}),
            r"exit 'a' does not run along the boundary.* leaves its line, by 0\.1\d* m at \(5, 2\)",
        ),
        (
            lambda: from_polygon(ROOM, exits={"a": [[4, 2], [4, 3]]}),
            r"exit 'a' is not on the boundary.*\(4, 2\) is 1 m",
        ),
        (
            lambda: from_polygon(ROOM, exits={"a": [[5, 4], [5, 6]]}),
            r"exit 'a' reaches beyond the boundary .*\(5, 6\) is 1 m away.*shorten it to 1 m, from \(5, 4\) to \(5, 5\)",
        ),
        (lambda: from_polygon(ROOM, exits={"a": [[5.1, 6], [5.1, 4]]}), r"beyond.* to 1 m, from \(5, 4\) to \(5, 5\)"),
        (lambda: from_polygon(ROOM, exits={"a": [[4.6, 2], [4.6, 3]]}), r"exit 'a' .*0.4 m away.*within 0.3 m"),
        (lambda: from_polygon(ROOM, exits={"a": [[5, 2], [5, 2]]}), r"exit 'a' at \(5, 2\) has length 0 m"),
        (lambda: from_polygon(ROOM, exits={"a": [[5, 2], [5, NAN]]}), "exit 'a' has a coordinate that is not finite"),
        (lambda: from_polygon(ROOM, exits={"a": Point(5, 2)}), "exit 'a' is a Point"),
        (lambda: from_polygon(ROOM, exits=5), "exits must be a list"),
        (
            lambda: from_polygon(ROOM, exits={"a": DOOR, "b": [[5, 2.5], [5, 4]]}),
            r"exits 'a' and 'b' overlap at \(5, 2.5\)",
        ),
        (lambda: from_polygon(ROOM, exits={"a": box(4, 2, 5, 3), "b": box(4, 2.5, 5, 4)}), "exits 'a' and 'b' overlap"),
        (lambda: from_polygon(ROOM, exits={"a": box(7, 2, 8, 3)}), "exit 'a' does not touch.* 2 m away"),
        (lambda: from_polygon(ROOM, exits={"a": box(-1, -1, 6, 6)}), "the exits leave no walkable area"),
        (lambda: from_polygon(ROOM, obstacles=[box(8, 8, 9, 9)]), r"obstacle 0 around \(8.5, 8.5\) lies outside"),
        (lambda: from_polygon(ROOM, obstacles=[ROOM]), "the obstacles leave no walkable area"),
        (lambda: from_polygon(ROOM, thin_walls=[[(1, 1), (7, 1)]]), r"thin wall 0 leaves .* at \(7, 1\)"),
        (lambda: from_polygon(ROOM, thin_walls=[[(1, 1), (1, 1)]]), r"thin wall 0 at \(1, 1\) has no length"),
        (lambda: from_polygon(ROOM, thin_walls=[ROOM]), "thin wall 0 is a Polygon"),
        (lambda: from_polygon(ROOM, regions={"r": box(8, 8, 9, 9)}), r"region 'r' around \(8.5, 8.5\) lies outside"),
        (
            lambda: from_polygon(ROOM, exits={"r": DOOR}, regions={"r": box(1, 1, 2, 2)}),
            "region 'r' has the name of an exit",
        ),
        (lambda: parse_exit("1,2,3"), "exit '1,2,3' is not understood; it must be 'x1,y1,x2,y2'"),
        (lambda: parse_exit("POINT (1 1)"), "is a Point; it must be"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(build, message):
    with pytest.raises(ValueError, match=message) as caught:
        build()
    assert "\n" not in str(caught.value)


@looped(
    "corners, noted",
    [
        ([[4, 2], [5, 2], [5, 3], [4, 3]], True),  # an area, as one writes it
        ([[4, 2], [5, 2], [5, 3], [4, 3], [4, 2]], True),
        ([[5, 2], [5, 2.5], [5, 2.8], [5, 3]], False),  # one line in pieces
        ([[5, 4], [5, 5], [4, 5]], False),  # around a corner
    ],
)
def test_a_line_through_the_corners_of_a_rectangle_is_noted(corners, noted):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        read_exits({"a": corners})
    assert any("'a' is a line through corners of a rectangle" in str(one.message) for one in said) == noted
