"""The narrowest passage of plans whose width can be worked out by hand."""

import numpy as np
import pytest
import shapely
from cases import looped
from shapely.geometry import Point, Polygon, box

from crowd_env.analysis.passages import narrowest_passages
from crowd_env.analysis.terrain import survey
from crowd_env.geometry.geometry import Geometry

BODY = 0.2  # m, radius


def narrowest(geometry, region=None):
    """Return the passages to all exits from everywhere, or from a region."""
    terrain = survey(geometry)
    starts = terrain.free(BODY)
    if region is not None:
        row, col = np.nonzero(starts)
        points = terrain.origin + terrain.spacing * np.column_stack([col, row])
        starts[row, col] = shapely.contains_xy(region, *points.T)
    return narrowest_passages(geometry, terrain, starts.astype(float))


def hall(*holes, size=(10.0, 6.0), exit_width=4.0, **others):
    """A hall with solid parts, and an exit in the middle of its right wall."""
    area = box(0, 0, *size).difference(shapely.union_all(holes))
    x, y = size[0], 0.5 * size[1]
    return Geometry.from_polygon(area, exits={"exit": [(x, y - 0.5 * exit_width), (x, y + 0.5 * exit_width)]}, **others)


TURN = np.radians(27.0)
PLANS = {
    # name: (plan, width, middle of the line)
    "corridor": (hall(size=(20.0, 1.53), exit_width=1.53), 1.53, (20.0, 0.765)),
    "exit": (hall(exit_width=0.87), 0.87, (10.0, 3.0)),
    "door": (hall(box(5, 0, 5.2, 2.31), box(5, 3.24, 5.2, 6)), 0.93, (None, 2.775)),
    "pillar": (hall(box(5, 1.1, 5.0 + 1e-3, 4.7), size=(10, 6)), 1.3, (5.0, 5.35)),
    "round pillar": (hall(Point(5, 2.75).buffer(2.0, quad_segs=64)), 1.25, (5.0, 5.375)),
    "two corners": (
        hall(Polygon([(4, 0), (4.2, 2.5), (4.4, 0)]), Polygon([(5.2, 6), (5.0, 3.2), (4.8, 6)])),
        np.hypot(0.8, 0.7),
        (4.6, 2.85),
    ),
    "thin walls": (hall(thin_walls=[[(5, 0), (5, 2.5)], [(5, 3.6), (5, 6)]]), 1.1, (5.0, 3.05)),
    "far from the origin": (
        Geometry.from_polygon(
            shapely.transform(
                box(0, 0, 10, 6).difference(shapely.union_all([box(5, 0, 5.2, 2.3), box(5, 3.2, 5.2, 6)])),
                lambda points: points + np.array([330000.0, 5700000.0]),
            ),
            exits={"exit": [(330010.0, 5700001.0), (330010.0, 5700005.0)]},
        ),
        0.9,
        (None, 5700002.75),
    ),
}


@looped("plan", PLANS)
def test_the_narrowest_passage_is_as_wide_as_it_is_drawn(plan):
    geometry, width, middle = PLANS[plan]
    passage = narrowest(geometry)["exit"]
    assert passage.gap.width == pytest.approx(width, abs=1e-3)
    assert np.hypot(*(passage.gap.line[1] - passage.gap.line[0])) == pytest.approx(passage.gap.width, abs=1e-9)
    for found, known in zip(passage.gap.line.mean(axis=0), middle, strict=True):
        assert known is None or found == pytest.approx(known, abs=2e-3)
    assert passage.is_exit == (plan in ("corridor", "exit"))


def test_it_does_not_depend_on_how_the_plan_is_turned():
    def turned(points):
        return points @ np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]]) + (3.0, -7.0)

    area = box(0, 0, 10, 6).difference(shapely.union_all([box(5, 0, 5.2, 2.31), box(5, 3.24, 5.2, 6)]))
    geometry = Geometry.from_polygon(
        shapely.transform(area, turned), exits={"exit": turned(np.array([(10.0, 1.0), (10.0, 5.0)]))}
    )
    assert narrowest(geometry)["exit"].gap.width == pytest.approx(0.93, abs=1e-6)


def test_it_is_the_way_of_greatest_width_that_counts():
    doors = box(5, 0, 5.2, 1).union(box(5, 1.7, 5.2, 4)).union(box(5, 5.1, 5.2, 6))  # 0.7 m and 1.1 m
    assert narrowest(hall(doors))["exit"].gap.width == pytest.approx(1.1, abs=1e-6)


def test_people_beyond_the_door_need_not_pass_it():
    geometry = hall(box(5, 0, 5.2, 2.31), box(5, 3.24, 5.2, 6))
    right = narrowest(geometry, box(5.2, 0, 10, 6))["exit"]
    assert right.is_exit and right.gap.width == pytest.approx(4.0)
    both = narrowest(geometry)["exit"]
    assert both.behind == pytest.approx(5.0 / 9.8, abs=0.02)


