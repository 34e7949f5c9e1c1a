"""Small networks as plain numbers: used, written and read with numpy alone, so that opening one runs nobody's code.

A file is one ``.npz``: the arrays ``weight0``, ``bias0``, ``weight1``, ... of float32, and ``facts``, a JSON object as text.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.files.array_file import read_arrays, write_arrays
from crowd_env.state import Floats

FORMAT, VERSION = "crowd_env network", 1
# Rows at once: larger products are shared out to threads, which costs more than it saves, much more on busy cores.
_AT_ONCE = 60
_MOST_BYTES = 2**28  # of all arrays unpacked: a hundred times the networks made here


@dataclass(frozen=True, eq=False)
class Network:
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

    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError(f"{len(self.weights)} arrays of weights and {len(self.biases)} of biases")
        # Calculated in double precision and rounded at the end: a row comes out the same in a batch of any size.
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

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Return the outputs (K, O) float32 for inputs (K, I)."""
        out = np.empty((len(rows), self.outputs), dtype=np.float32)
        some = np.asarray(rows).any(axis=1)  # rows of zeros, of people who are out, are all alike
        out[~some] = self._forward(np.zeros((1, self.inputs)))
        where = np.flatnonzero(some)
        for begin in range(0, len(where), _AT_ONCE):
            part = where[begin : begin + _AT_ONCE]
            out[part] = self._forward(np.asarray(rows)[part].astype(np.float64))
        return out

    def _forward(self, values: Floats) -> Floats:
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = np.tanh(values @ weight.T + bias)
        return np.asarray(values @ self.weights[-1].T + self.biases[-1])


def write_network(path: Path, network: Network, facts: dict[str, Any]) -> None:
    """Write a network and what there is to know of it, whole or not at all."""
    sizes = [network.inputs, *(len(bias) for bias in network.biases)]
    facts = {"format": FORMAT, "version": VERSION, **facts, "layers": sizes, "activation": "tanh"}
    layers: dict[str, Any] = {}
    for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        layers |= {f"weight{k}": weight.astype(np.float32), f"bias{k}": bias.astype(np.float32)}
    write_arrays(path, layers, facts)


def read_network(path: Path) -> tuple[Network, dict[str, Any]]:
    """Read what `write_network` wrote; nothing in the file is executed, whatever it holds.

    Raises
    ------
    ValueError
        If the file is missing, or no such network.
    """
    try:
        arrays, facts = read_arrays(path, _MOST_BYTES)
        if not isinstance(facts, dict) or facts.get("format") != FORMAT:
            raise ValueError("it does not say what it is")
        if facts.get("version") != VERSION:
            raise ValueError(f"it has version {facts.get('version')!r}; this program reads version {VERSION}")
        layers = [(arrays.pop(f"weight{k}"), arrays.pop(f"bias{k}")) for k in range(len(arrays) // 2)]
        if arrays or any(array.dtype != np.float32 for layer in layers for array in layer):
            raise ValueError("it holds other arrays than the weights and biases of layers")
        return Network(*zip(*layers, strict=True)), facts
    except OSError as error:
        raise ValueError(f"cannot read the network {path}: {error.strerror or error}") from None
    except Exception as error:  # a damaged file fails in many places: zip, npy header, JSON, shapes
        said = f"it has no array {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{path} is not a network saved by train.py or agents.train_routing: {said}") from None
