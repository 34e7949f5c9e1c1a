"""What pedestrians perceive, against brute force over all pairs and against shapely's rays."""

from functools import cache
from itertools import islice

import numpy as np
import pytest
import shapely
from cases import looped
from crowds import cluttered

from crowd_env import (
    FULL_SPEED,
    TABLE_4,
    Cohorts,
    CrowdEnv,
    Geometry,
    ObservationLayout,
    Population,
    Scenario,
    Uniform,
    make_scenario,
)
from crowd_env.envs.observation.layout import TERMS

CLUTTERED = Scenario("cluttered", cluttered(), Population(25, **TABLE_4), 60.0, **FULL_SPEED)
# Two cohorts that meet in front of a pillar; where they start is given, so that it can be turned.
MEETING = Scenario(
    "meeting",
    Geometry.from_polygon(
        [(0, 0), (9, 0), (9, 4), (0, 4)],
        exits={"west": [(0, 1), (0, 3)], "east": [(9, 0.5), (9, 2.5)]},
        obstacles=[[(4.2, 1.6), (4.9, 1.7), (4.5, 2.3)]],
    ),
    Cohorts(
        tuple(
            Population(
                6,
                radius=Uniform(0.2, 0.2),
                route=to,
                name=to,
                starts=[(x + d, y) for d in (0, 0.6) for y in (0.7, 1.5, 2.9)],
            )
            for to, x in (("east", 2.5), ("west", 5.6))
        )
    ),
    60.0,
    **FULL_SPEED,
)
FULL = ObservationLayout(tuple(TERMS), neighbors=7, rays=12, routes=1)


def crowds(frame="path", layout=FULL, scheme="nsm2"):
    """Yield a batch of two different places at many moments, with what everyone has just perceived."""
    env = CrowdEnv(
        [make_scenario("room-v0"), CLUTTERED],
        num_envs=3,
        action={"name": "continuous", "frame": frame},
        observation=layout,
        physics=scheme,
    )
    observation, _ = env.reset(seed=1)
    rng = np.random.default_rng(1)
    for k in range(45):
        if k % 4 == 0:
            assert env.active.sum() > 10
            yield env, observation
        observation = env.step(rng.uniform((0.2, -0.4), (1.0, 0.4), (env.num_people, 2))).observation


def axes(env, observation):
    """Return the first axis (P, 2) of everyone's frame."""
    return (
        observation[:, env.layout["direction"]]
        if env.action_kind.frame == "path"
        else np.tile([1.0, 0.0], (env.num_people, 1))
    )


