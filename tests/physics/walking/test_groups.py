"""Groups and attractions: their forces in plain NumPy, and what comes of them."""

import numpy as np
import pytest
import shapely
from cases import looped
from crowds import every_scheme
from shapely.geometry import box
from walking_crowds import decided, manner, standing

from crowd_env import Attraction, Geometry, GroupCohesion, Pulls, Simulation, Walking
from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.routing.route_set import RoutePlan
from crowd_env.routing.spec import Route

RULE = GroupCohesion(gaze=2.5, cohesion=2.0, repulsion=0.7, spacing=0.9)
POINTS = (Attraction(2.0, 1.0, 1.5, reach=1.5, lifetime=4.0), Attraction(-1.0, 0.5, 0.8, since=5.0))


def forces(position, way, k, group, rule):
    """Return the force on person ``k`` over the mass [m/s2] and the angle by which the head is turned [rad]."""
    members = np.flatnonzero(group == group[k])
    if group[k] < 0 or len(members) < 2:
        return np.zeros(2), 0.0
    others = position[members[members != k]]
    focus = others.mean(axis=0) - position[k]
    angle = max(np.arccos(np.clip(focus @ way / np.hypot(*focus), -1.0, 1.0)) - 0.5 * np.pi, 0.0)
    center = position[members].mean(axis=0) - position[k]
    force = np.zeros(2)
    if np.hypot(*center) > 0.5 * (len(members) - 1):
        force += rule.cohesion * center / np.hypot(*center)
    for other in others:
        apart = position[k] - other
        if np.hypot(*apart) < rule.spacing:
            force += rule.repulsion * apart / np.hypot(*apart)
    return force, angle


def attracted(position, points, time):
    """Return the pull of attractions [m/s2]: the gradient of their wells, by differences."""

    def well(at):
        far = [np.hypot(at[0] - one.x, at[1] - one.y) / one.reach for one in points]
        age = [time - one.since for one in points]
        return sum(
            -one.strength * one.reach * np.exp(0.5 * (1.0 - r * r) - t / one.lifetime)
            for one, r, t in zip(points, far, age, strict=True)
            if t >= 0.0
        )

    steps = 1e-5 * np.eye(2)
    return np.array([(well(position - step) - well(position + step)) / 2e-5 for step in steps])


def a_few(seed, keeps=None, pulls=None, **options):
    """Return 12 people, most of them in groups, who stand anywhere in a square of 5 m and want to go anywhere."""
    rng = np.random.default_rng(seed)
    group = rng.permutation([0, 0, 0, 0, 3, 3, 3, 7, 7, 5, -1, -1])
    angle = rng.uniform(0.0, 2.0 * np.pi, 12)
    options |= {"desired_speed": rng.uniform(0.8, 1.6, 12), "relaxation_time": rng.uniform(0.1, 0.5, 12)}
    bodies = make_bodies(np.full(12, 0.1), np.full(12, 70.0), group=group, **options)
    ways = np.column_stack([np.cos(angle), np.sin(angle)])
    position = rng.uniform(-2.5, 2.5, (12, 2))
    return standing(position, ways, keeps, bodies=bodies, pulls=pulls or Pulls(RULE, POINTS)), ways


def expected(simulation, ways, time=0.0):
    """Return the velocities (P, 2) at which drive and forces balance."""
    bodies, position = simulation.bodies, simulation.state.position
    found = np.zeros_like(ways)
    for k, way in enumerate(ways):
        force, angle = forces(position, way, k, bodies.group, RULE)
        force = force + attracted(position[k], POINTS, time)
        tau, speed = bodies.relaxation_time[k], bodies.desired_speed[k]
        wanted = (speed * way + tau * force) / (1.0 + tau * RULE.gaze * angle)
        found[k] = wanted * min(1.0, 1.3 * speed / np.hypot(*wanted))
    return found


@pytest.mark.kernels
@looped("seed", range(20))
def test_the_closed_form_of_all_forces(seed):
    (simulation, asked), ways = a_few(seed)
    wanted = expected(simulation, ways)
    np.testing.assert_allclose(decided(simulation, asked), wanted, rtol=0, atol=1e-8)


@pytest.mark.kernels
def test_an_attraction_begins_and_fades():
    (simulation, asked), ways = a_few(3)
    for time in (4.9, 5.0, 9.0, 60.0):
        simulation.state.time[:], simulation.history.memory.pulls.held_since[:] = time, 0.0  # nobody has lost patience
        wanted = expected(simulation, ways, time)
        np.testing.assert_allclose(decided(simulation, asked), wanted, rtol=0, atol=1e-8)


