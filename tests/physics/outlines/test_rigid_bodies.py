"""Bodies of several discs against closed forms: impacts, lever arms, and how they turn into their way."""

import numpy as np
import pytest
from cases import looped
from crowds import half_plane, plain
from outlined_crowds import DISC, DUMBBELL, ELASTIC, LIMP, TORSO, before_a_door, grains

from crowd_env import Hertz, Outline, Physics, Simulation, make_bodies, make_state
from crowd_env.physics import SCHEMES

HARD = Hertz(
    youngs_modulus=5e11, normal_damping=0.0, tangential_damping=0.0, friction=0.0, wall_friction=0.0, social=None
)


def momentum(simulation, about=(0.0, 0.0)):
    """Return linear (2,) and angular momentum about a point."""
    bodies, state = simulation.bodies, simulation.state
    (x, y), (u, v) = (state.position - about).T, state.velocity.T
    return bodies.mass @ state.velocity, (bodies.mass * (x * v - y * u) + bodies.inertia * state.spin).sum()


def energy(simulation):
    """Return the kinetic energy [J], of turning too."""
    bodies, state = simulation.bodies, simulation.state
    return 0.5 * (bodies.mass * (state.velocity**2).sum(axis=1) + bodies.inertia * state.spin**2).sum()


def meet(simulation, limit=5000):
    """Advance until bodies have met and parted; return the first contact, with where its two discs were."""
    first = None
    for _ in range(limit):
        simulation.advance()
        contacts = simulation.contacts()
        if len(contacts.gap) and first is None:
            discs, count = simulation.workspace.discs, len(simulation.outline.discs)
            arms = [
                np.array([discs.x[k], discs.y[k]])
                for k in (contacts.i[0] * count + contacts.disc_i[0], contacts.j[0] * count + contacts.disc_j[0])
                if contacts.j[0] >= 0 or k == contacts.i[0] * count + contacts.disc_i[0]
            ]
            first = contacts.normal[0].copy(), arms
        elif first is not None and not len(contacts.gap):
            return first
    raise AssertionError("they have not met, or not parted")


def _touch(position, angle, outline, scheme):
    simulation = grains(position, angle, outline, scheme=scheme, dt=1e-9)
    simulation.advance()
    return len(simulation.contacts().gap) > 0


def impact(angle, offset, outline=DUMBBELL, scheme=HARD, dt=1e-6):
    """Return two bodies about to run into each other, the second turned by ``angle`` and ``offset`` to the side [m]."""
    apart = 0.17 * outline.shape.reach * 2
    velocity = [[1.5, 0.3], [-0.5, 0.0]]
    gap = apart  # then as near as they can be
    for step in (1e-2, 1e-3, 1e-4):
        while not _touch([[0, 0], [gap, offset]], [0.1, angle], outline, scheme):
            gap -= step
        gap += 0.0 if step == 1e-4 else step
    start = [[0, 0], [gap + 2e-4, offset]]
    return grains(start, [0.1, angle], outline, velocity=velocity, scheme=scheme, dt=dt)


@looped(("angle", "offset"), [(0.3, 0.1), (1.2, -0.15), (2.5, 0.02)])
def test_a_hard_elastic_impact_off_center(angle, offset):
    simulation = impact(angle, offset)
    bodies, state = simulation.bodies, simulation.state
    before = state.copy()
    normal, arms = meet(simulation)
    left = np.array([-normal[1], normal[0]])
    lever = [arm @ left for arm in arms]
    assert min(map(abs, lever)) > 0.01  # both begin to turn
    share = (1.0 / bodies.mass + np.square(lever) / bodies.inertia).sum()
    impulse = -2.0 * (before.velocity[0] - before.velocity[1]) @ normal / share
    for i, sign in ((0, 1.0), (1, -1.0)):
        change = state.velocity[i] - before.velocity[i]
        np.testing.assert_allclose(change, sign * impulse * normal / bodies.mass[i], rtol=5e-3, atol=1e-3)
        turn = state.spin[i] - before.spin[i]
        assert turn == pytest.approx(-sign * lever[i] * impulse / bodies.inertia[i], rel=5e-3)


