"""Laws of people in buildings, under every contact scheme."""

import pickle
from functools import partial

import numpy as np
import pytest
from crowds import every_scheme, people, plain, scatter, tight
from shapely.geometry import box
from storeys import DOORS, DOWN, FLOOR, RISE, RUN, UP, in_two_storeys, laid, ramp, run, stacked, started, with_stair

import crowd_env.physics.spatial_order
from crowd_env.core.arrays.state import Bodies, make_bodies, make_state
from crowd_env.geometry.geometry import Geometry, turning
from crowd_env.geometry.sheets import united
from crowd_env.physics import make_scheme
from crowd_env.physics.scheme import IterativeScheme
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

every_manner = pytest.mark.parametrize("walking", [None, "hurried"])


def arrays(simulation, rows=slice(None)):
    """Return what moves, and when people left, by name."""
    state = simulation.state
    names = ("position", "velocity", "active", "exit_time")
    return {name: getattr(state, name)[rows].astype(np.float64) for name in names}


def assert_same(found, expected, accuracy=0.0):
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=0.0, atol=accuracy, err_msg=name)


# ------------------------------------------------------------------------------------------------------- one above the other


def accuracy_of(law):
    """Return how far [m, m/s] storeys may come apart: the solvers stop once all people of an environment meet the laws."""
    return 1e-8 if isinstance(make_scheme(law), IterativeScheme) else 0.0


ROUGH = 1e-3  # of 90 people: they press each other longer


def above_each_other(law, walking, count, radius, seconds):
    """Check two storeys with the same people against the storey alone."""
    rng, alone = np.random.default_rng(1), Geometry.from_polygon(FLOOR, exits=DOORS)
    bodies = people(rng, count)._replace(radius=np.full(count, radius), env_start=np.array([0, count]))
    position = scatter(rng, alone, bodies.radius, gap=0.01)
    both = Bodies(*(np.tile(column, 2) for column in bodies[:-1]), env_start=np.array([0, 2 * count]))
    physics = Physics(tight(make_scheme(law)))
    one = started(alone, bodies, position, 0, law, walking=walking, physics=physics)
    two = started(
        stacked([FLOOR, FLOOR]), both, np.tile(position, (2, 1)), np.repeat([0, 1], count), law, walking=walking,
        physics=physics,
    )  # fmt: skip
    touched = 0
    for _ in range(4):
        run(one, 0.25 * seconds)
        run(two, 0.25 * seconds)
        touched += int((one.results.impulse_magnitude > 0).sum())
        for rows in (slice(0, count), slice(count, None)):
            assert_same(arrays(two, rows), arrays(one), ROUGH if count > 64 and accuracy_of(law) else accuracy_of(law))
    assert touched > 2 or law == "helbing"  # its people keep off each other


@every_manner
@every_scheme
def test_storeys_one_above_the_other_are_two_places(name, walking):
    above_each_other(name, walking, 30, 0.22, 1.6)


@pytest.mark.more
@every_manner
@every_scheme
def test_full_storeys_one_above_the_other_are_two_places(name, walking):
    above_each_other(name, walking, 90, 0.2, 2.0)  # so many are listed by cells


@pytest.mark.more
@every_manner
def test_storeys_of_a_thousand_people_are_two_places(walking):
    above_each_other("dem", walking, 1056, 0.09, 1.2)


@every_manner
@every_scheme
def test_a_slab_keeps_all_influence_off(name, walking):
    # Two of the storey below pass under two others, and under a wall across their way.
    above = FLOOR.difference(box(8.5, 1.5, 9.0, 6.5))
    place, bodies = stacked([FLOOR, above]), people(np.random.default_rng(2), 4)
    bodies.radius[:] = 0.22  # ways are made for the largest
    position = np.array([[7.6, 4.0], [8.2, 5.2], [7.6, 4.0], [8.2, 5.2]])
    crowd = started(place, bodies, position, np.array([0, 0, 1, 1]), name, walking=walking)
    pair = Bodies(*(column[:2] for column in bodies[:-1]), env_start=np.array([0, 2]))
    alone = started(Geometry.from_polygon(FLOOR, exits=DOORS), pair, position[:2], 0, name, walking=walking)
    for _ in range(10):
        run(crowd, 0.5)
        run(alone, 0.5)
        assert_same(arrays(crowd, slice(0, 2)), arrays(alone))
    assert not crowd.state.active[:2].any()
    assert not crowd.escaped.any()


