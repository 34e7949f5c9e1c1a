"""Doors: an open one is not there, a closed one lets nobody through under any scheme, and ways follow."""

import warnings
from functools import cache

import numpy as np
import pytest
import simulations
from cases import looped
from crowds import copied, every_scheme, people, scatter
from shapely.geometry import box

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.observation.view import SIGHT
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.helbing import Helbing
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import DoorEvent, Route
from crowd_env.scenarios.population import Population, Uniform
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario

EXITS = {"west": [(0, 1), (0, 3)], "east": [(10, 1), (10, 3)]}
REGIONS = {"left": box(0, 0, 5, 4), "right": box(5, 0, 10, 4)}
WALLS = [box(4.9, 0, 5.1, 1), box(4.9, 3, 5.1, 4)]
DOORS = {"gate": [(5, 1), (5, 3)], "west door": "west", "east door": "east"}


@cache
def hall(doors=True):
    """Return two rooms with an exit each, joined by a gate of 2 m."""
    return Geometry.from_polygon(
        box(0, 0, 10, 4), exits=EXITS, obstacles=WALLS, regions=REGIONS, doors=DOORS if doors else None
    )


@cache
def route_set_of(doors=True, closed=(), events=(), routes=()):
    return RoutePlan(hall(doors), 0.25, min_radius=0.2, closed_at_start=closed, events=events, routes=routes).build()


def simulate(route_set, *crowds, name="nsm2", **options):
    """Return a simulation of crowds (positions each), one environment each, all of whom walk at 1.5 m/s."""
    position = np.concatenate([np.asarray(crowd, dtype=float).reshape(-1, 2) for crowd in crowds])
    start = np.cumsum([0, *(len(crowd) for crowd in crowds)])
    bodies = make_bodies(np.full(len(position), 0.2), 80.0, desired_speed=1.5, relaxation_time=0.3, env_start=start)
    state = make_state(position, environments=len(crowds))
    flat = {"scheme": name, "dt": 0.01, "allow_unstable": True, "fields": [route_set], **options}
    return simulations.simulate(route_set.geometry, bodies, state, **flat)


def crowd(count=25):
    rng = np.random.default_rng(3)
    bodies = people(rng, count)
    return bodies, make_state(scatter(rng, Geometry.from_polygon(box(5.3, 0, 9.8, 4)), bodies.radius))


# --------------------------------------------------------------------------------------------------------------- open


