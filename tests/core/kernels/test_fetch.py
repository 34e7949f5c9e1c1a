"""Memory that is asked for early: nothing else happens."""

import numpy as np
import pytest

from crowd_env.core.kernels.fetch import fetch
from crowd_env.core.kernels.jit import kernel


@kernel
def add_up(numbers):
    total = 0.0
    for k in range(len(numbers)):
        fetch(numbers, k + 8)
        total += numbers[k, 0]
    return total


@pytest.mark.kernels
def test_what_is_fetched_need_not_exist_and_changes_nothing():
    numbers = np.arange(20.0).reshape(10, 2)
    assert add_up(numbers) == 90.0
    np.testing.assert_array_equal(numbers, np.arange(20.0).reshape(10, 2))
    assert add_up(numbers[:0]) == 0.0
