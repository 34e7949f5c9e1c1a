"""Ways as data: quickest ways against closed forms and a visibility graph, routes by name, and one sentence for wrong input.

The yardstick for lengths is Dijkstra's algorithm on the corners of the plan shrunk by a body radius (shapely and scipy,
nothing of the code under test).  For speed maps it is Fermat's principle: the least time over the place of crossing.
"""

import functools

import numpy as np
import pytest
import shapely
from cases import looped
from late import late
from navigation_plans import RADIUS, exit_targets, shortest
from shapely.geometry import LineString, Point, box

from crowd_env.core.kernels.jit import kernel
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at, travel_time_at
from crowd_env.routing.route_set import RoutePlan, region_masks
from crowd_env.routing.spec import ControlRule, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone, jutting_corners
from crowd_env.scenarios.population import Population, Uniform
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario

minimize_scalar = late("scipy.optimize", "minimize_scalar")

WEST_EAST = {"west": [(0, 1), (0, 3)], "east": [(12, 1), (12, 3)]}


def random_obstacles():
    """Return boxes of random size and turn, with room for a body between any two of them and the walls."""
    rng = np.random.default_rng(7)
    placed = []
    while len(placed) < 9:
        shape = box(0, 0, *rng.uniform(0.3, 1.4, 2))
        shape = shapely.affinity.rotate(shape, rng.uniform(0, 90))
        shape = shapely.affinity.translate(shape, *rng.uniform((1, 0), (8, 6.5)))
        if box(0.7, 0.7, 9.3, 7.3).contains(shape) and all(shape.distance(other) > 0.7 for other in placed):
            placed.append(shape)
    return placed


L_SHAPE = [(0, 0), (6, 0), (6, 6), (4.5, 6), (4.5, 1.5), (0, 1.5)]
U_TURN = [(0, 0), (5, 0), (5, 5), (0, 5), (0, 3.5), (3.5, 3.5), (3.5, 1.5), (0, 1.5)]
PLANS = {  # outline, exit, obstacles, and a region to walk to
    "corner": (L_SHAPE, [(4.5, 6), (6, 6)], [], box(4.5, 4, 6, 6)),
    "u-turn": (U_TURN, [(0, 3.5), (0, 5)], [], box(0, 3.5, 0.8, 5)),
    "pillar": (box(0, 0, 6, 5), [(6, 2), (6, 3)], [Point(4, 2.5).buffer(0.6)], Point(5.2, 2.5).buffer(0.3)),
    "obstacles": (box(0, 0, 10, 8), [(10, 3.5), (10, 4.5)], random_obstacles(), box(8.9, 6.8, 10, 8)),
}


@functools.cache
def plan(name, goal):
    outline, door, obstacles, region = PLANS[name]
    geometry = Geometry.from_polygon(outline, exits=[door], obstacles=obstacles, regions={"goal": region})
    field = travel_time_field(geometry, RADIUS, goal=goal)
    return geometry, field, join_fields([field], geometry.boundary)


@kernel
def walk(field, boundary, x, y, radius, path):
    """Follow the direction from (x, y) in steps of 1 cm until the way is shorter than one; return how many points."""
    for n in range(len(path)):
        path[n, 0], path[n, 1] = x, y
        if travel_time_at(field, boundary, 0, x, y, radius) < 0.01:
            return n + 1
        ex, ey = direction_at(field, boundary, 0, x, y, radius)
        x, y = x + 0.01 * ex, y + 0.01 * ey
    return 0


def follow(arrays, geometry, start):
    path = np.empty((4000, 2))
    count = walk(arrays, geometry.boundary, *start, RADIUS, path)
    assert count > 0, f"from {start} nowhere"
    return path[:count]


def starts(geometry, count, seed):
    x0, y0, x1, y1 = geometry.bounds
    points = np.random.default_rng(seed).uniform((x0, y0), (x1, y1), (count, 2))
    return points[geometry.contains(points) & (geometry.clearance(points) > RADIUS + 1e-3)]


