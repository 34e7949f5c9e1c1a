"""People who stand close: pushes, walls and sway are read off right."""

import numpy as np
import pytest

from crowd_env import BALANCES
from validation.cases import CASES, Setting, standing


def test_the_period_of_a_spectrum_is_where_it_is_largest():
    frequency = np.fft.rfftfreq(1000, standing._LOOK)
    power = 1.0 + 20.0 * np.exp(-(((frequency - 0.1) / 0.01) ** 2)) + 1e3 * (frequency > 2.0)
    period, above = standing._peak(frequency, power)
    assert period == pytest.approx(10.0) and above == pytest.approx(21.0, rel=0.01)


def test_schemes_without_a_force_of_the_ground_have_no_row(tmp_path):
    assert list(standing.run(Setting("nsm1", "competitive"))) == []
    CASES["standing"].draw(tmp_path, [])
    assert (tmp_path / "standing.png").stat().st_size > 0


@pytest.mark.nightly
def test_a_wall_bears_nothing_that_a_push_does_not_reach_and_discs_take_it_further_the_closer_they_stand():
    for balance in BALANCES:
        found = standing.queues(Setting("nsm2", "competitive"), balance, 0.5)
        assert all(
            count < standing._QUEUE and force == 0.0 for count, force in zip(found.reached, found.force, strict=True)
        )
        if balance == "none":
            assert found.reached[0] >= 2 and all(np.diff(found.reached) >= 0)
