"""Passages, dead ends and fields that cannot be."""

import warnings

import numpy as np
import pytest
from cases import looped
from late import late
from navigation_plans import DOOR, RADIUS, ROOM, plan
from shapely.geometry import MultiPolygon, box

from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.grid import connected_parts
from crowd_env.routing.fields.lookup import direction_at, travel_time_at
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import Route

ndimage = late("scipy.ndimage")


def gap(width):
    """Return two rooms joined by a gap of ``width`` that no grid line runs through."""
    walls = [box(4, 0, 4.3, 2.117), box(4, 2.117 + width, 4.3, 5)]
    return Geometry.from_polygon(box(0, 0, 8, 5), exits=[[[8, 2], [8, 3]]], obstacles=walls)


@looped("width", [0.50, 0.53, 0.51, 0.60], quick=2)
def test_passages_a_body_just_fits_through_are_found(width):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        field = travel_time_field(gap(width), RADIUS, min_radius=0.2)
    assert field.radius == pytest.approx(RADIUS, abs=0.01)
    geometry = gap(width)
    arrays = join_fields([field], geometry.boundary)
    assert travel_time_at(arrays, geometry.boundary, 0, 1.0, 2.117 + width / 2, RADIUS) == pytest.approx(7, abs=0.05)


def test_narrower_passage_is_for_smaller_bodies_with_a_warning():
    with pytest.warns(UserWarning, match=r"too narrow for a body of radius 0.25 m"):
        field = travel_time_field(gap(0.44), RADIUS, min_radius=0.2)
    assert field.radius == RADIUS
    widest = np.nanmax(np.where(field.nodes()[..., 0] < 3, field.fits, np.nan))
    assert 0.2 <= widest <= 0.22


def test_narrow_dead_end_does_not_change_the_field_but_is_left():
    niche = Geometry.from_polygon(ROOM.union(box(1, 5, 1.4, 8)), exits=[DOOR])
    field = travel_time_field(niche, RADIUS)
    assert field.radius == RADIUS
    arrays = join_fields([field], niche.boundary)
    for y in np.arange(5.2, 7.9, 0.1):
        assert direction_at(arrays, niche.boundary, 0, 1.2, y, 0.15)[1] < -0.7


def test_bent_dead_end_is_followed_around_its_corner():
    niche = box(1, 5, 1.4, 8).union(box(-1, 7.6, 1.4, 8))
    geometry = Geometry.from_polygon(ROOM.union(niche), exits=[DOOR])
    arrays = join_fields([travel_time_field(geometry, RADIUS)], geometry.boundary)
    for x in np.arange(-0.9, 0.25, 0.1):
        assert direction_at(arrays, geometry.boundary, 0, x, 7.8, 0.15)[0] > 0.85


def test_exits_that_are_not_used_are_kept_off_like_walls():
    geometry = Geometry.from_polygon(box(0, 0, 10, 2), exits={"side": [[4, 0], [6, 0]], "end": [[10, 0], [10, 2]]})
    arrays = join_fields([travel_time_field(geometry, RADIUS, exits=["end"])], geometry.boundary)
    assert direction_at(arrays, geometry.boundary, 0, 5.0, 0.1, RADIUS)[1] > 0.3
    assert direction_at(arrays, geometry.boundary, 0, 5.0, 0.3, RADIUS) == pytest.approx((1, 0))


@pytest.mark.filterwarnings("ignore:no exit can be reached from a part")
def test_closed_pocket_smaller_than_a_body_is_no_error():
    pocket = Geometry.from_polygon(MultiPolygon([ROOM, box(6, 0, 6.4, 0.4)]), exits=[DOOR])
    arrays = join_fields([travel_time_field(pocket, RADIUS)], pocket.boundary)
    assert np.hypot(*direction_at(arrays, pocket.boundary, 0, 6.2, 0.2, RADIUS)) == pytest.approx(1)


def test_spacing_is_fine_in_a_room():
    assert plan("room")[1].spacing == 0.05


