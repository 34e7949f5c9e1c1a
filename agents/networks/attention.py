"""Attention of a person over the neighbors that are observed: no matter how many they are, nor in which order."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from crowd_env.core.arrays.state import Floats

from .mlp import MLP
from .network import Network

_PARTS = ("query", "token", "out")
NEIGHBOR = 5  # columns of a neighbor in the term "neighbors"


@dataclass(frozen=True, eq=False)
class Attention(Network):
    """One head of attention (Vaswani et al. 2017), then layers of tanh units over what is one's own and what was attended to.

    Parameters
    ----------
    query : from the own columns to a query (H,).
    token : from the columns of a neighbor to a key and a value (2 H,); 5 of the term ``neighbors``, and 1 of ``lead`` if that
        is observed.
    out : from the own columns and the attended value to the outputs.
    neighbors : first column of the term ``neighbors``.
    lead : first column of the term ``lead``; None = not observed.
    count : how many neighbors are observed.

    Raises
    ------
    ValueError
        If the parts do not fit one another.
    """

    kind: ClassVar[str] = "attention"
    query: MLP
    token: MLP
    out: MLP
    neighbors: int
    lead: int | None
    count: int

    def __post_init__(self) -> None:
        hidden, own = self.query.outputs, self.query.inputs
        wanted = (NEIGHBOR + (self.lead is not None), 2 * hidden, own + hidden)
        if (self.token.inputs, self.token.outputs, self.out.inputs) != wanted:
            raise ValueError(
                f"its token turns {self.token.inputs} numbers into {self.token.outputs} and its end takes {self.out.inputs}; "
                f"the query and the terms observed want {wanted[0]}, {wanted[1]} and {wanted[2]}"
            )
        columns = self._columns
        if self.count < 1 or not all(0 <= column < self.inputs for column in columns):
            raise ValueError(f"its {self.count} neighbors do not lie within its {self.inputs} inputs")
        if len(np.unique(columns)) < len(columns):
            raise ValueError("its columns of neighbors and lead overlap")

    @property
    def _columns(self) -> list[int]:
        """The columns that are about neighbors."""
        columns = [*range(self.neighbors, self.neighbors + NEIGHBOR * self.count)]
        return columns if self.lead is None else [*columns, *range(self.lead, self.lead + self.count)]

    @property
    def inputs(self) -> int:
        """How many numbers it takes."""
        return self.query.inputs + self.count * self.token.inputs

    @property
    def outputs(self) -> int:
        """How many numbers it returns."""
        return self.out.outputs

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the tensors of its parts: ``query.weight0``, ..."""
        return {f"{part}.{name}": array for part in _PARTS for name, array in getattr(self, part).tensors().items()}

    def settings(self) -> dict[str, Any]:
        """Return the settings of its parts and where the neighbors are."""
        return {**self.query.settings(), "neighbors": self.neighbors, "lead": self.lead, "count": self.count}

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Mapping[str, Any]) -> "Attention":
        """Return the network of these tensors; see `Network.of`."""
        where = {name: settings.get(name) for name in ("neighbors", "lead", "count")}
        if any(type(value) is not int for name, value in where.items() if name != "lead" or value is not None):
            raise ValueError(f"its settings {dict(settings)} do not say where the neighbors are")
        rest = {name: value for name, value in settings.items() if name not in where}
        found: dict[str, dict[str, np.ndarray]] = {part: {} for part in _PARTS}
        for name, array in tensors.items():
            part, _, own = name.partition(".")
            if part not in found:
                raise ValueError(f"its tensor {name!r} is of none of the parts {', '.join(_PARTS)}")
            found[part][own] = array
        parts = {part: MLP.of(own, rest) for part, own in found.items()}
        return cls(**parts, **where)  # type: ignore[arg-type]

    def forward(self, rows: Floats) -> Floats:
        """Return the outputs (K, O) for inputs (K, I)."""
        own = np.delete(rows, self._columns, axis=1)
        others = rows[:, self.neighbors : self.neighbors + NEIGHBOR * self.count].reshape(-1, self.count, NEIGHBOR)
        there = (others != 0.0).any(axis=2)  # rows of zeros are nobody
        if self.lead is not None:
            others = np.concatenate([others, rows[:, self.lead : self.lead + self.count, None]], axis=2)
        key, value = np.split(self.token.forward(others), 2, axis=2)
        score = np.einsum("kch,kh->kc", key, self.query.forward(own)) / np.sqrt(key.shape[2])
        weight = np.exp(np.where(there, score - score.max(axis=1, keepdims=True), -np.inf))
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
        seen = np.einsum("kc,kch->kh", weight, value)
        return self.out.forward(np.concatenate([own, seen], axis=1))