@pytest.mark.kernels
def test_people_who_keep_a_distance_walk_where_they_are_pulled():
    """Where nobody is near and no wall, the manner changes nothing."""
    far = 12.0 * np.arange(3)[:, None] * [0.0, 0.5] + [[0.0, -6.0]]
    for keeps in (None, manner()):
        simulation, asked = standing(far, np.tile([1.0, 0.0], (3, 1)), keeps, pulls=Pulls(RULE, POINTS))
        wanted = [[1.3, 0.0]] * 3 + 0.5 * np.array([attracted(one, POINTS, 0.0) for one in far])
        wanted *= np.minimum(1.0, 1.3 * 1.3 / np.hypot(*wanted.T))[:, None]
        np.testing.assert_allclose(decided(simulation, asked), wanted, rtol=0, atol=1e-8)


@pytest.mark.kernels
def test_repulsion_in_a_group_changes_no_momentum():
    rule = GroupCohesion(gaze=0.0, cohesion=0.0, repulsion=0.1)
    rng = np.random.default_rng(0)
    bodies = make_bodies(np.full(5, 0.1), np.full(5, 70.0), desired_speed=1.3, group=np.zeros(5, int))
    simulation, asked = standing(
        rng.uniform(-0.5, 0.5, (5, 2)), np.tile([1.0, 0.0], (5, 1)), None, bodies=bodies, pulls=Pulls(rule)
    )
    pulled = decided(simulation, asked) - [1.3, 0.0]
    assert np.abs(pulled).max() > 0.05
    np.testing.assert_allclose(pulled.sum(axis=0), 0.0, atol=1e-12)


def side_by_side(scheme, count=3, keeps=None, **rule):
    """Return people who walk side by side along x, the one in the middle as quick as the others."""
    bodies = make_bodies(
        np.full(count, 0.17), np.full(count, 70.0), desired_speed=1.3, relaxation_time=0.3, group=np.zeros(count, int)
    )
    start = np.column_stack([np.zeros(count), 0.85 * np.arange(count)])
    start[1, 0] = 0.2  # a little ahead
    asked = np.tile([1.0, 0.0], (count, 1))
    return standing(start, asked, keeps, bodies=bodies, scheme=scheme, pulls=Pulls(GroupCohesion(**rule)))


@every_scheme
def test_three_side_by_side_turn_into_a_v(name):
    """Whoever walks in the middle and ahead sees nobody, slows down, and is behind the others in the end."""
    for keeps in (None, manner()):
        simulation, asked = side_by_side(name, keeps=keeps)
        simulation.advance(**asked, n_substeps=round(8.0 / simulation.dt))
        x, y = simulation.state.position.T
        assert x[1] < min(x[0], x[2]) + 0.01 and y[0] < y[1] < y[2]
        blind, asked = side_by_side(name, keeps=keeps, gaze=0.0)
        blind.advance(**asked, n_substeps=round(8.0 / blind.dt))
        assert blind.state.position[1, 0] > blind.state.position[[0, 2], 0].max() + 0.1


CORRIDOR = Geometry.from_polygon(box(0, 0, 30, 3), exits={"end": [(30, 0), (30, 3)]})
CORNER = Geometry.from_polygon(shapely.union(box(0, 0, 12, 3), box(9, 0, 12, 12)), exits={"end": [(9, 12), (12, 12)]})


def two(place, start, keeps, scheme="dem", group=(0, 0), **rule):
    """Return two people who walk out."""
    bodies = make_bodies(
        np.full(2, 0.17), np.full(2, 70.0), desired_speed=[1.4, 0.7], relaxation_time=0.3, group=np.array(group)
    )
    state = make_state(np.array(start, dtype=float))
    pulls = Pulls(GroupCohesion(**rule))
    return Simulation(place, bodies, state, physics=scheme, walking=Walking(keeps, pulls=pulls))


@every_scheme
def test_who_is_far_ahead_waits_and_both_leave_together(name):
    for keeps in (None, "calm"):
        simulation = two(CORRIDOR, [(14, 1), (8, 2)], keeps, name)
        simulation.advance(n_substeps=round(2.0 / simulation.dt))
        assert abs(simulation.state.position[0, 0] - 14.0) < 0.05
        assert simulation.state.position[1, 0] > 9.0
        simulation.advance(n_substeps=round(48.0 / simulation.dt))
        assert not simulation.state.active.any()
        assert np.ptp(simulation.state.exit_time) < 5.0


