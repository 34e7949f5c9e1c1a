"""Layers of tanh units."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from crowd_env.core.arrays.state import Floats

from .network import Network

_SETTINGS = {"activation": "tanh"}


@dataclass(frozen=True, eq=False)
class MLP(Network):
    """Layers of tanh units with a linear one at the end.

    Parameters
    ----------
    weights : (outputs, inputs) of each layer.
    biases : (outputs,) of each layer.

    Raises
    ------
    ValueError
        If layers do not fit one another, or a number is not finite.
    """

    kind: ClassVar[str] = "mlp"
    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError(f"{len(self.weights)} arrays of weights and {len(self.biases)} of biases")
        object.__setattr__(self, "weights", tuple(np.array(one, dtype=np.float64) for one in self.weights))
        object.__setattr__(self, "biases", tuple(np.array(one, dtype=np.float64) for one in self.biases))
        size = None
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.ndim != 2 or bias.shape != weight.shape[:1] or size not in (None, weight.shape[1]):
                raise ValueError(f"layer {k} has weights {weight.shape} and biases {bias.shape}, which do not fit")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(f"layer {k} holds numbers that are not finite")
            size = weight.shape[0]

    @property
    def inputs(self) -> int:
        """How many numbers it takes."""
        return int(self.weights[0].shape[1])

    @property
    def outputs(self) -> int:
        """How many numbers it returns."""
        return int(self.weights[-1].shape[0])

    def tensors(self) -> dict[str, np.ndarray]:
        """Return ``weight0``, ``bias0``, ``weight1``, ..."""
        found: dict[str, np.ndarray] = {}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            found |= {f"weight{k}": weight, f"bias{k}": bias}
        return found

    def settings(self) -> dict[str, Any]:
        """Return the activation."""
        return dict(_SETTINGS)

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Mapping[str, Any]) -> "MLP":
        """Return the network of these tensors; see `Network.of`."""
        if settings != _SETTINGS:
            raise ValueError(f"its settings are {dict(settings)}; those of a network {cls.kind!r} are {_SETTINGS}")
        layers = range(max(1, len(tensors) // 2))
        expected = [f"{array}{k}" for k in layers for array in ("weight", "bias")]
        if set(tensors) != set(expected):
            raise ValueError(
                f"its tensors are {', '.join(sorted(tensors)) or 'none'} instead of weight0, bias0, weight1, ..."
            )
        return cls(tuple(tensors[f"weight{k}"] for k in layers), tuple(tensors[f"bias{k}"] for k in layers))

    def forward(self, rows: Floats) -> Floats:
        """Return the outputs (K, O) for inputs (K, I)."""
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            rows = np.tanh(rows @ weight.T + bias)
        return np.asarray(rows @ self.weights[-1].T + self.biases[-1])
