"""What a simulation is given: every array that does not fit is one sentence, before a kernel reads beyond its end."""

import re

import numpy as np
import pytest
from cases import looped

from crowd_env import FULL_SPEED, SCHEMES, CrowdEnv, Geometry, Physics, Population, Scenario, Uniform, make_scenario
from crowd_env.core.arrays.state import Bodies, CrowdState, make_bodies, make_state
from crowd_env.core.behaviors.outline import OUTLINES
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.scenarios.cohorts import Cohorts, extreme_bodies

ROOM = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)], exits=[[(5, 2), (5, 3)]])
XS, YS = np.array([1.0, 2, 3]), np.array([1.0, 3, 2])


def crowd():
    bodies = make_bodies(np.full(3, 0.2), 70.0, desired_speed=1.3, relaxation_time=0.3)
    return bodies, make_state(np.column_stack([XS, YS]))


def shorter(array):
    return array[:-1].copy()


def longer(array):
    return np.concatenate([array, array[-1:]])


def single(array):
    return array.astype(np.float32) if array.dtype == np.float64 else array.astype(np.int16)


def strided(array):
    return np.repeat(array, 2, axis=0)[::2]


def frozen(array):
    array = array.copy()
    array.flags.writeable = False
    return array


WRONG = {
    shorter: "has the shape|must ascend|empty",
    longer: "has the shape|must ascend",
    single: "it must hold (float64|int64|bool)$",
    strided: "is not contiguous in memory",
    frozen: "is read-only",
    list: "is list; it must be a NumPy array",
}


@looped("spoil", WRONG, ids=lambda spoil: spoil.__name__)
@looped("name", [*Bodies._fields, *CrowdState._fields])
def test_an_array_that_kernels_cannot_work_on_is_refused(name, spoil):
    bodies, state = crowd()
    if name in Bodies._fields:
        bodies = bodies._replace(**{name: spoil(getattr(bodies, name))})
    elif not (name == "time" and spoil is strided):  # one number is always contiguous
        state = state._replace(**{name: spoil(getattr(state, name))})
    else:
        return
    with pytest.raises(ValueError, match=WRONG[spoil]) as caught:
        Simulation(ROOM, bodies, state)
    assert "\n" not in str(caught.value)


@looped("value", [np.nan, np.inf, -1.0, 0.0])
@looped("name", Bodies._fields[:6])
def test_a_body_that_cannot_be_is_refused_by_name_and_number(name, value):
    bodies, state = crowd()
    getattr(bodies, name)[1] = value
    if value == 0.0 and name in ("desired_speed", "response_time"):
        Simulation(ROOM, bodies, state)
        return
    with pytest.raises(ValueError, match=rf"^{name} of pedestrian 1 is {value:g}; it must be finite and >=? 0$"):
        Simulation(ROOM, bodies, state)


@looped(
    ("name", "value", "bound"),
    [(name, value, "> 0 and finite") for name in ["time_gap"] for value in (np.inf, -1.0, 0.0)]
    + [("push", value, "in [0, 1]") for value in (np.inf, -0.1, 1.1)],
)
def test_what_people_mean_to_do_is_refused_by_name_and_number(name, value, bound):
    bodies, state = crowd()
    assert np.isnan(getattr(bodies, name)).all()  # as the manner of the run has it
    getattr(bodies, name)[1] = value
    with pytest.raises(ValueError, match=rf"^{name} of pedestrian 1 is {value:g}; it must be {re.escape(bound)}$"):
        Simulation(ROOM, bodies, state)


@pytest.mark.parametrize("start", [[0, 3, 3], [0, 2, 1, 3], [1, 3], [0, 2], [3], [0, 4]])
def test_environments_follow_one_another_and_nobody_is_left_over(start):
    bodies, state = crowd()
    state = state._replace(time=np.zeros(len(start) - 1))
    with pytest.raises(ValueError, match=r"env_start is \[.*\]; it must ascend from 0 to the number of people, 3"):
        Simulation(ROOM, bodies._replace(env_start=np.array(start)), state)
    with pytest.raises(ValueError, match="env_start is"):
        make_bodies(np.full(3, 0.2), 70.0, env_start=np.array(start))


def test_the_number_of_steps_is_a_whole_number():
    bodies, state = crowd()
    simulation = Simulation(ROOM, bodies, state)
    for steps in (1.5, True, "3", -1, None):
        with pytest.raises(ValueError, match=r"n_substeps is .*; it must be"):
            simulation.advance(n_substeps=steps)
    assert simulation.state.time[0] == 0.0
    simulation.advance(n_substeps=np.int64(2))
    simulation.advance(n_substeps=2.0)
    assert simulation.state.time[0] == pytest.approx(4 * simulation.dt)


@pytest.mark.parametrize("order", ["C", "F"])
def test_coordinates_may_come_transposed(order):
    position = np.array([XS, YS], order="C" if order == "F" else "F").T
    state = make_state(position, position)
    np.testing.assert_array_equal(state.position, np.column_stack([XS, YS]))
    bodies, _ = crowd()
    simulation = Simulation(ROOM, bodies, state)
    simulation.advance(n_substeps=2)
    simulation.restart(0, bodies, np.asfortranarray(np.column_stack([XS, YS])))
    simulation.advance(n_substeps=2)


def test_recorded_starts_may_come_transposed_and_are_the_populations_own():
    starts = np.array([XS, YS]).T
    people = Population(3, starts=starts)
    starts[0] = 0.01, 0.01  # into a wall
    env = CrowdEnv(Scenario("starts", ROOM, people, 10.0, **FULL_SPEED), num_envs=2)
    env.reset(seed=0)
    env.step(None)
    np.testing.assert_array_equal(people.starts, np.column_stack([XS, YS]))


