"""Arrays whose memory is used again when nobody holds them any more."""

import sys

import numpy as np
from numpy.typing import DTypeLike

_KEPT = 6
# Of an array that only the list below holds: there, in the loop, and in the call that counts.
_UNHELD = 3


class Recycled:
    """Hands out arrays of one shape that are the caller's for as long as he, or a view of his, holds them.

    The system gives fresh memory page by page as it is first written, which takes longer than to compute what is written: of an
    observation of 5,000 people by ten times.
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> None:
        self._shape, self._dtype = shape, dtype
        self._arrays: list[np.ndarray] = []

    def take(self) -> np.ndarray:
        """Return an array with anything in it."""
        for array in self._arrays:
            if sys.getrefcount(array) == _UNHELD:
                return array
        made = np.empty(self._shape, self._dtype)
        self._arrays = [*self._arrays[1 - _KEPT :], made]
        return made
