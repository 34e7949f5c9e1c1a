"""Round jambs: the shapes in closed form, and what is refused."""

import json

import numpy as np
import pytest
import shapely
from cases import looped
from shapely.geometry import Point, box

from crowd_env import Geometry, make_scenario
from crowd_env.geometry.geometry import join_boundaries

ROOM = box(0, 0, 5, 5)
DOOR = {"door": [(5, 2.1), (5, 2.9)]}
CUT = 1 - np.pi / 4  # what an arc of radius 1 cuts off a right angle, m2


def curves(geometry):
    """Return centers and radii of the round corners."""
    boundary = geometry.boundary
    is_round = boundary.corner_radius > 0
    return boundary.corner[is_round], boundary.corner_radius[is_round]


def test_a_door_in_a_wall_narrows_to_its_width_where_the_exit_is():
    plan = Geometry.from_polygon(ROOM, exits=DOOR, jamb_radius=0.1)
    np.testing.assert_allclose(plan.exits, [[[5.1, 2.1], [5.1, 2.9]]], atol=1e-12)
    center, radius = curves(plan)
    np.testing.assert_allclose(center, [[5.1, 2.0], [5.1, 3.0]], atol=1e-12)
    assert (radius == 0.1).all()
    assert plan.area == pytest.approx(25 + 0.08 + 2 * CUT * 0.01, abs=1e-4)
    assert plan.area > 25 + 0.08 + 2 * CUT * 0.01  # chords lie in the solid: nobody in front of an arc is outside


def test_an_exit_as_wide_as_its_corridor_stays_where_it_is():
    plan = Geometry.from_polygon(box(0, 0, 8, 2), exits=[[(8, 0), (8, 2)]], jamb_radius=0.1)
    sharp = Geometry.from_polygon(box(0, 0, 8, 2), exits=[[(8, 0), (8, 2)]])
    assert (plan.exits == sharp.exits).all()
    assert (plan.walls == sharp.walls).all()
    assert plan.area == sharp.area


def test_a_square_pillar_with_the_radius_of_its_half_side_is_a_round_one():
    plan = Geometry.from_polygon(box(0, 0, 6, 6), obstacles=[box(2, 2, 2.4, 2.4)], jamb_radius=0.2)
    assert plan.area == pytest.approx(36 - np.pi * 0.04, abs=1e-3)
    around = (2.2, 2.2) + 0.5 * np.column_stack([np.cos(np.arange(40)), np.sin(np.arange(40))])
    np.testing.assert_allclose(plan.clearance(around), 0.3, atol=3e-4)


def test_a_wall_without_thickness_ends_in_a_post_as_far_out_as_its_tip_was():
    plan = Geometry.from_polygon(box(0, 0, 6, 6), thin_walls=[[(3, 0), (3, 2)], [(3, 3), (3, 6)]], jamb_radius=0.1)
    np.testing.assert_allclose(curves(plan)[0], [[3, 1.9], [3, 3.1]], atol=1e-12)
    assert plan.clearance([3, 2.5])[0] == pytest.approx(0.5, abs=1e-3)
    assert plan.contains([[3, 2.001], [3, 1.9], [3.099, 1.9], [3.101, 1.9]]).tolist() == [True, False, False, True]


@looped("radius", [0.05, 0.2])
def test_hollow_corners_and_everything_away_from_corners_stay(radius):
    outline = [(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)]
    plan, sharp = (Geometry.from_polygon(outline, jamb_radius=r) for r in (radius, 0.0))
    cut_off = shapely.difference(plan.walkable, sharp.walkable)
    assert shapely.difference(sharp.walkable, plan.walkable).area == 0
    assert cut_off.area == pytest.approx(CUT * radius**2, rel=0.02)
    assert shapely.hausdorff_distance(cut_off, Point(3, 3)) < 1.01 * radius


def test_without_a_radius_nothing_is_round():
    plan = Geometry.from_polygon(ROOM, exits=DOOR, obstacles=[box(1, 1, 2, 2)])
    assert (plan.boundary.corner_radius == 0).all()
    assert plan.boundary.chord_start.tolist() == [len(plan.walls)]


