"""The cells that say which walls are near: against all walls of a plan."""

import numpy as np
import pytest
import shapely
from cases import looped
from crowds import PLANS
from shapely.geometry import box

import crowd_env.geometry.wall_grid
from crowd_env import Geometry
from crowd_env.core.kernels.jit import kernel
from crowd_env.geometry.geometry import join_boundaries
from crowd_env.geometry.wall_grid import is_hidden, make_wall_grid, walls_near

pytestmark = pytest.mark.kernels
REACH = 2.5  # m

PARK = Geometry.from_polygon(  # open on all sides, and one wall in it
    box(0, 0, 20, 20),
    exits=[[(0, 0), (20, 0)], [(20, 0), (20, 20)], [(20, 20), (0, 20)], [(0, 20), (0, 0)]],
    thin_walls=[[(8, 10), (12, 10)]],
)
HALL = Geometry.from_polygon(
    box(0, 0, 8, 6), thin_walls=[[(4, 0), (4, 2)], [(4, 4), (4, 6)]], doors={"middle": [(4, 2), (4, 4)]}
)


@kernel
def near_to(grid, g, x, y):
    """Return the first entry of the walls near a point, and one past the last."""
    return walls_near(grid, g, x, y)


@kernel
def hides(grid, g, boundary, door_open, x, y, dx, dy):
    """Return whether a wall of geometry ``g`` stands between (x, y) and the point (dx, dy) from there."""
    return is_hidden(grid, walls_near(grid, g, x, y), boundary, door_open, x, y, dx, dy)


def hidden(grid, boundary, g, here, there, door_open=()):
    """Return whether a wall of geometry ``g`` stands between two points."""
    stands_open = np.array(door_open, dtype=np.bool_)
    return hides(grid, g, boundary, stands_open, *here, *(there - here))


@pytest.fixture(scope="module")
def plans():
    return [PARK, HALL, Geometry.from_polygon(box(-40, -40, 40, 40)), *(make() for make in PLANS.values())]


@pytest.mark.more
@looped("cells", [1_000_000, 30])
def test_all_walls_near_a_place_are_listed_wherever_it_is(plans, cells, monkeypatch):
    monkeypatch.setattr(crowd_env.geometry.wall_grid, "_MOST_CELLS", cells)
    rng, boundary = np.random.default_rng(0), join_boundaries(plans)
    grid = make_wall_grid(boundary, REACH)
    for g, place in enumerate(plans):
        first = boundary.wall_start[g]
        lines = shapely.linestrings(place.walls)
        low, high = np.array(place.bounds).reshape(2, 2)
        for point in rng.uniform(np.maximum(low, -20) - 1.0, np.minimum(high, 20) + 1.0, (60, 2)):
            near = np.flatnonzero(shapely.distance(lines, shapely.Point(point)) < REACH)
            start, stop = near_to(grid, g, *point)
            listed = grid.wall[start:stop]
            assert set(near + first) <= set(listed.tolist())
            assert len(set(listed.tolist())) == len(listed)
            assert ((listed >= first) & (listed < boundary.wall_start[g + 1])).all()


def test_who_is_hidden_is_what_all_walls_say(plans):
    rng, boundary = np.random.default_rng(1), join_boundaries(plans)
    grid, found = make_wall_grid(boundary, REACH), set()
    for g, place in enumerate(plans):
        low, high = np.array(place.bounds).reshape(2, 2)
        for here in rng.uniform(np.maximum(low, -20), np.minimum(high, 20), (60, 2)):
            there = here + rng.uniform(-1.7, 1.7, 2)
            for door_open in ([True], [False]):
                walls, _ = place.walls_when([] if door_open[0] else place.doors)
                crossed = shapely.intersects(shapely.linestrings(walls), shapely.LineString([here, there])).any()
                assert hidden(grid, boundary, g, here, there, door_open) == crossed
                found.add(bool(crossed))
    assert found == {True, False}


def test_a_wall_hides_from_both_sides_alike_where_no_other_wall_is_near():
    boundary = PARK.boundary
    grid = make_wall_grid(boundary, REACH)
    above, below = np.array([10.0, 10.6]), np.array([10.3, 9.4])
    assert hidden(grid, boundary, 0, above, below)
    assert hidden(grid, boundary, 0, below, above)


def test_a_door_hides_only_while_it_is_closed():
    boundary = HALL.boundary
    grid = make_wall_grid(boundary, REACH)
    left, right = np.array([3.5, 3.0]), np.array([4.5, 3.1])
    assert hidden(grid, boundary, 0, left, right, [False])
    assert not hidden(grid, boundary, 0, left, right, [True])


def test_where_nobody_keeps_a_distance_there_are_no_cells():
    two_halls = join_boundaries([HALL, HALL])
    grid = make_wall_grid(two_halls, None)
    assert near_to(grid, 1, 0.0, 0.0) == (0, 0)
    assert len(grid.wall) == 0
