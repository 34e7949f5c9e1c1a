"""Behind an exit people go on being bodies, as in the passage that the drawing leaves out, and are gone at its end."""

import numpy as np
import pytest
from cases import looped
from crowds import every_scheme, people, scatter
from shapely import unary_union
from shapely.affinity import rotate
from shapely.geometry import LineString, Point, Polygon, box
from simulations import simulate

from crowd_env import MANNERS, CrowdEnv, Geometry, Population, Scenario, Simulation, make_bodies, make_state
from crowd_env.analysis.plan_check import check_place
from crowd_env.core.arrays.state import join_bodies
from crowd_env.physics import make_scheme
from crowd_env.physics.settings import Physics

APRON = 2.0  # m
ROOM = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2.0), (5, 3.0)]])


def march(place, position, speed, *, scheme, apron=APRON, **options):
    """Return a simulation of people without social forces who walk east at their desired speeds."""
    speed = np.asarray(speed, dtype=float)
    bodies = make_bodies(np.full(len(speed), 0.2), 80.0, desired_speed=speed, relaxation_time=0.3)
    velocity = np.column_stack([speed, np.zeros(len(speed))])
    scheme = make_scheme(scheme, social="none")
    state = make_state(position, velocity)
    return simulate(place.with_apron(apron), bodies, state, scheme=scheme, dt=0.005, fields=[None], **options)


def east(count):
    return {"command": np.tile([1.0, 0.0], (count, 1)), "relative": np.zeros(count, bool)}


def back(count):
    return {"command": np.tile([-1.0, 0.0], (count, 1)), "relative": np.zeros(count, bool)}


# ---------------------------------------------------------------------------------------------------- one by one


@every_scheme
def test_a_pedestrian_that_is_out_walks_straight_on_whatever_it_is_told(name):
    simulation = march(ROOM, [[4.95, 2.4], [1.0, 1.0]], [1.25, 0.0], scheme=name)
    state = simulation.state
    simulation.advance(n_substeps=10, **east(2))
    assert state.active.tolist() == [False, True] and state.exit_index.tolist() == [0, -1]
    assert state.exit_time[0] == pytest.approx(0.04, abs=1e-9) and simulation.inside.tolist() == [1]
    simulation.advance(n_substeps=300, **back(2))
    assert state.present.tolist() == [True, True]
    np.testing.assert_allclose(state.position[0], [4.95 + 1.25 * 1.55, 2.4], atol=2e-3)
    simulation.advance(n_substeps=40, **back(2))
    assert state.present.tolist() == [False, True] and not simulation.escaped.any()
    assert 5.0 + APRON <= state.position[0, 0] < 5.0 + APRON + 0.01
    assert state.exit_time[0] == pytest.approx(0.04, abs=1e-9)  # counted once


@every_scheme
@looped("apron", [0.0, APRON])
def test_a_pedestrian_that_is_out_is_in_the_way(name, apron):
    """The one behind walks faster, and runs into the slow one on the apron; without an apron that one is no more."""
    simulation = march(ROOM, [[4.95, 2.5], [4.3, 2.5]], [0.5, 1.5], scheme=name, apron=apron)
    met = 0.0
    for _ in range(100):
        simulation.advance(n_substeps=4, **east(2))
        met += float(simulation.results.impulse_magnitude.sum())
    assert not simulation.state.active.any()
    assert (met > 0.0) == (apron > 0.0)


@every_scheme
def test_an_apron_has_walls_at_its_sides(name):
    simulation = march(ROOM, [[4.95, 2.5]], [1.0], scheme=name)
    simulation.advance(n_substeps=20, **east(1))
    reach = 0.0
    while simulation.state.present[0]:
        simulation.advance(n_substeps=10, external_force=np.array([[0.0, 150.0]]), **east(1))
        reach = max(reach, float(simulation.state.position[0, 1]))
    assert 2.75 < reach < 2.83  # the body is 0.2 m, the jamb at 3 m