def shortest_way(geometry, points, goal):
    """Return the length of the shortest way of a disc from each of ``points`` to the exits or into a region."""
    lines = [*geometry.walls, *(geometry.exits if goal else [])]
    targets = exit_targets(geometry)
    if goal:
        free = geometry.walkable.difference(shapely.buffer(shapely.MultiLineString(lines), RADIUS - 1e-4, quad_segs=8))
        border = shapely.intersection(geometry.regions[goal].boundary, free)
        targets = shapely.get_coordinates(shapely.segmentize(border, 0.05))
    return shortest(geometry, points, targets, lines=lines, quad_segs=8)


# ----------------------------------------------------------------------------------------------------- lengths of ways


@looped("goal", [None, "goal"])
@pytest.mark.parametrize("name", PLANS)
def test_times_and_paths_are_the_shortest_to_exits_and_into_regions(name, goal):
    geometry, field, arrays = plan(name, goal)
    points = starts(geometry, 60, seed=3)
    if goal:
        points = points[~geometry.contains(points, goal)]
    exact = shortest_way(geometry, points, goal)
    times = np.array([travel_time_at(arrays, geometry.boundary, 0, *point, RADIUS) for point in points])
    paths = [follow(arrays, geometry, point) for point in points]
    walked = np.array([np.hypot(*np.diff(path, axis=0).T).sum() for path in paths])
    far = exact > 2.5  # nearer than that, a spacing of the grid is more than 2 %
    assert far.sum() > 10
    for length in (times, walked):
        np.testing.assert_allclose(length[far], exact[far], rtol=0.02, atol=0.02)
        np.testing.assert_allclose(length, exact, rtol=0.02, atol=field.spacing)
    assert min(geometry.clearance(path).min() for path in paths) > RADIUS - field.spacing


# ---------------------------------------------------------------------------------------------------------- speed maps


@looped("share", [0.4, 0.7])
def test_ways_into_slow_ground_are_bent_as_snell_says(share):
    # The goal is a small disc 3 m deep in slow ground; the way is straight on either side of the line y = 4.
    geometry = Geometry.from_polygon(
        box(0, 0, 12, 9), exits=[[(0, 0), (0, 1)]], regions={"goal": Point(9, 7).buffer(0.1)}
    )
    field = travel_time_field(
        geometry, RADIUS, goal="goal", speed=lambda points: np.where(points[..., 1] > 4, share, 1.0)
    )
    arrays = join_fields([field], geometry.boundary)
    for x, y in ((1.0, 1.0), (3.0, 2.0), (6.0, 0.7), (9.0, 1.5), (2.0, 3.0)):
        best = minimize_scalar(
            lambda c, x=x, y=y: np.hypot(c - x, 4 - y) + (np.hypot(9 - c, 3) - 0.1) / share,
            bounds=(x, 9),
            method="bounded",
        )
        assert travel_time_at(arrays, geometry.boundary, 0, x, y, RADIUS) == pytest.approx(best.fun, rel=0.02)
        ahead = np.array([best.x - x, 4 - y])
        ex, ey = direction_at(arrays, geometry.boundary, 0, x, y, RADIUS)
        assert np.degrees(np.arccos(np.dot((ex, ey), ahead / np.hypot(*ahead)))) < 4
        sine, there = ahead[0] / np.hypot(*ahead), (9 - best.x) / np.hypot(9 - best.x, 3)
        assert sine * share == pytest.approx(
            there, abs=1e-3
        )  # the yardstick itself: sin a / v is the same on both sides


def detour_hall(slow):
    """Return a hall in which slow ground up to y = 3 lies between the left half and the exit; around it, all is plain."""
    return Geometry.from_polygon(box(0, 0, 12, 8), exits={"east": [(12, 0.5), (12, 1.5)]}, regions={"stairs": slow})


def around(start, slow):
    """Return the length of the way from ``start`` over the upper corners of slow ground to the exit of the hall."""
    left, _, right, top = slow.bounds
    return np.hypot(left - start[0], top - start[1]) + right - left + np.hypot(12 - right, top - 1.25)