def test_plans_with_and_without_round_jambs_share_a_batch():
    plans = [Geometry.from_polygon(ROOM, exits=DOOR, jamb_radius=r) for r in (0.1, 0.0, 0.2)]
    joined = join_boundaries(plans)
    for g, plan in enumerate(plans):
        walls = slice(joined.wall_start[g], joined.wall_start[g + 1])
        assert (joined.wall[walls] == plan.walls).all()
        assert joined.chord_start[g] - joined.wall_start[g] == plan.boundary.chord_start[0]
        corners = slice(joined.corner_start[g], joined.corner_start[g + 1])
        for v in range(corners.start, corners.stop):
            for m in range(joined.corner_wall_start[v], joined.corner_wall_start[v + 1]):
                end = joined.wall[joined.corner_wall[m], joined.corner_wall_end[m]]
                away = np.hypot(*(end - joined.corner[v]))
                assert away == pytest.approx(joined.corner_radius[v], abs=1e-9)


def test_a_scenario_file_has_them_too(tmp_path):
    plan = {"walkable": {"box": [0, 0, 5, 5]}, "exits": {"door": [[5, 2.1], [5, 2.9]]}, "jamb_radius": 0.1}
    file = tmp_path / "gate.json"
    file.write_text(json.dumps({"name": "gate", "time_limit": 60, "geometry": plan, "population": {"people": 5}}))
    geometry = make_scenario(str(file)).geometry
    np.testing.assert_allclose(curves(geometry)[0], [[5.1, 2.0], [5.1, 3.0]], atol=1e-12)
    assert Geometry.from_wkt(ROOM.wkt, exits=DOOR, jamb_radius=0.1).arcs.radius == 0.1


ROOMS = [box(0, 0, 3, 4), box(3.3, 0, 6, 4), box(3, 1.5, 3.3, 2.5)]
ANGLE = [box(0, 2, 3, 2.05), box(2.95, 2.05, 3, 6)]  # walls of 5 cm that meet at a right angle


@looped(
    ("walkable", "options", "radius", "message"),
    [
        (ROOMS, {}, 0.2, r"0\.2 m, too large for the walls at the corner \(3(\.3)?, [12]\.5\); it must be <= 0\.15 m"),
        (
            box(0, 0, 6, 6),
            {"obstacles": ANGLE},
            0.2,
            r"too large for the walls at the corner \(3, 2\); it must be <= 0\.05 m",
        ),
        (box(0, 0, 6, 6), {"thin_walls": [[(3, 0), (3, 0.3)]]}, 0.2, r"corner \(3, 0\.3\); it must be <= 0\.1[45]"),
        (ROOM, {"exits": [[(5, 2), (5, 3)], [(5, 3), (5, 4)]]}, 0.1, "exit 'exit-0' is bent or touches another exit"),
        ([ROOM, box(5.05, 0, 8, 5)], {"exits": [[(5, 2), (5, 3)], [(8, 2), (8, 3)]]}, 0.1, "behind exit 'exit-0' at"),
        (ROOM, {"exits": DOOR}, -0.1, "jamb_radius is -0.1 m; it must be >= 0"),
        (ROOM, {"exits": DOOR}, float("inf"), "jamb_radius is inf m"),
        (ROOM, {"exits": DOOR}, "wide", "jamb_radius is 'wide'"),
    ],
)
def test_a_radius_that_does_not_fit_is_refused_in_one_sentence(walkable, options, radius, message):
    with pytest.raises(ValueError, match=message) as caught:
        Geometry.from_polygon(walkable, jamb_radius=radius, **options)
    assert "\n" not in str(caught.value)


def test_the_largest_radius_that_is_named_fits():
    Geometry.from_polygon(ROOMS, jamb_radius=0.15)
    with pytest.raises(ValueError, match="must be <=") as caught:
        Geometry.from_polygon(box(0, 0, 6, 6), obstacles=ANGLE, jamb_radius=0.2)
    most = float(str(caught.value).split("<= ")[1].split(" m")[0])
    plan = Geometry.from_polygon(box(0, 0, 6, 6), obstacles=ANGLE, jamb_radius=most)
    assert plan.walkable.is_valid
