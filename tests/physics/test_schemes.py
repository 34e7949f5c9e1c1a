"""Parameters of the schemes: bounds with their formula, and the two extensions of NSM2."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped

from crowd_env import DEM, NSM1, NSM2, SCHEMES, Geometry, Physics, Simulation, make_bodies, make_scheme, make_state

pytestmark = pytest.mark.kernels

HALL = Geometry.from_polygon([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])


@looped(
    ("scheme", "dt", "says"),
    [
        (DEM(), 0.04, r"dt = 0\.04 s is above the stable step of dem, 0\.03162 s .*: 2 / sqrt\(2 k / m_min\)"),
        (NSM1("inertial"), 0.3, r"dt = 0\.3 s is above the stable step of nsm1-inertial, 0\.2 s .*: 2 tau_min"),
        (NSM2(), 0.3, r"dt = 0\.3 s is above the stable step of nsm2, 0\.2 s .*: 2 tau_min"),
    ],
)
def test_a_step_that_is_too_long_names_the_bound_and_its_formula(scheme, dt, says):
    bodies = make_bodies([0.2], [60.0], relaxation_time=0.1)
    with pytest.raises(ValueError, match=says):
        Simulation(HALL, bodies, make_state([[5.0, 5.0]]), physics=Physics(scheme, dt=dt))


@looped("share", [0.25, 0.5, 1.0])
def test_the_position_correction_takes_back_its_share_and_gives_no_velocity(share):
    # Two resting discs overlap by 40 mm: the lighter one gives way more, the center of mass stays.
    bodies = make_bodies([0.2, 0.2], [60.0, 90.0])
    state = make_state([[5.0, 5.0], [5.36, 5.0]])
    scheme = NSM2(position_correction=share, tolerance=1e-10)
    simulation = Simulation(HALL, bodies, state, physics=scheme, driving=False)
    center = bodies.mass @ state.position / bodies.mass.sum()
    start = state.position[0, 0]
    simulation.advance()
    assert state.position[1, 0] - state.position[0, 0] == pytest.approx(0.4 - (1 - share) * 0.04, abs=1e-9)
    assert bodies.mass @ state.position / bodies.mass.sum() == pytest.approx(center, abs=1e-12)
    assert start - state.position[0, 0] == pytest.approx(share * 0.04 * 90 / 150, abs=1e-9)
    assert np.abs(state.velocity).max() < 1e-12
    assert simulation.contacts().impulse == pytest.approx(np.zeros((1, 2)), abs=1e-12)


def test_without_the_correction_a_resting_overlap_stays():
    state = make_state([[5.0, 5.0], [5.36, 5.0]])
    simulation = Simulation(HALL, make_bodies([0.2, 0.2], [60.0, 90.0]), state, physics=NSM2(), driving=False)
    simulation.advance(n_substeps=50)
    assert state.position[1, 0] - state.position[0, 0] == 5.36 - 5.0


@pytest.mark.parametrize("name", SCHEMES)
def test_a_scheme_has_the_name_of_its_entry_whatever_else_is_changed(name):
    assert SCHEMES[name].info.name == name
    for changed in (replace(SCHEMES[name], social="helbing"), make_scheme({"name": name, "social": "none"})):
        assert changed.info.name == name
    for parameter in ("tolerance", "youngs_modulus", "stiffness"):
        if hasattr(SCHEMES[name], parameter):
            assert make_scheme({"name": name, parameter: 0.125}).info.name == name


def test_only_without_inertia_are_impulses_no_forces():
    no_forces = [name for name, scheme in SCHEMES.items() if not scheme.info.impulses_are_forces]
    assert no_forces == ["nsm1", "nsm1-loose"]


@looped("dt", [0.01, 0.05])
def test_a_step_that_is_done_again_with_more_room_looks_up_directions_once(dt):
    # Near a round wall of many edges the lists hold more than they have room for at first.
    angles = np.linspace(0, 2 * np.pi, 1200, endpoint=False)
    place = Geometry.from_polygon(2.0 * np.column_stack([np.cos(angles), np.sin(angles)]))
    bodies = make_bodies([0.2] * 3, [60.0] * 3, desired_speed=1.0)
    state = make_state([[1.79, 0.0], [-1.79, 0.0], [0.0, 1.79]])
    simulation = Simulation(place, bodies, state, physics=Physics("nsm1", dt=dt), fields=[None])
    room = len(simulation.history.contacts.gap)
    simulation.advance(n_substeps=1)
    assert len(simulation.history.contacts.gap) > room and simulation.history.turn.tolist() == [1]
