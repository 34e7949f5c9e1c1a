"""Nobody goes through a wall, faster than a person can, or further in a step than the own radius: seen by positions."""

import numpy as np
import pytest
import shapely
from cases import looped
from crowds import GRAIN_SCHEMES, every_scheme, plain, tight
from simulations import simulate

from crowd_env import (
    DEM,
    FULL_SPEED,
    NSM2,
    TABLE_4,
    CrowdEnv,
    Geometry,
    Hertz,
    Physics,
    Population,
    Scenario,
    Simulation,
    SpeedZone,
    Uniform,
    make_bodies,
    make_state,
)
from crowd_env.core.arrays.state import MAX_SPEED
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.geometry.inside import border_of, mark_outside
from crowd_env.physics import SCHEMES

RADIUS = 0.2
ROOM = Geometry.from_polygon([(0, 0), (4, 0), (4, 3), (0, 3)], exits={"e": [(4, 1.9), (4, 2.9)]})
WEDGE = Geometry.from_polygon([(0, 0), (4, 0), (4, 3), (2, 0.6), (0, 3)])  # acute corners, and one that juts in
SLIM = Geometry.from_polygon([(0, 0), (4, 0), (4, 3), (0, 3)], obstacles=[[(1.99, 0), (2.01, 0), (2.01, 2), (1.99, 2)]])
THIN = Geometry.from_polygon([(0, 0), (4, 0), (4, 3), (0, 3)], thin_walls=[[(2, 0), (2, 2)]])


def outside(place, position):
    """Return how many positions are not in the walkable area, by shapely."""
    return int((~shapely.intersects_xy(place.walkable, *position.T)).sum())


def through(seen):
    """Return whether anyone changed sides between two moments but around the upper end of the wall at x = 2, y < 2."""
    before, after = seen[:-1], seen[1:]
    changed = (before[..., 0] < 2) != (after[..., 0] < 2)
    return bool((changed & (np.minimum(before[..., 1], after[..., 1]) < 1.9)).any())


def press(place, start, force, name, *, steps=200, velocity=None, **options):
    bodies = make_bodies(np.full(len(start), RADIUS), 80.0, desired_speed=1.0)
    state = make_state(start, velocity)
    simulation = simulate(place, bodies, state, scheme=name, fields=[None], **options)
    push = np.broadcast_to(np.asarray(force, dtype=float), (len(start), 2))
    seen = []
    for _ in range(steps):
        simulation.advance(np.zeros((len(start), 2)), external_force=push)
        seen.append(state.position.copy())
    return simulation, np.array(seen)


@every_scheme
@looped("force", [3e4, 1e7])
@looped("toward", [(-1, -1), (0.3, -1), (-1, 0), (0, -1)], quick=2)
def test_walls_hold_however_hard_one_is_pressed(name, force, toward):
    for place in (ROOM, WEDGE):
        simulation, seen = press(place, [[0.6, 0.5], [3.0, 0.5]], force * np.array(toward), name, steps=80)
        assert outside(place, seen.reshape(-1, 2)) == 0
        assert not simulation.escaped.any()


@pytest.mark.kernels
@every_scheme
def test_the_tip_of_two_walls_holds_where_it_is_met_head_on(name):
    # Within a margin of 1e-6 m of the axis a path meets the tip before it comes near either side.
    needle = Geometry.from_polygon([(0, 0), (4, 0), (4, 4), (0, 4)], obstacles=[[(1, 1.9), (1, 2.1), (3, 2)]])
    fold = Geometry.from_polygon([(0, 0), (4, 0), (4, 4), (0, 4)], thin_walls=[[(1, 1.9), (3, 2), (1, 2.1)]])
    offsets = np.linspace(-1e-6, 1e-6, 11)
    start = np.column_stack([np.full(11, 3.05), 2 + offsets])
    each = np.arange(12)
    bodies = make_bodies(np.full(11, RADIUS), 80.0, desired_speed=1.0)._replace(env_start=each)
    for place in (needle, fold):
        state = make_state(start, [[-12.0, 0.0]] * 11, environments=11)
        simulation = Simulation(place, bodies, state, physics=name, fields=[None])
        pressed = np.tile([-1e9, 0.0], (11, 1))
        for _ in range(8):
            simulation.advance(np.zeros((11, 2)), external_force=pressed)
            passed = (state.position[:, 0] < 3) & (abs(state.position[:, 1] - 2) < 0.05 * (3 - state.position[:, 0]))
            assert not passed.any()


