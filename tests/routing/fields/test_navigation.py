"""Navigation: people who follow the field get out, by the shortest way there is, and never into a wall.

The shortest way is known twice over: in closed form where the plan is simple, and from a visibility graph of the dilated
plan (shapely and Dijkstra's algorithm, nothing of the code under test) everywhere else.
"""

import numpy as np
import pytest
import shapely
from cases import looped
from navigation_plans import DOOR, PLANS, RADIUS, ROOM, exit_targets, plan, shortest

from crowd_env.core.kernels.jit import kernel
from crowd_env.geometry.geometry import Geometry, join_boundaries
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import direction_at, exit_frame, nearest_on_exit, travel_time_at

STEP = 0.01


@kernel
def walk(field, boundary, x, y, radius, step, path):
    """Follow the direction from (x, y) until an exit line is crossed; return the number of points and the exit."""
    for n in range(len(path) - 1):
        path[n, 0], path[n, 1] = x, y
        ex, ey = direction_at(field, boundary, 0, x, y, radius)
        nx, ny = x + step * ex, y + step * ey
        for k in range(len(boundary.exit)):
            a, b = boundary.exit[k, 0], boundary.exit[k, 1]
            ux, uy = b[0] - a[0], b[1] - a[1]
            here, there = ux * (y - a[1]) - uy * (x - a[0]), ux * (ny - a[1]) - uy * (nx - a[0])
            if here >= -1e-12 and there < 0:
                t = here / (here - there)
                cx, cy = x + t * (nx - x), y + t * (ny - y)
                if 0 <= (cx - a[0]) * ux + (cy - a[1]) * uy <= ux * ux + uy * uy:
                    path[n + 1, 0], path[n + 1, 1] = cx, cy
                    return n + 2, k
        x, y = nx, ny
    return len(path), -1


def follow(name, start, radius=RADIUS):
    geometry, _, arrays = plan(name)
    path = np.empty((3000, 2))
    count, exit_row = walk(arrays, geometry.boundary, *start, radius, STEP, path)
    return path[:count], exit_row


def path_length(path):
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def starts(geometry, count, seed=1):
    x0, y0, x1, y1 = geometry.bounds
    points = np.random.default_rng(seed).uniform((x0, y0), (x1, y1), (count, 2))
    return points[geometry.contains(points)]


def beside_walls(geometry, distance):
    """Return places at ``distance`` from the walls, those of a round column left out."""
    a, b = geometry.walls[np.hypot(*(geometry.walls[:, 1] - geometry.walls[:, 0]).T) > 0.3].swapaxes(0, 1)
    along = (b - a) / np.hypot(*(b - a).T)[:, None]
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.concatenate([a + share * (b - a) + distance * inward for share in (0.06, 0.22, 0.5, 0.78, 0.94)])


def shortest_out(geometry, points):
    """Return the length of the shortest way out of a disc from each of ``points``."""
    # Without walls nothing keeps the disc off the ends of an exit, but the field aims as if there were jambs.
    return shortest(geometry, points, exit_targets(geometry), lines=list(geometry.walls), quad_segs=16)


@pytest.mark.parametrize("name", PLANS)
def test_everyone_gets_out_and_keeps_off_the_walls(name):
    geometry, field, _ = plan(name)
    points = np.concatenate([starts(geometry, 60), beside_walls(geometry, 1e-3), beside_walls(geometry, 0.1)])
    own = geometry.clearance(points)
    for start, clearance in zip(points, own, strict=True):
        path, exit_row = follow(name, start)
        assert exit_row >= 0, f"from {start} to {path[-1]}"
        allowed = min(clearance, RADIUS) - field.spacing
        assert geometry.clearance(path).min() >= allowed, f"from {start}"
        assert not shapely.crosses(shapely.LineString(path), shapely.MultiLineString(list(geometry.walls))), (
            f"from {start} through a wall"
        )