def turned(vectors, axis):
    """Return the components along and to the left of the axis, by complex division; nan for those outside, who have none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (vectors[..., 0] + 1j * vectors[..., 1]) / (axis[..., 0] + 1j * axis[..., 1])
    return np.stack([z.real, z.imag], axis=-1)


def check(observation, layout, term, expected, who, **tolerance):
    assert np.isfinite(expected[who]).all() and np.abs(expected[who]).max() > 0.01  # there is something to see
    np.testing.assert_allclose(
        observation[who][:, layout[term]], np.clip(expected[who], -1, 1), **{"atol": 2e-6, "rtol": 0, **tolerance}
    )


# --------------------------------------------------------------------------------------------- what one has of oneself


@pytest.mark.parametrize("frame", ["path", "world"])
def test_own_velocity_is_seen_in_the_frame_of_the_actions(frame):
    for env, observation in islice(crowds(frame), 1, None):
        expected = turned(env.simulation.state.velocity, axes(env, observation)) / 2.0
        check(observation, FULL, "velocity", expected, env.active)
        check(observation, FULL, "desired_speed", env.simulation.bodies.desired_speed[:, None] / 2.0, env.active)
        assert np.abs(expected[env.active, 1]).max() > 0.1  # across the axis, too


def way_out_of_the_room(start, radius):
    """Return length and direction of the shortest path of a disc out of the 5 x 5 m room by its door, in closed form.

    Straight to the nearest point of the door line shrunk by the radius, or, where the nearer jamb is in the way, along the
    tangent of the circle of that radius around it and then along the circle.
    """
    y = start[1]
    aim = np.array([5.0, np.clip(y, 2.09 + radius, 2.91 - radius)])
    jamb = np.array([5.0, 2.91 if y > 2.5 else 2.09])
    side = np.sign(jamb[1] - 2.5)
    way, to_jamb = aim - start, jamb - start
    clear = abs(way[0] * to_jamb[1] - way[1] * to_jamb[0]) / np.hypot(*way)
    if clear >= radius:
        return np.hypot(*way), way / np.hypot(*way)
    distance = np.hypot(*to_jamb)
    straight = np.sqrt(distance**2 - radius**2)
    heading = np.arctan2(to_jamb[1], to_jamb[0]) - side * np.arcsin(radius / distance)
    return straight + radius * abs(heading), np.array([np.cos(heading), np.sin(heading)])


def test_direction_and_travel_time_are_those_of_the_shortest_path():
    env = CrowdEnv(
        make_scenario("room-v0", population=Population(10, **{**TABLE_4, "radius": Uniform(0.25, 0.25)})),
        num_envs=10,
        observation=FULL,
    )
    observation, _ = env.reset(seed=3)
    state, bodies = env.simulation.state, env.simulation.bodies
    free = state.position[:, 0] < 4.7  # nearer to the wall the path leads away from it first
    route_set = [way_out_of_the_room(start, 0.25) for start in state.position]
    length = np.array([way[0] for way in route_set])
    time = length / bodies.desired_speed
    check(observation, env.layout, "direction", np.array([way[1] for way in route_set]), free, atol=0.08)
    check(observation, env.layout, "travel_time", (time / (time + 5.0))[:, None], free, atol=0.006)


@pytest.mark.parametrize("scheme", ["dem", "nsm1-inertial", "nsm2"])
def test_push_and_crush_are_the_impulses_of_the_contacts(scheme):
    env = CrowdEnv(
        [make_scenario("room-v0"), CLUTTERED], num_envs=3, physics=scheme, decision_dt=0.01, observation=FULL
    )
    observation, _ = env.reset(seed=2)
    simulation, pushed = env.simulation, 0
    for k in range(190):
        observation = env.step(None).observation
        if k < 100:
            continue
        push, crush = np.zeros((env.num_people, 2)), np.zeros(env.num_people)
        for e in range(env.num_envs):
            touches = simulation.contacts(e)
            for i, j, n, (normal, tangent) in zip(touches.i, touches.j, touches.normal, touches.impulse, strict=True):
                kick = normal * n + tangent * np.array([-n[1], n[0]])
                for who, way in ((i, 1), (j, -1)):
                    if who >= 0:
                        push[env.env_start[e] + who] += way * kick
                        crush[env.env_start[e] + who] += np.hypot(normal, tangent)
        who = env.active & (crush > 0)
        if who.any():
            pushed += who.sum()
            mass = simulation.bodies.mass[:, None]
            check(observation, env.layout, "push", turned(push, axes(env, observation)) / mass, who)
            check(observation, env.layout, "crush", crush[:, None] / mass, who)
        assert not observation[env.active & (crush == 0), env.layout["crush"]].any()
    assert pushed > 500


@pytest.mark.parametrize("scheme", ["dem", "nsm1-inertial", "nsm2"])
def test_momentum_changes_by_what_is_pushed_and_what_is_driven(scheme):
    """m (u' - u) = push + dt m (v_d e - u) / tau: nothing else acts."""
    layout = ObservationLayout(terms=("push", "velocity"))
    options = {
        "physics": scheme,
        "decision_dt": 0.01,
        "action": {"name": "continuous", "frame": "world"},
        "observation": layout,
    }
    env = CrowdEnv("room-v0", num_envs=2, **options)
    env.reset(seed=1)
    state, bodies = env.simulation.state, env.simulation.bodies
    felt = 0
    for _ in range(200):
        before, action = state.velocity.copy(), np.tile([0.8, 0.1], (40, 1)) * (2.5 - state.position[:, 1:]) * [1, 2]
        action = np.where(np.abs(state.position[:, :1] - 4.0) < 1.0, action, [1.0, 0.0])
        length = np.maximum(np.hypot(*action.T), 1.0)[:, None]
        observation = env.step(action).observation
        wanted = bodies.desired_speed[:, None] * action / length
        drive = 0.01 * (wanted - before) / bodies.relaxation_time[:, None]
        push = state.velocity - before - drive  # over the own mass
        who = env.active & (np.abs(push).max(axis=1) < 0.99)
        np.testing.assert_allclose(observation[who][:, layout["push"]], push[who], atol=1e-6)
        felt += (np.abs(push[who]) > 0.01).sum()
    assert felt > 300


def test_impulses_add_up_over_the_physics_steps_of_a_decision():
    coarse, fine = (CrowdEnv("room-v0", decision_dt=step) for step in (0.1, 0.01))
    for env in (coarse, fine):
        env.reset(seed=2)
    for _ in range(40):
        coarse.step(None)
        push, crush = np.zeros((20, 2)), np.zeros(20)
        for _ in range(10):
            fine.step(None)
            push += fine.simulation.results.impulse
            crush += fine.simulation.results.impulse_magnitude
        np.testing.assert_array_equal(coarse.simulation.state.position, fine.simulation.state.position)
        np.testing.assert_allclose(coarse.simulation.results.impulse, push, atol=1e-9)
        np.testing.assert_allclose(coarse.simulation.results.impulse_magnitude, crush, atol=1e-9)
    assert crush.any()


# --------------------------------------------------------------------------------------------- what one has of others


def others(env, i):
    """Return the people of the room of person ``i`` who are inside, without that person."""
    people = env.people(env.env_of_person[i])
    inside = np.flatnonzero(env.active[people]) + people.start
    return inside[inside != i]


@pytest.mark.parametrize("frame", ["path", "world"])
def test_neighbors_are_the_nearest_by_gap_within_three_meters(frame):
    for env, observation in crowds(frame):
        state, radius = env.simulation.state, env.simulation.bodies.radius
        axis = axes(env, observation)
        expected = np.zeros((env.num_people, 7, 5))
        for i in np.flatnonzero(env.active):
            j = others(env, i)
            offset, relative = state.position[j] - state.position[i], state.velocity[j] - state.velocity[i]
            distance = np.hypot(*offset.T)
            gap = distance - radius[i] - radius[j]
            for slot, k in enumerate([k for k in np.argsort(gap, kind="stable") if distance[k] < 3.0][:7]):
                expected[i, slot, :2] = turned(offset[k], axis[i]) / 3.0
                expected[i, slot, 2:4] = turned(relative[k], axis[i]) / 4.0
                expected[i, slot, 4] = 1.0 - max(gap[k], 0.0) / 3.0
        check(observation, FULL, "neighbors", expected.reshape(env.num_people, -1), env.active)
        alone = (expected[:, -1] == 0).all(axis=1) & env.active
    assert alone.any()  # empty slots were seen as well


def test_density_counts_the_people_within_a_meter():
    most = 0
    for env, observation in crowds():
        position = env.simulation.state.position
        count = np.zeros(env.num_people)
        for i in np.flatnonzero(env.active):
            count[i] = 1 + (np.hypot(*(position[others(env, i)] - position[i]).T) < 1.0).sum()
        check(observation, FULL, "density", count[:, None] / (8.0 * np.pi), env.active)
        most = max(most, count.max())
    assert most >= 6


@pytest.mark.parametrize("frame", ["path", "world"])
def test_rays_end_at_the_first_wall(frame):
    for env, observation in islice(crowds(frame), 0, None, 3):
        state, radius = env.simulation.state, env.simulation.bodies.radius
        axis = axes(env, observation).astype(float)
        expected = np.zeros((env.num_people, 12))
        for i in np.flatnonzero(env.active):
            walls = shapely.multilinestrings(env.scenario_of_env[env.env_of_person[i]].geometry.walls)
            for k in range(12):
                turn = np.arctan2(axis[i, 1], axis[i, 0]) + 2 * np.pi * k / 12
                reach = 3.0 + radius[i]
                end = state.position[i] + reach * np.array([np.cos(turn), np.sin(turn)])
                hit = shapely.intersection(shapely.linestrings([state.position[i], end]), walls)
                far = reach if hit.is_empty else shapely.distance(shapely.points(state.position[i]), hit)
                expected[i, k] = max(far - radius[i], 0.0) / 3.0
        # a ray may just miss or just hit the end of a wall
        seen = observation[env.active][:, FULL["walls"]]
        wrong = np.abs(seen - expected[env.active]) > 1e-5
        assert wrong.mean() < 0.002
        assert (expected[env.active] < 1).mean() > 0.1 and (expected[env.active] == 1).any()


def test_nobody_is_seen_across_rooms():
    """A person alone in a room perceives nobody, whoever stands at the same place in the next."""
    one = make_scenario("room-v0", population=Population(1, starts=np.array([[2.5, 2.5]]), **TABLE_4))
    env = CrowdEnv([one, make_scenario("room-v0")], num_envs=2)
    observation, _ = env.reset(seed=0)
    assert not observation[0, env.layout["neighbors"]].any()
    assert observation[0, env.layout["density"]] == pytest.approx(1 / (8 * np.pi))


def test_neighbors_at_equal_gaps_come_in_the_order_of_their_slots():
    """Everyone stands on a square lattice of 0.5 m: four nearest at exactly the same gap."""
    x, y = np.meshgrid(np.arange(1.0, 4.1, 0.5), np.arange(1.0, 4.1, 0.5))
    starts = np.column_stack([x.ravel(), y.ravel()])
    starts = starts[np.random.default_rng(0).permutation(len(starts))]
    people = Population(len(starts), radius=Uniform(0.2, 0.2), starts=starts)
    layout = ObservationLayout(terms=("neighbors",), neighbors=2)
    env = CrowdEnv(
        make_scenario("room-v0", population=people), action={"name": "continuous", "frame": "world"}, observation=layout
    )
    observation, _ = env.reset(seed=0)
    for i in range(len(starts)):
        offset = starts - starts[i]
        touching = np.flatnonzero(np.hypot(*offset.T) == 0.5)[:2]
        np.testing.assert_allclose(observation[i].reshape(2, 5)[:, :2], offset[touching] / 3.0, atol=1e-6)


# -------------------------------------------------------------------------------------------------------- symmetries


def quarter_turn(points):
    """Return points of the 5 x 5 m room after a quarter turn to the left around its center."""
    x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return np.stack([5.0 - y, x], axis=-1)


@pytest.mark.parametrize("frame", ["path", "world"])
def test_a_turned_room_is_perceived_as_turned(frame):
    """In the frame of the path nothing changes but `direction`; in that of the world vectors turn and rays shift."""
    rng = np.random.default_rng(0)
    square, door = [(0, 0), (5, 0), (5, 5), (0, 5)], [(5, 2.033), (5, 2.847)]
    block = [(2.03, 1.01), (2.61, 1.07), (2.36, 1.57)]  # aligned with nothing: no two ways of equal length
    starts = []
    while len(starts) < 30:  # away from the door: at a few nodes next to it rounding decides between two directions
        point = rng.uniform((0.3, 0.3), (3.6, 4.7))
        if all(np.hypot(*(point - other)) > 0.41 for other in starts) and not (point[0] > 1.6 and 0.6 < point[1] < 2.0):
            starts.append(point)
    shows = []
    for turn in (np.asarray, quarter_turn):
        geometry = Geometry.from_polygon(turn(square), exits=[turn(door)], obstacles=[turn(block)])
        people = Population(30, radius=Uniform(0.2, 0.2), starts=turn(starts))
        layout = ObservationLayout(tuple(TERMS))
        env = CrowdEnv(
            Scenario("turned", geometry, people, 60.0, **FULL_SPEED),
            physics="dem",
            action={"name": "continuous", "frame": frame},
            observation=layout,
        )
        shows.append([env.reset(seed=0)[0], *(env.step(None).observation for _ in range(9))])
    terms = {name: [np.array(show)[:, :, layout[name]].astype(float) for show in shows] for name in layout.terms}
    steps = terms["velocity"][0].shape[:2]

    def left(vectors):
        return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)

    assert np.abs(terms["push"][0]).max() > 0.05
    for name, (straight, turned_left) in terms.items():
        expected = straight
        if name == "direction" or (frame == "world" and name in ("velocity", "push")):
            expected = left(straight)
        elif frame == "world" and name == "walls":
            expected = np.roll(straight, 2, axis=-1)  # a quarter of eight rays
        elif frame == "world" and name == "neighbors":
            slots = straight.reshape(*steps, -1, 5)
            expected = np.concatenate([left(slots[..., :2]), left(slots[..., 2:4]), slots[..., 4:]], axis=-1)
            expected = expected.reshape(straight.shape)
        np.testing.assert_allclose(turned_left, expected, atol=1e-5, err_msg=name)


