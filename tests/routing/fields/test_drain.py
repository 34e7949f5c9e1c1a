"""How people who keep a distance spread over wide openings."""

import numpy as np
import pytest
from cases import looped
from shapely import transform
from shapely.geometry import box

from crowd_env import CrowdEnv, Population, Scenario, Simulation, Uniform, make_scenario, make_state
from crowd_env.core.arrays.state import make_bodies
from crowd_env.geometry.geometry import Geometry, turning
from crowd_env.routing.fields.drain import spread
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at
from crowd_env.routing.route_set import RoutePlan
from crowd_env.scenarios.buildings import Level, Stair, building
from validation.cases.case import Setting, adults
from validation.cases.crowds import Passages, draw_crowds, mean_of, steady_flow

RADIUS = 0.19


def hall(width, depth=7.0, half=6.0):
    """Return a hall with an exit of ``width`` in the middle of its right wall, at x = 0."""
    return Geometry.from_polygon(box(-depth, -half, 0, half), exits={"out": [(0, -width / 2), (0, width / 2)]})


def fields(geometry):
    """Return the field of the shortest ways, and that of people who spread."""
    shortest = travel_time_field(geometry, RADIUS)
    return shortest, spread(shortest, geometry.walls_when()[0])


def walk(geometry, field, points, step=0.05):
    """Return where walks from ``points`` (K, 2), one after the other, leave the hall at x = 0."""
    arrays = join_fields([field], geometry.boundary)
    ends = []
    for x, y in points:
        for _ in range(1000):
            ex, ey = direction_at(arrays, geometry.boundary, 0, x, y, RADIUS)
            x, y = x + step * ex, y + step * ey
            if x >= 0.0:
                ends.append(y)
                break
    return np.array(ends)


def test_a_full_hall_drains_evenly_over_the_whole_width_of_an_opening():
    geometry, share = hall(5.0), []
    points = np.random.default_rng(0).uniform((-6.8, -5.8), (-0.5, 5.8), (600, 2))
    for field in fields(geometry):
        ends = walk(geometry, field, points)
        assert len(ends) == len(points)
        share.append(np.histogram(ends, 5, (-2.5, 2.5))[0] / len(points))
    assert np.abs(share[1] - 0.2).max() < 0.06
    assert share[0][[0, 4]].min() > 0.3  # shortest ways file along the ends


@looped("angle", [0.0, 25.0])
def test_a_corridor_drains_straight(angle):
    along, turn = np.array([1.0, 0.0]), np.radians(angle)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners = np.array([(-8, -2.5), (0, -2.5), (0, 2.5), (-8, 2.5)]) @ turned.T
    corridor = Geometry.from_polygon(corners, exits={"out": corners[1:3]})
    _, field = fields(corridor)
    points = np.random.default_rng(1).uniform((-7.5, -1.8), (-0.5, 1.8), (200, 2)) @ turned.T
    arrays = join_fields([field], corridor.boundary)
    off = [turned @ along @ direction_at(arrays, corridor.boundary, 0, x, y, RADIUS) for x, y in points]
    assert np.quantile(off, 0.05) > np.cos(np.radians(6.0))


def test_at_a_corner_the_way_does_not_jump():
    """From node to node, 5 cm, not even where the outer part of a stream turns."""
    place = Geometry.from_polygon([box(-8, -1.5, 1.5, 1.5), box(-1.5, -1.5, 1.5, 8)], exits=[[(-1.5, 8), (1.5, 8)]])
    _, field = fields(place)
    x, y = np.moveaxis(field.nodes(), -1, 0)
    beside = field.free & (np.hypot(x + 1.5, y - 1.5) > 0.5)  # around the inner end the way itself turns
    alike = (field.direction[:, 1:] * field.direction[:, :-1]).sum(axis=-1)[beside[:, 1:] & beside[:, :-1]]
    assert alike.min() > np.cos(np.radians(25.0))