@pytest.mark.parametrize("name", PLANS)
def test_paths_and_travel_times_are_the_shortest_there_are(name):
    geometry, field, arrays = plan(name)
    points = starts(geometry, 120, seed=2)
    points = points[geometry.clearance(points) > RADIUS + 1e-3]
    exact = shortest_out(geometry, points)
    walked = np.array([path_length(follow(name, point)[0]) for point in points])
    times = np.array([travel_time_at(arrays, geometry.boundary, 0, *point, RADIUS) for point in points])
    far = exact > 1.0
    np.testing.assert_array_less(walked[far], 1.03 * exact[far])
    np.testing.assert_array_less(walked, 1.03 * exact + 0.5 * field.spacing)
    np.testing.assert_array_less(0.97 * exact - 0.1, walked)  # no short cut through a wall, by either of the two
    np.testing.assert_array_less(np.abs(times - exact), 0.02 * exact + field.spacing)


def around_jamb(point, jamb, to):
    """Return the length of the tangent from ``point`` to the circle around ``jamb`` plus the arc to the point ``to``."""
    distance = np.hypot(*(point - jamb))
    tangent = np.sqrt(distance**2 - RADIUS**2)
    between = np.arccos(np.dot(point - jamb, to - jamb) / distance / RADIUS)
    return tangent + RADIUS * (between - np.arccos(RADIUS / distance))


@looped("start", [(1.0, 0.5), (2.5, 1.0), (0.5, 2.0), (3.5, 0.6)])
def test_length_of_the_way_around_a_door_jamb_in_closed_form(start):
    exact = around_jamb(np.array(start), np.array([5, 2.09]), np.array([5, 2.09 + RADIUS]))
    path, _ = follow("room", start)
    assert path_length(path) == pytest.approx(exact, rel=0.01)
    assert shortest_out(plan("room")[0], np.array([start]))[0] == pytest.approx(exact, rel=1e-3)  # the yardstick itself


def test_length_of_the_way_around_a_corner_in_closed_form():
    start, corner = np.array([0.5, 0.75]), np.array([4.5, 1.5])
    exact = around_jamb(start, corner, corner + np.array([RADIUS, 0])) + 4.5
    path, _ = follow("corner", start)
    assert path_length(path) == pytest.approx(exact, rel=0.01)


def test_axis_of_symmetry_behind_an_obstacle_is_left():
    for name, y in (("column before the door", 2.5), ("block in the room", 2.5), ("c-shaped obstacle", 3.0)):
        points = np.array([(0.3, y), (1.0, y), (1.5, y)])
        for point, length in zip(points, shortest_out(plan(name)[0], points), strict=True):
            path, exit_row = follow(name, point)
            assert exit_row == 0
            assert path_length(path) < 1.03 * length


def test_inside_of_the_c_is_left_by_its_open_side():
    path, _ = follow("c-shaped obstacle", (4.5, 3.0))
    assert path[:, 0].min() < 3 - RADIUS + 0.05


def test_two_exits_lead_to_the_nearer_one():
    geometry, field, _ = plan("two exits")
    for start in starts(geometry, 60, seed=3):
        if abs(start[0] - 5) > 0.1:
            assert follow("two exits", start)[1] == (start[0] > 5)
    names = np.array(geometry.exit_names)[field.direct[field.direct >= 0]]
    assert set(names) == {"west", "east"}


def test_chosen_exits_only():
    geometry = plan("two exits")[0]
    field = travel_time_field(geometry, RADIUS, exits=["east"])
    arrays = join_fields([field], geometry.boundary)
    assert set(field.direct[field.direct >= 0]) == {1}
    assert direction_at(arrays, geometry.boundary, 0, 0.1, 1.5, RADIUS)[0] > 0.3
    assert travel_time_at(arrays, geometry.boundary, 0, 1.0, 1.5, RADIUS) == pytest.approx(9, abs=0.01)


