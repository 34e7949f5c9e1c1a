"""Layers of tanh units that end in Beta distributions: what acts is their mode, which can be exactly a bound."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from crowd_env.core.arrays.state import Floats

from .mlp import MLP

# Both parameters are at least this.  Below 1 the density is largest at a bound, which then is the mode.
LEAST = 0.8


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


def beta_mode(alpha: Floats, beta: Floats) -> Floats:
    """Return where the density of a Beta distribution over [0, 1] is largest; of two such bounds that nearer to its mean.

    ``(alpha - 1) / (alpha + beta - 2)`` where both are above 1; else 1 where alpha is larger, 0 where beta is.
    """
    over, under = np.maximum(alpha - 1.0, 0.0), np.maximum(beta - 1.0, 0.0)
    inner = (over + under) > 0.0
    return np.where(inner, over / np.where(inner, over + under, 1.0), (1.0 + np.sign(alpha - beta)) / 2.0)
