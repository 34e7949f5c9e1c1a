"""Strategies at work: the fastest way through a crowd, speed zones and control rules, under every scheme where it matters."""

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import simulations
from cases import looped
from crowds import copied, every_scheme, joined, part, people, scatter
from repository import ROOT
from shapely.geometry import Point, box

from crowd_env import make_scenario
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.envs.rollout import run_episodes
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.neighbors.lists import invalidate_lists
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.routing.fields.field import join_fields
from crowd_env.routing.fields.fundamental_diagram import SLOWEST, FundamentalDiagram, weidmann
from crowd_env.routing.fields.lookup import direction_at
from crowd_env.routing.route_set import RoutePlan, region_masks
from crowd_env.routing.spec import ControlRule, Route
from crowd_env.routing.speed_map import SpeedZone

QUICK = Route("quick", strategy="fastest")


@cache
def two_exits():
    """Return a hall with two equal exits of 1.2 m."""
    return Geometry.from_polygon(box(0, 0, 12, 8), exits={"west": [(0, 3.4), (0, 4.6)], "east": [(12, 3.4), (12, 4.6)]})


@cache
def quick_routes():
    return RoutePlan(two_exits(), 0.25, min_radius=0.2, routes=[QUICK]).build()


def crowd(count, seed, area):
    rng = np.random.default_rng(seed)
    bodies = people(rng, count)
    return bodies, make_state(scatter(rng, Geometry.from_polygon(area), bodies.radius))


def simulate(route_set, position, *, name="nsm2", route=0, speed=1.5, envs=1, dt=0.01, **options):
    """Return a simulation of people of 0.2 m at ``position``."""
    bodies = make_bodies(np.full(len(position), 0.2), 80.0, desired_speed=speed, relaxation_time=0.2)
    bodies = bodies._replace(env_start=np.linspace(0, len(position), envs + 1).astype(np.int64))
    state = make_state(position, environments=envs)
    state.route[:] = route
    return simulations.simulate(route_set.geometry, bodies, state, scheme=name, dt=dt, fields=[route_set], **options)


def evacuate(name, route, seed):
    bodies, state = crowd(90, seed, box(6.5, 0.2, 11.8, 7.8))
    state.route[:] = route
    simulation = simulations.simulate(two_exits(), bodies, state, scheme=name, dt=0.01, fields=[quick_routes()])
    while simulation.inside[0] and state.time[0] < 120:
        simulation.advance(n_substeps=100)
    return state


@pytest.mark.parametrize("name", ["dem", "nsm1-inertial", "nsm2"])
def test_the_fastest_way_shares_people_out_and_is_faster_than_the_nearest_exit(name):
    gained = []
    for seed in (1, 2):
        shortest, quick = evacuate(name, 0, seed), evacuate(name, 1, seed)
        assert (shortest.exit_index == 1).all()
        assert 0.3 < (quick.exit_index == 0).mean() < 0.6  # of a crowd that starts all on one side
        assert quick.exit_time.max() < 0.9 * shortest.exit_time.max()
        gained.append(shortest.exit_time.mean() - quick.exit_time.mean())
    assert np.mean(gained) > 0  # one draw alone can be a hundredth of a second slower in the mean


def test_an_empty_place_gives_the_direction_of_the_shortest_way():
    geometry = Geometry.from_polygon(
        box(0, 0, 12, 8), exits=[[(12, 3.4), (12, 4.6)]], obstacles=[box(4, 2, 5, 6), Point(8.5, 2).buffer(0.7)]
    )
    route_set = RoutePlan(geometry, 0.25, routes=[QUICK]).build()
    arrays = join_fields([way.field for way in route_set.routes], geometry.boundary, [0, 0])
    points = np.random.default_rng(2).uniform((0, 0), (12, 8), (1500, 2))
    points = points[geometry.contains(points) & (geometry.clearance(points) > 0.6)]
    turn = []
    for x, y in points:
        a, b = (np.array(direction_at(arrays, geometry.boundary, f, x, y, 0.25)) for f in (0, 1))
        turn.append(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))
    assert np.median(turn) < 4
    assert np.quantile(turn, 0.95) < 12  # the rest stands where two ways are equally long


def test_density_integrates_to_the_number_of_people():
    congestion = quick_routes().routes[1].congestion
    cell = congestion.spacing**2
    for area, most in ((box(2, 2, 10, 6), 1e-9), (box(0.2, 0.2, 11.8, 7.8), 0.12), (box(0, 0, 4, 4), 0.25)):
        _, state = crowd(30, 4, area)
        density = congestion.density(state.position)
        assert density.sum() * cell == pytest.approx(30, rel=most)
        assert density.max() < 30 / 1.0


