"""Grains under gravity: collision laws, weights, free fall, Beverloo's law, arches."""

import numpy as np
import pytest

from crowd_env.geometry.geometry import Geometry, box
from crowd_env.reproduce.granular import cradle, stack
from crowd_env.reproduce.granular.grains import DIAMETER, INELASTIC, MASS, RADIUS, RIGID, passive, sand, weight
from crowd_env.reproduce.granular.silo import WIDTHS, beverloo, discharge, flows

GRAVITY = 9.81


def law(name):
    return next(one for one in cradle.LAWS if one.name == name)


@pytest.mark.parametrize("name", ["nsm1", "nsm2, e = 1", "nsm2, e = 0.9", "nsm2, e = 0"])
def test_rigid_balls_of_a_cradle_leave_as_the_closed_forms_say(name):
    one = law(name)
    for balls in (2, 5):
        for how, gap in cradle.GAPS.items():
            _, u = cradle.after(one, balls, gap)
            assert u[-1] == pytest.approx(one.last(balls, how), abs=1e-6), (how, balls)
            assert u.sum() == pytest.approx(1.0, abs=1e-8)  # momentum
            if one.e in (0.0, 1.0):
                assert u @ u == pytest.approx(1.0 if one.e else 1.0 / balls, abs=1e-6)


@pytest.mark.parametrize("name", ["dem", "hertz, undamped"])
def test_soft_balls_of_a_cradle_move_as_their_springs_say(name):
    integrate = pytest.importorskip("scipy.integrate")
    one, balls = law(name), 4
    if name == "dem":
        stiffness, power = one.scheme.stiffness, 1.0
    else:
        stiffness, power = one.scheme.normal_stiffness * np.sqrt(RADIUS / 2.0), 1.5

    def motion(_, state):
        x, u = np.split(state, 2)
        push = stiffness * np.maximum(0.0, DIAMETER - np.diff(x)) ** power
        return np.concatenate([u, (np.append(0.0, push) - np.append(push, 0.0)) / MASS])

    start = DIAMETER * np.arange(balls)
    solved = integrate.solve_ivp(motion, (0.0, 1.0), [*start, 1.0, *[0.0] * (balls - 1)], rtol=1e-9, atol=1e-12)
    touching, apart = (cradle.after(one, balls, gap)[1] for gap in cradle.GAPS.values())
    assert touching == pytest.approx(solved.y[balls:, -1], abs=1e-3)
    assert touching @ touching == pytest.approx(1.0, abs=1e-4)
    assert apart == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-4)


@pytest.mark.parametrize("scheme", [RIGID, INELASTIC, sand(0.5), cradle.LAWS[0].scheme], ids=lambda s: s.info.name)
def test_grains_fall_freely(scheme):
    room = Geometry.from_polygon(box(-5.0, -20.0, 5.0, 5.0))
    simulation = passive(room, np.full(2, RADIUS), np.array([[0.0, 0.0], [2.0, 1.0]]), scheme, 1e-3)
    simulation.advance(n_substeps=500, external_force=weight(simulation.bodies, GRAVITY))
    state = simulation.state
    assert state.velocity[:, 1] == pytest.approx(-0.5 * GRAVITY, rel=1e-9) and (state.velocity[:, 0] == 0.0).all()
    # The integrators of first order are off by g h t / 2.
    assert state.position[:, 1] == pytest.approx(np.array([0.0, 1.0]) - 0.125 * GRAVITY, abs=0.26e-3 * GRAVITY)


@pytest.mark.parametrize("name", ["nsm1", "nsm2", pytest.param("hertz", marks=pytest.mark.more)])
def test_a_stack_at_rest_bears_its_weight_and_stays(name):
    n, (scheme, dt) = 6, stack.SCHEMES[name]
    for how, wide in stack.SHAFTS.items():
        found = stack.rest(scheme, dt, n, wide * DIAMETER, GRAVITY, duration=3.0)
        above, beside = stack.closed_form(n, wide * DIAMETER, GRAVITY)
        rigid = name != "hertz"  # which sags
        assert found.vertical == pytest.approx(above, rel=1e-6 if rigid else 1e-2), how
        assert found.wall == pytest.approx(beside, rel=2e-3 if rigid else 0.1, abs=1e-6 * MASS), how
        assert found.speed < (1e-6 if rigid else 0.02), how
        if rigid:
            assert found.drift < 0.003, how
        elif how == "straight":  # F = k_n sqrt(R) overlap^(3/2), R = r at the floor and r / 2 between discs
            radius = np.where(np.arange(n), RADIUS / 2.0, RADIUS)
            sag = ((above / (scheme.normal_stiffness * np.sqrt(radius))) ** (2.0 / 3.0)).sum()
            assert found.position[-1, 1] == pytest.approx(RADIUS + (n - 1) * DIAMETER - sag, abs=0.02 * sag)


@pytest.mark.more
def test_dem_keeps_the_energy_of_a_stack_that_bounces():
    scheme, dt = stack.SCHEMES["dem"]
    found = stack.rest(scheme, dt, 6, DIAMETER, GRAVITY, duration=3.0)
    assert found.energy < 2e-3 and found.vertical == pytest.approx(stack.closed_form(6, DIAMETER, GRAVITY)[0], rel=0.03)


def test_the_fit_finds_the_law_it_is_given():
    pytest.importorskip("scipy")
    width = np.repeat(WIDTHS, 3)
    noise = np.exp(np.random.default_rng(1).normal(0.0, 0.01, len(width)))
    fit = beverloo(width, 1.2 * (width - 1.3) ** 1.5 * noise)
    assert fit.ci95[0] < 1.5 < fit.ci95[1] and abs(fit.exponent - 1.5) < 0.2
    assert fit.offset == pytest.approx(1.3, abs=0.1) and fit.factor == pytest.approx(1.2, rel=0.05)


@pytest.mark.more
def test_a_small_silo_obeys_beverloos_law():
    width = np.array([3.0, 4.5, 7.0])
    flow = [flows(discharge(RIGID, 5e-3, [0], 300, 16.0, w, GRAVITY, count=121).exit_time, 20, 120)[0] for w in width]
    exponent = np.polyfit(np.log(width - 1.0), np.log(flow), 1)[0]
    assert 1.3 < exponent < 1.7


@pytest.mark.more
def test_grains_that_rub_arch_over_an_outlet_that_lets_others_out():
    rough, smooth = (discharge(sand(mu), 1e-3, [0, 1], 100, 12.0, 2.0, GRAVITY, 1.0) for mu in (0.5, 0.0))
    assert all(rough.jammed) and np.isfinite(smooth.exit_time).sum() > np.isfinite(rough.exit_time).sum()
    # One filling is out long before another jams: the clock of an empty hopper stands still.
    wide = discharge(sand(0.5), 1e-3, range(4), 100, 12.0, 3.0, GRAVITY, 1.0)
    assert wide.jammed == [False, True, True, True] and wide.simulation.state.time.max() < 30.0
    assert not rough.simulation.escaped.any() and not smooth.simulation.escaped.any()