def test_overlaps_too_deep_to_be_taken_back_in_a_step_are_named_as_the_reason():
    crowd = np.random.default_rng(0).uniform([0.5, 0.5], [1.0, 1.0], (20, 2))
    with pytest.raises(
        FloatingPointError, match=r"moved apart by more than their radius .* smaller position_correction"
    ):
        press(ROOM, crowd, 0.0, NSM2(position_correction=1.0), steps=5)


@every_scheme
@looped("place", [SLIM, THIN], ids=["2 cm thick", "without thickness"])
def test_slim_and_thin_walls_hold_from_both_sides(name, place):
    start = np.array([[1.7, 0.5], [1.7, 1.2], [2.3, 0.5], [2.3, 1.2]])
    side = np.sign(start[:, 0] - 2)
    _, seen = press(place, start, np.column_stack([-side * 1e7, np.zeros(4)]), name, steps=60)
    assert not through(seen)
    assert (np.sign(seen[:20, :, 0] - 2) == side).all()  # later some have been squeezed along to the end of the wall


@every_scheme
@looped("place", [ROOM, SLIM, THIN], ids=["room", "slim", "thin"])
def test_walls_hold_however_fast_one_comes(name, place):
    rng = np.random.default_rng(1)
    start = np.array([[x, y] for x in (0.4, 0.9, 1.4) for y in (0.4, 0.9, 1.4)])
    angle = rng.uniform(0, 2 * np.pi, len(start))
    velocity = 12.4 * np.column_stack([np.cos(angle), np.sin(angle)])
    _, seen = press(place, start, 1e5 * velocity, name, steps=60, velocity=velocity)
    assert outside(place, seen.reshape(-1, 2)) == 0
    assert place is ROOM or not through(seen)


# Contacts as good as none, on lanes and not: only the bound holds.
SOFT = {
    "dem": DEM(stiffness=1e-3),
    "hertz": Hertz(youngs_modulus=1e-3, friction=0.0, wall_friction=0.0, social=None),
}


@pytest.mark.kernels
@pytest.mark.parametrize("scheme", SOFT.values(), ids=SOFT)
def test_a_wall_that_holds_takes_the_speed_into_it_and_says_so(scheme):
    bodies = make_bodies([RADIUS], 80.0, desired_speed=0.0, relaxation_time=1e9)
    state = make_state([[0.5, 1.0]], [[-4.0, 1.0]])
    simulation = Simulation(ROOM, bodies, state, physics=Physics(scheme, dt=0.01), fields=[None])
    simulation.advance(n_substeps=20)
    assert state.position[0, 0] == pytest.approx(1e-6, abs=1e-8)
    np.testing.assert_allclose(state.velocity, [[0.0, 1.0]], atol=1e-6)
    np.testing.assert_allclose(simulation.results.impulse, [[320.0, 0.0]], rtol=1e-6)
    assert simulation.results.impulse_magnitude[0] == pytest.approx(320.0, rel=1e-6)


@every_scheme
def test_people_are_no_faster_than_anyone_ever_ran_and_grains_may_be(name):
    simulation, _ = press(plain(), [[0.0, 0.0]], [1e6, 0.0], name, steps=5)
    speed = np.hypot(*simulation.state.velocity[0])
    assert speed == pytest.approx(MAX_SPEED) and simulation.diagnostics.max_speed[0] == pytest.approx(MAX_SPEED)
    if name not in GRAIN_SCHEMES:
        return
    bodies, state = make_bodies([RADIUS], 80.0), make_state([[0.0, 0.0]], [[15.0, 0.0]])
    grains = Simulation(plain(), bodies, state, physics=Physics(name, dt=0.001), driving=False)
    grains.advance(n_substeps=3)
    assert state.velocity[0, 0] == pytest.approx(15.0) and grains.diagnostics.max_speed[0] == pytest.approx(15.0)


@every_scheme
def test_the_largest_speed_is_that_of_any_step_since_the_start(name):
    env = CrowdEnv(
        "room-v0", physics=Physics(name, dt=SCHEMES[name].info.default_dt), decision_dt=SCHEMES[name].info.default_dt
    )
    env.reset(seed=1)
    seen = 0.0
    for _ in range(150):
        inside = env.active.copy()
        env.step(None)
        seen = max(seen, float(np.hypot(*env.simulation.state.velocity[inside].T).max()))
    largest = env.metrics(0).max_speed
    assert seen * (1.0 - 1e-12) <= largest  # hertz: of the middle of a step too
    assert largest <= seen * (1.02 if "hertz" in name else 1.0 + 1e-12)
    env.reset(seed=1)
    assert env.metrics(0).max_speed == 0.0


