"""Plans with many corners and plans that are very large: ways are found in time and memory that do not run away."""

import numpy as np
import pytest
import shapely
from cases import looped
from evacuations import evacuated

from crowd_env import FULL_SPEED, Geometry, Population, Scenario, Uniform
from crowd_env.geometry.boundary import solid_depth
from crowd_env.geometry.placement import closest_pair
from crowd_env.routing.fields import domain as navigation_plan
from crowd_env.routing.fields.field import travel_time_field

HALL = shapely.box(0, 0, 24, 12)


def divided(gap, **options):
    """A hall with a wall across it, which has one gap; the exit is in the right half."""
    walls = [[(12, 0), (12, 6 - gap / 2)], [(12, 6 + gap / 2), (12, 12)]]
    return Geometry.from_polygon(HALL, exits=[[(24, 5), (24, 7)]], thin_walls=walls, **options)


@pytest.fixture
def coarse(monkeypatch):
    """Let a hall count as a place in which a finer grid than 0.18 m has too many nodes."""
    monkeypatch.setattr(navigation_plan, "_MAX_NODES", 24 * 12 / 0.18**2)
    return 0.18


def test_a_place_too_large_for_a_fine_grid_gets_a_coarser_one_and_says_so(coarse):
    with pytest.warns(UserWarning, match=r"24 m x 12 m: ways are looked for on a grid of 0\.18\d m"):
        field = travel_time_field(divided(0.9), 0.25, min_radius=0.2)
    assert coarse <= field.spacing < 1.05 * coarse
    assert field.radius >= 1.25 * field.spacing  # nodes on both sides of a thin wall are no neighbors


def test_ways_on_a_coarse_grid_go_through_the_gap_not_the_wall(coarse):
    geometry = divided(0.9)
    with pytest.warns(UserWarning, match="ways are looked for"):
        field = travel_time_field(geometry, 0.25, min_radius=0.2)
    rows, cols = field.travel_time.shape
    x = field.origin[0] + field.spacing * np.arange(cols)
    y = field.origin[1] + field.spacing * np.arange(rows)
    left, low = np.searchsorted(x, 11.5), np.searchsorted(y, 1.0)
    straight = 12.5  # m, if the wall were not there; by way of the gap it is 5 m up and 12 m along
    assert field.travel_time[low, left] > straight + 3.0


@pytest.mark.more
@pytest.mark.filterwarnings("ignore:the plan is")
def test_bodies_get_out_by_ways_on_a_coarse_grid(coarse):
    people = Population(12, starts=np.column_stack([np.repeat([1.0, 2.0, 3.0], 4), np.tile([1.0, 4.0, 7.0, 11.0], 3)]))
    env = evacuated(Scenario("hall", divided(0.9), people, 120.0, **FULL_SPEED), physics="nsm1-inertial")
    assert env.metrics(0).unfinished == 0


@pytest.mark.filterwarnings("ignore:the plan is")
def test_passages_that_a_coarse_grid_does_not_show_are_refused(coarse):
    with pytest.raises(
        ValueError, match=r"no exit can be reached from .* for a body of diameter 0\.7\d m; widen the passage"
    ):
        travel_time_field(divided(0.42), 0.25, min_radius=0.2)
    narrow = Geometry.from_polygon(HALL, exits=[[(24, 5), (24, 5.5)]])
    with pytest.raises(ValueError, match=r"exit 'exit-0' is too narrow for a body of diameter 0\.7\d m"):
        travel_time_field(narrow, 0.25, min_radius=0.2)


def test_the_largest_places_are_refused_before_anything_is_allocated(monkeypatch):
    monkeypatch.setattr(navigation_plan, "_make_grid", None)
    big = Geometry.from_polygon(shapely.box(0, 0, 1200, 1200), exits=[[(1200, 5), (1200, 7)]])
    with pytest.raises(ValueError, match=r"1200 m x 1200 m needs more than 3e\+07 nodes; check that its coordinates"):
        Scenario("field", big, Population(10), 60.0, **FULL_SPEED)
    with pytest.raises(ValueError, match=r"bodies of radius 0\.001 m in a plan of 24\.0 m x 12\.0 m need more than"):
        Scenario("hall", divided(2.0), Population(10, radius=Uniform(0.001, 0.25)), 60.0, **FULL_SPEED)
    navigation_plan.require_grid(Geometry.from_polygon(shapely.box(0, 0, 676, 672), exits=[[(676, 5), (676, 7)]]), 0.2)


def columns(count):
    """A hall with many round columns."""
    side = int(np.ceil(np.sqrt(count)))
    x, y = np.meshgrid(2.0 + 2.0 * np.arange(side), 2.0 + 2.0 * np.arange(side))
    points = shapely.points(np.column_stack([x.ravel(), y.ravel()])[:count])
    size = 2.0 * side + 2.0
    return shapely.difference(
        shapely.box(0, 0, size, size), shapely.union_all(shapely.buffer(points, 0.2, quad_segs=8))
    )


def test_the_depth_of_walls_looks_only_at_what_is_near(monkeypatch):
    area = columns(150)
    walls = Geometry.from_polygon(area).walls
    assert len(walls) > 4500
    pairs = []
    intersection = shapely.intersection

    def counted(a, b):
        pairs.append(np.size(a))
        return intersection(a, b)

    monkeypatch.setattr(shapely, "intersection", counted)
    depth = solid_depth(walls, area)
    assert sum(pairs) < 40 * len(walls)  # all with all would be 4500 times as many
    round_ones = np.hypot(*(walls[:, 1] - walls[:, 0]).T) < 0.1
    assert np.all(depth[round_ones] <= 0.2) and np.all(depth[~round_ones] == 0.25)


@looped(
    ("area", "expected"),
    [
        (HALL, 0.25),
        (shapely.difference(HALL, shapely.box(5, 3, 5.2, 9)), 0.1),
        (shapely.union_all([shapely.box(0, 0, 5, 5), shapely.box(5.3, 0, 9, 5), shapely.box(0, 5, 9, 8)]), 0.15),
    ],
)
def test_the_depth_of_a_wall_is_half_of_what_is_solid_behind_it(area, expected):
    depth = solid_depth(Geometry.from_polygon(area).walls, area)
    assert depth.min() == pytest.approx(expected, abs=1e-6) and depth.max() == 0.25


def test_the_closest_pair_is_that_of_all_pairs():
    rng = np.random.default_rng(3)
    for count in (2, 3, 50, 300):
        position, radius = rng.random((count, 2)) * 5, rng.uniform(0.05, 0.4, count)
        apart = np.hypot(*(position[:, None] - position[None]).transpose(2, 0, 1)) - radius[:, None] - radius[None]
        apart[np.diag_indices(count)] = np.inf
        i, j, gap = closest_pair(position, radius)
        assert i < j and gap == pytest.approx(apart.min(), abs=1e-15) and apart[i, j] == apart.min()


def test_many_seats_are_checked_in_no_time():
    x, y = np.meshgrid(0.5 * np.arange(150), 0.5 * np.arange(150))
    seats = np.column_stack([x.ravel(), y.ravel()])
    assert closest_pair(seats, np.full(len(seats), 0.2))[2] == pytest.approx(0.1)