def test_a_niche_of_few_is_told_apart_from_what_the_others_pass():
    niche = box(4, 5.2, 5.6, 5.3).union(box(4, 5.3, 4.1, 6)).union(box(5.5, 5.3, 5.6, 5.45))  # 0.55 m to get in
    passage = narrowest(hall(niche, exit_width=2.0))["exit"]
    assert passage.is_exit and passage.gap.width == pytest.approx(2.0)
    assert passage.tighter.width == pytest.approx(0.55, abs=1e-6) and 0 < passage.few < 0.05


def test_nobody_gets_to_an_exit_without_a_way():
    geometry = Geometry.from_polygon(
        [box(0, 0, 5, 5), box(8, 0, 13, 5)], exits={"left": [(0, 1), (0, 2)], "right": [(13, 1), (13, 2)]}
    )
    found = narrowest(geometry, box(0, 0, 5, 5))
    assert found["left"].gap.width == pytest.approx(1.0) and found["right"] is None


def test_an_exit_that_people_walk_into_is_as_wide_as_its_border():
    geometry = Geometry.from_polygon(box(0, 0, 10, 6), exits={"exit": box(6, 2, 8, 4)})
    passage = narrowest(geometry)["exit"]
    assert passage.is_exit and passage.gap.width == pytest.approx(8.0)


YARD = shapely.union_all([box(0, 0, 10, 10), box(10, 4.4, 10.3, 5.6), box(10.3, 0, 15, 10)])


@looped("deep, aside", [(0.5, 0.5), (2.0, 0.5), (1.0, 0.0), (1.0, 3.0)])
def test_an_area_behind_a_door_is_as_wide_as_the_door_from_within(deep, aside):
    geometry = Geometry.from_polygon(YARD, exits={"exit": box(10.3, 4.4 - aside, 10.3 + deep, 5.6 + aside)})
    within = narrowest(geometry, box(0, 0, 10, 10))["exit"]
    assert within.is_exit and within.gap.width == pytest.approx(1.2) and within.behind == 1.0
    outside = narrowest(geometry, box(10.3, 0, 15, 10))["exit"]
    assert outside.gap.width == pytest.approx(min(1.2 + 2.0 * (aside + deep), 4.7), rel=0.01)  # 4.7 m: the yard
    assert narrowest(geometry)["exit"].behind == pytest.approx(0.7, abs=0.04)


def test_people_take_the_nearer_of_two_openings_of_an_exit():
    """Beyond the opening on their side of a narrow door is another."""
    floor = box(0, 0, 10, 6).difference(shapely.union_all([box(5, 0, 5.2, 2.6), box(5, 3.4, 5.2, 6)]))
    geometry = Geometry.from_polygon(
        floor, exits={"exit": shapely.MultiLineString([[(0, 2), (0, 4)], [(10, 2), (10, 4)]])}
    )
    for region in (box(0, 0, 5, 6), box(5.2, 0, 10, 6), None):
        passage = narrowest(geometry, region)["exit"]
        assert passage.is_exit and passage.gap.width == pytest.approx(2.0) and passage.tighter is None


def test_a_wall_before_an_exit_leaves_what_is_between_them():
    geometry = hall(box(9.6, 1.0, 9.7, 5.0), exit_width=2.0)
    assert narrowest(geometry)["exit"].gap.width == pytest.approx(0.3, abs=1e-6)


def test_nothing_leads_through_a_thin_wall():
    geometry = Geometry.from_polygon(
        box(0, 0, 10, 6), exits={"exit": [(10, 2), (10, 4)]}, thin_walls=[[(5, 0), (5.3, 6)]]
    )
    assert narrowest(geometry, box(0, 0, 4.8, 6))["exit"] is None


def test_the_distance_to_the_walls_is_that_of_the_plan():
    geometry = Geometry.from_polygon(
        Point(50, 20).buffer(4.0, quad_segs=6).difference(box(49, 19, 50.3, 21.1)),
        exits={"exit": [(54, 20), Point(50, 20).buffer(4.0, quad_segs=6).exterior.coords[1]]},
        thin_walls=[[(50, 22), (51, 23)]],
    )
    terrain = survey(geometry)
    rows, cols = terrain.clearance.shape
    points = terrain.origin + terrain.spacing * np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1)
    inside = geometry.contains(points)
    assert ((terrain.clearance > 0) == inside)[terrain.clearance > 1e-9].all()
    known = np.where(inside.ravel(), geometry.clearance(points.reshape(-1, 2)), 0.0)
    assert np.abs(terrain.clearance.ravel() - known).max() < 1e-9
