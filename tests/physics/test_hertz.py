"""The Hertz scheme against closed forms, and the readings of Lin, Ma, Lo that its options choose between."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from crowds import GRAIN_SCHEMES, converging, crowd_in, half_plane, l_shape, plain
from late import late

from crowd_env import DEM, SCHEMES, Hertz, Physics, Simulation, SocialForce, make_bodies, make_scheme, make_state
from crowd_env.envs.metrics import flow_slope
from crowd_env.scenarios import make_scenario

solve_ivp = late("scipy.integrate", "solve_ivp")

ELASTIC = Hertz(normal_damping=0.0, tangential_damping=0.0, friction=0.0, wall_friction=0.0)
BARE = replace(Hertz(), social=None)
KN, KT = 2 * 5e6 / (3 * 1.25 * 0.75), 2 * 5e6 / (1.25 * 1.75)


def meeting(scheme, closing, dt, *, masses=(70.0, 70.0), radii=(0.3, 0.3), side=0.0, spin=(0.0, 0.0)):
    """Return the simulation of two grains that are about to meet."""
    bodies = make_bodies(np.array(radii), np.array(masses))
    gap = 0.01
    start = np.array([[0.0, 0.0], [sum(radii) + gap, 0.0]])
    velocity = np.array([[0.5 * closing, 0.5 * side], [-0.5 * closing, -0.5 * side]])
    state = make_state(start, velocity)
    state.spin[:] = spin
    return Simulation(plain(), bodies, state, physics=Physics(scheme, dt=dt), fields=[None], driving=False)


def collide(scheme, closing, dt, **options):
    """Return the simulation of two grains after they have met and parted, with the deepest overlap and force on the way."""
    simulation = meeting(scheme, closing, dt, **options)
    deepest, strongest, met = 0.0, 0.0, False
    while True:
        simulation.advance()
        contacts = simulation.contacts()
        if len(contacts.gap):
            met = True
            deepest, strongest = max(deepest, -contacts.gap[0]), max(strongest, contacts.impulse[0, 0] / dt)
        elif met:
            return simulation, deepest, strongest


# --------------------------------------------------------------------------------------------------- two bodies, head on


def test_stiffnesses_are_those_of_table_1():
    assert Hertz().normal_stiffness == pytest.approx(3.556e6, rel=1e-3) == KN
    assert Hertz().tangential_stiffness == pytest.approx(4.571e6, rel=1e-3) == KT


@looped("closing", [1.0, 4.0, 0.5, 2.0], quick=2)
def test_an_undamped_collision_is_elastic_and_meets_the_closed_forms(closing):
    simulation, deepest, strongest = collide(ELASTIC, closing, 1e-4)
    velocity = simulation.state.velocity
    assert velocity[1, 0] - velocity[0, 0] == pytest.approx(closing, rel=1e-6)
    reduced, mass = 0.15, 35.0
    expected = (5 * mass * closing**2 / (4 * KN * np.sqrt(reduced))) ** 0.4
    assert deepest == pytest.approx(expected, rel=1e-3)
    assert strongest == pytest.approx(KN * np.sqrt(reduced) * expected**1.5, rel=1e-3)


def test_the_printed_values_of_a_collision_at_2_and_half_a_meter_per_second():
    for closing, overlap, force in ((2.0, 0.0276, 6330.0), (0.5, 0.0091, 1200.0)):
        _, deepest, strongest = collide(ELASTIC, closing, 1e-4)
        assert deepest == pytest.approx(overlap, abs=5e-5)
        assert strongest == pytest.approx(force, rel=5e-3)


@looped(("dt", "error"), [(1e-3, 1e-4), (2e-3, 4e-4), (5e-3, 4e-3)])
def test_the_error_of_an_elastic_collision_is_small_at_the_steps_in_use(dt, error):
    for closing in (0.7, 1.0, 1.9):
        simulation, _, _ = collide(ELASTIC, closing, dt)
        velocity = simulation.state.velocity
        assert abs((velocity[1, 0] - velocity[0, 0]) / closing - 1) < error


def restitution(scheme, closing=1.0):
    simulation = meeting(replace(scheme, social=None), closing, 2e-5)
    (position, velocity), reach = simulation.state[:2], simulation.bodies.radius.sum()
    while position[1, 0] - position[0, 0] < reach or velocity[1, 0] < velocity[0, 0]:
        simulation.advance(n_substeps=50)
    return (velocity[1, 0] - velocity[0, 0]) / closing


def integrated_restitution(damping, closing=1.0, mass=35.0, reduced=0.15):
    """Return the restitution by an independent integrator; ``damping(alpha)`` in N s/m."""

    def rhs(_, y):
        overlap = max(y[0], 0.0)
        alpha = np.sqrt(overlap * reduced)
        return [y[1], -(alpha * KN * overlap + damping(alpha) * y[1]) / mass]

    def parted(_, y):
        return y[0]

    parted.terminal, parted.direction = True, -1
    solution = solve_ivp(rhs, (0, 1), [1e-12, closing], events=parted, rtol=1e-9, atol=1e-13)
    return -solution.y_events[0][0, 1]


@looped(
    ("unit", "stated", "damping"),
    [
        ("rate per length", 0.9994, lambda alpha: alpha * 35 * 0.8),
        ("rate", 0.98, lambda alpha: 35 * 0.8),
        ("critical", 0.003, lambda alpha: 2 * 0.8 * np.sqrt(1.5 * KN * alpha * 35)),
    ],
)
def test_restitution_of_the_three_readings_of_the_damping(unit, stated, damping):
    measured = restitution(Hertz(damping_unit=unit))
    assert measured == pytest.approx(integrated_restitution(damping), abs=2e-3)
    assert measured == pytest.approx(stated, abs=5e-3 if unit == "rate" else 1e-3)


def test_a_wall_is_a_body_that_does_not_move():
    bodies, state = make_bodies([0.3], 70.0), make_state([[0.31, 0.0]], [[-1.0, 0.0]])
    simulation = Simulation(
        half_plane(), bodies, state, physics=Physics(ELASTIC, dt=1e-4), fields=[None], driving=False
    )
    deepest = 0.0
    for _ in range(1000):
        simulation.advance()
        deepest = max(deepest, float(simulation.results.diagnostics.max_outside[0]))
    assert state.velocity[0, 0] == pytest.approx(1.0, rel=1e-6)
    assert deepest == pytest.approx((5 * 70 / (4 * KN * np.sqrt(0.3))) ** 0.4, rel=1e-3)  # R = r, m = m


# ------------------------------------------------------------------------------------------------- friction and rotation


def spun_crowd(scheme, steps=600):
    """Return bodies, state and the largest tangential over normal force seen, per kind of contact."""
    geometry = l_shape()
    bodies, state, _ = crowd_in(np.random.default_rng(21), geometry, 45)
    state.spin[:] = np.random.default_rng(22).normal(0, 6, 45)
    simulation = Simulation(geometry, bodies, state, physics=Physics(scheme, dt=1e-3), fields=[None], driving=False)
    ratio, stuck = {True: 0.0, False: 0.0}, 0
    for _ in range(steps):
        simulation.advance()
        contacts = simulation.contacts()
        for kind in ratio:
            chosen = (contacts.j >= 0) == kind
            normal, tangential = np.abs(contacts.impulse[chosen].T)
            if chosen.any():
                ratio[kind] = max(ratio[kind], float((tangential / normal).max()))
        normal, tangential = np.abs(contacts.impulse.T)
        stuck += int((tangential < 0.08 * normal).sum())
    return ratio, stuck


def test_the_coulomb_limit_is_reached_and_never_exceeded():
    ratio, stuck = spun_crowd(Hertz(friction=0.5, wall_friction=0.1))
    assert ratio[True] == pytest.approx(0.5, abs=1e-9)
    assert ratio[False] == pytest.approx(0.1, abs=1e-9)
    assert stuck > 100  # some do not slide


def total_angular_momentum(bodies, state):
    x, v = state.position, state.velocity
    orbital = (bodies.mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum()
    return orbital + (bodies.inertia * state.spin).sum()


def test_friction_turns_spin_into_motion_and_keeps_linear_momentum():
    simulation, _, _ = collide(BARE, 0.5, 1e-4, spin=(8.0, 8.0))
    state, bodies = simulation.state, simulation.bodies
    assert (state.spin < 7.9).all()  # rubbed down
    assert np.abs(state.velocity[:, 1]).max() > 0.01  # thrown aside
    np.testing.assert_allclose(bodies.mass @ state.velocity, 0.0, atol=1e-10)


@looped("spin", [(8.0, 8.0), (8.0, -3.0), (0.0, 0.0)], quick=2)
def test_angular_momentum_changes_only_by_the_offset_of_the_contact_point(spin):
    # Eq 6 takes the lever arm r, the contact lies at about r - overlap/2: each step makes F_t times the overlap of it.
    radii, masses, dt = (0.28, 0.33), (65.0, 78.0), 1e-4
    bodies = make_bodies(np.array(radii), np.array(masses))
    state = make_state([[0.0, 0.0], [sum(radii) + 0.002, 0.1]], [[0.4, 0.1], [-0.4, -0.2]])
    state.spin[:] = spin
    simulation = Simulation(plain(), bodies, state, physics=Physics(BARE, dt=dt), fields=[None], driving=False)
    before, expected, moved = total_angular_momentum(bodies, state), 0.0, 0.0
    for _ in range(1000):
        simulation.advance()
        contacts = simulation.contacts()
        if len(contacts.gap):
            # torque on both: -(r_i + r_j) F_t by eq 6, +d F_t by the orbits, with d = r_i + r_j + gap
            expected += contacts.gap[0] * contacts.impulse[0, 1]
            moved = max(moved, abs(contacts.impulse[0, 1] / dt))
    assert moved > 50
    assert total_angular_momentum(bodies, state) - before == pytest.approx(expected, abs=2e-4)
    assert abs(expected) > 1e-3


def test_without_rotation_nobody_turns_and_friction_is_stronger():
    for rotation in (True, False):
        scheme = replace(Hertz(), rotation=rotation)
        bodies, state = converging(np.random.default_rng(1), 40)
        Simulation(plain(), bodies, state, physics=scheme, fields=[None], driving=False).advance(n_substeps=1500)
        assert (np.abs(state.spin).max() > 0.1) == rotation
        assert (np.abs(state.angle).max() > 0.01) == rotation


def test_a_disc_held_against_a_wall_by_friction_stays_and_above_the_limit_slides():
    # Pressed on with 1000 N and pulled along with less and with more than mu times that; the spring holds, it does not creep.
    scheme = replace(BARE, wall_friction=0.3, rotation=False, damping_unit="critical")
    ends, gains = [], []
    for pull in (250.0, 350.0):
        bodies, state = make_bodies([0.3], 70.0), make_state([[0.3, 0.0]])
        simulation = Simulation(
            half_plane(), bodies, state, physics=Physics(scheme, dt=1e-3), fields=[None], driving=False
        )
        force = np.array([[-1000.0, 0.0]])
        simulation.advance(external_force=force, n_substeps=2000)
        rested = state.position[0, 1]
        pulled = force + np.array([[0.0, pull]])
        simulation.advance(external_force=pulled, n_substeps=1000)
        speed = state.velocity[0, 1]
        simulation.advance(external_force=pulled, n_substeps=1000)
        ends.append(state.position[0, 1] - rested)
        gains.append(state.velocity[0, 1] - speed)
        contacts = simulation.contacts()
        assert contacts.impulse[0, 0] == pytest.approx(1.0, rel=1e-3)  # N s: 1000 N for a millisecond
        assert abs(contacts.impulse[0, 1]) == pytest.approx(1e-3 * min(pull, 300.0), rel=1e-2)
    alpha = np.sqrt((1000 / (KN * np.sqrt(0.3))) ** (2 / 3) * 0.3)
    assert ends[0] == pytest.approx(250 / (alpha * KT), rel=0.02)  # the elongation that carries the pull
    assert gains[0] == pytest.approx(0.0, abs=1e-9)
    assert gains[1] == pytest.approx(50 / 70, rel=1e-3)  # m/s in a second, by the 50 N beyond the limit


def test_the_spring_of_a_sliding_contact_carries_what_damping_leaves_of_the_limit():
    """By eq 4 spring and damping together give the limit: a disc that is stopped while it slides keeps the spring's part."""
    press, slides, scheme = 1000.0, 1.0, replace(BARE, wall_friction=0.3, rotation=False, damping_unit="rate")
    overlap = (press / (KN * np.sqrt(0.3))) ** (2 / 3)  # at which the wall carries the press
    bodies, state = make_bodies([0.3], 70.0), make_state([[0.3 - overlap, 0.0]], [[0.0, slides]])
    simulation = Simulation(half_plane(), bodies, state, physics=Physics(scheme, dt=1e-5), fields=[None], driving=False)
    rubbing = []
    for velocity in (slides, 0.0):
        state.velocity[0] = 0.0, velocity
        simulation.advance(external_force=np.array([[-press, 0.0]]), n_substeps=1 if velocity == 0.0 else 500)
        rubbing.append(abs(simulation.contacts().impulse[0, 1]) / 1e-5)
    assert rubbing[0] == pytest.approx(0.3 * press, rel=1e-3)
    assert rubbing[1] == pytest.approx(0.3 * press - 70.0 * scheme.tangential_damping * slides, rel=5e-3)


