"""Travel times through a crowd, in corridors where they have a closed form."""

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

from crowd_env import Population, Scenario, make_scenario
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.fundamental_diagram import FundamentalDiagram, weidmann
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import Route
from validation.cases.case import Setting
from validation.cases.crowds import draw_crowds

RADIUS, LENGTH, WIDTH = 0.2, 12.0, 3.0


def corridor(width=WIDTH):
    """Return the congestion field of a corridor along x, with an exit over all of its right end."""
    place = Geometry.from_polygon(box(0, 0, LENGTH, width), exits={"end": [(LENGTH, 0), (LENGTH, width)]})
    return RoutePlan(place, RADIUS, routes=[Route("quick", strategy="fastest")]).build().routes[1].congestion


def on_axis(field, values):
    """Return the distances to the exit [m] of the nodes on the axis of the corridor, and the values (rows, cols) there."""
    row = round((0.5 * WIDTH - field.origin[1]) / field.spacing)
    left = LENGTH - field.origin[0] - field.spacing * np.arange(values.shape[1])
    inside = (left > 0.0) & (left < LENGTH - RADIUS)
    return left[inside], values[row][inside]


def test_without_people_the_time_is_the_distance_from_the_exit_on():
    field = corridor().march()
    left, time = on_axis(field, field.travel_time)
    assert left.min() < 1.5 * field.spacing < left.max()  # nodes beside the exit too, from which the march starts
    np.testing.assert_allclose(time, left, rtol=0, atol=0.5 * field.spacing)


@looped("abreast", [3, 4])
def test_a_queue_that_passes_quicker_than_the_crowd_walks_saves_no_time(abreast):
    """All over a corridor of one width people walk at the speed of their density: the exit would let more of them pass."""
    people, side = FundamentalDiagram(RADIUS, 1.3, keeps_distance=True), WIDTH / abreast
    flow = 1.3 * weidmann(np.array(side**-2)) * side**-2 * WIDTH
    assert people.flow(np.array(WIDTH - 2.0 * RADIUS)) > flow
    x, y = np.meshgrid(np.arange(0.5 * side, LENGTH, side), np.arange(0.5 * side, WIDTH, side))
    congestion, position = corridor(), np.column_stack([x.ravel(), y.ravel()])
    field = congestion.march(position, people)
    left, time = on_axis(field, field.travel_time)
    _, density = on_axis(field, congestion.density(position))
    middle = (left > 3.0) & (left < LENGTH - 3.0)
    slowness = np.polyfit(left[middle], time[middle], 1)[0]  # s/m at 1 m/s
    assert slowness == pytest.approx((1.0 / weidmann(density[middle])).mean(), rel=0.03)


def test_while_nobody_waits_the_way_is_that_of_an_empty_place():
    people, congestion = FundamentalDiagram(RADIUS, 1.3, keeps_distance=True), corridor()
    alone, apart = (congestion.march(np.array(at), people) for at in ([[2.0, 1.5]], [[1.0, 1.0], [6.0, 2.0]]))
    crowd = congestion.march(np.tile([[6.0, 1.5]], (40, 1)), people)
    np.testing.assert_array_equal(alone.travel_time, apart.travel_time)
    assert np.nanmax(crowd.travel_time - alone.travel_time) > 1.0


def test_a_large_place_is_marched_less_often(monkeypatch):
    assert corridor().every == 1.0
    monkeypatch.setattr("crowd_env.routing.fields.congestion._NODES", 100)
    congestion = corridor(2.0)  # equal places are made once
    assert congestion.every == congestion.march().travel_time.size / 100 > 1.0


def a_passage_to_two_exits():
    rooms = [box(0, 0, 8, 8), box(8, 3.6, 10, 4.4), box(10, 0, 14, 8)]
    exits = {"right": [(14, 0.5), (14, 1.5)], "left": [(14, 6.5), (14, 7.5)]}
    place = Geometry.from_polygon(rooms, exits=exits, regions={"room": rooms[0]})
    return Scenario("passage", place, Population(60, start_region="room"), 300.0)


@looped("name", ["passage", "bottleneck-v0", "l-corridor-v0", "pillar-v0"], quick=1)
def test_where_all_ways_share_one_opening_the_fastest_is_no_slower_than_the_shortest(name):
    took, place = [], a_passage_to_two_exits() if name == "passage" else make_scenario(name)
    for strategy in ("shortest", "fastest"):
        crowds = draw_crowds([place], Setting("dem", "hurried", draws=4, strategy=strategy))
        out = crowds.walk(200.0).exit_time
        took.append(crowds.means([out[crowds.people(e)].max() for e in range(crowds.count)])[0])
    assert took[1] < 1.04 * took[0]  # the marched field alone takes 9 to 12 % more
