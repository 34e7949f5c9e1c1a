"""The narrowest bottleneck on the way ahead: as wide as it was drawn, from wherever one comes, however the place is turned."""

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from crowd_env import CrowdEnv, ObservationLayout, Scenario, make_scenario
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.bottlenecks import WIDEST, bottlenecks_of
from crowd_env.routing.fields.field import travel_time_field
from crowd_env.routing.spec import DoorEvent
from crowd_env.scenarios.distributions import Uniform
from crowd_env.scenarios.population import Population

RADIUS, LONG = 0.2, 8.0


def turned(shape, angle):
    return shapely.affinity.rotate(shape, angle, origin=(0.0, 0.0), use_radians=True)


def place(inner=None, outer=1.4, angle=0.0, thick=0.2):
    """Return a room of 8 x 6 m with an exit of ``outer`` in the east; an ``inner`` door stands in a wall at x = 4 m."""
    floor, line = box(0.0, 0.0, LONG, 6.0), shapely.LineString([(LONG, 4.5 - outer), (LONG, 4.5)])
    if inner is not None:
        floor -= box(4.0, 0.0, 4.0 + thick, 1.5) | box(4.0, 1.5 + inner, 4.0 + thick, 6.0)
    end = shapely.get_coordinates(turned(line, angle))
    return Geometry.from_polygon(turned(floor, angle), exits={"out": end})


def of_nodes(geometry, radius=RADIUS):
    """Return where the nodes are (K, 2), unturned places alone, and the opening ahead of each: width (K,) and rest (K,)."""
    field = travel_time_field(geometry, radius)
    found = bottlenecks_of([field], [geometry])
    rows, cols = found.shape[0]
    x, y = np.meshgrid(*(found.origin[0, k] + found.spacing[0] * np.arange(n) for k, n in ((0, cols), (1, rows))))
    known = ~np.isnan(found.width)
    return np.column_stack([x.ravel(), y.ravel()])[known], found.width[known], found.rest[known]


@pytest.mark.parametrize("outer", [0.6, 0.8, 1.4, 3.0])
def test_a_door_is_as_wide_as_it_is_from_everywhere(outer):
    """The grid ends beside the exit: at many angles no node there sees it straight ahead."""
    for angle in np.linspace(0.0, 3.1, 7):
        for radius in (0.2, 0.25):
            _, width, rest = of_nodes(place(outer=outer, angle=angle), radius)
            inside = np.isclose(width, outer, rtol=0.0, atol=1e-9)
            assert inside.mean() > 0.99 and (width <= outer + 1e-9).all(), (angle, radius)
            assert rest[inside].max() == 0.0


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.4])
def test_of_two_exits_the_one_that_the_way_leads_to_counts(angle):
    lines = {"west": [(0.0, 2.0), (0.0, 4.0)], "east": [(LONG, 2.5), (LONG, 3.3)]}
    exits = {name: shapely.get_coordinates(turned(shapely.LineString(line), angle)) for name, line in lines.items()}
    nodes, width, _ = of_nodes(Geometry.from_polygon(turned(box(0.0, 0.0, LONG, 6.0), angle), exits=exits))
    x = nodes @ [np.cos(angle), np.sin(angle)]
    for those, wide in ((x < 3.0, 2.0), (x > 5.0, 0.8)):
        assert those.any() and np.isclose(width[those], wide, rtol=0.0, atol=1e-9).mean() > 0.99


