"""Progress is the loss of a potential: over an episode it sums to the travel time at the start less that at the end."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

from crowd_env import (
    FULL_SPEED,
    SCHEMES,
    ControlRule,
    CrowdEnv,
    DoorEvent,
    Geometry,
    Population,
    Route,
    Scenario,
    Uniform,
)
from crowd_env.routing.fields.extension import carried_along
from crowd_env.routing.fields.field import join_fields, travel_time_field
from crowd_env.routing.fields.lookup import travel_time_at

EXITS = {"west": [(0, 1), (0, 3)], "east": [(12, 1), (12, 3)]}
DOORS = {"west door": "west", "east door": "east"}
REGIONS = {"left": box(0, 0, 4, 4), "spot": box(8, 0, 9, 1)}
SAME = Uniform(0.2, 0.2)


@cache
def hall():
    """Return a hall with an exit at each end that can be closed."""
    return Geometry.from_polygon(box(0, 0, 12, 4), exits=EXITS, doors=DOORS, regions=REGIONS)


def evacuation(count=4, starts=None, **options):
    speed = Uniform(1.5, 1.5) if starts is not None else Uniform(1.2, 1.8)
    people = Population(count, radius=SAME, desired_speed=speed, relaxation_time=Uniform(0.1, 0.1), starts=starts)
    return Scenario("hall", hall(), people, 60.0, **{**FULL_SPEED, **options})


def seen_time(env, observation):
    """Return the travel time that everyone sees [s]."""
    seen = observation[:, env.layout["travel_time"]][:, 0].astype(float)
    return 5.0 * seen / (1.0 - seen)


def play(env, steps=10_000, act=lambda k: None, seed=0):
    """Play to the end; returns the travel times seen at the start (P,) and the progress of every step (T, P)."""
    first, paid = seen_time(env, env.reset([seed])[0]), []
    while not env.finished.all() and len(paid) < steps:
        paid.append(env.step(act(len(paid))).info["reward/progress"])
    return first, np.array(paid)


def test_a_control_rule_cannot_be_farmed():
    """One steps in and out of the region of a rule every 3 s and sends the other to and fro."""
    place = Geometry.from_polygon(
        box(0, 0, 20, 4),
        exits={"west": [(0, 1.5), (0, 2.5)], "east": [(20, 1.5), (20, 2.5)]},
        regions={"w": box(0, 0, 6, 4)},
    )
    people = Population(
        2,
        radius=SAME,
        desired_speed=Uniform(1.5, 1.5),
        relaxation_time=Uniform(0.1, 0.1),
        starts=np.array([[5.0, 3.5], [9.0, 2.0]]),
    )
    farm = Scenario("farm", place, people, 600.0, rules=(ControlRule("w", 1, "east"),), **FULL_SPEED)
    env = CrowdEnv(farm, action={"name": "continuous", "frame": "world"}, physics="nsm1", routing="west")
    first = seen_time(env, env.reset(seed=0)[0])
    total, sent = 0.0, 0
    for k in range(300):
        x = env.simulation.state.position
        goal = 5.3 if (k // 30) % 2 == 0 else 6.7
        action = np.zeros((2, 2))
        action[0] = np.clip([goal - x[0, 0], 3.5 - x[0, 1]], -1, 1)
        step = env.step(action, scripted=np.array([False, True]))
        total += step.info["reward/progress"][1]
        sent += abs(step.info["reward/progress"][1]) > 0.3
        assert total <= first[1] + 1e-9
    assert env.active[1] and sent >= 4  # the rule switched to and fro
    assert total == pytest.approx(first[1] - seen_time(env, step.observation)[1], abs=1e-4)


@pytest.mark.parametrize("strategy", ["shortest", "nearest", "west"])
def test_a_door_that_closes_and_opens_again_pays_what_the_way_gets_longer(strategy):
    events = (DoorEvent("west door", opens=False, at=0.8), DoorEvent("west door", opens=True, at=2.0))
    env = CrowdEnv(evacuation(8, door_events=events), physics="dem", routing=strategy)
    first, paid = play(env)
    assert not env.active.any()
    np.testing.assert_allclose(paid.sum(axis=0), first, rtol=1e-5)
    if strategy == "shortest":  # at the switch the potential jumps by what the other way takes longer, and back
        assert paid.min() < -1.0 and paid.max() > 1.0
    else:  # people sent to a closed exit wait there: their way is the same
        assert np.abs(paid).max() < 0.2


def test_a_switch_pays_the_difference_of_the_ways_at_that_place():
    """West to east from x = 4 m at 1.5 m/s: 4 m turn into 8 m, so that 2.67 s are paid, and the same back."""
    starts = np.array([[4.0, 2.0], [9.0, 2.0]])
    env = CrowdEnv(
        evacuation(2, starts, routes=(Route("east", ("east",)),)), physics="nsm1", routing="west", num_envs=2
    )
    env.reset(seed=0)
    still = np.zeros((4, 2))
    env.step(still)
    route_set = env.simulation.planner.route_set(0)
    env.simulation.send(0, route_set.number("east"))
    env.reset(mask=[False, True])  # looking once more does not make the switch forgotten
    there = env.step(still).info["reward/progress"]
    env.simulation.send(0, route_set.number("west"))
    back = env.step(still).info["reward/progress"]
    np.testing.assert_allclose(there, [-4 / 1.5, 6 / 1.5, 0.0, 0.0], atol=0.02)
    np.testing.assert_allclose(back, -there, atol=1e-9)


def test_replanning_the_fastest_way_pays_nothing():
    """The ways follow the crowd, but progress is counted on those of the empty place: no step pays more than is walked."""
    env = CrowdEnv("two-exit-hall-v0", people=60, routing="fastest", physics="nsm1")
    env.reset([5])
    speed, steps = env.simulation.bodies.desired_speed, []
    for _ in range(60):
        before, inside = env.simulation.state.position.copy(), env.active.copy()
        paid = env.step(None).info["reward/progress"]
        walked = np.hypot(*(env.simulation.state.position - before).T)
        stayed = inside & env.active
        assert (np.abs(paid[stayed]) <= (walked[stayed] + 0.15) / speed[stayed]).all()
        steps.append(paid[inside].std())
    replanned = np.array(steps)[::10]
    assert env.simulation.planner.marches >= 6
    assert replanned.max() < 0.25 and replanned.mean() < 2.0 * np.mean(steps)


def test_a_way_via_a_region_leads_on_to_the_exit():
    """Progress counts the whole way, so that reaching the region pays no more and no less than any other step."""
    routes = (Route("detour", exits=("west",), via="spot"),)
    env = CrowdEnv(evacuation(6, routes=routes), physics="nsm1", routing="detour")
    env.reset([0])
    place, speed = env.simulation.state.position.copy(), env.simulation.bodies.desired_speed
    radius = env.simulation.bodies.radius
    paid = []
    while env.active.any():
        before = env.simulation.state.position.copy()
        step = env.step(None)
        paid.append(step.info["reward/progress"])
        walked = np.hypot(*(env.simulation.state.position - before).T)
        assert (np.abs(paid[-1][env.active]) <= (walked[env.active] + 0.1) / speed[env.active]).all()
    to_spot = join_fields([travel_time_field(hall(), 0.2, goal="spot")], hall().boundary)
    to_west = join_fields([travel_time_field(hall(), 0.2, exits=["west"])], hall().boundary)
    for i, total in enumerate(np.sum(paid, axis=0)):
        x, y = place[i]
        there = travel_time_at(to_spot, hall().boundary, 0, x, y, radius[i])
        # The nearest place of the spot, and the way from there; who starts in it has only that.
        entry = np.clip(x, 8.0, 9.0), np.clip(y, 0.2, 1.0)
        rest = travel_time_at(to_west, hall().boundary, 0, *entry, radius[i])
        assert total * speed[i] == pytest.approx(there + rest, abs=0.15)


def test_whatever_happens_the_sum_is_that_of_the_ends():
    """Ways, doors and resets of others at random: what is paid so far is always the travel time at the start less that now."""
    routes = (Route("detour", via="spot"), Route("quick", strategy="fastest"))
    env = CrowdEnv(
        evacuation(5, routes=routes), physics="nsm1", num_envs=3, routing="fastest", autoreset=True, time_limit=3.0
    )
    rng = np.random.default_rng(4)
    env.reset(seed=1)
    simulation, boundary = env.simulation, env.simulation.world.boundary
    potential = env.observer.view.potential

    def now():
        """Return the travel time of everyone by the potential of the followed route, looked up from outside."""
        rows = simulation.planner.potential_of_route[env.env_of_person, simulation.history.followed]
        time = [
            travel_time_at(simulation.world.field, boundary, f, x, y, r)
            for f, (x, y), r in zip(rows, simulation.state.position, simulation.bodies.radius, strict=True)
        ]
        return np.where(env.active, time / simulation.bodies.desired_speed, 0.0)

    first, total, episodes = now(), np.zeros(15), 0
    for k in range(100):
        e = int(rng.integers(3))
        if rng.random() < 0.3:
            simulation.send(e, rng.integers(len(env.route_set[0].routes), size=5))
        if rng.random() < 0.2:
            simulation.close_doors(e, [[], ["west door"], ["east door"]][rng.integers(3)])
        if k == 50:
            env.reset(mask=np.arange(3) == e)
            again = env.env_of_person == e
            first[again], total[again] = now()[again], 0.0
        step = env.step(rng.uniform(-1.0, 1.0, (15, 2)))
        total += step.info["reward/progress"]
        over = step.info["finished"][env.env_of_person]
        np.testing.assert_allclose((first - total)[~over], now()[~over], atol=1e-9)
        first[over], total[over] = now()[over], 0.0
        np.testing.assert_allclose(potential, now(), atol=1e-9)
        episodes += int(step.info["finished"].sum())
    assert episodes >= 6


def test_what_is_carried_along_ways_is_that_of_their_ends():
    """Ways that run straight to the left, where the value is the height: the value of every node is its height."""
    y, x = np.mgrid[0:20, 0:30].astype(float)
    value = carried_along(x, y)
    np.testing.assert_allclose(value, y, atol=1e-12)
    # ... and straight to one point, from both sides of a gap: that of the point, whatever stood there before.
    time = np.hypot(x - 7, y - 9)
    time[:, 15] = np.nan
    far = carried_along(time, np.where(time == 0, 3.0, 99.0))
    np.testing.assert_allclose(far[:, :15], 3.0)


def who_stands(people=2, **options):
    """Return a crowd at the far end of the hall whose west door is closed: 10 m to the exit, at 1.5 m/s."""
    starts = np.array([(1.5, 1.0 + k) for k in range(people)])
    return evacuation(people, starts, closed_doors=("west door",), **options)


@looped("scheme", SCHEMES, quick=3)
def test_no_exit_is_blocked_while_the_first_are_on_their_way(scheme):
    free = 10.5 / 1.5  # s
    env = CrowdEnv(who_stands(blocked_after=1.0), physics=scheme)
    play(env)
    assert env.metrics(0).unfinished == 0 and env.metrics(0).evacuation_time > free > 5.0
    env.reset(0)
    stand = np.zeros((env.num_people, 2))
    while not env.finished.all():
        env.step(stand)
    # They could have been out by then; a second and a decision later nobody was.
    assert env.simulation.state.time[0] == pytest.approx(free + 1.0, abs=0.25)
    assert env.metrics(0).unfinished == 2 and env.metrics(0).blocked_since == 0.0


def test_who_responds_late_is_waited_for_in_every_episode():
    place = who_stands(blocked_after=1.0)
    late = replace(place, population=place.population.changed(response_time=Uniform(6.0, 6.0)))
    env = CrowdEnv([place, late], num_envs=2, autoreset=True)
    env.reset(0)
    stand, ends = np.zeros((env.num_people, 2)), []
    for _ in range(400):
        step = env.step(stand)
        ends += [(int(e), metrics.unfinished) for e, metrics in step.info["metrics"].items()]
    # 8 and 14 s an episode, a decision more for each, 40 s in all.
    assert ends.count((0, 2)) == 4 and ends.count((1, 2)) == 2


def test_the_wait_of_an_episode_knows_nothing_of_the_one_before():
    env = CrowdEnv(who_stands(blocked_after=5.0), autoreset=True)
    env.reset(0)
    ends, time = [], 0.0
    while len(ends) < 2:
        walks = not ends and time > 4.0  # out after 11 s; the second stand, and are given up after 7 + 5
        step = env.step(np.full((2, 2), [float(walks), 0.0]))
        time += env.decision_dt
        ends += [(time, metrics.unfinished) for metrics in step.info["metrics"].values()]
    (first, out), (second, left) = ends
    assert out == 0 and first > 11.0 and left == 2
    assert second - first == pytest.approx(12.0, abs=0.25)
