"""Networks as arrays of numbers: their interface, multilayer perceptrons, and heads for Beta distributions and speeds."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import known
from crowd_env.envs.action import SpeedTable

from ..plain import Plain

# Multiplications of the largest layer in one product.  NumPy shares larger products among threads, which costs more than it
# saves: ten times as much on busy cores.
_AT_ONCE = 60 * 64 * 64
# Activation, as files name it -> function.
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {"tanh": np.tanh, "relu": lambda sums: np.maximum(sums, 0.0)}
# Lower bound of both parameters of a Beta distribution.  Where one is below 1 the density is largest at a bound: the mode.
LEAST = 0.8
_ARRAYS = ("weight", "bias")  # of a layer, as files name them


class Network(ABC):
    """A function from rows of numbers to rows of numbers, each row by itself.

    A kind is a class with a line in `crowd_env.agents.networks.NETWORKS`.  It consists of its `tensors` and `settings`; `of`
    restores it from them.  It computes in double precision and rounds at the end: the result of a row does not depend on the
    size of its batch.

    Attributes
    ----------
    kind : name in files.
    """

    kind: ClassVar[str]

    @property
    @abstractmethod
    def inputs(self) -> int:
        """Number of inputs I."""

    @property
    @abstractmethod
    def outputs(self) -> int:
        """Number of outputs O."""

    @abstractmethod
    def tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays by name; files hold them in single precision."""

    @abstractmethod
    def settings(self) -> Plain:
        """Return what the tensors do not hold, as plain data for JSON."""

    @classmethod
    @abstractmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Plain) -> "Network":
        """Return the network of tensors and settings, which may come from any file.

        Raises
        ------
        ValueError
            If this kind has other tensors or settings, or they do not fit one another.
        """

    @abstractmethod
    def forward(self, rows: Floats) -> Floats:
        """Return the outputs (K, O) for inputs (K, I)."""

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Return the outputs (K, O) float32 for inputs (K, I)."""
        out = np.empty((len(rows), self.outputs), dtype=np.float32)
        some = np.asarray(rows).any(axis=1)  # rows of zeros, of pedestrians outside, have one common output
        out[~some] = self.forward(np.zeros((1, self.inputs)))
        where = np.flatnonzero(some)
        rows_at_once = max(1, _AT_ONCE // max(array.size for array in self.tensors().values()))
        for begin in range(0, len(where), rows_at_once):
            part = where[begin : begin + rows_at_once]
            out[part] = self.forward(np.asarray(rows)[part].astype(np.float64))
        return out


@dataclass(frozen=True, eq=False)
class MLP(Network):
    """A multilayer perceptron: layers of units, the last one linear.

    Parameters
    ----------
    weights : (outputs, inputs) of each layer.
    biases : (outputs,) of each layer.
    activation : of all layers but the last, a name in `ACTIVATIONS`.

    Raises
    ------
    ValueError
        If layers do not fit one another, a number is not finite, or the activation is unknown.
    """

    kind = "mlp"
    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]
    activation: str = "tanh"

    def __post_init__(self) -> None:
        known("activation", self.activation, ACTIVATIONS)
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError(f"{len(self.weights)} arrays of weights and {len(self.biases)} of biases")
        for name in ("weights", "biases"):
            object.__setattr__(self, name, tuple(np.array(one, dtype=np.float64) for one in getattr(self, name)))
        size = self.weights[0].shape[-1:]
        for k, (weight, bias) in enumerate(self.layers):
            if weight.ndim != 2 or bias.shape != weight.shape[:1] or size != weight.shape[1:]:
                raise ValueError(f"layer {k} has weights {weight.shape} and biases {bias.shape}, which do not fit")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(f"layer {k} holds numbers that are not finite")
            size = bias.shape

    @property
    def layers(self) -> list[tuple[Floats, Floats]]:
        """Weights (outputs, inputs) and biases (outputs,) of each layer."""
        return list(zip(self.weights, self.biases, strict=True))

    @property
    def inputs(self) -> int:
        """Number of inputs I."""
        return int(self.weights[0].shape[1])

    @property
    def outputs(self) -> int:
        """Number of outputs O."""
        return int(self.weights[-1].shape[0])

    def tensors(self) -> dict[str, np.ndarray]:
        """Return ``weight0``, ``bias0``, ``weight1``, ..."""
        return {
            f"{name}{k}": one for k, layer in enumerate(self.layers) for name, one in zip(_ARRAYS, layer, strict=True)
        }

    def settings(self) -> Plain:
        """Return the activation."""
        return {"activation": self.activation}

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Plain) -> "MLP":
        """Return the network of these tensors; see `Network.of`."""
        if set(settings) != {"activation"}:
            raise ValueError(
                f"its settings are {dict(settings)}; a network {cls.kind!r} has an activation and no other"
            )
        names = [[f"{array}{k}" for k in range(max(1, len(tensors) // 2))] for array in _ARRAYS]
        if set(tensors) != {*names[0], *names[1]}:
            raise ValueError(
                f"its tensors are {', '.join(sorted(tensors)) or 'none'} instead of weight0, bias0, weight1, ..."
            )
        weights, biases = (tuple(tensors[name] for name in some) for some in names)
        return cls(weights, biases, settings["activation"])

    def forward(self, rows: Floats) -> Floats:
        """Return the outputs (K, O) for inputs (K, I)."""
        *hidden, last = self.layers
        for weight, bias in hidden:
            rows = ACTIVATIONS[self.activation](rows @ weight.T + bias)
        return rows @ last[0].T + last[1]


@dataclass(frozen=True, eq=False)
class BetaMLP(MLP):
    """An `MLP` with the parameters of a Beta distribution over [-1, 1] for each component of an action.

    The layers end in 2 A numbers for the A components of an action.  ``alpha = LEAST + softplus`` of the first A, and ``beta``
    likewise of the others.  In Chou, Maturana, Scherer (2017) both parameters are at least 1, so that no mode is a bound.

    Raises
    ------
    ValueError
        As an `MLP`, or if the number of outputs of the layers is odd.
    """

    kind = "beta-mlp"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.biases[-1]) % 2:
            raise ValueError(f"its layers end in {len(self.biases[-1])} numbers; two are needed for each of an action")

    @property
    def outputs(self) -> int:
        """Number A of components of an action."""
        return super().outputs // 2

    def forward(self, rows: Floats) -> Floats:
        """Return the modes (K, A) in [-1, 1] for inputs (K, I)."""
        alpha, beta = np.split(LEAST + np.logaddexp(0.0, super().forward(rows)), 2, axis=1)
        return 2.0 * beta_mode(alpha, beta) - 1.0


@dataclass(frozen=True, eq=False)
class BetweenMLP(MLP):
    """An `MLP` over the choices of a `SpeedTable` whose command lies between two of its speeds.

    The layers end in a logit for each choice.  The heading is that of the most likely choice.  The speed is the mean of this
    choice and of the more likely of its two neighbors in speed, weighted by their odds.  Cloning labels a speed that the table
    lacks with shares of its two neighbors (`crowd_env.agents.learned.cloning`).  Their mean is the speed of the expert policy;
    the more likely one alone is too fast or too slow.

    Parameters
    ----------
    table : speeds and headings of the choices.

    Raises
    ------
    ValueError
        As an `MLP`, or if the number of outputs of the layers is not the number of choices.
    """

    kind = "between-mlp"
    table: SpeedTable = field(default_factory=SpeedTable)

    def __post_init__(self) -> None:
        super().__post_init__()
        outputs, choices = len(self.biases[-1]), len(self.table.commands)
        if outputs != choices:
            raise ValueError(f"its layers end in {outputs} numbers; its table has {choices} choices")

    @property
    def outputs(self) -> int:
        """Number of components of a command."""
        return 2

    @cached_property
    def commands(self) -> Floats:
        """The command of each of K choices, and a placeholder for no choice (K + 1, 2)."""
        return np.vstack([self.table.commands, np.zeros(2)])

    @cached_property
    def beside(self) -> Ints:
        """The choices with the next lower and the next higher speed in the same heading (2, K); K where there is none."""
        speeds, headings = np.array(self.table.speeds), np.arange(len(self.table.headings))
        order = np.array([-1, *np.argsort(speeds), -1])
        rank = 1 + np.argsort(np.argsort(speeds))
        speed = order[np.stack([rank - 1, rank + 1])][:, :, None]
        found = np.where(speed < 0, speeds.size * headings.size, speed * headings.size + headings)
        return np.asarray(found.reshape(2, -1), dtype=np.int64)

    def settings(self) -> Plain:
        """Return the activation, the speeds and the headings."""
        return {**super().settings(), "speeds": list(self.table.speeds), "headings": list(self.table.headings)}

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Plain) -> "BetweenMLP":
        """Return the network of these tensors; see `Network.of`."""
        own = {name: settings[name] for name in ("speeds", "headings") if name in settings}
        layers = MLP.of(tensors, {name: value for name, value in settings.items() if name not in own})
        return cls(layers.weights, layers.biases, layers.activation, SpeedTable(**own))

    def forward(self, rows: Floats) -> Floats:
        """Return the commands (K, 2) for inputs (K, I)."""
        logits = np.pad(super().forward(rows), ((0, 0), (0, 1)), constant_values=-np.inf)
        row, best = np.arange(len(rows)), logits.argmax(axis=1)
        slower, faster = self.beside[:, best]
        beside = np.where(logits[row, faster] > logits[row, slower], faster, slower)
        odds = np.exp(logits[row, beside] - logits[row, best])
        share, commands = odds / (1.0 + odds), self.commands
        return commands[best] + share[:, None] * (commands[beside] - commands[best])


def beta_mode(alpha: Floats, beta: Floats) -> Floats:
    """Return the mode of Beta distributions over [0, 1]; where both bounds are modes, the one nearer to the mean.

    ``(alpha - 1) / (alpha + beta - 2)`` where both are above 1; else 1 where alpha is larger, 0 where beta is.
    """
    over, under = np.maximum(alpha - 1.0, 0.0), np.maximum(beta - 1.0, 0.0)
    inner = (over + under) > 0.0
    return np.where(inner, over / np.where(inner, over + under, 1.0), (1.0 + np.sign(alpha - beta)) / 2.0)