@looped("outline", [DUMBBELL, LIMP])
def test_what_an_impact_without_friction_keeps(outline):
    simulation, points = impact(0.9, 0.11, outline, ELASTIC, 2e-5), [(0.0, 0.0), (-3.0, 7.0)]
    momenta, before = [momentum(simulation, about) for about in points], energy(simulation)
    meet(simulation, 20000)
    assert np.abs(simulation.state.spin).min() > 0.1
    for about, (linear, angular) in zip(points, momenta, strict=True):
        now = momentum(simulation, about)
        np.testing.assert_allclose(now[0], linear, atol=1e-10)
        assert now[1] == pytest.approx(angular, abs=1e-9)
    assert energy(simulation) == pytest.approx(before, rel=1e-5)


def test_with_friction_angular_momentum_changes_only_by_the_offset_of_the_contact_point():
    # As for discs: the tangential force acts at the radius of the disc, the contact lies half an overlap nearer.
    simulation = impact(0.9, 0.11, LIMP, Hertz(social=None), 2e-5)
    linear, angular = momentum(simulation)
    expected, rubbed = angular, 0.0
    for _ in range(4000):
        simulation.advance()
        contacts = simulation.contacts()
        expected += (contacts.gap * contacts.impulse[:, 1]).sum()
        rubbed += np.abs(contacts.impulse[:, 1]).sum()
    assert rubbed > 1.0
    now = momentum(simulation)
    np.testing.assert_allclose(now[0], linear, atol=1e-10)
    assert now[1] == pytest.approx(expected, abs=1e-6)


@looped("side", [1.0, -1.0])
def test_a_push_at_the_shoulder_turns_a_body_away_from_it(side):
    # Facing +x, the left shoulder at +y; somebody comes from the front.
    simulation = grains([[0, 0], [0.6, 0.2 * side]], [0.0, np.pi], LIMP, velocity=[[0, 0], [-1.0, 0.0]], dt=1e-4)
    simulation.advance(n_substeps=8000)
    assert side * simulation.state.spin[0] > 0.5
    assert simulation.state.velocity[0, 0] < -0.1


def test_a_wall_at_the_shoulder_turns_a_body_along_it():
    # Towards a wall at x = 0, the right shoulder ahead: that one is stopped, the body turns clockwise.
    turned = -0.5
    simulation = grains([[0.3, 0]], np.pi + turned, LIMP, place=half_plane(), velocity=[[-0.5, 0.0]])
    before = energy(simulation)
    spins = []
    for _ in range(6000):
        simulation.advance()
        spins.append(simulation.state.spin[0])
    assert max(np.abs(spins)) > 0.5
    assert spins[np.argmax(np.abs(spins))] > 0.0
    assert energy(simulation) == pytest.approx(before, rel=1e-4)


# ------------------------------------------------------------------------------------------------------ into their way


def turning(outline, angle, *, seconds, dt=1e-3, spin=0.0):
    """Return angles at every step of somebody in the open who wants to walk along +x."""
    bodies = make_bodies([0.17], [80.0], desired_speed=1.0)
    state = make_state([[0.0, 0.0]])
    state.angle[:], state.spin[:] = angle, spin
    simulation = Simulation(plain(), bodies, state, physics=Physics("hertz", dt=dt, outline=outline), fields=[None])
    asked = {"command": np.array([[1.0, 0.0]]), "relative": np.zeros(1, dtype=bool)}
    found = []
    for _ in range(round(seconds / dt)):
        simulation.advance(**asked)
        found.append((state.angle[0], state.spin[0]))
    return np.array(found).T, simulation


@looped("start", [1.0, -2.5, 0.3 + 4 * np.pi])
def test_people_turn_into_their_way_critically_damped(start):
    outline = Outline(TORSO.discs, turning_time=0.3, max_torque=np.inf)
    (angle, _), simulation = turning(outline, start, seconds=1.5)
    time = simulation.dt * np.arange(1, len(angle) + 1) / 0.3
    whole = 2.0 * np.pi * np.round(start / (2.0 * np.pi))
    expected = whole + (start - whole) * (1.0 + time) * np.exp(-time)
    np.testing.assert_allclose(angle, expected, atol=5e-3 * abs(start - whole))
    assert abs(angle[-1] - whole) < 0.05 * abs(start - whole)


