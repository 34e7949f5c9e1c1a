"""Plain data that stand for objects, in Python as in a scenario file; pydantic is loaded when some are given."""

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import number, refuse
from crowd_env.scenarios.distributions import Distribution
from crowd_env.scenarios.file.errors import validate


def as_distribution(where: str, name: str, value: Any) -> Distribution:
    """Return a distribution, or the one that plain data describe: a number, a pair, or a table as in a scenario file.

    Raises
    ------
    ValueError
        If it is neither, or a bound is not finite.
    """
    if isinstance(value, Real | list | tuple | Mapping):
        from crowd_env.scenarios.file.values import distribution_adapter  # loads pydantic

        plain: Distribution = validate(distribution_adapter, value, where, name)
        return plain
    what = f"{where}: {name}"
    if isinstance(value, type) or not all(hasattr(value, part) for part in ("low", "high", "sample")):
        allowed = "a number, a pair (low, high), a table of a scenario file or a distribution: Uniform(low, high)"
        refuse(what, value, allowed)
    for bound in ("low", "high"):
        number(f"{what}.{bound}", getattr(value, bound))
    return value


def as_positions(starts: Any, count: int = 0) -> Floats:
    """Return a copy of recorded starts (K, 2) [m] as kernels want it; tables in a list stand for grids, as in a scenario file.

    Raises
    ------
    ValueError
        If they cannot be positions, or are fewer than ``count``.
    """
    if isinstance(starts, list | tuple) and any(isinstance(one, Mapping) for one in starts):
        from crowd_env.scenarios.file.plan import positions_adapter  # loads pydantic

        starts = validate(positions_adapter, list(starts), "population", "starts")
    try:
        positions = np.array(starts, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ValueError(f"starts must be numbers, one (x, y) [m] a row: {error}") from None
    if positions.ndim != 2 or positions.shape[1] != 2 or len(positions) < count:
        raise ValueError(f"starts must have the shape ({count}, 2), not {positions.shape}, or more rows to draw from")
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(bad):
        raise ValueError(f"start {bad[0]} is {positions[bad[0]].tolist()}; it must be finite")
    return positions
