"""Ways over all sheets of a building: the crowd shares out over its stairs, and wide bodies keep off narrow ones."""

from functools import cache

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

from crowd_env import Population, Scenario, Uniform
from crowd_env.core.arrays.state import make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.routing.fields.field import travel_time_field
from crowd_env.routing.fields.grid import nearest_nodes
from crowd_env.scenarios.buildings import Level, Ramp, Stair, building

RISE, TREAD, RISERS = 3.06, 0.28, 18
RUN, LONG, DEEP = RISERS * TREAD, 24.0, 8.0


@cache
def house(west: float = 1.2, east: float = 1.2) -> Geometry:
    """Return two levels with a stair of these widths at either end, each before an exit; all but the widths is symmetric."""
    ends = -RUN - 3.0, LONG + RUN + 3.0
    levels = [
        Level(
            "ground",
            0.0,
            box(ends[0], 0, ends[1], DEEP),
            exits={name: [(x, 3), (x, 5)] for name, x in zip(("west", "east"), ends, strict=True)},
        ),
        Level("upper", RISE, box(0, 0, LONG, DEEP), regions={"half": box(13, 0, LONG, DEEP)}),
    ]
    stairs = [
        Stair(f"{name} stair", "ground", "upper", (x, 4.0), direction, width, RISE / RISERS, TREAD)
        for name, x, direction, width in (("west", -RUN, 0.0, west), ("east", LONG + RUN, 180.0, east))
    ]
    return building(levels, stairs)


@pytest.mark.parametrize("strategy", ["shortest", "fastest"])
def test_a_level_in_two_parts_has_a_way_out_of_both(strategy):
    """The part that was not reached first was refused."""
    levels = [
        Level("ground", 0.0, box(0, 0, 30, 10), exits={"door": [(14, 0), (16, 0)]}),
        Level("upper", RISE, box(0, 0, 8, 10).union(box(22, 0, 30, 10)), regions={"west": box(0, 0, 8, 10)}),
    ]
    stairs = [
        Stair(name, "ground", "upper", (x, 5.0), direction, riser=RISE / RISERS)
        for name, x, direction in (("west stair", 8 + RUN, 180.0), ("east stair", 22 - RUN, 0.0))
    ]
    _, on_west = walk(building(levels, stairs), 12, "west", strategy, "dem", 0)
    assert on_west == 1.0


def walk(place, people, region, strategy, law, seed, **options):
    """Return how long all take [s], and the share of them on the west stair."""
    scenario = Scenario("house", place, Population(people, start_region=region), 600.0)
    routes = scenario.route_set(scenario.strategy_of_run(strategy))
    bodies, position = scenario.population.draw(np.random.default_rng(seed), place, scenario.room)
    start, sheet = place.on_sheets(position)
    state = make_state(start, sheet=sheet)
    state.route[:] = scenario.choose(routes, strategy, position, bodies.radius, bodies.group)
    run = Simulation(place, bodies, state, physics=law, walking="hurried", fields=[routes], **options)
    stair = np.full(people, -1)
    while state.active.any() and state.time[0] < 300.0:
        run.advance(n_substeps=round(0.5 / run.dt))
        stair = np.where(state.active & (state.sheet > 1), state.sheet, stair)
    assert not state.active.any() and (stair > 1).all()
    return float(state.exit_time.max()), float((stair == 2).mean())


@pytest.mark.parametrize("law", ["dem", "nsm2"])
def test_few_people_take_the_near_stair_and_many_share_out_over_both(law):
    for strategy in ("shortest", "fastest"):
        assert walk(house(), 5, "half", strategy, law, 0)[1] == 0.0
    shortest, fastest = (walk(house(), 120, "half", strategy, law, 0) for strategy in ("shortest", "fastest"))
    assert shortest[1] == 0.0 and 0.25 < fastest[1] < 0.55
    assert fastest[0] < 0.85 * shortest[0]


@pytest.mark.nightly
@pytest.mark.parametrize("law", ["dem", "nsm2"])
def test_two_hundred_people_of_one_storey_are_out_sooner_by_both_stairs(law):
    shortest, fastest = (
        np.array([walk(house(), 200, "half", strategy, law, seed) for seed in range(5)])
        for strategy in ("shortest", "fastest")
    )
    gained = shortest[:, 0] - fastest[:, 0]
    assert gained.mean() > 2.8 * gained.std(ddof=1) / np.sqrt(5) + 15.0
    assert 0.35 < fastest[:, 1].mean() < 0.55