@pytest.mark.parametrize("name", PLANS)
def test_everyone_in_the_area_and_beside_it_gets_a_unit_direction(name):
    geometry, field, arrays = plan(name)
    x0, y0, x1, y1 = geometry.bounds
    points = np.random.default_rng(4).uniform((x0 - 0.5, y0 - 0.5), (x1 + 0.5, y1 + 0.5), (2000, 2))
    points = np.concatenate(
        [points, geometry.boundary.corner, geometry.walls.mean(axis=1), geometry.exits.mean(axis=1)]
    )
    got = np.array([direction_at(arrays, geometry.boundary, 0, *point, RADIUS) for point in points])
    np.testing.assert_allclose(np.hypot(*got.T), 1, rtol=1e-12)
    walkable = np.isfinite(field.travel_time)
    np.testing.assert_allclose(np.hypot(*np.moveaxis(field.direction[walkable], -1, 0)), 1, rtol=1e-12)
    assert (field.direction[~walkable] == 0).all()
    assert (field.direct[~walkable] == -1).all()
    rows, cols = np.indices(walkable.shape)
    places = field.origin + field.spacing * np.stack([cols, rows], axis=-1)
    inside = shapely.contains_xy(geometry.walkable, places[..., 0], places[..., 1])
    thin = shapely.MultiLineString(list(geometry.walls[geometry.two_sided]))
    assert walkable[inside & ~(shapely.distance(thin, shapely.points(places)) < 1e-6)].all()


def test_direction_is_smooth_away_from_ridges():
    geometry, _, arrays = plan("room")
    points = starts(geometry, 2000, seed=5)
    points = points[(geometry.clearance(points) > RADIUS + 0.06) & (np.hypot(*(points - (5, 2.5)).T) > 1)]
    for dx, dy in ((0.01, 0), (0, 0.01)):
        here = np.array([direction_at(arrays, geometry.boundary, 0, x, y, RADIUS) for x, y in points])
        there = np.array([direction_at(arrays, geometry.boundary, 0, x + dx, y + dy, RADIUS) for x, y in points])
        turn = np.degrees(np.arccos(np.clip((here * there).sum(axis=1), -1, 1)))
        assert turn.max() < 3
        assert np.median(turn) < 0.3


@looped("wall", [[(0, 2.02), (4, 2.02)], [(2.02, 0), (2.02, 4)], [(0, 1), (3, 4)], [(1, 3), (3, 1)]])
def test_thin_wall_is_not_looked_through(wall):
    geometry = Geometry.from_polygon(ROOM, exits=[DOOR], thin_walls=[wall])
    arrays = join_fields([travel_time_field(geometry, RADIUS)], geometry.boundary)
    (a, b) = np.array(wall, dtype=float)
    normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(b - a))
    for share in np.linspace(0.1, 0.9, 33):
        for distance in (-0.02, -0.001, 0.001, 0.02):
            place = a + share * (b - a) + distance * normal
            assert distance * np.dot(direction_at(arrays, geometry.boundary, 0, *place, RADIUS), normal) > 0


def test_thin_wall_parts_the_travel_times():
    geometry, _, arrays = plan("thin wall")
    times = [travel_time_at(arrays, geometry.boundary, 0, 3.02 + d, 1.0, RADIUS) for d in (-0.01, 0.01)]
    assert times[0] > times[1] + 2
    aligned = Geometry.from_polygon(ROOM, exits=[DOOR], thin_walls=[[(3, 0), (3, 4)]])  # nodes on the wall itself
    there = join_fields([travel_time_field(aligned, RADIUS)], aligned.boundary)
    for x, side in ((2.99, -1), (3.01, 1)):
        assert side * direction_at(there, aligned.boundary, 0, x, 1.0, RADIUS)[0] > 0


@looped("name", PLANS)
def test_a_field_made_again_is_the_same_to_the_last_bit(name):
    field, again = plan(name)[1], travel_time_field(PLANS[name](), RADIUS)
    for one, other in zip(vars(field).values(), vars(again).values(), strict=True):
        np.testing.assert_array_equal(one, other, strict=True)
    assert again.travel_time is not field.travel_time


def test_direct_nodes_are_exact():
    geometry, field, arrays = plan("room")
    i, j = 50, 20  # (1, 2.5), in front of the door
    assert field.direct[i, j] == 0
    assert field.travel_time[i, j] == pytest.approx(4, abs=1e-9)
    assert field.direction[i, j] == pytest.approx([1, 0], abs=1e-9)
    assert travel_time_at(arrays, geometry.boundary, 0, 1.234, 2.4, RADIUS) == pytest.approx(5 - 1.234, abs=1e-9)
    assert field.direct[10, 20] == -1  # (1, 0.5): the straight line to the door scrapes the jamb
    assert plan("block in the room")[1].direct[50, 20] == -1  # the block stands between