def test_who_has_turned_a_corner_waits_until_the_others_are_in_sight():
    for start, waits in (([(11.5, 4.6), (9.5, 2.5)], False), ([(9.3, 4.5), (8.0, 2.8)], True)):
        near = two(CORNER, start, "calm")
        assert np.hypot(*np.subtract(*start)) < 3.0
        hidden = (
            shapely.LineString(start).length - shapely.intersection(CORNER.walkable, shapely.LineString(start)).length
        )
        assert (hidden > 0.0) == waits
        near.advance(n_substeps=50)
        assert (np.hypot(*near.state.velocity[0]) < 0.02) == waits


def test_patience_ends_and_who_goes_on_alone_is_not_pulled_back():
    simulation = two(CORRIDOR, [(14, 1), (8, 2)], "calm", patience=3.0)
    simulation.bodies.desired_speed[1] = 0.0
    simulation.restart(0, simulation.bodies, simulation.state.position.copy())
    simulation.advance(n_substeps=250)
    assert simulation.state.position[0, 0] == pytest.approx(14.0, abs=0.05)
    simulation.advance(n_substeps=400)
    assert simulation.state.position[0, 0] > 16.0


@pytest.mark.kernels
@looped(("share", "held"), [(0.2, True), (0.3, False), (0.45, False)])
def test_people_slowed_to_less_than_a_quarter_of_their_speed_lose_patience_and_others_do_not(share, held):
    """Who is pulled straight back by a member 2 m behind walks at v - tau beta_2, and after the patience at v."""
    tau, speed = 0.5, 1.2
    rule = GroupCohesion(cohesion=(1.0 - share) * speed / tau, gaze=0.0, repulsion=0.0, patience=10.0)
    bodies = make_bodies(
        np.full(2, 0.1),
        np.full(2, 70.0),
        desired_speed=speed,
        relaxation_time=tau,
        response_time=np.array([0.0, 900.0]),
        group=np.zeros(2, int),
    )
    start = np.array([[0.0, 0.0], [-2.0, 0.0]])
    simulation, asked = standing(start, [[1.0, 0.0]] * 2, None, bodies=bodies, pulls=Pulls(rule))
    for time in range(41):  # s, in the same place
        simulation.state.time[:], simulation.state.position[:] = time, start
        walks = decided(simulation, asked)[0]
        if time == 10:  # the mean of about two seconds begins late
            np.testing.assert_allclose(walks, [share * speed, 0.0], atol=1e-12)
    np.testing.assert_allclose(walks, [speed if held else share * speed, 0.0], atol=1e-12)


@looped("tau", [0.1, 0.2, 0.36, 0.5], quick=2)
def test_patience_ends_beside_a_member_that_does_not_set_out(tau):
    """Who is pulled to and fro across the threshold of the cohesion, 0.8 m in front of the other, is held back as well."""
    for speed in (0.8, 1.1, 1.5, 1.9):
        bodies = make_bodies(
            np.full(2, 0.17),
            np.full(2, 75.0),
            desired_speed=speed,
            relaxation_time=tau,
            response_time=np.array([0.0, 900.0]),
            group=np.zeros(2, int),
        )
        state = make_state(np.array([[6.8, 1.2], [6.0, 1.6]]))
        pulls = Pulls(GroupCohesion(patience=10.0))
        simulation = Simulation(CORRIDOR, bodies, state, physics="nsm2", walking=Walking("hurried", pulls=pulls))
        simulation.advance(n_substeps=round((10.0 + 12.0 + 23.2 / speed) / simulation.dt))
        assert not simulation.state.active[0], (tau, speed)