@every_scheme
def test_whoever_is_pushed_out_before_it_responds_walks_on(name):
    bodies = make_bodies([0.2], 80.0, desired_speed=1.2, relaxation_time=0.3, response_time=60.0)
    simulation = Simulation(ROOM.with_apron(APRON), bodies, make_state([[4.95, 2.5]]), physics=name)
    for _ in range(40):
        pushed = np.where(simulation.state.active[:, None], [300.0, 0.0], 0.0)
        simulation.advance(n_substeps=round(0.1 / simulation.dt), external_force=pushed)
    assert not simulation.state.present[0]


def test_where_the_drawing_has_a_passage_the_apron_is_the_rest_of_it():
    """A pedestrian is a body up to two meters behind the jambs, whatever of them is drawn."""
    for drawn in (0.0, 0.5, 1.0, 2.0, 3.0):
        floor = box(0, 0, 5, 5).union(box(5, 2, 5 + drawn, 3))
        place = Geometry.from_polygon(floor, exits=[[(5 + drawn, 2), (5 + drawn, 3)]])
        boundary = place.with_apron(APRON).boundary
        assert boundary.apron.tolist() == pytest.approx([max(APRON - drawn, 0.0)])
        assert len(boundary.wall) == len(place.walls) + 2 * (drawn < APRON)
    np.testing.assert_array_equal(place.boundary.wall, place.walls)


# ---------------------------------------------------------------------------------------------- awkward places

PLACES = {
    "corner": Geometry.from_polygon(box(0, 0, 6, 6), exits=[[(6, 5), (6, 6)], [(5, 6), (6, 6)]]),
    "two exits at an inner corner": Geometry.from_polygon(
        [(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)], exits=[[(3, 3), (3, 4)], [(3, 3), (4, 3)]]
    ),
    "exits face each other": Geometry.from_polygon(
        [box(0, 0, 4, 4), box(4.2, 0, 8, 4)], exits=[[(4, 1), (4, 2)], [(4.2, 1), (4.2, 2)]]
    ),
    "exits face each other from afar": Geometry.from_polygon(
        [box(0, 0, 4, 4), box(6, 0, 9, 4)], exits=[[(4, 1), (4, 2)], [(6, 1), (6, 2)]]
    ),
    "hole": Geometry.from_polygon(box(0, 0, 8, 6), obstacles=[box(3, 2, 4, 4)], exits=[[(3, 2), (3, 4)]]),
    "area in the middle": Geometry.from_polygon(box(0, 0, 8, 6), exits=[box(3, 2, 4, 4)]),
    "area at a wall": Geometry.from_polygon(box(0, 0, 8, 6), exits=[box(7.6, 2, 8, 4)]),
    "area off a wall": Geometry.from_polygon(box(0, 0, 8, 6), exits=[box(7.5, 2, 7.9, 4)]),
    "area across a corridor": Geometry.from_polygon(box(0, 0, 12, 3), exits=[box(6, 0, 6.4, 3)]),
    "area behind a door": Geometry.from_polygon(
        [box(0, 0, 5, 6), box(5, 2.4, 5.3, 3.6), box(5.3, 0, 9, 6)], exits=[box(5.3, 1.9, 6.3, 4.1)]
    ),
    "round jambs": Geometry.from_polygon(box(0, 0, 6, 6), exits=[[(6, 2), (6, 3)]], jamb_radius=0.1),
    "beside another leg": Geometry.from_polygon(
        [(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)], exits=[[(3, 3.2), (3, 4.2)]]
    ),
}


@every_scheme
@looped("y", [2.7, 3.0, 3.3])
def test_nothing_touches_one_who_walks_through_a_door_into_an_area(name, y):
    simulation = march(PLACES["area behind a door"], [[4.5, y]], [1.0], scheme=name)
    while simulation.state.present[0]:
        simulation.advance(n_substeps=10, **east(1))
        assert not simulation.results.impulse_magnitude.any()
    np.testing.assert_allclose(simulation.state.exit_time, 0.8, atol=0.01)


