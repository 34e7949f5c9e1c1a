"""The flow of `crowd_env.routing.fields.drain`, compiled: a file of its own, since kernels are kept by what they import."""

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.kernels.jit import kernel

_ENOUGH = 1e-4  # share of the sources that may be left unbalanced
_MOST = 4000  # steps of conjugate gradients


@kernel
def drain(beside: Ints, ends: Bools, phi: Floats, scratch: Floats) -> None:
    """Write ``phi`` (K,) of the nodes of a floor by conjugate gradients; ``scratch`` (3, K) is 1 at first.

    ``beside`` (K, 4) are the neighbors of each node, itself in place of those to which one cannot walk.
    """
    left, step, out = scratch
    square = float(len(phi))
    enough = _ENOUGH * _ENOUGH * square
    for _ in range(_MOST):
        if square <= enough:
            break
        along = 0.0
        for k in range(len(phi)):
            others = step[beside[k, 0]] + step[beside[k, 1]] + step[beside[k, 2]] + step[beside[k, 3]]
            out[k] = (5.0 if ends[k] else 4.0) * step[k] - others
            along += step[k] * out[k]
        share, before, square = square / along, square, 0.0
        for k in range(len(phi)):
            phi[k] += share * step[k]
            left[k] -= share * out[k]
            square += left[k] * left[k]
        for k in range(len(phi)):
            step[k] = left[k] + square / before * step[k]
