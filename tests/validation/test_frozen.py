"""The case of faster is frozen: the balance of forces that it rests on, and what is made of the draws."""

import numpy as np
import pytest
from cases import looped
from crowds import plain

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.physics import DEM, SocialForce
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from validation.cases.case import Setting
from validation.cases.frozen import SPEEDS, Variant, finding, onset
from validation.tables import MAKERS


@looped("angle", [0.0, 0.2, 0.5])
@looped("neighbors", [6, 4])
def test_who_touches_others_evenly_all_around_is_held_back_by_z_over_2_phi_a(neighbors, angle):
    # Everyone walks at the desired velocity, so that nothing drives; only those who touch are near enough to count.
    around = angle + 2.0 * np.pi / neighbors * np.arange(neighbors)
    position = np.concatenate([[[0.0, 0.0]], 0.5 * np.stack([np.cos(around), np.sin(around)], axis=1)])
    count, social = neighbors + 1, SocialForce(strength=200.0, anisotropy=0.4, cutoff=0.05)
    bodies = make_bodies(np.full(count, 0.25 - 1e-9), np.full(count, 80.0), desired_speed=1.5, relaxation_time=0.5)
    velocity = np.tile([1.5, 0.0], (count, 1))
    simulation = Simulation(
        plain(), bodies, make_state(position, velocity), physics=Physics(DEM(social=social), dt=1e-3)
    )
    simulation.advance(np.tile([1.0, 0.0], (count, 1)), relative=np.zeros(count, bool))
    force = 80.0 * (simulation.state.velocity[0] - velocity[0]) / 1e-3
    np.testing.assert_allclose(force, [-0.5 * neighbors * 0.4 * 200.0, 0.0], atol=1e-4)


def test_the_characteristic_speed_is_that_of_the_paper():
    assert Variant().characteristic_speed == pytest.approx(2 * 0.3 * 300 * 0.5 / 70)
    assert Variant(strength=600.0, anisotropy=0.15).characteristic_speed == pytest.approx(9 / 7)


@looped(
    ("shares", "found"),
    [
        ([0.0, 0.2, 0.8], 1.5),
        ([0.0, 0.5, 1.0], 1.4),
        ([0.5, 0.6, 1.0], 1.2),
        ([0.0, 0.1, 0.4], None),
        ([0.8, 1.0, 1.0], None),
    ],
)
def test_the_onset_is_where_half_of_the_draws_block(shares, found):
    assert onset((1.2, 1.4, 1.6), shares) == (None if found is None else pytest.approx(found))


def test_a_finding_counts_every_draw_and_passes_if_half_block_in_between():
    def found(*counts):
        draws = {times: [k < n for k in range(10)] for times, n in zip(SPEEDS, counts, strict=True)}
        return finding(Setting("hertz", "competitive"), Variant(), 2.0, draws)

    usual = found(2, 8)
    assert usual.passed and usual.more["half block at, m/s"] == pytest.approx(1.3 * 2.0)
    assert usual.more["blocked at 1.2 v*"] == 2
    assert usual.more["blocked at 1.2 v*, most"] == pytest.approx(0.5098, abs=1e-4)  # Wilson, as scipy has it
    never = found(0, 3)
    assert never.passed is False

    class Source:
        def rows(self, case):
            assert case == "frozen"
            return [{"more": usual.more}, {"more": never.more}]

    _, first, second = MAKERS["frozen"](Source())
    assert first[4:] == ["2 of 10 (6 to 51 %)", "8 of 10 (49 to 94 %)", "1.30 v* = 2.60 m/s"]
    assert second[-1] == "–"