def test_what_comes_through_narrow_openings_holds_its_place_in_the_flow_beyond():
    """Two lanes lead into a passage; a stream from its far end stays on the far side of it."""
    lanes = [box(2.0 + 1.6 * k, 3.0, 3.0 + 1.6 * k, 9.0) for k in range(2)]
    place = Geometry.from_polygon([box(0, 0, 9, 3), *lanes], exits={"out": [(0, 3), (0, 0)]})
    _, field = fields(place)
    arrays = join_fields([field], place.boundary)
    assert direction_at(arrays, place.boundary, 0, 2.5, 2.5, RADIUS)[1] < -0.2
    assert direction_at(arrays, place.boundary, 0, 6.5, 2.5, RADIUS)[1] == pytest.approx(0.0, abs=0.05)


@looped("name", ["t-junction-v0", "supermarket-v0", "stadium-sector-v0", "theatre-v0"], quick=2)
def test_every_step_makes_the_shortest_way_shorter(name):
    geometry = make_scenario(name).geometry
    shortest, field = fields(geometry)
    changed = (field.direction != shortest.direction).any(axis=-1)
    assert changed.any() and (field.direction * shortest.direction).sum(axis=-1)[changed].min() > 0.0
    np.testing.assert_array_equal(field.travel_time, shortest.travel_time)


@looped("width", [0.7, 0.9, 1.0])
def test_in_front_of_a_narrow_opening_people_take_the_shortest_way(width):
    inner = Geometry.from_polygon([box(-5, -3, 0, 3), box(-0.1, -width / 2, 0.3, width / 2), box(0.3, -3, 4, 3)],
                                  exits=[[(4, -3), (4, 3)]])  # fmt: skip
    for geometry in (hall(width), inner):
        shortest, field = fields(geometry)
        x, y = np.moveaxis(shortest.nodes(), -1, 0)
        before = (np.abs(x + 0.55) < 0.4) & (np.abs(y) < 0.45)
        np.testing.assert_array_equal(field.direction[before], shortest.direction[before])
        np.testing.assert_array_equal(field.cell[before], shortest.cell[before])


def planner_of(route_set, manner):
    bodies, state = make_bodies(np.full(1, RADIUS), 80.0), make_state(np.array([[-3.0, 0.0]]))
    return Simulation(route_set.geometry, bodies, state, walking=manner, fields=[route_set]).planner


def test_people_spread_if_they_keep_a_distance_and_follow_a_path():
    plan = RoutePlan(hall(5.0), RADIUS)
    shortest, field = fields(hall(5.0))
    for manner, expected in (("competitive", shortest), ("hurried", field), ("calm", field)):
        found = planner_of(plan.build(), manner).field
        np.testing.assert_array_equal(found.direction, expected.direction.reshape(-1, 2))
    straight = RoutePlan(hall(5.0), RADIUS, target="nearest").build()
    plain, kept = (planner_of(straight, manner).field for manner in ("competitive", "hurried"))
    np.testing.assert_array_equal(kept.direction, plain.direction)
    np.testing.assert_array_equal(kept.cell, plain.cell)


def test_people_spread_over_what_a_closed_door_leaves():
    exits = {"a": [(0, -4), (0, -1)], "b": [(0, 1), (0, 4)]}
    geometry = Geometry.from_polygon(box(-7, -6, 0, 6), exits=exits)
    route_set = RoutePlan(geometry, RADIUS).build()
    planner = planner_of(route_set, "hurried")
    planner.close(0, frozenset({"a"}))
    row = int(planner.guidance.field_of_route[0, 0])
    found = planner.field.direction[planner.field.node_start[row] : planner.field.node_start[row + 1]]
    expected = spread(route_set.when(frozenset({"a"})).routes[0].field, geometry.walls_when({"a"})[0])
    np.testing.assert_array_equal(found, expected.direction.reshape(-1, 2))