# --------------------------------------------------------------------------------------------------------- social force


def in_file(scheme, gap):
    """Return the social forces [N] along x on two people in file who both want to go to +x, rear one first."""
    bodies = make_bodies([0.3, 0.3], 70.0, desired_speed=1.0, relaxation_time=0.5)
    state = make_state([[0.0, 0.0], [0.6 + gap, 0.0]], [[1.0, 0.0], [1.0, 0.0]])  # at the desired velocity: no drive
    simulation = Simulation(plain(), bodies, state, physics=Physics(scheme, dt=1e-6), fields=[None])
    before = state.velocity.copy()
    simulation.advance(np.tile([1.0, 0.0], (2, 1)), relative=np.zeros(2, bool))
    return bodies.mass * (state.velocity - before)[:, 0] / 1e-6


every_inertial = pytest.mark.parametrize("name", GRAIN_SCHEMES)


@every_inertial
def test_in_file_at_contact_the_rear_is_pushed_by_390_newtons_and_the_front_by_210(name):
    rear, front = in_file(make_scheme(name, social="lin"), 1e-9)
    assert (rear, front) == (pytest.approx(-390.0, rel=1e-4), pytest.approx(210.0, rel=1e-4))


@every_inertial
def test_the_force_of_helbing_is_2000_newtons_from_the_front_and_none_from_behind(name):
    rear, front = in_file(make_scheme(name, social="helbing"), 1e-9)
    assert (rear, front) == (pytest.approx(-2000.0, rel=1e-4), pytest.approx(0.0, abs=0.1))
    rear, front = in_file(make_scheme(name, social="helbing"), 0.16)
    assert (rear, front) == (pytest.approx(-2000.0 * np.exp(-2), rel=1e-3), pytest.approx(0.0, abs=0.1))


