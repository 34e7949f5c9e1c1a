"""Numbers that go into a page come out again as the documented format says, to half a step."""

import numpy as np
import pytest
from replayed_pages import unpack

from crowd_env.rendering.replay.pack import Column, pack


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("scale", [1.0, 1e3, 2e9])
def test_whole_numbers_come_back_exactly(order: int, scale: float) -> None:
    values = np.rint(scale * np.random.default_rng(0).uniform(-1.0, 1.0, 500))
    about, text = pack([Column("a", values, order=order), Column("b", values[:3])])
    found = unpack(about, text)
    np.testing.assert_array_equal(found["a"], values)
    np.testing.assert_array_equal(found["b"], values[:3])


def test_lengths_come_back_to_half_a_millimeter_wherever_they_lie() -> None:
    x = 5_628_000.0 + np.cumsum(np.random.default_rng(1).normal(0.0, 0.1, 1000))  # as in maps
    about, text = pack([Column("x", x, 1e-3, 2, 5_628_000.0)])
    np.testing.assert_allclose(unpack(about, text)["x"], x, rtol=0, atol=0.5001e-3)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 3e9])
def test_numbers_that_do_not_fit_are_refused(wrong: float) -> None:
    with pytest.raises(ValueError, match="x of a recording has a value that is not finite, or beyond"):
        pack([Column("x", np.array([0.0, wrong]))])


def test_a_steady_walk_takes_less_than_a_byte_a_number() -> None:
    x = np.cumsum(np.full(10_000, 0.131))
    assert len(pack([Column("x", x, 1e-3, 2)])[1]) < len(x)