# ------------------------------------------------------------------------------------------------------------ ramps and stairs


@every_manner
@every_scheme
def test_a_ramp_that_does_not_rise_is_level_floor(name, walking):
    sheets, seams, number = united(*ramp(0.0, 4.0, 4.0))
    assert len(sheets) == 1 and not seams and (number == 0).all()
    out = np.array([[8.0, 0.5], [8.0, 1.5]])
    level = Geometry.from_polygon(box(-4, 0, 8, 2).normalize(), exits={"out": out})
    rng = np.random.default_rng(3)
    bodies = people(rng, 16)
    position = scatter(rng, level, bodies.radius, gap=0.02)
    both = [
        started(place, bodies, position, 0, name, walking=walking)
        for place in (laid(sheets, seams, {"out": (0, out)}), level)
    ]
    for _ in range(3):
        for simulation in both:
            run(simulation, 0.7)
        assert_same(arrays(both[0]), arrays(both[1]))


ON_SLOPES = {
    "": ({}, {}),
    "own speeds": ({"stepped": True}, {"upstairs": 0.4, "downstairs": 0.5}),
    "a belt": ({"belt": 0.5}, {}),
}


@pytest.mark.parametrize("climbs", [True, False])
@every_scheme
def test_ten_meters_of_slope_take_as_long_as_the_speed_says(name, climbs):
    for kind, (slope, own) in ON_SLOPES.items():
        relative = own.get("upstairs", UP) if climbs else own.get("downstairs", DOWN)
        belt = slope.get("belt", 0.0) * (1.0 if climbs else -1.0)
        ten_meters(name, climbs, 1.3 * relative + belt, slope, own, kind)


def ten_meters(name, climbs, walks, slope, own, kind):
    """Check the time that a pedestrian alone takes at the speed ``walks`` [m/s] along a slope."""
    rise, along = 6.0, 12.0
    run_length = np.sqrt(along**2 - rise**2)
    x = run_length + 1.0 if climbs else -1.0
    out = np.array([[x, 0.0], [x, 2.0]] if climbs else [[x, 2.0], [x, 0.0]])
    place = laid(*ramp(rise, run_length, 1.0, up=UP, down=DOWN, **slope), {"out": (2 if climbs else 0, out)})
    speed, cosine = 1.3, run_length / along
    start = 1.0 * cosine if climbs else 11.0 * cosine
    bodies = make_bodies([0.2], [70.0], desired_speed=speed, relaxation_time=0.3, **own)
    alone = started(place, bodies, [[start, 1.0]], 1, name, velocity=[[walks * cosine * (1 if climbs else -1), 0.0]])
    end = start + (10.0 if climbs else -10.0) * cosine
    before = start
    while (alone.state.position[0, 0] < end) == climbs:
        before = alone.state.position[0, 0]
        alone.advance()
        assert alone.state.time[0] < 60.0
    late = (alone.state.position[0, 0] - end) / (alone.state.position[0, 0] - before) * alone.dt
    assert alone.state.time[0] - late == pytest.approx(10.0 / walks, rel=0.01), kind
    assert alone.state.sheet[0] == 1


@pytest.mark.parametrize("belt", [-0.5, 0.5])
def test_the_landing_of_an_escalator_stands_still(belt):
    """What does not rise carries nobody, whichever way the steps before and behind it run."""
    place = laid(*ramp(0.0, 6.0, 1.0, belt=belt), {"out": (2, np.array([[7.0, 0.0], [7.0, 2.0]]))})
    bodies = make_bodies([0.2], [70.0], desired_speed=1.3, relaxation_time=0.3)
    alone = started(place, bodies, [[1.0, 1.0]], 1, "dem", velocity=[[1.3, 0.0]])
    run(alone, 2.0)
    assert alone.state.position[0, 0] == pytest.approx(1.0 + 2.0 * 1.3, rel=0.01)