def waiting(width):
    """Return people in front of a door of ``width`` [m] in a wall 12 m wide, at 3 /m2, 50 for each meter of it."""
    count = max(80, round(50 * width))
    back = -0.5 - count / 36.0
    floor = [box(back, -6, 0, 6), box(-0.1, -width / 2, 0.4, width / 2), box(0.3, -6, 3.3, 6)]
    place = Geometry.from_polygon(
        floor, exits={"out": [(3.3, -6), (3.3, 6)]}, regions={"waiting": box(back, -6, -0.5, 6)}
    )
    return Scenario("waiting", place, adults(count, start_region="waiting"), 300.0)


@pytest.mark.more
@looped("strategy", ["shortest", "fastest"])
def test_as_many_pass_a_meter_of_a_wide_door_as_of_a_narrow_one(strategy):
    # Recorded flow per meter does not fall with width (Seyfried et al. 2009).
    flow = []
    for width in (1.0, 5.0):
        crowds = draw_crowds([waiting(width)], Setting("dem", "hurried", draws=5, strategy=strategy))
        passages = Passages(crowds, 0, 0.3)
        assert not passages.watch(300.0, 20.0)
        flow.append(mean_of([steady_flow(passages.times(e)) / width for e in range(5)]))
    assert flow[1] > 0.92 * flow[0]  # means of five draws; by shortest ways along its ends it is a third


def test_people_keep_to_the_exit_of_the_shortest_way():
    exits = {"wide": [(0, -6), (0, -2)], "less": [(0, 3), (0, 4.2)]}
    geometry = Geometry.from_polygon(box(-7, -6.5, 0, 6), exits=exits)
    points = np.random.default_rng(2).uniform((-6.8, -5.8), (-0.5, 5.8), (400, 2))
    shortest, spreading = (walk(geometry, field, points) > 0.0 for field in fields(geometry))
    assert (shortest != spreading).mean() < 0.01


@looped("angle", [0.0, 17.0, 34.0, 56.0, 73.0])
def test_in_front_of_an_exit_the_fastest_way_leads_out(angle):
    """Of people who keep a distance, within the spacing of the marched field, whichever way the exit faces."""
    turn = turning(np.radians(angle))
    exits = {name: turn(np.array(line)) for name, line in (("narrow", [(0, 3), (0, 3.61)]), ("wide", [(7, 2), (7, 4)]))}
    geometry = Geometry.from_polygon(transform(box(0, 0, 7, 8), turn), exits=exits)
    body = {"radius": Uniform(0.226, 0.226), "desired_speed": Uniform(1.0, 1.0)}
    env = CrowdEnv(Scenario("room", geometry, Population(42, **body), 60.0), walking="hurried", routing="fastest")
    env.reset(0)
    names, position = [route.name for route in env.route_set[0].routes], env.simulation.state.position
    inside = turn(np.array([3.5, 4.0]))
    for a, b in np.asarray(geometry.exits).reshape(-1, 2, 2):
        along, middle = (b - a) / np.hypot(*(b - a)), (a + b) / 2
        out = np.array([along[1], -along[0]])
        out *= np.sign(out @ (middle - inside))
        half = np.hypot(*(b - a)) / 2 - 0.23
        points = [middle - d * out + s * half * along for d in (0.01, 0.05, 0.1, 0.2) for s in (-1, -0.5, 0, 0.5, 1)]
        position[: len(points)] = points
        env.simulation.state.route[:] = names.index("fastest")
        env.observer.observe(env.active)
        assert (env.observer.view.direction[: len(points)] @ out).min() > 0.5


@looped("width", [1.4, 2.0, 2.4])
def test_a_hall_drains_evenly_over_a_stair(width):
    levels = [
        Level("hall", 0.0, box(-10, -4, 0, 4)),
        Level("above", 3.78, box(5.88, -2, 8, 2), exits={"out": [(8, -1), (8, 1)]}),
    ]
    geometry = building(levels, [Stair("stair", "hall", "above", (0.0, 0.0), 0.0, width, 0.18)])
    field = RoutePlan(geometry, RADIUS).build().spread.routes[0].field
    found = field.direction[field.windows[0].nodes][4:-4, 40:180]
    np.testing.assert_allclose(
        found[::-1] * (1.0, -1.0), found, atol=0.05
    )  # as the hall, its ways are their mirror image