@pytest.mark.more
@pytest.mark.parametrize("law", ["dem", "nsm2"])
def test_a_symmetric_building_is_shared_evenly(law):
    found = np.array([walk(house(), 100, "upper", "fastest", law, seed) for seed in range(4)])
    assert found[:, 1].mean() == pytest.approx(0.5, abs=0.06)


def times_of(place, size, least, x):
    """Return the travel times [s] of bodies of ``size`` from places ``x`` [m] along the axis of the upper level."""
    field = travel_time_field(place, 0.3, min_radius=least)
    points = np.column_stack([x, np.full(len(x), 4.0)])
    return field.travel_time_for(place.laid_out(points, np.ones(len(x), dtype=int)), size) - field.behind


@looped("least", [0.3, 0.2])
def test_bodies_keep_off_a_stair_that_is_too_narrow_for_them(least):
    x, down = np.array([22.0, 12.0, 2.0]), np.hypot(RISE, RUN) / (51.8 * np.sqrt(TREAD * RISERS / RISE) / 84.0)
    found = times_of(house(1.2, 0.5), 0.3, least, x)
    np.testing.assert_allclose(found, x + down + 3.0, rtol=0.03)  # by the west stair


@pytest.mark.filterwarnings("ignore:the way out from")
def test_where_only_small_bodies_get_down_the_way_is_theirs():
    at = np.array([12.0])
    place = house(0.5, 0.5)
    assert np.isfinite(times_of(place, 0.2, 0.2, at)).all() and np.isinf(times_of(place, 0.3, 0.2, at)).all()
    with pytest.raises(ValueError, match="no exit can be reached from 'upper'"):
        travel_time_field(place, 0.3)


@pytest.mark.parametrize("strategy", ["shortest", "fastest"])
def test_wide_people_walk_to_the_stair_that_is_wide_enough(strategy):
    place = house(1.2, 0.5)
    people = Population(12, radius=Uniform(0.25, 0.3), start_region="half")
    scenario = Scenario("house", place, people, 600.0)
    routes = scenario.route_set(strategy)
    bodies, position = people.draw(np.random.default_rng(0), place, scenario.room)
    start, sheet = place.on_sheets(position)
    state = make_state(start, sheet=sheet)
    state.route[:] = scenario.choose(routes, strategy, position, bodies.radius, bodies.group)
    run = Simulation(place, bodies, state, physics="dem", fields=[routes])
    while state.active.any() and state.time[0] < 60.0:
        run.advance(n_substeps=round(0.5 / run.dt))
        assert not (state.sheet == 3).any()
    assert (state.exit_index == list(place.exit_names).index("west")).all()


@pytest.mark.more
@looped(("strategy", "way"), [("shortest", "stair"), ("comfortable", "ramp")])
def test_the_comfortable_way_takes_the_ramp(strategy, way):
    """The stair is nearer; a meter of it costs as much as four."""
    ends = box(-13, 0, 41, 10)
    levels = [
        Level("ground", 0.0, ends, exits={"west": [(-13, 3), (-13, 5)], "east": [(41, 3), (41, 5)]}),
        Level("upper", RISE, box(0, 0, 24, 8)),
    ]
    stair = Stair("stair", "ground", "upper", (-RUN, 4.0), 0.0, riser=RISE / RISERS)
    ramp = Ramp("ramp", "ground", "upper", (34.0, 4.0), 180.0, 10.0)
    place = building(levels, [stair], [ramp])
    field = (
        Scenario("house", place, Population(1), 60.0)
        .route_set(strategy)
        .routes[1 if strategy != "shortest" else 0]
        .field
    )
    at = place.laid_out(np.array([[11.0, 4.0]]), np.array([1]))
    row, col = (int(n[0]) for n in nearest_nodes(at, field.origin, field.spacing, field.travel_time.shape))
    assert np.sign(field.direction[row, col, 0]) == (1.0 if way == "ramp" else -1.0)


@pytest.mark.more
def test_a_checkpoint_keeps_the_ways_of_all_sheets():
    place = house()
    scenario = Scenario("house", place, Population(60, start_region="half"), 600.0)
    bodies, position = scenario.population.draw(np.random.default_rng(0), place, scenario.room)
    start, sheet = place.on_sheets(position)
    routes = scenario.route_set("fastest")
    state = make_state(start, sheet=sheet)
    state.route[:] = scenario.choose(routes, "fastest", position, bodies.radius, bodies.group)
    run = Simulation(place, bodies, state, physics="dem", walking="hurried", fields=[routes])
    run.advance(n_substeps=round(6.3 / run.dt))
    then, found = run.checkpoint(), []
    for _ in range(2):
        run.advance(n_substeps=round(6.0 / run.dt))
        found.append(run.state.position.copy())
        run.restore(then)
    np.testing.assert_array_equal(*found)