@every_scheme
def test_people_come_down_a_stair_without_a_jump_and_are_counted(name):
    place, rng = with_stair(), np.random.default_rng(4)
    position, sheet = in_two_storeys(rng, 14, 10)
    crowd = started(place, people(rng, 24), position, sheet, name, walking="hurried")
    state, steepest = crowd.state, RISE / RUN
    seen = np.zeros(24, dtype=bool)
    while state.active.any() and state.time[0] < 60.0:
        before, height = state.position.copy(), place.heights(state.position, state.sheet)
        crowd.advance(n_substeps=1 if state.time[0] < 14.0 else 20)
        if state.time[0] < 14.0:
            inside, path = state.active, np.hypot(*(state.position - before).T)
            jump = np.abs(place.heights(state.position, state.sheet) - height)
            assert (jump[inside] <= steepest * path[inside] + 1e-9).all()
            seen |= state.sheet == 2
    assert seen.sum() > 4
    assert not state.active.any() and not crowd.escaped.any()
    assert (state.exit_index == 0).all() and (state.sheet == 0).all()


@pytest.mark.kernels
@pytest.mark.parametrize("law", ["dem", "nsm2"])
def test_without_ways_people_walk_down_a_ramp_as_they_are_told(law):
    sheets, seams = ramp(0.6, 1.6, 2.0, down=0.5)
    line = np.array([[-2.0, 2.0], [-2.0, 0.0]])
    place = laid(sheets, seams, {"out": (0, line)})
    bodies = people(np.random.default_rng(5), 3)._replace(desired_speed=np.full(3, 1.4))
    position, relative = np.array([[2.2, 0.5], [2.2, 1.5], [-1.5, 1.0]]), np.zeros(3, dtype=bool)
    crowd = started(place, bodies, position, np.array([2, 2, 0]), law, walking="hurried", fields=[None])
    seen, slowest, command = set(), np.inf, np.tile([-1.0, 0.0], (3, 1))
    while crowd.state.active.any() and crowd.state.time[0] < 7.0:
        crowd.advance(command, relative=relative, n_substeps=20)
        seen |= {*crowd.state.sheet.tolist()}
        slowest = min([slowest, *(-crowd.state.velocity[crowd.state.sheet == 1, 0]).tolist()])
    assert seen == {0, 1, 2} and not crowd.state.active.any() and not crowd.escaped.any()
    assert crowd.history.height == pytest.approx(0.0)
    assert slowest == pytest.approx(1.4 * 0.5 / np.hypot(1.0, 0.6 / 1.6), rel=0.1)  # half as fast, along the slope


# ------------------------------------------------------------------------------------------------------------- symmetries


MOTIONS = {"quarter turn": (0.5 * np.pi, False), "turn": (0.7, False), "mirror": (0.0, True), "all": (2.4, True)}


@every_scheme
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_building_seen_from_elsewhere_does_the_same(name, motion):
    place, rng = with_stair(), np.random.default_rng(5)
    turn, moved = turning(*MOTIONS[motion]), place.turned(*MOTIONS[motion])
    on_stair = np.array([[5.0, 0.5], [5.5, 0.6], [7.2, 0.5], [7.7, 0.6], [4.2, 0.6], [8.6, 0.6], [3.5, 0.6]])
    sheet = np.array([2, 2, 2, 2, 2, 1, 0])
    bodies, physics = people(rng, 7), Physics(tight(make_scheme(name)))
    ends = []
    for seen, stand in ((place, on_stair), (moved, turn(on_stair))):
        # Fields are found on nodes that do not turn: people are told their way.
        simulation = started(seen, bodies, stand, sheet, name, physics=physics, fields=[None])
        way = np.array([1.0, -1.0, 1.0, -1.0, -1.0, -1.0, 1.0])[:, None] * [1.0, 0.1]
        command = way if seen is place else turn(way)
        simulation.advance(command, relative=np.zeros(7, bool), n_substeps=round(0.6 / simulation.dt))
        ends.append(simulation)
    np.testing.assert_allclose(ends[1].state.position, turn(ends[0].state.position), rtol=0.0, atol=1e-7)
    np.testing.assert_array_equal(ends[1].state.sheet, ends[0].state.sheet)
    heights = [one.heights(end.state.position, end.state.sheet) for one, end in zip((place, moved), ends, strict=True)]
    np.testing.assert_allclose(heights[1], heights[0], rtol=0.0, atol=1e-7)
    assert (ends[0].results.impulse_magnitude > 0).any() or name == "helbing"  # its people keep off each other
    assert (ends[0].state.sheet != sheet).any()


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_turned_building_leads_people_out_alike(motion):
    place, rng = with_stair(), np.random.default_rng(6)
    turn, moved = turning(*MOTIONS[motion]), place.turned(*MOTIONS[motion])
    position, sheet = in_two_storeys(rng, 8, 4)
    bodies = people(rng, 12)
    times = []
    for seen, stand in ((place, position), (moved, turn(position))):
        crowd = started(seen, bodies, stand, sheet, "nsm2")
        run(crowd, 40.0)
        assert not crowd.state.active.any() and not crowd.escaped.any()
        times.append(np.sort(crowd.state.exit_time))
    assert times[1].mean() == pytest.approx(times[0].mean(), rel=0.05)


