"""Queues at openings: who waits for whom, and where the shortest way stays the fastest."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry import Point, box

from crowd_env import make_scenario
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.fundamental_diagram import FundamentalDiagram
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import Route

RADIUS = 0.2
PEOPLE = FundamentalDiagram(RADIUS, 1.4)
QUICK = Route("quick", strategy="fastest")


def congestion_of(geometry):
    return RoutePlan(geometry, RADIUS, routes=[QUICK]).build().routes[1].congestion


def queues(congestion, position, at):
    """Return how many times as long as alone it takes where the points ``at`` lie, with people at ``position``."""
    fronts, shape = congestion._fronts, congestion.density(np.zeros((0, 2))).shape
    nodes = [
        grid.nearest_nodes(np.asarray(points, dtype=np.float64), congestion.origin, congestion.spacing, shape)
        for points in (position, at)
    ]
    return fronts.queue(nodes[0], PEOPLE)[fronts.front[nodes[1]]]


def test_branches_that_merge_wait_for_each_other():
    # Two corridors that meet before one door, like an aisle on either side of the seats.
    forked = Geometry.from_polygon(
        [box(0, 0, 4, 2), box(0, 4, 4, 6), box(4, 0, 6, 6)], exits=[[(6, 2.4), (6, 3.6)]], obstacles=[]
    )
    congestion = congestion_of(forked)
    here, there = [[2.0, 1.0]] * 10, [[2.0, 5.0]] * 10
    alone, both = queues(congestion, here, [here[0]])[0], queues(congestion, here + there, [here[0]])[0]
    assert both == pytest.approx(2 * alone) and alone > 1.0
    assert queues(congestion, there, [[3.0, 1.0]])[0] == 1.0  # who is nearer to the door does not wait for them


def test_a_pillar_before_a_door_lets_no_more_people_through_it():
    def waiting(obstacles):
        room = Geometry.from_polygon(box(0, 0, 8, 6), exits=[[(8, 2.6), (8, 3.4)]], obstacles=obstacles)
        return queues(congestion_of(room), [[2.0, 3.0]] * 30, [[2.0, 3.0]])[0]

    assert waiting([box(5.5, 2.5, 6.5, 3.5)]) == pytest.approx(waiting([]), rel=0.01)


def test_a_queue_is_one_door_wide():
    room = Geometry.from_polygon(box(0, 0, 8, 6), exits=[[(8, 2.4), (8, 3.6)]])
    congestion = congestion_of(room)
    (found,) = queues(congestion, [[2.0, 3.0]] * 30, [[2.0, 3.0]])
    seconds = 30 / PEOPLE.flow(np.array([1.2 - 2 * RADIUS]))[0]
    assert found == pytest.approx(seconds * 1.4 / congestion._fronts._depth)


@pytest.mark.parametrize("zone", [box(6, 6, 8, 8), Point(7, 7).buffer(1.2)], ids=["box", "circle"])
def test_around_an_exit_that_is_an_area_people_leave_by_all_of_its_lines(zone):
    """Lines shorter than a body too: no jamb stands where two of them meet."""
    room = Geometry.from_polygon(box(0, 0, 14, 14), exits={"zone": zone})
    ring = np.radians(np.arange(0, 360, 3))
    around = 7.0 + 4.0 * np.column_stack([np.cos(ring), np.sin(ring)])
    congestion = congestion_of(room)
    seconds = len(around) / PEOPLE.flow(np.array([zone.exterior.length]))[0]
    found = queues(congestion, around, around).max() * congestion._fronts._depth / 1.4
    assert 0.3 * seconds < found < 1.05 * seconds  # they stand in two or three bands


@pytest.mark.parametrize("name", ["classroom-v0", "l-corridor-v0", pytest.param("floor-v0", marks=pytest.mark.more)])
def test_without_people_the_shortest_way_is_the_fastest_everywhere(name):
    fronts = make_scenario(name).route_set("fastest").routes[1].congestion._fronts
    assert fronts.keeps_on(np.ones(len(fronts._beside))).all()


def test_fronts_do_not_reach_through_walls():
    """Walls of the theatre, 0.2 m thick, run along lines of nodes; beyond them the exit is nearer by many meters."""
    fronts = make_scenario("theatre-v0").route_set("fastest").routes[1].congestion._fronts
    jumps = [abs(fronts._band[n] - fronts._band[p]) for n, near in enumerate(fronts._beside) for p in near]
    assert max(jumps) <= 5  # at the edge of stairs; through a wall it was 30


@pytest.mark.parametrize("name", ["passage", "theatre-v0", "stadium-sector-v0"])
def test_what_a_front_parts_from_the_way_out_is_what_cannot_be_reached_without_it(name):
    geometry = two_ways_behind_a_passage() if name == "passage" else make_scenario(name).geometry
    fronts = congestion_of(geometry)._fronts
    pairs = np.array([(n, other) for n, beside in enumerate(fronts._beside) for other in beside])
    count, rng = len(fronts._band), np.random.default_rng(0)
    for only in rng.choice(np.arange(1, count), 40):
        narrow = np.arange(count) == only
        kept = pairs[(pairs != only).all(axis=1)]
        graph = coo_array((np.ones(len(kept)), kept.T), shape=(count, count))
        part = connected_components(graph, directed=False)[1]
        reached = np.isin(part, part[fronts._first[fronts._first != only]]) | narrow
        reached[0] = True
        np.testing.assert_array_equal(fronts._behind(narrow), ~reached)


def test_upstream_of_a_passage_all_ways_are_shared():
    congestion = congestion_of(two_ways_behind_a_passage())
    shared, shape = congestion._fronts.shared, congestion._inside.shape
    here = [[1.0, 1.0], [7.0, 4.0], [12.0, 4.0], [13.0, 1.0]]
    nodes = grid.nearest_nodes(np.array(here), congestion.origin, congestion.spacing, shape)
    assert shared[nodes].tolist() == [True, True, False, False]


def two_ways_behind_a_passage(width=0.8):
    rooms = [box(0, 0, 8, 8), box(8, 4 - width / 2, 10, 4 + width / 2), box(10, 0, 14, 8)]
    return Geometry.from_polygon(rooms, exits={"e": [(14, 0.5), (14, 1.5)], "f": [(14, 6.5), (14, 7.5)]})