@looped("where", PLACES)
def test_everybody_leaves_and_nobody_comes_back(where):
    place = PLACES[where]
    rng = np.random.default_rng(3)
    bodies = people(rng, 40)._replace(response_time=np.zeros(40))
    state = make_state(scatter(rng, place, bodies.radius))
    simulation = Simulation(place.with_apron(APRON), bodies, state, physics="dem")
    gone = np.zeros(40, bool)
    for _ in range(400):
        simulation.advance(n_substeps=10)
        known = state.exit_time.copy()
        assert not (state.present & gone).any() and not (state.active & ~state.present).any()
        gone |= ~state.present
        if not state.present.any():
            break
    assert np.isfinite(known).all() and not simulation.escaped.any()
    assert not state.present.any()


COURT = Polygon([(0, 0), (10, 0), (10, 8), (7, 8), (7, 3), (3, 3), (3, 8), (0, 8)])


@looped("floor, line", [(box(0, 0, 6, 6), [(6, 2.5), (6, 3.5)]), (COURT, [(4, 3), (5.2, 3)])])
@looped("angle", [0.0, 5.0, 30.0, 45.0, 200.0])
def test_people_start_on_the_floor_and_on_all_of_it(floor, line, angle):
    """Wherever the apron lies: its walls are none of the outline that people are drawn within."""
    turned = rotate(floor, angle, origin=(0, 0))
    door = list(rotate(LineString(line), angle, origin=(0, 0)).coords)
    places = [
        Scenario("turned", Geometry.from_polygon(turned, exits={"door": door}), Population(40), 60.0, apron=apron)
        for apron in (0.0, APRON)
    ]
    drawn = [place.population.draw(np.random.default_rng(5), place.geometry)[1] for place in places]
    assert places[1].geometry.contains(drawn[1]).all()
    np.testing.assert_array_equal(*drawn)


def test_behind_lines_bent_into_the_room_people_vanish():
    """Aprons that lean towards each other would wedge them."""
    angle = np.radians(np.linspace(135.0, 225.0, 9))
    bay = [(7.0 + np.cos(a), 3.0 + np.sin(a)) for a in angle]
    floor = Polygon([(0, 0), (bay[-1][0], 0), *bay[::-1], (bay[0][0], 6), (0, 6)])
    place = Geometry.from_polygon(floor, exits={"bay": bay}).with_apron(APRON)
    assert not place.apron_depths.any()
    out = Geometry.from_polygon(Point(0, 0).buffer(5, quad_segs=40), exits={"arc": box(3, -1, 6, 1)}).with_apron(APRON)
    assert out.apron_depths.all()


def test_a_room_close_behind_an_exit_does_not_block_it():
    place = Geometry.from_polygon(
        [box(0, 0, 6, 6), box(6.3, 0, 9, 6)], exits={"a": [(6, 2.5), (6, 3.5)], "b": [(9, 2), (9, 3)]}
    )
    env = CrowdEnv(Scenario("close", place, Population(10), 60.0), physics="dem")
    env.reset(0)
    while not env.finished.all():
        env.step(None)
    assert env.metrics(0).unfinished == 0 and env.metrics(0).escaped == 0


AREAS = [(where, None) for where in PLACES if where.startswith("area")]


@looped("where, far", [("exits face each other from afar", 2.0), ("hole", 1.0), ("corner", None), *AREAS])
def test_a_check_of_a_plan_says_where_an_apron_is_short(where, far):
    check = check_place(Scenario("short", PLACES[where], Population(5), 60.0))
    said = [remark.partition(" behind exit")[0] for remark in check.remarks if "vanish" in remark]
    assert said == ([f"floor begins {far:.2f} m"] * len(check.widths) if far else [])


