"""What every case shares: rows, effort, and the CPU time of one function among others."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple


class Row(NamedTuple):
    """One figure."""

    what: str
    value: float
    unit: str


@dataclass(frozen=True)
class Effort:
    """How long to measure.

    Parameters
    ----------
    seconds : CPU time of a block.
    blocks : blocks measured one after the other, of which the fastest counts.
    """

    seconds: float = 1.0
    blocks: int = 3

    def __post_init__(self) -> None:
        if not self.seconds > 0:
            raise ValueError(f"--seconds is {self.seconds}; it must be > 0")
        if self.blocks < 1:
            raise ValueError(f"--blocks is {self.blocks}; it must be at least 1")


class Stopwatch:
    """Adds up the CPU time of the calls of one function.

    >>> watch = Stopwatch(venv, "step_wait")   # from here on, calls of venv.step_wait are timed
    """

    def __init__(self, owner: Any, method: str) -> None:
        self.seconds = 0.0
        self.calls = 0
        self._call: Callable[..., Any] = getattr(owner, method)
        setattr(owner, method, self._timed)

    def _timed(self, *args: Any, **kwargs: Any) -> Any:
        begin = time.process_time()
        try:
            return self._call(*args, **kwargs)
        finally:
            self.seconds += time.process_time() - begin
            self.calls += 1

    def restart(self) -> None:
        """Set the sum back to zero."""
        self.seconds, self.calls = 0.0, 0


def significant(value: float, digits: int = 4) -> float:
    """Round to so many digits: more would pretend."""
    return float(f"{value:.{digits}g}")
