"""Who is nearer the exit, as it is observed: by hand on a line, and against brute force over all pairs."""

import numpy as np
import pytest
from crowds import cluttered

from crowd_env import FULL_SPEED, TABLE_4, CrowdEnv, ObservationLayout, Population, Scenario, Uniform, make_scenario
from crowd_env.envs.observation.layout import TERMS, USUAL
from crowd_env.routing.fields.lookup import direction_at, travel_time_at

CLUTTERED = Scenario("cluttered", cluttered(), Population(25, **TABLE_4), 60.0, **FULL_SPEED)
LAYOUT = ObservationLayout(("lead", "ahead", "neighbors"), neighbors=4)


def on_a_line(*x, **options):
    """Return the environment and first observation of people on the center line of the 5 x 5 m room; the exit is at x = 5."""
    starts = np.column_stack([x, np.full(len(x), 2.5)])
    people = Population(len(x), radius=Uniform(0.2, 0.2), desired_speed=1.5, relaxation_time=0.01, starts=starts)
    env = CrowdEnv(make_scenario("room-v0", population=people), observation=LAYOUT, **options)
    return env, env.reset(seed=0)[0]


def test_on_a_line_by_hand():
    env, observation = on_a_line(1.0, 2.0, 4.5)
    lead, ahead = observation[:, LAYOUT["lead"]], observation[:, LAYOUT["ahead"]]
    np.testing.assert_allclose(lead[0], [1.0 / 3.0, 0.0, 0.0, 0.0], atol=1e-6)  # the third is 3.5 m away
    np.testing.assert_allclose(lead[1], [-1.0 / 3.0, 2.5 / 3.0, 0.0, 0.0], atol=1e-6)  # the nearest first
    np.testing.assert_allclose(lead[2], [-2.5 / 3.0, 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(ahead, [[2 / 3, 0, 1 / 11], [0.5 / 3, 0, 1 / 11], [0, 0, 0]], atol=1e-6)
    step = env.step([[0.0, 0.0], [0.4, 0.0], [1.0, 0.0]])  # 0, 0.6 and 1.5 m/s, reached at once
    np.testing.assert_allclose(step.observation[:2, LAYOUT["ahead"]][:, 1], [0.6 / 2.0, 1.5 / 2.0], atol=1e-6)
    x = env.simulation.state.position[:, 0]
    assert x[1] > 2.04
    assert step.observation[0, LAYOUT["ahead"]][0] == pytest.approx(1 - (x[1] - x[0]) / 3, abs=1e-6)


def test_whoever_steps_back_is_seen_to_and_whoever_is_out_is_not_seen():
    env, _ = on_a_line(3.0, 4.0, 4.9)
    step = env.step([[0.0, 0.0], [-0.5, 0.0], [1.0, 0.0]])  # the third is out
    assert not env.active[2]
    x = env.simulation.state.position[:, 0]
    assert x[1] < 3.95
    np.testing.assert_allclose(
        step.observation[0, LAYOUT["ahead"]], [1 - (x[1] - x[0]) / 3, -0.75 / 2, 1 / 11], atol=1e-6
    )
    assert not step.observation[1, LAYOUT["ahead"]].any()
    assert not step.observation[2].any()


def expected_of(env):
    """Return both terms by brute force: everyone's route from the place of everyone else, by each one's own field."""
    state, bodies, view = env.simulation.state, env.simulation.bodies, env.observer.view
    lead, ahead, other_way = np.zeros((env.num_people, 4)), np.zeros((env.num_people, 3)), 0
    for i in np.flatnonzero(env.active):
        e = env.env_of_person[i]
        people = env.people(e)
        field = int(view.field_of_route[e, view.followed[i]])

        def to_go(j, field=field):
            return travel_time_at(view.field, view.boundary, field, *state.position[j], bodies.radius[j])

        others = [j for j in np.flatnonzero(env.active[people]) + people.start if j != i]
        distance = {j: np.hypot(*(state.position[j] - state.position[i])) for j in others}
        seen = sorted((distance[j] - bodies.radius[i] - bodies.radius[j], j) for j in others if distance[j] < 3.0)
        leads = {j: to_go(i) - to_go(j) for _, j in seen}
        lead[i, : len(seen[:4])] = [leads[j] / 3.0 for _, j in seen[:4]]
        same = {j for j in leads if int(view.field_of_route[e, view.followed[j]]) == field}
        nearer = sorted((leads[j], j) for j in same if leads[j] > 0.0)
        if nearer:
            least, j = nearer[0]
            way = direction_at(view.field, view.boundary, field, *state.position[j], bodies.radius[j])
            other_way += len(same) < len(leads)
            ahead[i] = max(1 - least / 3.0, 0.0), state.velocity[j] @ way / 2.0, len(nearer) / (len(nearer) + 10.0)
    return lead, ahead, other_way


@pytest.mark.parametrize("frame", ["path", "world"])
@pytest.mark.parametrize(
    ("places", "other_ways"), [(["room-v0", CLUTTERED], False), (["counter-flow-v0"], True)], ids=["one way", "two"]
)
def test_order_is_that_of_the_rest_of_the_own_route(places, other_ways, frame):
    """Among people who follow another route `lead` places each on the observer's own, and `ahead` counts none of them."""
    env = CrowdEnv(
        [make_scenario(place) for place in places],
        num_envs=2,
        action={"name": "continuous", "frame": frame},
        observation=LAYOUT,
    )
    observation, _ = env.reset(seed=1)
    rng, met = np.random.default_rng(1), 0
    for k in range(80):
        if k % 8 == 0:
            lead, ahead, other_way = expected_of(env)
            inside, met = env.active, met + other_way
            np.testing.assert_allclose(observation[inside][:, LAYOUT["lead"]], np.clip(lead[inside], -1, 1), atol=2e-6)
            np.testing.assert_allclose(
                observation[inside][:, LAYOUT["ahead"]], np.clip(ahead[inside], -1, 1), atol=2e-6
            )
            assert (lead[inside] > 0.1).any() and (lead[inside] < -0.1).any() and (ahead[inside, 2] > 0).any()
        action = rng.uniform((0.2, -0.4), (1.0, 0.4), (env.num_people, 2)) if frame == "path" else None
        observation = env.step(action).observation
    assert (met > 10) == other_ways


def test_observations_hold_neither_unless_they_are_named():
    of_ways = {"routes", "queues_seen", "queues_shown"}
    assert set(TERMS) - set(USUAL) == {"direction", "opening", "slope", "stood", "lead", "ahead", "group"} | of_ways
    assert ObservationLayout().terms == USUAL and ObservationLayout().size == 46