@every_scheme
def test_a_step_that_desired_speeds_alone_make_too_long_is_refused_with_the_formula(name):
    bodies, state = make_bodies([0.2, 0.06], 80.0, desired_speed=[1.0, 4.0]), make_state([[1.0, 1.0], [2.0, 1.0]])
    with pytest.raises(
        ValueError, match=r"pedestrian 1: desired speed x dt = 4 m/s x 0\.01 s = 0\.04 m, .* 0\.5 of the radi"
    ):
        Simulation(ROOM, bodies, state, physics=Physics(name, dt=0.01), fields=[None])
    Simulation(ROOM, bodies, state, physics=Physics(name, dt=0.007), fields=[None])


@every_scheme
def test_one_who_goes_too_far_in_a_step_is_named_with_place_and_time(name):
    bodies = make_bodies([0.2, 0.1], 80.0, desired_speed=1.0)
    state = make_state([[0.0, 0.0], [3.0, 1.0]])
    simulation = Simulation(plain(), bodies, state, physics=Physics(name, dt=0.01))
    simulation.advance(n_substeps=20)
    force = np.array([[0.0, 0.0], [1e6, 0.0]])
    with pytest.raises(
        FloatingPointError,
        match=rf"{name}: pedestrian 1 of environment 0 would move 0\.125 m in one step near \(3\..*, 1\..*\) at t = 0\.2\d? s "
        r"with dt = 0\.01 s, further than its radius of 0\.1 m \(12\.5 m/s\); take a smaller dt",
    ):
        for _ in range(2):
            simulation.advance(external_force=force)


def test_desired_speeds_above_what_anyone_ran_are_refused():
    with pytest.raises(ValueError, match=r"desired_speed of pedestrian 1 is 13; it must be at most 12\.5 m/s"):
        make_bodies([0.2, 0.2], 80.0, desired_speed=[1.0, 13.0])

    with pytest.raises(
        ValueError, match=r"population: desired_speed must be in \[0, 12\.5\], but can be as high as 1e\+06"
    ):
        Population(20, desired_speed=(1.0, 1e6))
    with pytest.raises(ValueError, match=r"speed zone 'stairs': speed is 40\.0; it must be above 0 and at most 12\.5"):
        SpeedZone("stairs", speed=40.0)


def test_who_is_outside_is_found_by_position_as_shapely_finds_it():
    rng = np.random.default_rng(2)
    for corners in (4, 9, 400):
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
        radius = rng.uniform(5, 20, corners)
        star = shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])).buffer(0)
        place = star.difference(shapely.Point(0, 1).buffer(2)).union(shapely.box(25, -3, 30, 3))
        place = shapely.transform(place, lambda xy: np.add(xy, [5e5, 4e6]))
        points = np.add(rng.uniform(-32, 32, (3000, 2)), [5e5, 4e6])
        found, active = np.zeros(len(points), dtype=bool), rng.uniform(size=len(points)) < 0.8
        border, env_start = struct_ref(border_of([shapely.box(0, 0, 1, 1), place])), np.array([0, len(points)])
        mark_outside(border, np.array([1]), env_start, active, points, found)
        np.testing.assert_array_equal(found, active & ~shapely.contains_xy(place, *points.T))


def test_the_quick_way_to_find_who_is_outside_is_right_in_plans_of_right_angles():
    rng = np.random.default_rng(3)
    for _ in range(30):
        boxes = [shapely.box(*low, *(low + rng.integers(1, 6, 2))) for low in rng.integers(0, 12, (8, 2))]
        holes = [shapely.box(*low, *(low + rng.uniform(0.1, 1.0, 2))) for low in rng.uniform(0, 15, (6, 2))]
        place = shapely.union_all(boxes).difference(shapely.union_all(holes))
        points = np.concatenate(
            [rng.uniform(-1, 18, (2000, 2)), np.add(rng.uniform(0, 17, (500, 2)).round(1), [0.0, 1e-3])]
        )
        near = shapely.distance(shapely.boundary(place), shapely.points(points)) < 2e-6  # either will do
        found = np.zeros(len(points), dtype=bool)
        env_start, everyone = np.array([0, len(points)]), np.ones(len(points), dtype=bool)
        mark_outside(struct_ref(border_of([place])), np.array([0]), env_start, everyone, points, found)
        np.testing.assert_array_equal(found[~near], ~shapely.contains_xy(place, *points[~near].T))


