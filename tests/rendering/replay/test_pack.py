"""Numbers that go into a page come out again as the documented format says."""

import numpy as np
import pytest
from replayed_pages import unpack

from crowd_env.rendering.replay.page import pack


def test_numbers_come_back_whole_or_to_half_a_step_wherever_they_lie() -> None:
    rng = np.random.default_rng(0)
    whole, real = rng.integers(-(2**31), 2**31, 500), rng.normal(0.0, 1e3, 500)
    walk, far = 30.0 + np.cumsum(rng.normal(0.0, 0.1, 500)), np.array([-400.0, 0.0, 400.0])
    about, text = pack({"whole": whole, "real": real, "x": walk, "y": far})
    found = unpack(about, text)
    np.testing.assert_array_equal(found["whole"], whole)
    np.testing.assert_allclose(found["real"], real, rtol=1e-7)
    np.testing.assert_allclose(found["x"], walk, rtol=0, atol=0.5001 * about[2]["step"])
    np.testing.assert_allclose(found["y"], far, rtol=0, atol=0.51 * 400.0 / 32767)
    with pytest.raises(ValueError, match="x of a recording has a value that is not finite"):
        pack({"x": np.array([0.0, np.nan])})


def test_a_steady_walk_takes_less_than_a_byte_a_number() -> None:
    x = np.cumsum(np.full(10_000, 0.131)) % 30.0
    assert len(pack({"x": x})[1]) < len(x)