@pytest.mark.parametrize("angle", [0.0, 2.4])
def test_no_corner_makes_one_forget_what_is_ahead(angle):
    """Between seats, the neighbors that are nearer to the exit lie aside of the way; theirs is the narrowest ahead."""
    geometry = make_scenario("theatre-v0").turned(angle, False).geometry
    field = travel_time_field(geometry, RADIUS)
    found = bottlenecks_of([field], [geometry])
    stride = round(float(found.spacing[0] / field.spacing))
    time, width = field.travel_time[::stride, ::stride], found.width.reshape(found.shape[0])
    around = np.s_[1:-1, 1:-1]
    ahead, lower = np.full(width[around].shape, -np.inf), np.zeros(width[around].shape, dtype=bool)
    for i, j in np.ndindex(3, 3):
        beside = np.s_[i : i + width.shape[0] - 2, j : j + width.shape[1] - 2]
        nearer = time[beside] < time[around]
        lower |= nearer
        ahead = np.where(nearer, np.maximum(ahead, width[beside]), ahead)
    assert lower.sum() > 10_000 and (width[around] <= ahead)[lower].all()


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_the_narrower_of_two_doors_counts_until_it_is_passed(angle):
    geometry = place(inner=0.8, outer=1.4, angle=angle)
    nodes, width, rest = of_nodes(geometry)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x = (nodes @ turn)[:, 0]
    before, beyond = width[x < 3.9], width[x > 4.6]
    assert np.mean(np.abs(before - 0.8) < 0.07) > 0.98  # lines through nodes are a little longer than from jamb to jamb
    assert np.median(beyond) == pytest.approx(1.4)
    far = rest[x < 3.9]  # from the door to the exit
    assert np.mean(np.abs(far - np.hypot(4.0, 1.5)) < 0.5) > 0.98


def test_wide_floors_count_as_the_widest():
    geometry = Geometry.from_polygon(box(0.0, 0.0, 20.0, 9.0), exits={"out": [(20.0, 0.0), (20.0, 9.0)]})
    _, width, _ = of_nodes(geometry)
    assert width.max() == WIDEST and np.median(width) == WIDEST


@pytest.mark.kernels
def test_it_is_seen_in_bodies_and_seconds():
    """The term holds 1 - diameter / width, and the time to the opening at the own speed, as it says."""
    layout = ObservationLayout(terms=("opening", "travel_time"))
    kinds = {"radius": Uniform(0.15, 0.25), "desired_speed": Uniform(0.8, 2.0)}
    scenario = Scenario("two-doors", place(inner=0.8), Population(12, **kinds), 60.0)
    env = CrowdEnv(scenario, observation=layout)
    seen, _ = env.reset(seed=1)
    bodies, x = env.simulation.bodies, env.simulation.state.position[:, 0]
    inside = x < 3.9
    assert inside.sum() >= 3 and (x > 4.6).sum() >= 3
    share, time = seen[:, layout["opening"]].T.astype(float)
    np.testing.assert_allclose(share[inside], 1.0 - 2.0 * bodies.radius[inside] / 0.8, atol=0.01)
    left = seen[:, layout["travel_time"]][:, 0].astype(float)
    seconds, to_exit = (5.0 * value / (1.0 - value) for value in (time, left))
    rest = (to_exit - seconds) * bodies.desired_speed
    np.testing.assert_allclose(rest[inside], np.hypot(4.0, 1.5), atol=0.5)


def test_nobody_pays_for_what_nobody_sees():
    env = CrowdEnv("room-v0")
    assert not env.observer.view.fields.openings.fields.width.size


def test_an_opening_is_known_in_the_step_in_which_a_door_shuts():
    """The ways then change within the step, before what is seen after it."""
    hall = Geometry.from_polygon(
        box(0, 0, 10, 6), exits={"left": [(0, 2), (0, 3)], "right": [(10, 2), (10, 4)]}, doors={"left": "left"}
    )
    place = Scenario("hall", hall, Population(20), 60.0, door_events=(DoorEvent("left", False, at=0.25),))
    env = CrowdEnv(
        [place, place.turned(0.3)], num_envs=2, observation=ObservationLayout(terms=("opening", "travel_time"))
    )
    env.reset(seed=0)
    env.step(None)
    before = len(env.simulation.planner.fields)
    for _ in range(3):
        step = env.step(None)
        np.testing.assert_array_equal(step.observation[env.active], env.observer.observe(env.active)[env.active])
    assert len(env.simulation.planner.fields) > before