@looped("behind", [0.0, 0.3, 1.0])
@looped("angle", [0.0, 1.0, 2.5])
def test_helbings_form_is_equation_12(behind, angle):
    social, gap = SocialForce.helbing(1700.0, 0.07, behind), 0.05
    printed = 1700 * np.exp(-gap / 0.07) * (behind + (1 - behind) * (1 + np.cos(angle)) / 2)
    ours = social.strength * np.exp(-gap / social.length) * (1 + social.anisotropy * np.cos(angle))
    assert ours == pytest.approx(printed, rel=1e-12)


def test_without_inertia_a_social_force_shifts_the_velocity_by_tau_f_over_m():
    bodies = make_bodies([0.3, 0.3], 70.0, desired_speed=1.0, relaxation_time=0.5)
    state = make_state([[0.0, 0.0], [0.8, 0.0]])
    scheme = make_scheme("nsm1", social="lin")
    simulation = Simulation(plain(), bodies, state, physics=Physics(scheme, dt=1e-4), fields=[None])
    simulation.advance(np.tile([1.0, 0.0], (2, 1)), relative=np.zeros(2, bool))
    force = 300 * np.exp(-0.2 / 0.05) * np.array([-1.3, 0.7])
    np.testing.assert_allclose(state.velocity[:, 0], 1.0 + 0.5 * force / 70.0, rtol=1e-6)


