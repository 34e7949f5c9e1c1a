"""What tests of the files and the command of clogging share."""

import numpy as np
import pytest

needs_powerlaw = pytest.mark.skipif(
    __import__("importlib.util").util.find_spec("powerlaw") is None, reason="powerlaw is not installed"
)


def pareto(alpha, count, seed, x_min=0.7):
    """Gaps with p(gap) = (alpha - 1) / x_min (gap / x_min)^-alpha, by inversion."""
    return x_min * np.random.default_rng(seed).uniform(size=count) ** (-1.0 / (alpha - 1.0))