def test_speed_falls_with_density_as_weidmann_says():
    # Weidmann's (1993) fundamental diagram of level walkways, 1.34 m/s freely.
    for density, speed in ((1.0, 1.06), (2.0, 0.61), (3.0, 0.33), (4.0, 0.16)):
        assert 1.34 * weidmann(np.array([density]))[0] == pytest.approx(speed, abs=0.015)
    assert weidmann(np.array([0.0, 5.4, 9.0])).tolist() == [1.0, SLOWEST, SLOWEST]


def test_the_flow_through_a_door_is_that_of_one_file_or_of_a_front():
    people = FundamentalDiagram(radius=0.2, desired_speed=1.4)
    assert people.flow(np.array([0.0]))[0] == pytest.approx(1.4 / 0.4)  # one behind the other, touching
    touching = 1.0 / (0.4**2 * np.sqrt(3.0) / 2.0)  # 1/m2, packed in triangles
    assert people.flow(np.array([10.0]))[0] == pytest.approx(10.0 * 1.4 * touching)


def test_people_who_keep_a_distance_pass_a_door_as_recorded_crowds_do():
    # Seyfried et al. 2009 (Transp. Sci. 43:395): 1.9 /(m s) through 1 m; the middle of a body has 0.6 m of it.
    people = FundamentalDiagram(radius=0.2, desired_speed=1.4, keeps_distance=True)
    assert people.flow(np.array([0.6]))[0] == pytest.approx(1.9)


def test_people_who_keep_a_distance_are_out_sooner_by_the_faster_of_two_exits():
    hall = replace(make_scenario("two-exit-hall-v0", people=60), manner="hurried")
    shortest, fastest = (
        np.array([run.metrics.evacuation_time for run in run_episodes(hall, 2, strategy=strategy, scheme="dem")])
        for strategy in ("shortest", "fastest")
    )
    assert (fastest < shortest).all()  # weighed with density alone, people leave both doors to each other: 6 s later


def one_exit_times(route, manner, seed):
    """Return when each of 60 people gets out of a room with a door of 1.6 m."""
    geometry = Geometry.from_polygon(box(0, 0, 7, 7), exits=[[(7, 2.7), (7, 4.3)]])
    bodies, state = crowd(60, seed, box(0.2, 0.2, 6.8, 6.8))
    state.route[:] = route
    route_set = RoutePlan(geometry, 0.25, min_radius=0.2, routes=[QUICK]).build()
    simulation = Simulation(geometry, bodies, state, walking=manner, fields=[route_set])
    while simulation.inside[0] and state.time[0] < 90:
        simulation.advance(n_substeps=100)
    return np.where(state.active, 90.0, np.nan_to_num(state.exit_time))


@looped("manner", ["competitive", "hurried"])
def test_with_one_exit_the_fastest_way_is_not_slower_than_the_shortest(manner):
    later = []
    for seed in range(3):
        shortest, quick = one_exit_times(0, manner, seed), one_exit_times(1, manner, seed)
        later.append([quick.mean() / shortest.mean() - 1.0, quick.max() / shortest.max() - 1.0])
    assert (np.mean(later, axis=0) < 0.04).all()  # weighed with a density that holds nobody up it is a quarter


@looped("radius", [0.2, 0.15])
def test_the_fastest_way_does_not_lead_through_a_thin_wall(radius):
    wall, door = [(5.1, 0), (5.1, 4.8)], [(10, 0.5), (10, 2)]
    quick = RoutePlan(
        Geometry.from_polygon(box(0, 0, 10, 6), exits=[door], thin_walls=[wall]), radius, routes=[QUICK]
    ).build()
    field = quick.routes[1].field
    assert field.travel_time[round(1 / field.spacing), round(4.6 / field.spacing)] > 9.0  # 5.4 m through the wall


def run_batch(crowds, *, name="nsm2", calls=12, n_substeps=25, **options):
    bodies, state = joined([copied(*one) for one in crowds])
    state.route[:] = 1
    simulation = simulations.simulate(
        two_exits(), bodies, state, scheme=name, dt=0.01, fields=[quick_routes()], **options
    )
    for _ in range(calls):
        simulation.advance(n_substeps=n_substeps)
    return simulation