@looped(
    ("make", "sentence"),
    [
        (lambda: make_state([XS, YS]), r"^position has the shape \(2, 3\); it must be \(P, 2\)"),
        (
            lambda: make_state(np.zeros((3, 2)), np.zeros((2, 2))),
            r"^velocity has the shape \(2, 2\); it must be \(3, 2\)",
        ),
        (lambda: make_state([["x", "y"]]), "^position is not made of numbers"),
        (lambda: make_state(np.zeros((3, 2)), environments=0), "^environments is 0; it must be at least 1$"),
        (lambda: make_bodies([], 70.0), r"^radius has the shape \(0,\)"),
        (lambda: make_bodies(np.full((2, 2), 0.2), 70.0), r"^radius has the shape \(2, 2\)"),
        (
            lambda: make_bodies(np.full(3, 0.2), np.ones(2)),
            r"^mass has the shape \(2,\); it must be one number, or \(3,\)",
        ),
        (lambda: make_bodies(np.full(3, 0.2), "heavy"), "^mass is not made of numbers"),
        (lambda: make_bodies(np.full(3, 0.2), 1.0, env_start=[0.0, 3.0]), "^env_start is .* a row of whole numbers$"),
        (
            lambda: Simulation(ROOM, *crowd(), physics=Physics(threads=1.5)),
            "^threads is 1.5; it must be a whole number, 1 to 1024$",
        ),
        (lambda: Simulation(ROOM, *crowd(), geometry_of_env=np.zeros((1, 1), int)), "^geometry_of_env"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_sentence(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


@pytest.mark.parametrize(
    ("what", "sentence"),
    [
        ({"position": np.array([1.0, 1.0])}, r"^position has the shape \(2,\); it must be \(3, 2\)$"),
        ({"position": np.full((3, 2), np.nan)}, r"^position\[0, 0\] is nan; it must be finite$"),
        ({"velocity": np.zeros(2)}, r"^velocity has the shape \(2,\); it must be \(3, 2\)$"),
        ({"bodies": make_bodies(np.full(2, 0.2), 70.0)}, "^environment 0 holds 3 people, not 2$"),
        ({"bodies": crowd()[0]._replace(mass=np.ones(1))}, r"^bodies.mass has the shape \(1,\); it must be \(3,\)$"),
        ({"bodies": make_bodies(np.full(3, 0.2), 1e-3)}, "^dt = 0.01 s is above the stable step of dem"),
    ],
)
def test_a_restart_is_checked_before_anything_changes(what, sentence):
    bodies, state = crowd()
    simulation = Simulation(ROOM, bodies, state, physics="dem")
    before, mass = state.copy(), bodies.mass.copy()
    with pytest.raises(ValueError, match=sentence):
        simulation.restart(0, **{"bodies": bodies, "position": before.position, **what})
    np.testing.assert_array_equal(simulation.state.position, before.position)
    np.testing.assert_array_equal(simulation.bodies.mass, mass)


# ------------------------------------------------------------------------------------------------------- stable steps


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("place", ["room-v0", "counter-flow-v0"])
def test_no_draw_has_a_shorter_stable_step_than_the_one_that_is_checked(scheme, place):
    scenario, law = make_scenario(place), SCHEMES[scheme]
    bound = law.stable_dt(extreme_bodies(scenario.population))
    rng = np.random.default_rng(0)
    for _ in range(50):
        bodies, _ = scenario.population.draw(rng, scenario.geometry)
        assert law.stable_dt(bodies) >= bound


def test_a_step_that_nobody_gave_is_that_of_the_scenario_and_a_part_of_the_decision():
    people = {"radius": Uniform(0.2, 0.25), "mass": Uniform(60.0, 100.0)}
    few, many = (make_scenario("room-v0", side=20.0, population=Population(n, **people)) for n in (20, 400))
    law = SCHEMES["hertz"]
    steps = [CrowdEnv(few, num_envs=n, physics="hertz").simulation.dt for n in (1, 3)]
    assert steps == [0.005, 0.005]  # whoever shares the batch
    assert CrowdEnv(few, physics="hertz", decision_dt=0.012).simulation.dt == 0.004
    assert CrowdEnv(few, physics="dem").simulation.dt == 0.01
    short = CrowdEnv(many, physics="hertz").simulation.dt
    limit = 0.5 * law.stable_dt(extreme_bodies(many.population))
    assert 0.9 * limit < short <= limit < 0.005 and 0.1 / short == pytest.approx(round(0.1 / short), abs=1e-9)
    turned = CrowdEnv(few, physics=Physics("hertz", outline="torso")).simulation.dt
    assert 0.9 * OUTLINES["torso"].step_share < turned / 0.005 <= OUTLINES["torso"].step_share


def test_a_step_is_refused_if_any_draw_would_be_unstable_whatever_the_first_one_is():
    kinds = Uniform(0.2, 0.25), Uniform(60.0, 100.0)
    people = Cohorts((Population(10, *kinds, name="a"), Population(10, *kinds, name="b")))
    for place in (make_scenario("room-v0"), make_scenario("room-v0", population=people)):
        limit = SCHEMES["hertz"].stable_dt(extreme_bodies(place.population))
        for _ in range(20):
            with pytest.raises(ValueError, match=r"^dt = 0.0125 s is above the stable step of hertz, 0.012"):
                CrowdEnv(place, physics=Physics("hertz", dt=0.0125), decision_dt=0.1)
        assert 0.012 < limit < 0.0125
        CrowdEnv(place, physics=Physics("hertz", dt=0.012), decision_dt=0.12)
