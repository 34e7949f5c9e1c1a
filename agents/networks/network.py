"""Networks as numbers: what every kind has, layers of units, and such that end in Beta distributions or between two speeds."""

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

# Multiplications at once, of the largest layer: larger products are shared out to threads, which costs more than it saves, ten
# times as much on busy cores.
_AT_ONCE = 60 * 64 * 64
# Activation, as files call it -> what it does.
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {"tanh": np.tanh, "relu": lambda sums: np.maximum(sums, 0.0)}
# Both parameters of a Beta distribution are at least this.  Below 1 the density is largest at a bound, which then is the mode.
LEAST = 0.8


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
    def settings(self) -> dict[str, object]:
        """Return what the tensors do not say, as JSON can hold it."""

    @classmethod
    @abstractmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Plain) -> "Network":
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
        rows_at_once = max(1, _AT_ONCE // max(array.size for array in self.tensors().values()))
        for begin in range(0, len(where), rows_at_once):
            part = where[begin : begin + rows_at_once]
            out[part] = self.forward(np.asarray(rows)[part].astype(np.float64))
        return out


@dataclass(frozen=True, eq=False)
class MLP(Network):
    """Layers of units with a linear one at the end.

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

    kind: ClassVar[str] = "mlp"
    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]
    activation: str = "tanh"

    def __post_init__(self) -> None:
        known("activation", self.activation, ACTIVATIONS)
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

    def settings(self) -> dict[str, object]:
        """Return the activation."""
        return {"activation": self.activation}

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], settings: Plain) -> "MLP":
        """Return the network of these tensors; see `Network.of`."""
        if set(settings) != {"activation"}:
            raise ValueError(
                f"its settings are {dict(settings)}; a network {cls.kind!r} has an activation and no other"
            )
        layers = range(max(1, len(tensors) // 2))
        expected = [f"{array}{k}" for k in layers for array in ("weight", "bias")]
        if set(tensors) != set(expected):
            raise ValueError(
                f"its tensors are {', '.join(sorted(tensors)) or 'none'} instead of weight0, bias0, weight1, ..."
            )
        weights, biases = (tuple(tensors[f"{array}{k}"] for k in layers) for array in ("weight", "bias"))
        return cls(weights, biases, settings["activation"])

    def forward(self, rows: Floats) -> Floats:
        """Return the outputs (K, O) for inputs (K, I)."""
        bend = ACTIVATIONS[self.activation]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            rows = bend(rows @ weight.T + bias)
        return np.asarray(rows @ self.weights[-1].T + self.biases[-1])


@dataclass(frozen=True, eq=False)
class BetaMLP(MLP):
    """An `MLP` whose outputs are the parameters of a Beta distribution for each number of an action, over [-1, 1].

    The layers end in 2 A numbers for A of an action: ``alpha = LEAST + softplus`` of the first A, ``beta`` likewise of the
    others (Chou, Maturana, Scherer 2017, whose parameters are at least 1: no mode of theirs is a bound).

    Raises
    ------
    ValueError
        As an `MLP`, or if the number of outputs of the layers is odd.
    """

    kind: ClassVar[str] = "beta-mlp"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.biases[-1]) % 2:
            raise ValueError(f"its layers end in {len(self.biases[-1])} numbers; two are needed for each of an action")

    @property
    def outputs(self) -> int:
        """How many numbers of an action it returns."""
        return super().outputs // 2

    def forward(self, rows: Floats) -> Floats:
        """Return the modes (K, A) in [-1, 1] for inputs (K, I)."""
        alpha, beta = np.split(LEAST + np.logaddexp(0.0, super().forward(rows)), 2, axis=1)
        return 2.0 * beta_mode(alpha, beta) - 1.0


@dataclass(frozen=True, eq=False)
class BetweenMLP(MLP):
    """An `MLP` over the choices of a `SpeedTable` that acts between two of its speeds.

    The layers end in a logit for each choice.  The heading is that of the likeliest choice.  The speed is the mean, weighted by
    their odds, of that choice and of the likelier of the two with the speeds beside it.  A teacher whose speed the table lacks
    is learned as shares of the two beside it (`crowd_env.agents.learned.cloning`): their mean is what it wanted, and the
    likelier of them alone is too fast or too slow.

    Parameters
    ----------
    table : what the choices mean.

    Raises
    ------
    ValueError
        As an `MLP`, or if the layers do not end in as many numbers as there are choices.
    """

    kind: ClassVar[str] = "between-mlp"
    table: SpeedTable = field(default_factory=SpeedTable)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.biases[-1]) != self._choices:
            raise ValueError(f"its layers end in {len(self.biases[-1])} numbers; its table has {self._choices} choices")

    @property
    def _choices(self) -> int:
        return len(self.table.speeds) * len(self.table.headings)

    @property
    def outputs(self) -> int:
        """How many numbers of a command it returns."""
        return 2

    @cached_property
    def commands(self) -> Floats:
        """The command of each of K choices, and one that stands for no choice (K + 1, 2)."""
        return np.vstack([self.table.commands, np.zeros(2)])

    @cached_property
    def beside(self) -> Ints:
        """The choices with the next lower and the next higher speed in the same heading (2, K); K where there is none."""
        speeds, headings = np.array(self.table.speeds), np.arange(len(self.table.headings))
        order = np.array([-1, *np.argsort(speeds), -1])
        rank = 1 + np.argsort(np.argsort(speeds))
        speed = order[np.stack([rank - 1, rank + 1])][:, :, None]
        found = np.where(speed < 0, self._choices, speed * len(headings) + headings)
        return np.asarray(found.reshape(2, -1), dtype=np.int64)

    def settings(self) -> dict[str, object]:
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
        return np.asarray(commands[best] + share[:, None] * (commands[beside] - commands[best]))


def beta_mode(alpha: Floats, beta: Floats) -> Floats:
    """Return where the density of a Beta distribution over [0, 1] is largest; of two such bounds that nearer to its mean.

    ``(alpha - 1) / (alpha + beta - 2)`` where both are above 1; else 1 where alpha is larger, 0 where beta is.
    """
    over, under = np.maximum(alpha - 1.0, 0.0), np.maximum(beta - 1.0, 0.0)
    inner = (over + under) > 0.0
    return np.where(inner, over / np.where(inner, over + under, 1.0), (1.0 + np.sign(alpha - beta)) / 2.0)