@pytest.mark.kernels
def test_the_torque_has_a_limit_and_contacts_can_be_stronger():
    outline = Outline(TORSO.discs, turning_time=0.3, max_torque=5.0)
    (_, spin), simulation = turning(outline, 2.0, seconds=0.1)
    most = 5.0 / simulation.bodies.inertia[0]
    gained = -np.diff(spin, prepend=0.0) / simulation.dt
    assert gained.max() == pytest.approx(most, rel=1e-9)
    assert (gained[:50] > 0.999 * most).all()


def test_without_a_way_people_only_come_to_rest():
    bodies, state = make_bodies([0.17], [80.0], desired_speed=1.0), make_state([[0.0, 0.0]])
    state.angle[:], state.spin[:] = 0.7, 2.0
    simulation = Simulation(plain(), bodies, state, physics=Physics("hertz", outline=TORSO), fields=[None])
    simulation.advance(np.zeros((1, 2)), relative=np.zeros(1, dtype=bool), n_substeps=3000)
    assert state.spin[0] == pytest.approx(0.0, abs=1e-4)
    assert state.angle[0] == pytest.approx(0.7 + 2.0 * 0.45 / 2.0, rel=1e-2)  # spin times 1 / (2 / t)


def test_people_face_their_way_when_they_begin():
    simulation = before_a_door(30)
    simulation.advance()
    facing = np.column_stack([np.cos(simulation.state.angle), np.sin(simulation.state.angle)])
    np.testing.assert_allclose(facing, simulation.history.direction, atol=1e-3)
    assert np.ptp(simulation.state.angle) > 0.5
    given = before_a_door(30)
    given.state.angle[3] = 1.0  # then all angles count as given
    given.advance()
    assert np.abs(np.delete(given.state.angle, 3)).max() < 1e-3
    simulation.restart(0, simulation.bodies, simulation.state.position.copy()[::-1].copy())
    simulation.advance()
    facing = np.column_stack([np.cos(simulation.state.angle), np.sin(simulation.state.angle)])
    np.testing.assert_allclose(facing, simulation.history.direction, atol=1e-3)


# ------------------------------------------------------------------------------------------------------------ one disc


@pytest.mark.parametrize("scheme", ["hertz", "hertz-literal"])
@looped("count", [60, 1100])
@looped("manner", [None, "hurried"])
def test_one_disc_around_the_center_is_a_disc_bit_by_bit(scheme, count, manner):
    runs = [before_a_door(count, scheme=scheme, outline=o, density=5.0, manner=manner) for o in (None, DISC)]
    for simulation in runs:
        simulation.advance(n_substeps=400 if count < 1000 else 60)
    one, other = runs
    assert count > 1000 or one.diagnostics.overlap_count[0] > 60
    np.testing.assert_array_equal(one.bodies.inertia, other.bodies.inertia)
    for name in ("position", "velocity", "spin", "exit_time"):
        np.testing.assert_array_equal(getattr(other.state, name), getattr(one.state, name))
    for name in ("i", "j", "gap", "normal", "impulse"):
        np.testing.assert_array_equal(getattr(other.contacts(), name), getattr(one.contacts(), name))
    np.testing.assert_array_equal(other.results.impulse, one.results.impulse)


# ------------------------------------------------------------------------------------------------------------- refused


@pytest.mark.parametrize("name", [name for name, scheme in SCHEMES.items() if not scheme.turns_bodies])
def test_schemes_that_turn_nobody_refuse_an_outline(name):
    with pytest.raises(
        ValueError, match=f"{name} does not turn bodies.*'torso'; schemes that can: hertz, hertz-literal"
    ):
        before_a_door(30, scheme=name)
    before_a_door(30, scheme=name, outline="disc")


def test_a_scheme_whose_turning_is_switched_off_refuses_an_outline():
    with pytest.raises(ValueError, match="hertz with rotation=False does not turn bodies"):
        before_a_door(30, scheme=Hertz(rotation=False))


def test_the_stable_step_is_shorter_with_several_discs():
    limit = SCHEMES["hertz"].stable_dt(before_a_door(30).bodies)
    before_a_door(30, outline=None, dt=0.9 * limit)
    before_a_door(30, outline=DISC, dt=0.9 * limit)
    with pytest.raises(ValueError, match=r"above the stable step of hertz.*less with several discs a body"):
        before_a_door(30, dt=0.9 * limit)