@pytest.mark.parametrize("name", ["dem", "nsm1", "nsm2"])
def test_replanning_gives_the_same_bits_alone_in_a_batch_in_threads_and_however_calls_are_cut(name):
    crowds = [crowd(n, 20 + n, box(7, 1, 11.8, 7)) for n in (30, 12, 1)]
    batch = run_batch(crowds, name=name)
    for e, one in enumerate(crowds):
        alone = run_batch([one], name=name)
        for field, expected in part(alone.state, alone.bodies, 0).items():
            np.testing.assert_array_equal(part(batch.state, batch.bodies, e)[field], expected)
    for calls, n_substeps, threads in ((12, 25, 2), (300, 1, 1), (4, 75, 1), (1, 300, 1)):
        other = run_batch(crowds, name=name, calls=calls, n_substeps=n_substeps, threads=threads)
        for field in other.state._fields:
            np.testing.assert_array_equal(getattr(other.state, field), getattr(batch.state, field))
    assert batch.planner.marches == 3 * len(crowds)  # at 0, 1 and 2 s


def test_environments_that_began_at_other_times_replan_at_their_own():
    crowds = [crowd(n, 20 + n, box(7, 1, 11.8, 7)) for n in (30, 25)]
    batch = run_batch(crowds, calls=1, n_substeps=37)
    batch.restart(1, crowds[1][0], crowds[1][1].position, route=1)
    batch.advance(n_substeps=213)
    for e, steps in ((0, 250), (1, 213)):
        alone = run_batch([crowds[e]], calls=1, n_substeps=steps)
        np.testing.assert_array_equal(part(batch.state, batch.bodies, e)["position"], alone.state.position)


def corridor(zones):
    regions = {"a": box(3, 0, 9, 3), "b": box(6, 0, 12, 3)}
    geometry = Geometry.from_polygon(box(0, 0, 20, 3), exits=[[(20, 0), (20, 3)]], regions=regions)
    return RoutePlan(geometry, 0.25, zones=zones).build()


@every_scheme
@looped(
    ("zones", "speeds"),
    [
        ([SpeedZone("a", speed=0.5)], (1.5, 0.5, 0.5, 1.5, 1.5)),
        ([SpeedZone("b", factor=0.4)], (1.5, 1.5, 0.6, 0.6, 1.5)),
        ([SpeedZone("a", speed=1.0), SpeedZone("b", factor=0.5)], (1.5, 1.0, 0.5, 0.75, 1.5)),
        ([SpeedZone("a", factor=0.5), SpeedZone("b", factor=2.0)], (1.5, 0.75, 1.5, 3.0, 1.5)),
    ],
)
def test_people_walk_as_fast_as_the_zones_say_after_relaxation(name, zones, speeds):
    x = np.array([1.0, 4.0, 7.0, 10.0, 13.0])
    simulation = simulate(corridor(zones), np.column_stack([x, np.full(5, 1.5)]), name=name, dt=0.01)
    simulation.advance(n_substeps=60)  # three relaxation times; nobody is in another zone yet, or in reach of another
    speed = np.hypot(*simulation.state.velocity.T)
    np.testing.assert_allclose(speed, speeds, rtol=0.06)
    np.testing.assert_allclose(simulation.history.local_speed, speeds)


@every_scheme
def test_stairs_are_left_as_fast_as_they_were_entered(name):
    simulation = simulate(corridor([SpeedZone("a", speed=0.5)]), [[1.0, 1.5]], name=name)
    track = []
    for _ in range(340):
        simulation.advance(n_substeps=5)
        track.append((simulation.state.velocity[0, 0], simulation.state.position[0, 0]))
    speed, x = np.array(track).T
    np.testing.assert_allclose(speed[(x > 5) & (x < 9)], 0.5, atol=2e-3)
    np.testing.assert_allclose(speed[((x > 2.6) & (x < 3)) | (x > 11)], 1.5, rtol=0.01)


@cache
def rule_routes(*rules):
    """Return a hall where all would leave by the east door, through region "gate"; "lobby" lies left of it."""
    regions = {"gate": box(8, 0, 10, 4), "lobby": box(4, 0, 8, 4), "west": box(0, 0, 2, 4)}
    geometry = Geometry.from_polygon(
        box(0, 0, 12, 4), exits={"left": [(0, 1), (0, 3)], "right": [(12, 1), (12, 3)]}, regions=regions
    )
    return RoutePlan(geometry, 0.25, rules=rules, routes=[Route("on", ("right",))]).build()