@looped("slow", [0.02, 0.1])
def test_patience_ends_beside_a_member_that_hardly_walks(slow):
    for count in (4, 6):
        start = [6.0, 0.5] + 0.6 * np.array([[k % 3, k // 3] for k in range(count)])
        bodies = make_bodies(
            np.full(count, 0.17),
            np.full(count, 75.0),
            desired_speed=np.array([slow, *np.linspace(0.9, 1.6, count - 1)]),
            relaxation_time=0.3,
            group=np.zeros(count, int),
        )
        pulls = Pulls(GroupCohesion(patience=10.0))
        simulation = Simulation(
            CORRIDOR, bodies, make_state(start), physics="nsm2", walking=Walking("calm", pulls=pulls)
        )
        simulation.advance(n_substeps=round(75.0 / simulation.dt))
        assert simulation.state.active.tolist() == [True] + [False] * (count - 1)


def test_only_members_on_the_same_way_are_waited_for():
    exits = {"end": [(30, 0), (30, 3)], "back": [(0, 0), (0, 3)]}
    place = Geometry.from_polygon(box(0, 0, 30, 3), exits=exits)
    for routes, waits in ((("east", "east"), True), (("east", "west"), False)):
        fields = [RoutePlan(place, 0.17, routes=(Route("east", ("end",)), Route("west", ("back",)))).build()]
        state = make_state(np.array([[14.0, 1.0], [8.0, 2.0]]))
        bodies = make_bodies(np.full(2, 0.17), np.full(2, 70.0), desired_speed=1.4, group=np.zeros(2, int))
        alone = Walking("calm", pulls=Pulls(GroupCohesion(cohesion=0.0, gaze=0.0)))
        simulation = Simulation(place, bodies, state, walking=alone, fields=fields)
        names = [route.name for route in fields[0].routes]
        simulation.restart(0, bodies, state.position.copy(), route=np.array([names.index(name) for name in routes]))
        simulation.advance(n_substeps=round(1.0 / simulation.dt))
        assert (simulation.state.velocity[0, 0] < 0.05) == waits


def test_the_group_pulls_only_members_that_have_set_out_and_have_not_left():
    bodies = make_bodies(
        np.full(2, 0.17),
        np.full(2, 70.0),
        desired_speed=1.4,
        response_time=np.array([5.0, 0.0]),
        group=np.zeros(2, int),
    )
    simulation, asked = standing([[0.0, 0.0], [2.0, 0.5]], [[1.0, 0.0]] * 2, None, bodies=bodies)
    walks = decided(simulation, asked)
    assert (walks[0] == 0.0).all() and walks[1, 0] < 1.0
    simulation.state.active[0] = False
    np.testing.assert_allclose(decided(simulation, asked)[1], [1.4, 0.0], atol=1e-12)


def test_members_behind_a_wall_do_not_pull_into_it():
    wall = Geometry.from_polygon(box(0, 0, 20, 6), exits={"end": [(20, 0), (20, 6)]}, thin_walls=[[(8, 0), (8, 5)]])
    simulation = two(wall, [(9, 1), (7, 1)], None)
    simulation.advance(n_substeps=3)
    way = simulation.history.direction[1]
    walks = simulation.history.walking_velocity[1]
    assert way[1] > 0.5 and abs(way[0] * walks[1] - way[1] * walks[0]) < 1e-12


def test_an_attraction_is_left_when_it_has_faded():
    """Who walks against it escapes when the largest pull no longer balances the drive: t = T ln(tau A / v)."""
    tau, strength, lifetime, speed = 0.5, 6.0, 5.0, 1.3
    pulls = Pulls(attractions=(Attraction(0.0, 0.0, strength, reach=2.0, lifetime=lifetime),))
    bodies = make_bodies(np.array([0.17]), np.array([70.0]), desired_speed=speed, relaxation_time=tau)
    simulation, asked = standing([[0.0, 0.0]], [[1.0, 0.0]], None, bodies=bodies, pulls=pulls)
    escapes = lifetime * np.log(tau * strength / speed)
    while simulation.state.position[0, 0] < 2.0:
        simulation.advance(**asked, n_substeps=1)
    assert escapes < simulation.state.time[0] < escapes + 3.0  # slowly at first


def test_a_wall_hides_an_attraction():
    place = Geometry.from_polygon(box(-5, -5, 5, 5), thin_walls=[[(1, -1), (1, 1)]])
    pulls = Pulls(attractions=(Attraction(2.0, 0.0, 1.0),))
    for y, seen in ((0.0, False), (4.0, True)):
        simulation, asked = standing([[0.0, y]], [[-1.0, 0.0]], None, place=place, pulls=pulls)
        assert (decided(simulation, asked)[0, 0] > -1.3) == seen


def test_what_is_refused():
    with pytest.raises(ValueError, match=r"group of pedestrian 1 is 2; it must be from -1 to 1"):
        make_bodies(np.full(2, 0.2), np.full(2, 70.0), group=np.array([0, 2]))
    with pytest.raises(ValueError, match="pulls is 3; it must be a Pulls, or a list of 1, one for each geometry"):
        standing([[0.0, 0.0]], [[1.0, 0.0]], None, pulls=3)
    with pytest.raises(ValueError, match=r"attraction: strength is -1\.0; it must be > 0"):
        Attraction(0.0, 0.0, -1.0)
    alone, _ = standing([[0.0, 0.0], [2.0, 0.0]], [[1.0, 0.0]] * 2, None)
    bodies = make_bodies(np.full(2, 0.2), np.full(2, 70.0), group=np.array([0, 0]))
    with pytest.raises(ValueError, match="no group had two members when the simulation was made"):
        alone.restart(0, bodies, np.array([[0.0, 0.0], [2.0, 0.0]]))