@kernel
def aim(exits, x, y, radius):
    return nearest_on_exit(exit_frame(exits, 0), x, y, radius)


def test_own_radius_decides_where_to_pass_the_door():
    geometry, _, arrays = plan("room")
    boundary = geometry.boundary
    assert aim(boundary.exit, 4.0, 2.2, 0.2) == pytest.approx((5, 2.29))
    assert aim(boundary.exit, 4.0, 2.2, 0.3) == pytest.approx((5, 2.39))
    assert aim(boundary.exit, 4.0, 2.6, 0.3) == pytest.approx((5, 2.6))
    assert aim(boundary.exit, 4.0, 2.2, 0.5) == pytest.approx((5, 2.5))  # wider than the door: its middle
    slim, stout = (direction_at(arrays, boundary, 0, 4.0, 2.36, radius) for radius in (0.2, 0.35))
    assert slim == pytest.approx((1, 0))
    assert stout == pytest.approx(np.array([1, 0.08]) / np.hypot(1, 0.08))


@looped("radius", [0.32, 0.18], quick=1)
@pytest.mark.parametrize("name", ["room", "column before the door", "u-turn"])
def test_people_of_other_radii_get_out_as_well(name, radius):
    geometry = plan(name)[0]
    for start in starts(geometry, 60, seed=6):
        path, exit_row = follow(name, start, radius)
        assert exit_row >= 0
        assert geometry.clearance(path).min() >= min(geometry.clearance([start])[0], radius, RADIUS) - 0.06


def test_people_in_the_door_opening_are_led_out():
    geometry, _, arrays = plan("room")
    for y in np.linspace(2.2, 2.8, 25):
        for x in (4.8, 4.9, 4.97, 5.0):
            ex, ey = direction_at(arrays, geometry.boundary, 0, x, y, RADIUS)
            assert ex > 0
            assert ey * (2.5 - y) >= 0  # and away from the jamb
    assert direction_at(arrays, geometry.boundary, 0, 5.0, 2.5, 0.0) == pytest.approx((1, 0))
    assert direction_at(arrays, geometry.boundary, 0, 5.01, 2.5, RADIUS)[0] > 0.9


def test_positions_off_the_grid_and_nan_do_no_harm():
    geometry, _, arrays = plan("room")
    for x, y in ((-100.0, 2.0), (100.0, 2.0), (2.0, 1e300), (np.nan, np.nan), (np.inf, -np.inf)):
        assert np.hypot(*direction_at(arrays, geometry.boundary, 0, x, y, RADIUS)) == pytest.approx(1)


def test_batch_of_fields_gives_the_same_as_each_alone():
    names = ["thin wall", "two exits", "room"]
    geometries = [plan(name)[0] for name in names]
    box_without_exit = Geometry.from_polygon(ROOM)
    boundary = join_boundaries([geometries[0], box_without_exit, *geometries[1:]])
    arrays = join_fields([plan(names[0])[1], None, plan(names[1])[1], plan(names[2])[1]], boundary)
    assert arrays.node_start[1] == arrays.node_start[2]
    for g, name in ((0, names[0]), (2, names[1]), (3, names[2])):
        geometry, _, alone = plan(name)
        for x, y in starts(geometry, 100, seed=7):
            assert direction_at(arrays, boundary, g, x, y, 0.2) == direction_at(alone, geometry.boundary, 0, x, y, 0.2)
            assert travel_time_at(arrays, boundary, g, x, y, 0.2) == travel_time_at(
                alone, geometry.boundary, 0, x, y, 0.2
            )
    assert set(arrays.direct[arrays.node_start[3] :]) == {-1, 3}
    assert direction_at(arrays, boundary, 1, 2.0, 2.0, 0.2) == (0, 0)
    assert np.isnan(travel_time_at(arrays, boundary, 1, 2.0, 2.0, 0.2))
    with pytest.raises(ValueError, match="1 fields for 4 geometries"):
        join_fields([None], boundary)
