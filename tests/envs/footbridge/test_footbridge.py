"""The deck that sways: closed forms, scipy beside our integrator, and what a crowd notices of it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.envs.footbridge.crossing import COUPLINGS, Footbridge
from crowd_env.envs.footbridge.deck import Deck, order_parameter
from crowd_env.envs.footbridge.gait import step_frequency, walking_speed
from crowd_env.envs.footbridge.pendulum import Pendulum, advance_pendulum, start_walking
from crowd_env.envs.footbridge.synchrony import SPREAD, Synchrony, advance_synchrony, normal_density
from crowd_env.envs.footbridge.walkers import come_round
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.physics.simulation.simulation import Simulation

DECK = Deck()


def by_scipy(coupling, omega, psi, start, duration):
    """Integrate the equations as they are printed: amplitude, phase of the deck, and phases."""

    def rates(_, y):
        x, v, theta = y[0], y[1], y[2:]
        amplitude, phase = np.hypot(x, v / DECK.frequency), np.arctan2(x, v / DECK.frequency)
        force = coupling.force * (psi * np.sin(theta)).sum()
        pulled = omega + coupling.sensitivity * amplitude * psi * np.sin(phase - theta + coupling.lag)
        return np.concatenate([[v, (force - DECK.damping * v - DECK.stiffness * x) / DECK.mass], pulled])

    return solve_ivp(rates, (0.0, duration), start, method="DOP853", rtol=1e-11, atol=1e-14).y[:, -1]


def walkers(people, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(DECK.frequency, SPREAD, people), rng.uniform(0.0, 2.0 * np.pi, people), rng.random(people)


def test_the_north_span_has_the_numbers_of_2005():
    assert DECK.frequency == pytest.approx(6.47, abs=0.005)
    assert DECK.damping_ratio == pytest.approx(0.0075, abs=5e-5)
    assert Synchrony().threshold(DECK, normal_density(SPREAD)) == pytest.approx(149.0, abs=0.5)
    assert DECK.shape([-1.0, 0.0, 40.5, 81.0, 90.0]) == pytest.approx([0.0, 0.0, 1.0, 0.0, 0.0])


def test_scipy_finds_the_same_motion_of_all_at_mid_span():
    omega, theta, _ = walkers(60)
    psi, coupling, start = np.ones(60), Synchrony(), (np.array(0.02), np.array(0.05), np.exp(1j * theta))
    x, v, turn = advance_synchrony(DECK, coupling, omega, psi, start, 0.005, 6000)
    there = by_scipy(coupling, omega, psi, np.concatenate([[0.02, 0.05], theta]), 30.0)
    assert [float(x), float(v)] == pytest.approx(there[:2].tolist(), abs=2e-7)
    assert np.abs(turn - np.exp(1j * there[2:])).max() < 1e-5 and np.abs(np.abs(turn) - 1.0).max() < 1e-9


@pytest.mark.parametrize("lag", [0.5 * np.pi, 0.7])
def test_the_integrator_is_of_fourth_order(lag):
    omega, theta, psi = walkers(8, seed=1)
    coupling = Synchrony(force=3e4, lag=lag)  # as if each were a thousand: the deck is driven hard
    there = by_scipy(coupling, omega, psi, np.concatenate([[0.01, 0.0], theta]), 4.0)
    errors = []
    for steps in (80, 160, 320):
        start = (np.array(0.01), np.array(0.0), np.exp(1j * theta))
        x, _, turn = advance_synchrony(DECK, coupling, omega, psi, start, 4.0 / steps, steps)
        errors.append(max(abs(float(x) - there[0]), np.abs(turn - np.exp(1j * there[2:])).max()))
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([4.0, 4.0], abs=0.25)


def test_a_deck_alone_dies_away_as_its_damping_says():
    start = (np.array(0.05), np.array(0.0), np.ones(1, dtype=complex))
    x, v, _ = advance_synchrony(DECK, Synchrony(), np.zeros(1), np.zeros(1), start, 0.05, 2000)
    decay = np.log(0.05 / float(DECK.amplitude(x, v))) / 100.0
    assert decay == pytest.approx(DECK.damping / (2.0 * DECK.mass), rel=0.01)


@pytest.mark.parametrize("people", [20, 60, 130])
def test_pendulums_feed_the_deck_as_the_closed_form_says(people):
    coupling, step = Pendulum(), 0.5 / (0.9 * 28)
    rng = np.random.default_rng(3)
    feet, (_, v, y, y_rate) = start_walking(coupling, np.full(people, 0.9), step, rng)
    state = (np.array(0.5), v, y, y_rate)  # so large that the steps themselves do not count
    psi, logs = np.linspace(0.6, 1.0, people), []
    for _ in range(40):
        state = advance_pendulum(DECK, coupling, feet, psi, state, step, 28)
        logs.append(np.log(float(DECK.amplitude(*state[:2]))))
    growth = np.polyfit(28 * step * np.arange(20), logs[20:], 1)[0]
    damping = DECK.damping + (psi**2).sum() * coupling.damping_per_walker(DECK.frequency)
    assert growth == pytest.approx(-damping / (2.0 * DECK.mass), abs=0.002)
    assert (growth > 0.0) == (people > 90)
    assert 50 < coupling.critical_number(DECK) < 60


def test_a_steady_gait_is_steady_on_a_deck_at_rest():
    coupling, step = Pendulum(), 0.02
    feet, start = start_walking(coupling, np.full(9, 0.9), step, np.random.default_rng(0))
    before, foot = feet.phase(), feet.foot.copy()
    end = advance_pendulum(DECK, coupling, feet, np.zeros(9), start, step, 2 * int(feet.steps[0]))
    assert end[2] == pytest.approx(start[2], abs=1e-6) and feet.foot == pytest.approx(foot, abs=1e-6)
    assert np.exp(1j * feet.phase()) == pytest.approx(np.exp(1j * before))


def test_speed_and_steps_are_inverse():
    speed = np.array([0.0, 0.3, 1.34, 1.61, 2.5, 4.0])
    assert walking_speed(step_frequency(speed)) == pytest.approx(speed, abs=1e-9)
    assert float(step_frequency(np.array(1.61))) == pytest.approx(2.06, abs=0.005)


def test_order_counts_those_who_count():
    phase = np.array([0.0, 0.0, np.pi])
    assert float(order_parameter(phase)) == pytest.approx(1.0 / 3.0)
    assert float(order_parameter(phase, np.array([1.0, 1.0, 0.0]))) == pytest.approx(1.0)
    assert float(order_parameter(phase, np.zeros(3))) == 0.0


def on_deck(people=30):
    """Return a crowd in rows of three at mid-span."""
    k = np.arange(people)
    rng = np.random.default_rng(0)
    bodies = make_bodies(np.full(people, 0.2), np.full(people, 80.0), desired_speed=rng.uniform(1.2, 2.0, people))
    start = make_state(np.column_stack([30.0 + 0.6 * (k // 3), 1.0 + k % 3]))
    place = Geometry.from_polygon(box(-1.0, 0.0, 87.0, 4.0))
    return Simulation(place, bodies, start, physics="dem", walking="hurried")


def walked(bridge, calls=60):
    for _ in range(calls):
        bridge.advance(world=True)
    return bridge.simulation.state.position


def test_without_a_coupling_no_bit_changes():
    alone = on_deck()
    for _ in range(60):
        alone.advance(relative=np.zeros(30, dtype=np.bool_), n_substeps=10)
    for coupling in ("off", "pendulum"):
        bridge = Footbridge(on_deck(), coupling)
        assert (walked(bridge) == alone.state.position).all(), coupling
        assert (bridge.amplitude > 0.0) == (coupling != "off")
    assert not (walked(Footbridge(on_deck(), Synchrony(sensitivity=1e3))) == alone.state.position).all()


def test_a_shaken_crowd_falls_into_one_pace():
    bridge = Footbridge(on_deck(), Synchrony(force=3e3))
    walked(bridge, 300)
    assert bridge.order > 0.8 and bridge.amplitude > 0.02
    strides = np.pi * step_frequency(bridge._pace * bridge.simulation.bodies.desired_speed)
    assert strides.mean() == pytest.approx(DECK.frequency, abs=0.3) and strides.std() < 0.5 * bridge.omega.std()


def test_who_passes_the_end_comes_round_where_there_is_room():
    simulation = on_deck(4)
    position = simulation.state.position
    position[:] = [(81.5, 1.0), (81.5, 2.0), (0.6, 2.1), (40.0, 1.0)]
    assert come_round(simulation, 81.0, 81.0).tolist() == [True, False, False, False]
    assert position[:, 0] == pytest.approx([0.5, 81.5, 0.6, 40.0])


@pytest.mark.parametrize("gap", [-0.1, -0.01, 0.01])
def test_nobody_comes_round_into_another(gap):
    simulation = on_deck(2)
    position, apart = simulation.state.position, 2.0 * 0.2 + gap
    position[:] = [(82.0, 2.0), (1.0 + apart, 2.0)]
    assert come_round(simulation, 81.0, 81.0).tolist() == [gap > 0.0, False]
    assert (np.hypot(*(position[0] - position[1])) < apart + 1e-9) == (gap > 0.0)


def test_who_has_left_the_place_loads_the_deck_no_more():
    """An exit at mid-span: the last places of pedestrians that have left are on the deck."""
    place = Geometry.from_polygon(box(30.0, 0.0, 40.0, 4.0), exits={"stairs": [(40.0, 0.0), (40.0, 4.0)]})
    bodies = make_bodies(np.full(2, 0.2), np.full(2, 80.0), desired_speed=np.array([1.5, 0.0]))
    bridge = Footbridge(Simulation(place, bodies, make_state([(39.0, 1.0), (35.0, 3.0)]), physics="dem"))
    walked(bridge, 20)
    state = bridge.simulation.state
    assert state.active.tolist() == [False, True] and DECK.shape(state.position[:, 0]).min() > 0.9
    assert bridge.psi == pytest.approx([0.0, np.sin(np.pi * 35.0 / DECK.length)], abs=1e-6)
    assert bridge.order == pytest.approx(1.0)  # of the one that is there


def test_mistakes_are_said():
    with pytest.raises(ValueError, match="unknown coupling 'glue'; known: synchrony, pendulum, off"):
        Footbridge(on_deck(), "glue")
    with pytest.raises(ValueError, match=r"n_substeps: 0.5 s; at most 0.4 s"):
        Footbridge(on_deck()).advance(n_substeps=50)
    with pytest.raises(ValueError, match=r"0.01 s; .* pendulums multiples of 0.02 s"):
        Footbridge(on_deck(), "pendulum").advance(n_substeps=1)
    with pytest.raises(ValueError, match="mass"):
        Deck(mass=0.0)
    with pytest.raises(ValueError, match="force"):
        Synchrony(force=-1.0)
    assert list(COUPLINGS) == ["synchrony", "pendulum", "off"]