STANDING = np.array([[8.6, 1.0], [8.6, 2.0], [8.6, 3.0]])
WALKING = np.array([[5.0, 2.0], [7.0, 1.0], [11.0, 2.0], [1.0, 2.0]])


def ruled(rules, *, waiting=3, walking=WALKING, **options):
    """Return a simulation where so many stand in the gate and others walk to the right exit."""
    position = np.concatenate([STANDING[:waiting], walking])
    speed = np.where(np.arange(len(position)) < waiting, 0.0, 1.0)
    return simulate(rule_routes(*rules), position, route=1, speed=speed, **options)


@looped("waiting", [0, 1, 2, 3])
def test_a_rule_is_on_at_so_many_and_sends_only_those_who_would_come_through(waiting):
    simulation = ruled([ControlRule("gate", 2, "left")], waiting=waiting)
    simulation.advance(n_substeps=1)
    on = waiting >= 2
    assert simulation.history.rule_on.tolist() == [[on]]
    followed, left = simulation.history.followed, rule_routes(ControlRule("gate", 2, "left")).number("left")
    assert (followed[:waiting] == 1).all()  # whoever stands in the region goes on
    assert followed[waiting:].tolist() == ([left, left, 1, left] if on else [1] * 4)  # the third one is past it
    assert (simulation.state.route == 1).all()  # they still mean to go where they wanted to


def test_regions_are_bits_and_counts_are_those_of_brute_force():
    route_set = rule_routes(
        *(ControlRule(region, n, "left") for region in ("gate", "lobby", "west") for n in (3, 6, 9))
    )
    rng = np.random.default_rng(8)
    geometry = route_set.geometry
    simulation = simulate(route_set, rng.uniform((0.1, 0.1), (11.9, 3.9), (40, 2)), speed=0.0)
    state = simulation.state
    state.active[::5] = False
    invalidate_lists(simulation.workspace.neighbors)
    x = state.position.copy()
    simulation.advance(n_substeps=1)
    inside = region_masks(geometry, x)
    near = np.abs(x[:, :1] - [[2, 4, 8, 10]]).min(axis=1) < 0.05
    np.testing.assert_array_equal(simulation.history.region_bits[state.active & ~near], inside[state.active & ~near])
    counts = [int((simulation.history.region_bits[state.active] >> k & 1).sum()) for k in range(3)]
    assert simulation.history.rule_on[0].tolist() == [n <= count for count in counts for n in (3, 6, 9)]


def test_a_rule_goes_off_below_and_not_before_hold():
    for below, hold, off_at in ((None, 0.0, 2), (1, 0.0, 0), (0, 0.0, None), (2, 1.5, 1)):
        simulation = ruled([ControlRule("gate", 3, "left", below=below, hold=hold)])
        simulation.advance(n_substeps=1)
        assert simulation.history.rule_on[0, 0]
        for k in range(3):  # one after the other is gone
            simulation.state.active[k] = False
            simulation.advance(n_substeps=20)
            held = simulation.state.time[0] < hold
            fewer = 2 - k < (3 if below is None else below)
            assert simulation.history.rule_on[0, 0] == (held or not fewer), (below, hold, k)
        simulation.advance(n_substeps=100)
        assert simulation.history.rule_on[0, 0] == (off_at is None)


@looped("commits", [False, True])
def test_whoever_was_sent_another_way_keeps_to_it_if_the_rule_commits(commits):
    simulation = ruled([ControlRule("gate", 3, "left", commits=commits)])
    simulation.advance(n_substeps=30)
    simulation.state.active[:3] = False
    simulation.advance(n_substeps=5)
    left = simulation.planner.route_set(0).number("left")
    expected = [left, left, 1, left] if commits else [1] * 4
    assert simulation.state.route[3:].tolist() == simulation.history.followed[3:].tolist() == expected
    simulation.advance(n_substeps=1300)
    assert simulation.state.exit_index[3:].tolist() == ([0, 0, 1, 0] if commits else [1] * 4)


def test_of_several_rules_the_first_that_applies_counts():
    for order in (("gate", "lobby"), ("lobby", "gate")):
        rules = [ControlRule(region, 1, "left" if region == "gate" else "out") for region in order]
        simulation = ruled(rules, walking=np.array([[1.0, 1.0], [5.0, 1.0], [7.0, 2.0]]), waiting=1)
        simulation.advance(n_substeps=1)
        left = simulation.planner.route_set(0).number("left")
        # 1: through both; 2, 3: stand in the lobby, so that only the rule on the gate concerns them.
        assert simulation.history.followed.tolist() == [1, left if order[0] == "gate" else 0, left, left]