@pytest.mark.more
def test_spacing_is_bounded_in_a_hall():
    hall = Geometry.from_polygon(box(0, 0, 120, 90), exits=[[[0, 10], [0, 12]]])
    assert travel_time_field(hall, RADIUS, min_radius=0.2).spacing == pytest.approx(0.1)


@looped(
    ("build", "message"),
    [
        (
            lambda: travel_time_field(Geometry.from_polygon(ROOM, exits=[[[5, 2], [5, 2.3]]]), 0.25, min_radius=0.2),
            r"exit 'exit-0' is 0.30 m wide, narrower than the smallest body \(0.40 m\)",
        ),
        (lambda: travel_time_field(gap(0.3), 0.25, min_radius=0.2), r"no exit can be reached from \(.*diameter 0.40 m"),
        (
            lambda: travel_time_field(
                Geometry.from_polygon(ROOM, exits=[DOOR], thin_walls=[[(0, 2), (2, 2), (2, 0)]]), RADIUS
            ),
            r"no exit can be reached from \([01]\.\d+, [01]\.\d+\)",
        ),
        (
            lambda: travel_time_field(
                Geometry.from_polygon(ROOM, exits={"a": DOOR, "b": [[0, 2], [0, 3]]}, obstacles=[box(0.1, 1, 0.5, 4)]),
                RADIUS,
            ),
            "the way to exit 'b' is blocked",
        ),
        (lambda: travel_time_field(Geometry.from_polygon(ROOM), RADIUS), "the geometry has no exit"),
        (lambda: travel_time_field(plan("room")[0], RADIUS, exits=["door"]), r"\['door'\].*choose from \['exit-0'\]"),
        (lambda: travel_time_field(plan("room")[0], 0.2, min_radius=0.3), "0 < min_radius <= radius"),
        (lambda: travel_time_field(plan("room")[0], float("nan")), "0 < min_radius <= radius"),
        (
            lambda: travel_time_field(Geometry.from_polygon(box(0, 0, 5000, 5000), exits=[[[0, 0], [0, 60]]]), RADIUS),
            "needs more than .* nodes; check that its coordinates are in meters",
        ),
    ],
)
def test_impossible_fields_are_refused_in_one_sentence(build, message):
    with pytest.raises(ValueError, match=message) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_the_way_out_has_a_length_beside_the_walls_of_a_tight_place_too():
    geometry = gap(0.58)
    quick = RoutePlan(geometry, RADIUS, routes=[Route("quick", strategy="fastest")]).build().routes[-1]
    points = np.random.default_rng(0).uniform((0, 0), (8, 5), (2000, 2))
    points = points[geometry.contains(points)]
    known = quick.congestion.march(), travel_time_field(geometry, RADIUS)
    fields = [join_fields([field], geometry.boundary) for field in known]
    length = [[travel_time_at(field, geometry.boundary, 0, *point, RADIUS) for point in points] for field in fields]
    beside = geometry.clearance(points) < 0.1
    assert beside.sum() > 100
    # The time of the nearest node alone, without the way to it, is up to half a meter short.
    np.testing.assert_allclose(*np.array(length)[:, beside], rtol=0.05, atol=0.15)


def test_connected_parts_are_those_of_scipy():
    rng = np.random.default_rng(0)
    for share in (0.3, 0.5, 0.6, 0.7, 1.0):
        free, seeds = rng.random((40, 60)) < share, rng.random((40, 60)) < 0.01
        label, (parts, count) = connected_parts(free, seeds), ndimage.label(free)
        reached = np.unique(parts[seeds & free])
        np.testing.assert_array_equal(label == 1, np.isin(parts, reached) & free)
        np.testing.assert_array_equal(label == 0, ~free)
        pairs = np.unique(np.stack([parts, label], axis=-1)[label > 1], axis=0)
        assert len(pairs) == count - len(reached) == label.max() - 1  # one number each