@looped("share", [0.3, 0.6, 0.66, 0.72, 0.9])
def test_around_or_through_slow_ground_whatever_is_quicker(share):
    # From (2, 1) through two meters of slow ground it takes 8 + 2 / share, around 10.9: they break even at 0.69.
    slow = box(5, 0, 7, 3)
    geometry = detour_hall(slow)

    def speed(points):
        return np.where(shapely.intersects_xy(slow, points[..., 0], points[..., 1]), share, 1.0)

    arrays = join_fields([travel_time_field(geometry, RADIUS, speed=speed)], geometry.boundary)
    exact = min(8 + 2 / share, around((2, 1), slow))
    assert travel_time_at(arrays, geometry.boundary, 0, 2.0, 1.0, RADIUS) == pytest.approx(exact, rel=0.025)
    path = LineString(follow(arrays, geometry, (2.0, 1.0)))
    assert (path.intersection(slow).length > 1.5) == (share > 0.69)


# -------------------------------------------------------------------------------------------------------------- routes


def hall(**options):
    return Geometry.from_polygon(box(0, 0, 12, 4), exits=WEST_EAST, **options)


def time_at(route_set, name, x, y):
    arrays = join_fields([route_set.routes[route_set.number(name)].field], route_set.geometry.boundary)
    return travel_time_at(arrays, route_set.geometry.boundary, 0, x, y, RADIUS)


def test_a_route_leads_to_its_exits_only_and_out_to_the_best():
    route_set = RoutePlan(hall(), RADIUS, routes=[Route("left", ("west",)), Route("both", ("west", "east"))]).build()
    for x in (1.0, 4.0, 8.0, 11.0):
        assert time_at(route_set, "left", x, 2.0) == pytest.approx(x, abs=1e-6)
        assert time_at(route_set, "out", x, 2.0) == pytest.approx(min(x, 12 - x), abs=1e-6)
        assert time_at(route_set, "both", x, 2.0) == time_at(route_set, "out", x, 2.0)
    assert [way.name for way in route_set.routes] == ["out", "left", "both"]
    assert not route_set.is_dynamic


def test_a_route_via_a_region_has_two_halves():
    route_set = RoutePlan(
        hall(regions={"bay": box(8, 3, 9, 4)}), RADIUS, routes=[Route("detour", ("west",), via="bay")]
    ).build()
    first, then = route_set.routes[route_set.number("detour")], route_set.routes[route_set.number("detour/then")]
    assert (first.goal, first.following) == (0, route_set.number("detour/then"))
    assert (then.goal, then.following) == (-1, -1)
    assert time_at(route_set, "detour", 4.0, 2.0) == pytest.approx(np.hypot(4, 1), rel=0.02)
    assert time_at(route_set, "detour/then", 8.0, 2.0) == pytest.approx(8.0, abs=1e-6)


def test_a_route_leads_to_its_regions_in_turn():
    place = hall(regions={"bay": box(8, 3, 9, 4), "nook": box(2, 3, 3, 4)})
    route_set = RoutePlan(place, RADIUS, routes=[Route("round", ("west",), via=("bay", "nook"))]).build()
    first = route_set.routes[route_set.number("round")]
    second = route_set.routes[first.following]
    last = route_set.routes[second.following]
    assert (first.goal, second.goal, last.goal, last.following) == (0, 1, -1, -1)
    at = np.array([[5.0, 3.5]])
    on_foot = 3.0 + 5.0 + 3.0  # to the bay, back to the nook, and out
    assert first.potential.travel_time_for(at, 0.0)[0] == pytest.approx(on_foot, rel=0.03)
    people = Population(1, starts=[(5.0, 3.5)], route="round")
    routes = (Route("round", ("west",), via=["bay", "nook"]),)
    env = CrowdEnv(Scenario("round", place, people, 60.0, routes=routes))
    env.reset(seed=0)
    seen = []
    while not env.finished.all():
        env.step(None)
        seen += [name for name in place.regions if place.contains(env.simulation.state.position, name)[0]]
    assert list(dict.fromkeys(seen)) == ["bay", "nook"] and np.isfinite(env.simulation.state.exit_time[0])