def test_beyond_the_cut_off_nobody_is_noticed():
    social = SocialForce(cutoff=0.2)
    assert in_file(Hertz(social=social), 0.1999)[0] == pytest.approx(-390 * np.exp(-0.1999 / 0.05), rel=1e-3)
    np.testing.assert_array_equal(in_file(Hertz(social=social), 0.2001), 0.0)


@looped("share", [0.0, 300.0])
def test_walls_push_only_if_asked_to(share):
    bodies = make_bodies([0.3], 70.0, desired_speed=1.0, relaxation_time=0.5)
    state = make_state([[0.35, 0.0]], [[-1.0, 0.0]])
    scheme = Hertz(social=SocialForce(wall_strength=share))
    simulation = Simulation(half_plane(), bodies, state, physics=Physics(scheme, dt=1e-6), fields=[None])
    simulation.advance(np.array([[-1.0, 0.0]]), relative=np.array([False]))
    force = 70.0 * (state.velocity[0, 0] + 1.0) / 1e-6
    assert force == pytest.approx(share * np.exp(-1) * 1.3, rel=1e-4, abs=1e-6)  # ahead of one: 1 + phi


def test_grains_have_no_social_force():
    bodies = make_bodies([0.3, 0.3], 70.0)
    state = make_state([[0.0, 0.0], [0.601, 0.0]])
    scheme = make_scheme("dem", social="helbing")
    Simulation(plain(), bodies, state, physics=scheme, fields=[None], driving=False).advance(n_substeps=100)
    np.testing.assert_array_equal(state.velocity, 0.0)


