"""The whole crowd for a centralised critic."""

import numpy as np
import pytest

from crowd_env import FULL_SPEED, Geometry, Normal, Population, Scenario, Uniform, make_scenario, parallel_env
from crowd_env.geometry.geometry import box
from crowd_env.routing.spec import DoorEvent

SMALL = {"people": 8, "time_limit": 6.0}
LINES = {"west": [(0, 1.5), (0, 2.5)], "east": [(8, 1.5), (8, 3.5)]}


def corridor(origin=(0.0, 0.0), *, doors=None, **options):
    """8 x 4 m with two exits, its lower left corner anywhere; two people, one left and one right of the middle."""
    x, y = origin
    lines = {name: [(a + x, b + y) for a, b in line] for name, line in LINES.items()}
    geometry = Geometry.from_polygon(box(x, y, x + 8, y + 4), exits=lines, doors=doors)
    people = Population(
        2,
        radius=Uniform(0.2, 0.2),
        mass=Uniform(70.0, 70.0),
        desired_speed=Uniform(1.5, 1.5),
        relaxation_time=Uniform(0.3, 0.3),
        response_time=Uniform(0.25, 0.25),
        starts=np.array([[1.5, 2.0], [5.0, 2.5]]) + origin,
    )
    return Scenario("corridor", geometry, people, 20.0, **{**FULL_SPEED, **options})


def test_the_state_of_two_people_by_hand():
    env = parallel_env(corridor(), routing="nearest")
    layout = env.state_layout
    assert (layout.people, layout.exits, layout.size) == (2, 2, 2 * 13 + 2 * 5 + 1)
    env.reset(seed=0)
    seen = layout.split(env.state())
    assert seen.people.shape == (2, 13) and seen.exits.shape == (2, 5)
    expected = {
        "inside": [[1], [1]],
        "position": [[1.5, 2.0], [5.0, 2.5]],
        "velocity": [[0, 0], [0, 0]],
        "radius": [[0.2], [0.2]],
        "mass": [[70], [70]],
        "desired_speed": [[1.5], [1.5]],
        "relaxation_time": [[0.3], [0.3]],
        "response_time": [[0.25], [0.25]],
        "route": [[env.env.route_set[0].number("west")], [env.env.route_set[0].number("east")]],
        "exit": [[1, 0], [0, 1]],  # each means to take the nearest
    }
    assert list(expected) == list(layout.of_person)
    for name, values in expected.items():
        np.testing.assert_allclose(seen.people[:, layout[name]], values, rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(seen.exits, [[0, 2.5, 0, 1.5, 1], [8, 1.5, 8, 3.5, 1]])  # inside is to the left
    assert seen.time_left == 20.0
    with pytest.raises(KeyError, match="no column 'speed'; it has: inside, position"):
        layout["speed"]


def test_people_who_are_out_leave_the_exit_they_took_and_nothing_else():
    env = parallel_env(corridor(), routing="east")
    env.reset(seed=0)
    layout = env.state_layout
    np.testing.assert_array_equal(layout.split(env.state()).people[:, layout["exit"]], [[0, 1], [0, 1]])
    while len(env.agents) == 2:
        env.step({})
    gone = [agent not in env.agents for agent in env.possible_agents].index(True)
    people = layout.split(env.state()).people
    assert people[1 - gone, layout["inside"]] == 1
    np.testing.assert_array_equal(people[gone, layout["exit"]], [0, 1])
    people[gone, layout["exit"]] = 0
    assert not people[gone].any()


def test_on_the_shortest_way_any_exit_will_do_and_whoever_is_truncated_took_none():
    env = parallel_env(corridor(), max_cycles=2)
    env.reset(seed=0)
    layout = env.state_layout
    np.testing.assert_array_equal(layout.split(env.state()).people[:, layout["exit"]], [[1, 1], [1, 1]])
    while env.agents:
        env.step({})
    assert not layout.split(env.state()).people.any()
    assert layout.split(env.state()).time_left == 0.0


def test_an_exit_that_a_door_closes_is_not_open():
    env = parallel_env(corridor(doors={"gate": "east"}, door_events=(DoorEvent("gate", opens=False, at=0.5),)))
    env.reset(seed=0)
    layout = env.state_layout
    assert layout.split(env.state()).exits[:, 4].tolist() == [1, 1]
    for _ in range(8):
        env.step({})
    assert layout.split(env.state()).exits[:, 4].tolist() == [1, 0]
    env.reset(seed=0)
    assert layout.split(env.state()).exits[:, 4].tolist() == [1, 1]


def test_places_are_told_from_the_corner_of_the_plan_so_that_float32_can_hold_them():
    here, far = parallel_env(corridor()), parallel_env(corridor((691_000.0, 5_335_000.0)))
    for env in (here, far):
        env.reset(seed=0)
    np.testing.assert_allclose(far.state(), here.state(), atol=1e-6)


@pytest.mark.parametrize("name", ["room-v0", "two-exit-hall-v0", "counter-flow-v0"])
def test_the_state_is_everybody_where_the_exits_are_and_the_time_left(name):
    scenario = make_scenario(name)
    scenario = scenario if name == "counter-flow-v0" else make_scenario(name, people=8)
    env = parallel_env(scenario, time_limit=6.0)
    env.reset(seed=2)
    layout, bodies, crowd = env.state_layout, env.env.simulation.bodies, env.env.simulation.state
    corner = np.array(scenario.geometry.bounds[:2])
    while env.agents:
        state = env.state()
        assert state.dtype == np.float32 and state.shape == (layout.size,) and env.state_space.contains(state)
        people, exits, time_left = layout.split(state)
        inside = crowd.active
        np.testing.assert_array_equal(people[:, 0], inside)
        columns = {"position": crowd.position - corner, "velocity": crowd.velocity, "radius": bodies.radius}
        columns |= {"mass": bodies.mass, "desired_speed": bodies.desired_speed, "route": crowd.route}
        for column, values in columns.items():
            given = values[inside].reshape(inside.sum(), -1)
            np.testing.assert_allclose(people[inside, layout[column]], given, rtol=1e-6, atol=1e-5)
        np.testing.assert_allclose(exits[:, :4], (scenario.geometry.exits - corner).reshape(-1, 4), atol=1e-5)
        assert time_left == pytest.approx(6.0 - crowd.time[0], abs=1e-5)
        env.step({})
    assert env.state_space.contains(env.state())


def test_its_size_depends_on_people_and_exits_alone():
    sizes = {
        parallel_env({"name": "room-v0", **options}, routing=strategy).state_space.shape
        for options in (
            {"people": 5},
            {"people": 5, "side": 9.0},
            {"population": Population(5, mass=Normal(70, 5, 50, 90))},
        )
        for strategy in ("shortest", "nearest", "comfortable")
    }
    assert sizes == {(5 * 12 + 5 + 1,)}
