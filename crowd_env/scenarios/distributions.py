"""Distributions of body parameters, all with bounds: the range of a crowd is known beforehand."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Protocol, runtime_checkable

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import NotNegative, Positive, at, check_fields, from_table, known, number, refuse

_LEAST_SHARE = 0.01  # of the draws has to lie within the bounds: a draw outside is repeated


@runtime_checkable
class Distribution(Protocol):
    """A distribution of a body parameter; ``low`` and ``high`` bound every draw."""

    @property
    def low(self) -> float:
        """Smallest possible value."""
        ...

    @property
    def high(self) -> float:
        """Largest possible value."""
        ...

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw ``count`` values."""
        ...


@dataclass(frozen=True)
class Uniform:
    """Uniform distribution on [low, high]; equal bounds give a constant."""

    low: float
    """the smallest possible value."""
    high: float
    """the largest possible value."""

    def __post_init__(self) -> None:
        check_fields("uniform distribution", self)
        if not self.low <= self.high:
            raise ValueError(f"uniform distribution from {self.low:g} to {self.high:g}: the first must not be larger")

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw ``count`` values."""
        return rng.uniform(self.low, self.high, count)


@dataclass(frozen=True)
class Normal:
    """Normal distribution; values outside [low, high] are drawn again."""

    mean: float
    """the mean before values outside the bounds are drawn again."""
    sd: NotNegative
    """the standard deviation before values outside the bounds are drawn again."""
    low: float
    """the smallest possible value."""
    high: float
    """the largest possible value."""

    def __post_init__(self) -> None:
        check_fields("normal distribution", self)
        if not (self.low <= self.mean <= self.high and self.low < self.high):
            raise ValueError(
                f"normal distribution with mean {self.mean:g}: the mean must lie in [{self.low:g}, {self.high:g}]"
            )
        if self.sd > 0:
            _require_share("normal", self.low, self.high, *((x - self.mean) / self.sd for x in (self.low, self.high)))

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw ``count`` values."""
        return _within(self.low, self.high, lambda many: rng.normal(self.mean, self.sd, many), count)


@dataclass(frozen=True)
class LogNormal:
    """Log-normal distribution, the usual one for response times; values outside [low, high] are drawn again."""

    median: Positive
    """the median before values outside the bounds are drawn again."""
    sigma: NotNegative
    """the standard deviation of the logarithm: about two thirds of all values lie between ``median / exp(sigma)`` and ``median
    * exp(sigma)``."""
    high: float
    """the largest possible value."""
    low: NotNegative = 0.0
    """the smallest possible value."""

    def __post_init__(self) -> None:
        check_fields("log-normal distribution", self)
        if not (self.low <= self.median <= self.high and self.low < self.high):
            raise ValueError(
                f"log-normal distribution with median {self.median:g}: it must lie in [{self.low:g}, {self.high:g}]"
            )
        if self.sigma > 0:
            ends = (-math.inf if x == 0 else math.log(x / self.median) / self.sigma for x in (self.low, self.high))
            _require_share("log-normal", self.low, self.high, *ends)

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw ``count`` values."""
        return _within(self.low, self.high, lambda k: self.median * np.exp(self.sigma * rng.standard_normal(k)), count)


def _within(low: float, high: float, draw: Callable[[int], Floats], count: int) -> Floats:
    """Draw ``count`` values; repeat draws outside the bounds."""
    values = draw(count)
    while (bad := (values < low) | (values > high)).any():
        values[bad] = draw(int(bad.sum()))
    return values


def _require_share(kind: str, low: float, high: float, from_sd: float, to_sd: float) -> None:
    """Raise ValueError if less than `_LEAST_SHARE` lies between two bounds, given in standard deviations from the mean."""
    share = 0.5 * (math.erf(to_sd / math.sqrt(2.0)) - math.erf(from_sd / math.sqrt(2.0)))
    if share < _LEAST_SHARE:
        raise ValueError(f"{kind} distribution: only {share:.2g} of it lies in [{low:g}, {high:g}]; set wider bounds")


# Name of each distribution in a table.
LAWS: dict[str, type[Uniform] | type[Normal] | type[LogNormal]] = {
    "uniform": Uniform,
    "normal": Normal,
    "lognormal": LogNormal,
}


def as_distribution(what: str, value: Any) -> Distribution:
    """Return a distribution, or the one that plain data describe: a number, a pair, or a table with the key "distribution".

    Raises
    ------
    ValueError
        If it is none of them, or a bound is not finite.
    """
    if isinstance(value, Real):
        return Uniform(number(what, value), float(value))
    if isinstance(value, list | tuple) and len(value) == 2:
        low, high = (number(f"{what}[{k}]", bound) for k, bound in enumerate(value))
        with at(what):
            return Uniform(low, high)
    if isinstance(value, Mapping):
        law = LAWS[known("distribution", value.get("distribution"), LAWS, f"{what}: ")]
        with at(what):
            return from_table(what, law, {key: one for key, one in value.items() if key != "distribution"})
    if isinstance(value, type) or not isinstance(value, Distribution):
        refuse(
            what, value, "a number, a pair (low, high), a distribution such as Uniform(low, high), or a table of one"
        )
    for bound in ("low", "high"):
        number(f"{what}.{bound}", getattr(value, bound))
    return value