@pytest.mark.parametrize("name", SCHEMES)
@looped("social", ["lin", "helbing"])
def test_a_crowd_with_a_social_force_keeps_its_distance_and_gets_out(name, social):
    place = make_scenario("room-v0", people=12)
    bodies, position = place.population.draw(np.random.default_rng(4), place.geometry)
    crushes = []
    for chosen in (social, "none"):
        state = make_state(position)
        scheme = make_scheme(name, social=chosen)
        simulation = Simulation(place.geometry, bodies, state, physics=scheme, fields=[place.field()])
        crush = np.zeros(12)
        for _ in range(30):
            simulation.advance(n_substeps=round(0.1 / simulation.dt))
            crush += simulation.results.impulse_magnitude
        crushes.append(crush.sum())
        assert np.isfinite(state.position).all()
    assert crushes[0] < 0.9 * crushes[1]
    simulation.advance(n_substeps=round(20 / simulation.dt))
    assert np.isfinite(state.exit_time).sum() >= 10 or name == "hertz-literal"


# --------------------------------------------------------------------------------------------------------------- presets


def test_the_presets_say_what_they_are():
    assert SCHEMES["hertz"] == Hertz() and "fitted" in Hertz().info.title
    literal = SCHEMES["hertz-literal"]
    assert literal.info.name == "hertz-literal" and "as printed" in literal.info.title
    assert (literal.wall_friction, literal.social.wall_strength) == (literal.friction, 0.0)
    assert DEM().social is None


# ------------------------------------------------------------------------------------------------------------- the room


def test_people_of_lin_leave_at_about_0_8_a_second():
    # A small crowd for a quick look; `crowd-env reproduce lin` measures the paper's figures.
    place = make_scenario("lin-room-v0", people=60)
    bodies, position = place.population.draw(np.random.default_rng(0), place.geometry)
    simulation = Simulation(place.geometry, bodies, make_state(position), physics="hertz", fields=[place.field()])
    simulation.advance(n_substeps=100_000)
    assert simulation.inside[0] == 0
    assert flow_slope(simulation.state.exit_time) == pytest.approx(0.83, rel=0.15)