@every_scheme
def test_a_rule_switches_at_the_look_after_the_count_is_reached(name):
    # One walks into the gate, where one stands: the rule is on then, in the middle of a call if need be.
    position = np.array([[9.5, 0.5], [7.5, 3.0], [3.0, 1.5]])
    runs = []
    for per_call in (1, 7, 150):
        route_set = rule_routes(ControlRule("gate", 2, "left"))
        runs.append(simulate(route_set, position, route=1, speed=[0.0, 1.0, 1.0], name=name))
        for _ in range(149 // per_call + 1):
            runs[-1].advance(n_substeps=per_call)
            if per_call == 1 and runs[0].state.position[1, 0] < 8.0:
                crossed = runs[0].state.time[0]
    for run in runs:
        assert run.history.rule_on[0, 0]
        assert run.history.rule_since[0, 0] == pytest.approx(crossed, abs=0.0201)


@pytest.mark.parametrize("name", ["dem", "nsm1", "nsm2", "hertz"])
def test_rules_give_the_same_bits_in_a_batch_in_threads_and_however_calls_are_cut(name):
    rules = [ControlRule("gate", 3, "left", below=2, hold=0.4)]
    batches = []
    for calls, options in ((1, {}), (6, {}), (120, {}), (3, dict(threads=2))):
        together = simulate(
            rule_routes(*rules), np.tile(np.concatenate([STANDING, WALKING]), (3, 1)), route=1, name=name, envs=3,
            dt=0.001 if name == "hertz" else 0.01, **options,
        )  # fmt: skip
        together.state.active[0] = False
        for _ in range(calls):
            together.advance(n_substeps=round(1.2 / together.dt) // calls)
        batches.append(together)
    for other in batches[1:]:
        for field in other.state._fields:
            np.testing.assert_array_equal(getattr(other.state, field), getattr(batches[0].state, field))
    position = batches[0].state.position.reshape(3, 7, 2)
    np.testing.assert_array_equal(position[1], position[2])
    assert (position[0, 3:] != position[1, 3:]).any()


@every_scheme
def test_a_route_written_mid_run_sends_people_elsewhere(name):
    route_set = RoutePlan(two_exits(), 0.25, routes=[Route("left", ("west",)), Route("right", ("east",))]).build()
    simulation = simulate(route_set, [[4.0, 4.0], [8.0, 4.0]], name=name)
    simulation.advance(n_substeps=50)
    assert (simulation.state.velocity[:, 0] * [-1, 1] > 1).all()
    simulation.state.route[:] = [route_set.number("right"), route_set.number("left")]
    simulation.advance(n_substeps=80)
    assert (simulation.state.velocity[:, 0] * [1, -1] > 0.5).all()


@every_scheme
def test_a_route_via_a_region_is_walked_there_first_and_then_on(name):
    geometry = Geometry.from_polygon(
        box(0, 0, 8, 5), exits={"door": [(0, 1), (0, 2)]}, regions={"bay": box(5, 3.5, 6, 4.5)}
    )
    route_set = RoutePlan(geometry, 0.25, routes=[Route("round", via="bay")]).build()
    simulation = simulate(route_set, [[2.0, 1.5], [5.5, 4.0]], route=1, name=name)
    simulation.advance(n_substeps=1)
    assert simulation.state.route.tolist() == [1, route_set.number("round/then")]  # the second one stands there
    simulation.advance(n_substeps=1200)
    assert simulation.state.exit_index.tolist() == [0, 0]
    length = np.hypot(3.0, 2.0) + np.hypot(5.0, 2.0)
    assert simulation.state.exit_time[0] == pytest.approx(length / 1.5 + 0.2, rel=0.1)


BAD_ROUTE = """
from test_strategies import *
simulation = simulate(quick_routes(), [[4.0, 4.0]])
simulation.state.route[:] = 10**9
simulation.advance(n_substeps=3)
"""


@pytest.mark.more
def test_a_route_out_of_range_does_not_end_the_process():
    done = subprocess.run(
        [sys.executable, "-c", BAD_ROUTE], capture_output=True, text=True, cwd=Path(__file__).parent,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "tests"), str(ROOT)])}, check=False,
    )  # fmt: skip
    assert "ValueError: route of pedestrian 0 is" in done.stderr