# ------------------------------------------------------------------------------------------------------------- the same bits


def bits(simulation, rows=slice(None)):
    """Return all that moves as bytes."""
    return b"".join(
        getattr(simulation.state, name)[rows].tobytes() for name in ("position", "velocity", "sheet", "active")
    )


@pytest.mark.parametrize("is_sorted", [False, True])
@every_scheme
def test_a_checkpoint_on_a_stair_goes_on_bit_by_bit(name, is_sorted, monkeypatch):
    if is_sorted:
        monkeypatch.setattr(crowd_env.physics.spatial_order, "MANY", 1)
    place, rng = with_stair(), np.random.default_rng(7)
    position, sheet = in_two_storeys(rng, 40, 30)
    bodies = people(rng, 70)
    make = partial(started, place, bodies, position, sheet, name, walking="hurried")
    first = make()
    run(first, 6.03)
    assert (first.state.sheet == 2).sum() > 1
    checkpoint = pickle.loads(pickle.dumps(first.checkpoint()))
    run(first, 1.5)
    run(second := make(), 1.11)
    for simulation in (first_again := make(), second):
        simulation.restore(checkpoint)
        run(simulation, 1.5)
        assert bits(simulation) == bits(first)
    assert first_again.state.time[0] == first.state.time[0]


@every_scheme
def test_threads_and_the_place_in_the_batch_change_no_bit(name):
    building, room, rng = with_stair(), Geometry.from_polygon(FLOOR, exits=DOORS), np.random.default_rng(8)
    position, sheet = in_two_storeys(rng, 16, 8)
    bodies, others = people(rng, 24), people(rng, 12)
    standing = scatter(rng, room, others.radius, gap=0.02)
    alone = started(building, bodies, position, sheet, name, walking="hurried")
    run(alone, 6.0)
    assert (alone.state.sheet == 2).any()
    for threads in (1, 3):
        order = [(others, standing, np.zeros(12, int)), (bodies, position, sheet), (bodies, position, sheet)]
        start = np.cumsum([0, *(len(each[1]) for each in order)])
        columns = [np.concatenate(parts) for parts in zip(*(each[0][:-1] for each in order), strict=True)]
        at, on = (np.concatenate([each[k] for each in order]) for k in (1, 2))
        state = make_state(at, sheet=on, environments=3)
        batch = Simulation(
            [building, room], Bodies(*columns, env_start=start), state, physics=Physics(name, threads=threads),
            walking="hurried", geometry_of_env=[1, 0, 0],
        )  # fmt: skip
        run(batch, 6.0)
        for e in (1, 2):
            assert bits(batch, slice(start[e], start[e + 1])) == bits(alone)


def test_a_sheet_that_is_not_there_is_refused():
    bodies = people(np.random.default_rng(9), 2)
    for place, sheet, text in ((with_stair(), [0, 3], "0 to 2"), (plain(), [1, 0], "0, the only one")):
        with pytest.raises(
            ValueError, match=f"^pedestrian {int(np.argmax(sheet))} is on sheet {max(sheet)}; .*{text}$"
        ):
            started(place, bodies, [[1.0, 3.0], [3.0, 3.0]], np.array(sheet), "dem")