def test_whoever_is_outside_is_counted_until_the_next_episode():
    env = CrowdEnv("room-v0", num_envs=2)
    env.reset(seed=0)
    env.step(None)
    assert env.metrics(1).escaped == 0
    env.simulation.state.position[env.people(1)][3] += 30.0
    env.step(None)
    env.step(None)
    assert (env.metrics(0).escaped, env.metrics(1).escaped) == (0, 1)
    env.reset(seed=0)
    assert env.metrics(1).escaped == 0


def hall(people, density, door, **population):
    side = np.sqrt(people / density)
    exits = {"east": [(side, 0.5 * (side - door)), (side, 0.5 * (side + door))]}
    place = Geometry.from_polygon([(0, 0), (side, 0), (side, side), (0, side)], exits=exits)
    return Scenario("hall", place, Population(people, **{**TABLE_4, **population}), time_limit=3600.0, **FULL_SPEED)


def run_out(env, decisions):
    """Return how many were outside at any decision, by shapely, and the metrics."""
    place, lost = env.scenarios[0].geometry, 0
    for _ in range(decisions):
        env.step(None)
        lost += outside(place, env.simulation.state.position[env.active])
        if env.finished.all():
            break
    return lost, env.metrics(0)


@pytest.mark.parametrize("name", [name for name in SCHEMES if name != "nsm2-printed"])
def test_nobody_leaves_a_crowded_hall_but_by_the_door(name):
    small = {"radius": Uniform(0.1, 0.12), "mass": Uniform(30.0, 40.0)}
    for people, density, door, options in ((150, 3.0, 1.2, {}), (120, 11.0, 0.8, small)):
        dt = 0.001 if "hertz" in name else 0.005
        env = CrowdEnv(hall(people, density, door, **options), physics=Physics(name, dt=dt))
        env.reset(seed=3)
        lost, metrics = run_out(env, 40 if "hertz" in name else 100)
        assert (lost, metrics.escaped) == (0, 0)
        assert 0.0 < metrics.max_speed <= MAX_SPEED * (1 + 1e-12)


def test_a_soft_wall_that_gives_way_by_a_radius_still_holds():
    # At a tenth of the stiffness a crowd of 600 does what 5000 do at the whole of it.
    env = CrowdEnv(hall(600, 3.0, 0.8), physics=DEM(stiffness=4e3))
    env.reset(seed=3)
    lost, metrics = run_out(env, 150)
    assert metrics.max_outside > 0.19  # somebody's center was at the wall
    assert (lost, metrics.escaped) == (0, 0)


def test_the_printed_law_is_kept_under_its_name_and_ends_in_bounds_or_in_words():
    assert SCHEMES["nsm2"] == NSM2() and NSM2().reaction == "dissipative"
    assert SCHEMES["nsm2-printed"] == NSM2(reaction="printed") and "makes energy" in SCHEMES["nsm2-printed"].info.title
    assert tight(SCHEMES["nsm2-printed"]).info.name == "nsm2-printed"
    speeds = {}
    for name in ("nsm2", "nsm2-printed"):
        env = CrowdEnv(hall(500, 3.1, 1.2), physics=name)
        env.reset([0])
        lost, metrics = run_out(env, 60)
        assert (lost, metrics.escaped) == (0, 0)
        speeds[name] = metrics.max_speed
    assert speeds["nsm2"] < 9.0 < speeds["nsm2-printed"] <= MAX_SPEED * (1 + 1e-12)


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in SCHEMES if name != "nsm2-printed"])
def test_soak(name):
    # 1e7 pedestrian-steps: halls of 500 to 5000 people, 2 to 4 /m2, doors of 0.8 to 4 m.
    done, people = 0, (500, 1000, 2000, 5000)
    cases = [
        (n, density, door)
        for n, density, door in zip(people * 2, (2, 3, 4, 2.5, 4, 2, 3, 4), (0.8, 1.2, 2, 4) * 2, strict=True)
    ]
    for k, (n, density, door) in enumerate(cases):
        env = CrowdEnv(hall(n, density, door), physics=name)
        env.reset([k])
        before = done
        while done - before < 1e7 / len(cases) and not env.finished.all():
            inside = int(env.active.sum())
            lost, metrics = run_out(env, 1)
            assert lost == 0
            done += inside * env.n_substeps
        assert metrics.escaped == 0 and metrics.max_speed <= MAX_SPEED * (1 + 1e-12)