@every_scheme
def test_an_open_door_is_not_there_bit_by_bit(name):
    law = Helbing(social=None) if name == "helbing" else name  # whose social force keeps people apart
    runs = []
    for doors in (True, False):
        bodies, state = copied(*crowd())
        route = Route("through", ("west",))
        route_set = route_set_of(doors, routes=(route,))
        state.route[:] = 1
        simulation = Simulation(
            hall(doors), bodies, state, physics=Physics(law, dt=0.01, allow_unstable=True), fields=[route_set]
        )
        simulation.advance(n_substeps=250)
        runs.append(simulation)
    for field in runs[0].state._fields:
        np.testing.assert_array_equal(*(getattr(run.state, field) for run in runs), err_msg=field)
    for a, b in zip(*(run.diagnostics for run in runs), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (runs[0].state.position[:, 0] < 4.8).sum() > 3
    assert runs[0].diagnostics.max_overlap[0] > 0


# ------------------------------------------------------------------------------------------------------------- closed


@every_scheme
@looped(("door", "push"), [("gate", -1.0), ("east door", 1.0)])
def test_nobody_passes_a_closed_door_however_hard_they_push(name, door, push):
    bodies, state = copied(*crowd(30))
    simulation = Simulation(
        hall(), bodies, state, physics=Physics(name, dt=0.001 if "hertz" in name else 0.01), fields=[route_set_of()]
    )
    simulation.close_doors(0, [door])
    towards = np.tile([push, 0.0], (30, 1)), np.zeros(30, bool)
    force = push * np.tile([150.0, 0.0], (30, 1))
    simulation.advance(towards[0], relative=towards[1], n_substeps=round(2.5 / simulation.dt), external_force=force)
    leaves = hall().walls[hall().door_of_wall >= 0, :, 0].mean(axis=1)  # those of exits a millimeter inside
    assert leaves == pytest.approx([5.0, 0.001, 9.999])
    front = (state.position[:, 0] - 5.0) if push < 0 else (10.0 - state.position[:, 0])
    assert 0.1 < front.min() < 0.3  # at the leaf, no more than half a body in it
    assert state.active.all() and hall().contains(state.position).all()


@every_scheme
def test_a_door_that_closes_on_people_pushes_them_to_one_side(name):
    dt = 0.001 if "hertz" in name else 0.01
    start = [[5.03, 1.3], [5.15, 1.8], [4.97, 2.4], [4.8, 2.9], [5.5, 2.0]]
    bodies = make_bodies(np.full(5, 0.2), 80.0, desired_speed=1.5, relaxation_time=0.3)
    state = make_state(start)
    simulation = Simulation(hall(), bodies, state, physics=Physics(name, dt=dt), fields=[route_set_of()])
    simulation.advance(n_substeps=1)
    simulation.close_doors(0, ["gate"])
    simulation.advance(n_substeps=1)
    assert simulation.contacts().gap.min() < -0.1  # the leaf is there in the very next step
    fastest = 0.0
    for _ in range(30):
        simulation.advance(n_substeps=round(0.05 / dt))
        assert np.isfinite(state.position).all()
        fastest = max(fastest, np.hypot(*state.velocity[state.active].T).max(initial=0.0))
    side = np.array([1, 1, -1, -1, 1])
    assert (side * (state.position[:, 0] - 5.0) > 0.15).all(), state.position
    assert fastest < 25  # m/s; a spring of 20 cm overlap throws far, but nothing explodes
    simulation.advance(n_substeps=round(1.0 / dt))
    assert np.hypot(*state.velocity[state.active].T).max(initial=0.0) < 5


@pytest.mark.parametrize("name", ["dem", "hertz"])  # nsm2 acts on velocities alone: it goes no deeper
def test_who_stands_exactly_on_the_line_of_a_door_gets_off_it(name):
    simulation = simulate(route_set_of(), [[5.0, 1.3]], name=name)
    simulation.close_doors(0, ["gate"])
    simulation.advance(n_substeps=200)
    assert abs(simulation.state.position[0, 0] - 5.0) > 0.15


@every_scheme
def test_people_behind_a_closed_door_take_the_other_exit(name):
    simulation = simulate(route_set_of(), [[1.0, 2.0], [9.0, 2.0]], name=name)
    simulation.close_doors(0, ["west door"])
    simulation.advance(n_substeps=900)
    assert simulation.state.exit_index.tolist() == [1, 1]
    assert simulation.state.exit_time[0] == pytest.approx(9 / 1.5 + 0.3, abs=0.4)


def test_environments_of_a_batch_have_doors_of_their_own():
    two = [[2.0, 2.0], [8.0, 2.2]]
    batch = simulate(route_set_of(), two, two, two)
    batch.close_doors(1, ["west door"])
    alone = []
    for closed in ([], ["west door"], []):
        alone.append(simulate(route_set_of(), two))
        alone[-1].close_doors(0, closed)
    for simulation in (batch, *alone):
        simulation.advance(n_substeps=600)
    np.testing.assert_array_equal(batch.state.exit_time, np.concatenate([one.state.exit_time for one in alone]))
    assert batch.state.exit_index.tolist() == [0, 1, 1, 1, 0, 1]
    assert batch.planner.route_set(0) is batch.planner.route_set(2) is not batch.planner.route_set(1)


def test_a_restart_puts_the_doors_as_they_were():
    route_set = route_set_of(
        closed=("west door",), events=(DoorEvent("west door", True, at=0.5), DoorEvent("gate", False, at=0.7))
    )
    simulation = simulate(route_set, [[2.0, 2.0]], [[2.0, 2.0]])
    assert simulation.history.door_open.tolist() == [[True, False, True]] * 2
    for _ in range(2):
        simulation.advance(n_substeps=100)
        assert simulation.history.door_open.tolist() == [[False, True, True]] * 2
        bodies = make_bodies([0.2], 80.0, desired_speed=1.5, relaxation_time=0.3)
        simulation.restart(0, bodies, np.array([[2.0, 2.0]]))
        assert simulation.history.door_open.tolist() == [[True, False, True], [False, True, True]]
        simulation.restart(1, bodies, np.array([[2.0, 2.0]]))


def test_locked_in_there_is_a_warning_and_people_wait():
    simulation = simulate(route_set_of(), [[2.0, 2.0], [8.0, 2.0]])
    with pytest.warns(UserWarning, match="with east door, west door closed people wait there: all exits .* are closed"):
        simulation.close_doors(0, ["west door", "east door"])
    simulation.advance(n_substeps=400)
    assert simulation.state.active.all()
    assert simulation.state.position[:, 0] == pytest.approx([0.2, 9.8], abs=0.02)  # in front of the exits they know
    simulation.close_doors(0, ["west door"])
    simulation.advance(n_substeps=900)
    assert simulation.state.exit_index.tolist() == [1, 1]


def test_a_route_to_a_closed_exit_does_not_keep_others_from_the_open_one():
    simulation = simulate(route_set_of(routes=(Route("west", ("west",)),)), [[2.0, 2.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        simulation.close_doors(0, ["west door"])
    simulation.advance(n_substeps=800)
    assert simulation.state.exit_index.tolist() == [1]


# ------------------------------------------------------------------------------------------------------------- events


def moment(events, crowds, *, door="gate", opens=False, closed=(), per_call=1, steps=300, environment=0):
    """Return when a door moved, to the step, and the simulation."""
    simulation = simulate(route_set_of(closed=closed, events=tuple(events)), *crowds)
    row, when = hall().doors.index(door), np.nan
    for _ in range(steps // per_call):
        simulation.advance(n_substeps=per_call)
        if np.isnan(when) and simulation.history.door_open[environment, row] == opens:
            when = simulation.state.time[environment] - per_call * simulation.dt
    return when, simulation


def test_a_door_opens_and_closes_at_a_time():
    at, simulation = moment([DoorEvent("gate", False, at=0.73)], [[[9.0, 2.0]]])
    assert at == pytest.approx(0.73, abs=0.011)
    at, _ = moment([DoorEvent("gate", True, at=0.4)], [[[9.0, 2.0]]], opens=True, closed=("gate",))
    assert at == pytest.approx(0.4, abs=0.011)
    events = [DoorEvent("gate", False, at=0.2), DoorEvent("gate", True, at=0.9)]
    assert moment(events, [[[9.0, 2.0]]], steps=80)[1].history.door_open[0, 0] == np.False_
    assert moment(events, [[[9.0, 2.0]]], steps=120)[1].history.door_open[0, 0] == np.True_
    assert simulation.state.active.tolist() == [False]


def test_a_door_closes_when_so_many_have_left_by_an_exit():
    position = [[9.0, 1.3], [8.0, 2.0], [7.0, 2.7], [1.0, 2.0]]
    event = DoorEvent("east door", False, at_least=2, exit="east")
    at, simulation = moment([event], [position], door="east door", steps=900)
    left = np.sort(simulation.state.exit_time[:2])
    assert left[1] - 0.01 <= at <= left[1] + 0.11  # looked at every 0.1 s
    assert simulation.state.exit_index.tolist() == [1, 1, 0, 0]  # the third one walks back


def test_a_door_closes_when_so_many_stand_in_a_region():
    position = [[2.0, 1.0], [6.0, 1.5], [6.0, 2.5], [6.6, 2.0]]
    simulation = simulate(route_set_of(events=(DoorEvent("gate", False, at_least=3, region="left"),)), position)
    west = dict(command=np.tile([-1.0, 0.0], (4, 1)), relative=np.zeros(4, bool))
    while simulation.history.door_open[0, 0] and simulation.state.time[0] < 3:
        simulation.advance(n_substeps=1, **west)
    x = simulation.state.position[:, 0]
    assert (x < 5).sum() == 3  # the brute count, within the step of 1 cm
    assert np.abs(np.sort(x)[2] - 5) < 0.17  # looked at every 0.1 s


def test_a_door_moves_at_the_same_time_however_calls_are_cut():
    event = DoorEvent("west door", False, at=0.55)
    runs = [moment([event], [[[4.0, 2.0]]], door="west door", per_call=n, steps=210)[1] for n in (1, 7, 10, 210)]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.state.position, runs[0].state.position)


def test_fastest_ways_behind_closed_doors_follow_the_crowd_of_their_own_environment():
    route_set = route_set_of(routes=(Route("quick", strategy="fastest"),))
    crowds = [[[x, y] for x in (6.0, 7.0, 8.0) for y in np.arange(0.5, 3.6, 0.5)], [[2.0, 2.0]], [[9.0, 2.0]]]
    simulation = simulate(route_set, *crowds, manner="hurried")
    for e in (0, 1):
        simulation.close_doors(e, ["west door"])
    simulation.advance(n_substeps=1)
    rows, nodes = simulation.world.guidance.field_of_route[:, 1], simulation.world.field.node_start
    times = [np.nanmax(simulation.world.field.travel_time[nodes[f] : nodes[f + 1]]) for f in rows]
    assert len(set(rows)) == 3
    assert times[0] > times[1] + 1 > times[2] + 4  # a crowd in the way, an empty hall, and both exits open


def test_a_door_elsewhere_leaves_the_fastest_ways_as_they_are():
    route_set = route_set_of(routes=(Route("quick", strategy="fastest"),))
    rng = np.random.default_rng(0)
    simulation = simulate(route_set, rng.uniform((6, 0.5), (9.5, 3.5), (20, 2)), [[1.0, 1.0]])
    simulation.advance(n_substeps=1)
    field = simulation.world.guidance.field_of_route[0, 1]

    def times():
        nodes = simulation.world.field.node_start
        return simulation.world.field.travel_time[nodes[field] : nodes[field + 1]].copy()

    before = times()
    simulation.close_doors(1, ["west door"])
    np.testing.assert_array_equal(times(), before)


# ---------------------------------------------------------------------------------------------------------------- env


def test_rays_see_closed_doors_and_see_through_open_ones():
    layout = ObservationLayout(terms=("walls",), rays=4)
    people = Population(1, radius=Uniform(0.2, 0.2), starts=np.array([[6.5, 2.0]]))
    scenario = Scenario("doors", hall(), people, 30.0, **FULL_SPEED)
    env = CrowdEnv(scenario, num_envs=2, observation=layout, action={"name": "continuous", "frame": "world"})
    env.reset(seed=1)
    env.simulation.close_doors(1, ["gate"])
    rays = env.observer.observe(env.active) * SIGHT
    west = 2
    assert rays[0, west] == pytest.approx(SIGHT)
    assert rays[1, west] == pytest.approx(1.3, abs=1e-6)
    np.testing.assert_array_equal(np.delete(rays[0], west), np.delete(rays[1], west))


# -------------------------------------------------------------------------------------------------------- wrong input


@looped(
    ("options", "message"),
    [
        ({"closed": ("x",)}, "unknown door 'x'; known: gate, west door, east door"),
        ({"events": (DoorEvent("x", True, at=1.0),)}, "unknown door 'x'"),
        (
            {"events": (DoorEvent("gate", True, at_least=1, exit="x"),)},
            "names an unknown exit 'x'; known: west, east",
        ),
    ],
)
def test_unknown_names_of_events_are_refused_in_one_sentence(options, message):
    with pytest.raises(ValueError, match=message):
        route_set_of(**options)


@looped(
    ("doors", "message"),
    [
        ({"west": [(5, 1), (5, 3)]}, "door 'west' has the name of an exit; it must close that exit"),
        ({"d": "north"}, "door 'd' names an unknown exit 'north'; known: west, east; or give a line"),
        ({"d": [(5, 1), (5, 1.05)]}, r"door 'd' is 0\.050 m wide; it must be at least 0\.1 m"),
        ({"d": [(5, 1), (5, 7)]}, r"door 'd' leaves the walkable area at \(5, .*\); it must cross a passage inside"),
        ({"d": box(5, 1, 6, 2)}, "door 'd' 0 is a Polygon; it must be a LineString or"),
        ({"west": np.array([(5, 1), (5, 3)])}, "door 'west' has the name of an exit"),
    ],
)
def test_impossible_doors_are_refused_in_one_sentence(doors, message):
    with pytest.raises(ValueError, match=message) as caught:
        Geometry.from_polygon(box(0, 0, 10, 4), exits=EXITS, doors=doors)
    assert "\n" not in str(caught.value)


def test_unknown_doors_are_refused_when_they_are_closed():
    simulation = simulate(route_set_of(), [[2.0, 2.0]])
    with pytest.raises(ValueError, match="unknown door 'window'; known: gate, west door, east door"):
        simulation.close_doors(0, ["window"])
    with pytest.raises(ValueError, match="unknown door 'gate'; known: none"):
        simulate(route_set_of(False), [[2.0, 2.0]]).close_doors(0, ["gate"])


def test_a_door_of_an_empty_place_does_not_cut_calls_short(monkeypatch):
    event = DoorEvent("west door", False, at=50.0)  # never: everyone is out by then
    simulation = simulate(route_set_of(events=(event,)), [[0.5, 2.0]])
    simulation.advance(n_substeps=300)
    assert simulation.inside[0] == 0
    targets = []
    monkeypatch.setattr(simulation._stepper, "run_until", lambda target, dt, then: targets.append(target))
    simulation.advance(n_substeps=100_000)
    assert targets == [100_000]
