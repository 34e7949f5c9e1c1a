"""Walkers that fall into step with the deck: the coupling ``synchrony``.

    F = sum_i G psi_i sin(theta_i)                                                       force on the mode
    theta_i' = Omega_i + C A psi_i sin(Psi - theta_i + alpha)
             = Omega_i + C psi_i [X cos(theta_i - alpha) - X' sin(theta_i - alpha) / omega_0]
    sum_i psi_i^2 = (4 zeta / pi) K / (G C P(omega_0))                                   threshold, for alpha = pi / 2

Strogatz, Abrams, McRobie, Eckhardt, Ott 2005 (Nature 438:43, doi 10.1038/438043a); there psi_i = 1.  ``theta_i`` is the phase
of a stride, left and right, so that Omega_i is half of the frequency of steps; ``P`` is the density of the Omega_i.  The paper
could not be opened.  The equations, alpha and C, which it fits to a test on the bridge, were checked against accounts of it.
G = 30 N and the spread of 0.63 rad/s come from a program by others, which has another C.

The threshold follows from linear response.  A small motion A of the mode brings a share pi P C A psi_i / 2 of the walkers at
omega_0 into step, a quarter of a cycle ahead.  The deck takes energy from them as fast as it loses it.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Checked, NotNegative, Range
from crowd_env.envs.footbridge.deck import Deck, State, runge_kutta_4

SPREAD = 0.63  # rad/s, standard deviation of Omega


@dataclass(frozen=True)
class Synchrony(Checked):
    """Phases that the deck pulls along.

    Parameters
    ----------
    force : N, ``G``, amplitude of the force of one walker to the side.
    sensitivity : 1/(m s), ``C``; 0 = walkers ignore the motion.
    lag : rad, ``alpha``.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    force: NotNegative = 30.0
    sensitivity: NotNegative = 16.0
    lag: Annotated[float, Range(-2.0 * np.pi, 2.0 * np.pi)] = 0.5 * np.pi

    def threshold(self, deck: Deck, density: float) -> float:
        """Return the sum of psi_i squared beyond which the deck sways; ``density`` [s] is that of Omega at omega_0.

        It is the number of walkers at mid-span, and half the number of walkers spread evenly over the deck.
        """
        return (
            4.0 * deck.damping_ratio / np.pi * deck.stiffness / (self.force * max(self.sensitivity, 1e-300) * density)
        )


def normal_density(sd: float) -> float:
    """Return the density [s] of a normal distribution of angular frequencies at its mean; ``sd`` in rad/s."""
    return float(1.0 / (np.sqrt(2.0 * np.pi) * sd))


def synchrony_rates(deck: Deck, coupling: Synchrony, omega: Floats, psi: Floats, state: State) -> State:
    """Return the derivatives of ``state``: X (...), X' (...), exp(i theta) (..., N); ``omega`` and ``psi`` are (..., N)."""
    x, v, turn = state
    pull = np.exp(-1j * coupling.lag) * (x + 1j * v / deck.frequency)
    rate = omega + coupling.sensitivity * psi * (pull.real[..., None] * turn.real - pull.imag[..., None] * turn.imag)
    force = coupling.force * (psi * turn.imag).sum(axis=-1)
    return v, deck.acceleration(x, v, force), 1j * rate * turn


def advance_synchrony(
    deck: Deck, coupling: Synchrony, omega: Floats, psi: Floats, state: State, dt: float, steps: int = 1
) -> State:
    """Return ``state`` ``steps`` steps of ``dt`` [s] later, walkers staying where they are; see `synchrony_rates`.

    After each step exp(i theta) is put back to length 1 by a step of Newton, which keeps the order (Hairer, Lubich, Wanner,
    Geometric Numerical Integration, IV.4).
    """
    for _ in range(steps):
        x, v, turn = runge_kutta_4(lambda at: synchrony_rates(deck, coupling, omega, psi, at), state, dt)
        turn *= 1.5 - 0.5 * (turn.real**2 + turn.imag**2)
        state = x, v, turn
    return state