WITHOUT_DIRECTION = ObservationLayout(tuple(name for name in TERMS if name != "direction"), neighbors=4)


@cache
def meeting(angle, mirrored):
    """Return what people perceive in ten steps of a turned place, and the layout, which knows the number of routes."""
    env = CrowdEnv(MEETING.turned(angle, mirrored), physics="dem", observation=WITHOUT_DIRECTION)
    env.reset(seed=0)
    return np.array([env.step(None).observation for _ in range(10)]).astype(float), env.layout


@looped("mirrored", [False, True])
@looped("angle", [0.0, 90.0, 137.0, 180.0])
def test_nothing_but_direction_tells_how_a_place_lies(angle, mirrored):
    """A place that is turned, mirrored and moved is perceived as it was, with left and right exchanged in a mirror."""
    (plain, _), (seen, layout) = meeting(0.0, False), meeting(np.radians(angle), mirrored)
    expected = {name: plain[..., layout[name]].copy() for name in layout.terms}
    if mirrored:
        for name, columns in {"velocity": [1], "push": [1], "neighbors": [*range(1, 20, 5), *range(3, 20, 5)]}.items():
            expected[name][..., columns] *= -1.0
        expected["walls"] = expected["walls"][..., -np.arange(layout.rays)]
    for name, wanted in expected.items():
        found = seen[..., layout[name]]
        if name == "opening":
            # Its nodes lie 0.1 m apart, along x and y: where a passage is about as narrow for a while, either end may count
            # as the narrowest.  Its first column is that of the other within a tenth; tests/routing/fields turns doors.
            found, wanted = found[..., 0] / 5.0, wanted[..., 0] / 5.0
        assert np.quantile(np.abs(found - wanted), 0.99) < 0.02, name