@looped("strategy, exits", [("shortest", 2), ("comfortable", 1)])  # costs of comfort differ by exit
def test_travel_times_end_at_the_line(strategy, exits):
    doors = {"a": [(12, 3), (12, 5)], "b": [(0, 3), (0, 4)]}
    place = Geometry.from_polygon(box(0, 0, 12, 8), exits=dict([*doors.items()][:exits]))
    env = CrowdEnv(Scenario("hall", place, Population(20), 60.0), physics="dem", routing=strategy)
    env.reset(0)
    while not env.finished.all():
        before = env.simulation.bodies.desired_speed * env._transition.fields.travel_time_before
        step = env.step(None)
        if step.terminated.any():
            assert (before[step.terminated] < 0.35).all()  # m: not further than a step


# ------------------------------------------------------------------------------------------- batches and moments


@every_scheme
def test_a_checkpoint_keeps_who_is_on_an_apron(name):
    rng = np.random.default_rng(1)
    bodies = people(rng, 15)
    simulation = Simulation(ROOM.with_apron(APRON), bodies, make_state(scatter(rng, ROOM, bodies.radius)), physics=name)
    steps = round(0.1 / simulation.dt)
    while not (simulation.state.present & ~simulation.state.active).any():
        simulation.advance(n_substeps=steps)
    saved = simulation.checkpoint()
    simulation.advance(n_substeps=10 * steps)
    then = simulation.state.copy()
    simulation.restore(saved)
    simulation.advance(n_substeps=10 * steps)
    for ours, theirs in zip(simulation.state, then, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@every_scheme
def test_places_with_and_without_aprons_share_a_batch(name):
    rng = np.random.default_rng(2)
    bodies = people(rng, 12)
    position = scatter(rng, ROOM, bodies.radius)
    both = Simulation(
        [ROOM, ROOM.with_apron(APRON)],
        join_bodies([bodies, bodies]),
        make_state(np.tile(position, (2, 1)), environments=2),
        physics=name,
        geometry_of_env=np.array([0, 1]),
    )
    alone = [Simulation(ROOM.with_apron(apron), bodies, make_state(position), physics=name) for apron in (0.0, APRON)]
    for simulation in (both, *alone):
        simulation.advance(n_substeps=round(4.0 / simulation.dt))
    for e, one in enumerate(alone):
        for name_, ours in one.state._asdict().items():
            whole = getattr(both.state, name_)
            here = whole[e : e + 1] if name_ == "time" else whole[12 * e : 12 * (e + 1)]
            np.testing.assert_array_equal(here, ours)
    assert not np.array_equal(both.state.position[:12], both.state.position[12:])


@pytest.mark.more
def test_a_large_crowd_is_the_same_on_one_thread_and_on_two():
    side = 40.0
    place = Geometry.from_polygon(box(0, 0, side, side), exits=[[(side, 5), (side, 35)]])
    rng = np.random.default_rng(4)
    bodies = people(rng, 4100)._replace(response_time=np.zeros(4100))
    position = scatter(rng, place, bodies.radius)
    states = []
    for threads in (1, 2):
        simulation = Simulation(
            place.with_apron(APRON), bodies, make_state(position), physics=Physics("dem", threads=threads)
        )
        for _ in range(30):
            simulation.advance(n_substeps=10)
        states.append(simulation.state)
    for one, other in zip(*states, strict=True):
        np.testing.assert_array_equal(one, other)
    on_apron = states[0].present & ~states[0].active
    assert on_apron.sum() > 10 and (states[0].position[on_apron, 0] <= side + APRON).all()


# ------------------------------------------------------------------------------------------------- environments


def hall(drawn, width, people, apron=APRON, centers=(5.0,)):
    """Return a hall of 10 x 10 m with doors, behind which passages of a length ``drawn`` [m] lead to the exit lines."""
    spans = [(y - 0.5 * width, y + 0.5 * width) for y in centers]
    floor = unary_union([box(0, 0, 10, 10), *(box(10, low, 10 + drawn, high) for low, high in spans)])
    exits = {f"out {k}": [(10 + drawn, low), (10 + drawn, high)] for k, (low, high) in enumerate(spans)}
    place = Geometry.from_polygon(floor, exits=exits, regions={"hall": box(0, 0, 10, 10)})
    crowd = Population(people, start_region="hall")
    return Scenario("hall", place, crowd, 600.0, blocked_after=30.0, apron=apron)


def test_an_environment_counts_people_out_at_the_line():
    env = CrowdEnv(hall(0.0, 1.0, 20), walking="hurried")
    assert env.scenarios[0].apron == APRON == Scenario.apron
    env.reset(0)
    state, left = env.simulation.state, np.zeros(20, dtype=int)
    reward, beside = np.zeros(20), 0
    while not env.finished.all():
        before = env.active
        step = env.step(None)
        left += step.terminated
        reward += step.info["reward/exit"]
        beside = max(beside, int((state.present & ~state.active).sum()))
        assert not step.reward[~before].any() and not step.observation[~before].any()
        assert (np.isnan(state.exit_time) == env.active).all()
    assert (left == 1).all() and (reward == 1.0).all() and beside > 0
    assert step.info["metrics"][0].escaped == 0


def passed(scenario, manner, scheme, draws):
    """Return when people pass the jambs (draws, N) [s], in order."""
    env = CrowdEnv(scenario, num_envs=draws, physics=scheme, walking=manner)
    env.reset([*range(draws)])
    state, of = env.simulation.state, env.env_of_person
    time, x, then = np.full(env.num_people, np.nan), state.position[:, 0].copy(), state.time.copy()
    while not env.finished.all():
        env.step(None)
        now = state.position[:, 0]
        new = (x < 10.0) & (now >= 10.0) & np.isnan(time)
        time[new] = (then[of] + (10.0 - x) / np.where(new, now - x, 1.0) * (state.time - then)[of])[new]
        x, then = now.copy(), state.time.copy()
    return np.sort(time.reshape(draws, -1), axis=1)


def figures(scenario, manner, scheme, draws):
    """Return the mean time of the last one at the jambs [s] and the flow there [1/s], each with its standard error."""
    times = passed(scenario, manner, scheme, draws)
    first, last = times.shape[1] // 5, times.shape[1] * 9 // 10
    flow = (last - first) / (times[:, last] - times[:, first])
    return [(float(np.mean(of)), float(np.std(of, ddof=1) / np.sqrt(draws))) for of in (times[:, -1], flow)]


def test_a_door_in_the_wall_is_no_faster_than_one_with_a_passage_behind():
    """Where people vanish at the line in the wall, two fifths more pass."""
    (_, drawn), (_, bare), (_, vanish) = (
        figures(hall(*where), "hurried", "dem", 6) for where in ((2.0, 1.0, 60), (0.0, 1.0, 60), (0.0, 1.0, 60, 0.0))
    )
    assert bare[0] == pytest.approx(drawn[0], rel=0.1)
    assert vanish[0] > 1.2 * bare[0]


@pytest.mark.more
def test_two_doors_side_by_side_pass_as_many_wherever_their_lines_are_drawn():
    """By the fastest way, which counts people behind the line in the wall, and turns nobody round in a passage."""
    found = [figures(hall(drawn, 1.0, 60, centers=(4.4, 5.6)), "hurried", "dem", 12)[1] for drawn in (0.0, 2.0)]
    (bare, error), (drawn, its_error) = found
    assert abs(bare / drawn - 1.0) < 0.04 + 2.0 * np.hypot(error, its_error) / drawn  # 1.10 where people turn round


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["dem", "nsm1", "nsm2", "hertz"])
@looped("width", [0.8, 1.0, 2.0, 3.0])
@looped("manner", [manner for manner in MANNERS if MANNERS[manner] is not None])
def test_time_and_flow_do_not_hang_on_where_the_line_is_drawn(name, width, manner):
    found = [figures(hall(drawn, width, 100), manner, name, 40) for drawn in (0.0, 0.5, 1.0, 2.0)]
    for k in (0, 1):
        (of, error), others = found[-1][k], [one[k] for one in found[:-1]]
        for mean, its_error in others:
            assert abs(mean / of - 1.0) < 0.03 + 2.0 * np.hypot(error, its_error) / of