def test_nearest_is_the_exit_of_the_shortest_way_not_of_the_shortest_line():
    # The west exit is behind a wall that reaches up to y = 3.2, which makes the way longer than the line.
    geometry = Geometry.from_polygon(
        box(0, 0, 8, 4), exits={"west": [(0, 0), (0, 1.5)], "east": [(8, 0), (8, 1.5)]}, thin_walls=[[(3, 0), (3, 3.2)]]
    )
    scenario = Scenario("n", geometry, Population(3, radius=Uniform(RADIUS, RADIUS)), 10.0, **FULL_SPEED)
    route_set = scenario.route_set("nearest")
    points = starts(geometry, 200, seed=5)
    by_length = np.array([[time_at(route_set, name, *point) for name in ("west", "east")] for point in points])
    sure = np.abs(by_length[:, 0] - by_length[:, 1]) > 0.1
    chosen = scenario.choose(route_set, "nearest", points)
    np.testing.assert_array_equal(
        chosen[sure], np.where(by_length[sure].argmin(axis=1) == 0, route_set.number("west"), route_set.number("east"))
    )
    by_line = np.array([route_set.number(geometry.exit_names[k]) for k in geometry.nearest_exit(points)])
    assert (chosen != by_line).mean() > 0.03


# ------------------------------------------------------------------------------------------------------------- comfort


@looped(("length", "avoids"), [(0.1, False), (1.0, True), (2.0, True)])
def test_comfort_goes_around_stairs_when_the_detour_is_cheaper(length, avoids):
    # From (2, 1) with stairs of this length in the middle: through costs 3 m more for every meter of stairs.
    stairs = box(6 - length / 2, 0, 6 + length / 2, 3)
    detour = around((2, 1), stairs)
    assert avoids == (detour < 10 + 3 * length)
    geometry = detour_hall(stairs)
    routes, zones = [Route("easy", strategy="comfortable")], [SpeedZone("stairs", speed=0.5)]
    route_set = RoutePlan(geometry, RADIUS, routes=routes, zones=zones, comfort=Comfort(3.0, 0.0)).build()
    field = route_set.routes[route_set.number("easy")].field
    path = LineString(follow(join_fields([field], geometry.boundary), geometry, (2.0, 1.0)))
    assert (path.intersection(stairs).length < 0.1 * length) == avoids
    assert time_at(route_set, "easy", 2.0, 1.0) == pytest.approx(min(detour, 10 + 3 * length), rel=0.025)
    assert time_at(route_set, "out", 2.0, 1.0) == pytest.approx(10.0, abs=0.01)


def test_corners_that_jut_into_the_way_are_found():
    l_shape = Geometry.from_polygon([(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)])
    assert jutting_corners(l_shape.boundary).tolist() == [[3.0, 3.0]]
    block = Geometry.from_polygon(box(0, 0, 8, 8), obstacles=[box(3, 3, 5, 4)])
    assert sorted(jutting_corners(block.boundary).tolist()) == [[3, 3], [3, 4], [5, 3], [5, 4]]
    screen = Geometry.from_polygon(box(0, 0, 8, 8), thin_walls=[[(4, 2), (4, 5)]])
    assert sorted(jutting_corners(screen.boundary).tolist()) == [[4, 2], [4, 5]]
    assert len(jutting_corners(Geometry.from_polygon(box(0, 0, 4, 4)).boundary)) == 0


# ------------------------------------------------------------------------------------------------- regions on the way


def test_regions_on_the_way_in_a_loop_of_corridors():
    # A ring of corridors around a block: who is left of the middle passes the west bar, who is right of it the east one.
    bars = {"west": box(1, 4, 3, 4.4), "east": box(7, 4, 9, 4.4), "top": box(1, 8.5, 9, 9), "attic": box(4, 8.6, 6, 9)}
    geometry = Geometry.from_polygon(
        box(1, 1, 9, 9), exits={"door": [(4.5, 1), (5.5, 1)]}, obstacles=[box(3, 3, 7, 7)], regions=bars
    )
    field = RoutePlan(geometry, RADIUS, rules=[ControlRule("west", 3, "door")]).build().routes[0].field
    x, y = np.moveaxis(field.nodes(), -1, 0)
    assert (x[0, 0], y[0, 0]) == (1, 1) and np.allclose([x[0, -1], y[-1, 0]], 9)
    inside = ~np.isnan(field.travel_time) & (np.abs(x - 5) > 0.2)
    own = region_masks(geometry, field.nodes())
    np.testing.assert_array_equal((own >> 3 & 1)[inside], ((x >= 4) & (x <= 6) & (y >= 8.6))[inside])
    for bit, side in ((0, x < 5), (1, x > 5)):
        np.testing.assert_array_equal((field.through >> bit & 1)[inside], (side & (y >= 4))[inside])
    np.testing.assert_array_equal((field.through >> 2 & 1)[inside & (y < 8)], False)