# ------------------------------------------------------------------------------------------------------------ layout


@cache
def whole():
    """Return all that is perceived at the moments of `crowds`."""
    return [observation.copy() for _, observation in crowds()]


@looped("term", TERMS)
def test_each_term_can_be_had_alone_and_is_the_same_then(term):
    single = ObservationLayout(terms=(term,), neighbors=7, rays=12)
    for every, (env, part) in zip(whole(), crowds(layout=single), strict=True):
        assert env.layout[term] == slice(0, part.shape[1])
        np.testing.assert_array_equal(part, every[:, FULL[term]])


def test_columns_follow_the_order_of_the_terms_without_gaps():
    layout = ObservationLayout(terms=("walls", "crush", "neighbors", "velocity"), neighbors=3, rays=5)
    assert [layout[name] for name in layout.terms] == [slice(0, 5), slice(5, 6), slice(6, 21), slice(21, 23)]
    assert layout.size == 23
    with pytest.raises(KeyError, match=r"density.*walls, crush, neighbors, velocity"):
        layout["density"]


def test_who_is_out_perceives_nothing_and_is_not_perceived():
    env = CrowdEnv("room-v0", people=2, observation=ObservationLayout(neighbors=1))
    env.reset(seed=0)
    while env.active.all():
        env.step(None)
    step = env.step(None)
    gone = int(np.flatnonzero(~env.active)[0])
    if env.active.any():
        assert not step.observation[1 - gone, env.layout["neighbors"]].any()
        assert step.observation[1 - gone, env.layout["density"]] == pytest.approx(1 / (8 * np.pi))
    assert not step.observation[gone].any()
