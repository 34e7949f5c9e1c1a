"""What every kind of network has: numbers in, numbers out, and named arrays that say all of it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from crowd_env.core.arrays.state import Floats

# Rows at once: larger products are shared out to threads, which costs more than it saves, much more on busy cores.
_AT_ONCE = 60


class Network(ABC):
    """Turns rows of numbers into rows of numbers, each row for itself.

    A kind is a class with a line in `crowd_env.agents.networks.NETWORKS`.  What it holds are its `tensors` and
    `settings`; `of` makes it
    from them again.  It calculates in double precision and rounds at the end: a row comes out the same in a batch of any size.

    Attributes
    ----------
    kind : what its file calls it.
    """

    kind: ClassVar[str]

    @property
    @abstractmethod
    def inputs(self) -> int:
        """How many numbers it takes."""

    @property
    @abstractmethod
    def outputs(self) -> int:
        """How many numbers it returns."""

    @abstractmethod
    def tensors(self) -> dict[str, np.ndarray]:
        """Return its arrays by name; files hold them in single precision."""

    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """Return what the tensors do not say, as JSON can hold it."""

    @classmethod
    @abstractmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Mapping[str, Any]) -> "Network":
        """Return the network of these tensors and settings, which may come from any file.

        Raises
        ------
        ValueError
            If they are others than a network of this kind has, or do not fit one another.
        """

    @abstractmethod
    def forward(self, rows: Floats) -> Floats:
        """Return the outputs (K, O) for inputs (K, I)."""

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Return the outputs (K, O) float32 for inputs (K, I)."""
        out = np.empty((len(rows), self.outputs), dtype=np.float32)
        some = np.asarray(rows).any(axis=1)  # rows of zeros, of people who are out, are all alike
        out[~some] = self.forward(np.zeros((1, self.inputs)))
        where = np.flatnonzero(some)
        for begin in range(0, len(where), _AT_ONCE):
            part = where[begin : begin + _AT_ONCE]
            out[part] = self.forward(np.asarray(rows)[part].astype(np.float64))
        return out