def test_regions_on_the_way_are_those_that_the_path_walks_through():
    regions = {"on": box(4.5, 3.8, 5.5, 4.8), "off": box(4.5, 1, 5.5, 2.3)}
    geometry = Geometry.from_polygon(box(0, 0, 10, 8), exits={"door": [(10, 0.5), (10, 1.5)]}, regions=regions)
    field = RoutePlan(geometry, RADIUS, rules=[ControlRule("on", 3, "door")]).build().routes[0].field
    arrays = join_fields([field], geometry.boundary)
    for point in starts(geometry, 100, seed=6):
        path = LineString(follow(arrays, geometry, point))
        bits = field.through[tuple(np.rint(point[::-1] / field.spacing).astype(int))]
        for k, area in enumerate(regions.values()):
            distance, depth = path.distance(area), path.intersection(area.buffer(-0.15)).length
            assert not (bits >> k & 1 and distance > 0.15), f"from {point} not through {k}"
            assert bits >> k & 1 or depth == 0, f"from {point} through {k}"


# --------------------------------------------------------------------------------------------------------- wrong input


@looped(
    ("options", "message"),
    [
        ({"routes": [Route("a", ("north",))]}, "route 'a' names an unknown exit 'north'; known: west, east"),
        ({"routes": [Route("a", via="hall")]}, "route 'a' names an unknown region 'hall'; known: bay"),
        ({"routes": [Route("a", via=("bay", "hall"))]}, "route 'a' names an unknown region 'hall'; known: bay"),
        ({"routes": [Route("a"), Route("a")]}, "route 'a': the name is taken or holds a '/'; take another"),
        ({"routes": [Route("out")]}, "route 'out': the name is taken"),
        ({"routes": [Route("a/b")]}, "route 'a/b': the name is taken or holds a '/'"),
        ({"routes": [Route("west", ("east",))]}, "route 'west' has the name of an exit; it must lead to that exit alo"),
        ({"zones": [SpeedZone("x", factor=0.5)]}, "speed zone names an unknown region 'x'; known: bay"),
        ({"rules": [ControlRule("x", 1, "west")]}, "control rule names an unknown region 'x'; known: bay"),
        ({"rules": [ControlRule("bay", 1, "x")]}, "control rule on 'bay' names an unknown route 'x'; known: .*out"),
    ],
)
def test_unknown_and_taken_names_are_refused_in_one_sentence(options, message):
    with pytest.raises(ValueError, match=message) as caught:
        RoutePlan(hall(regions={"bay": box(8, 3, 9, 4)}), RADIUS, **options).build()
    assert "\n" not in str(caught.value)


def test_other_impossible_ways_are_refused():
    with pytest.raises(ValueError, match=r"unknown route 'x'; known: out, a$"):
        RoutePlan(hall(regions={"bay": box(8, 3, 9, 4)}), RADIUS, routes=[Route("a", via="bay")]).build().number("x")
    many = {f"r{k}": box(k / 10, 1, k / 10 + 0.1, 2) for k in range(63)}
    with pytest.raises(ValueError, match="63 regions; a plan may have at most 62"):
        RoutePlan(hall(regions=many), RADIUS).build()
    inside_wall = hall(regions={"nook": box(5, 3.9, 5.1, 4)})
    with pytest.raises(ValueError, match=r"the region that the way leads to can.* be reached"):
        RoutePlan(inside_wall, RADIUS, routes=[Route("a", via="nook")]).build()
    scenario = Scenario("n", hall(), Population(2), 10.0, **FULL_SPEED)
    with pytest.raises(ValueError, match="n: unknown strategy 'x'; known: shortest, nearest, fastest, comfortable, w"):
        scenario.route_set("x")
