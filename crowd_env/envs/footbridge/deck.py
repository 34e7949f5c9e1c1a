"""The deck: one lateral mode of vibration, and how much of it is felt where.

    M X'' + B X' + K X = F                F force of all feet on the mode
    psi(x) = sin(pi x / L)                share of the motion that is felt at x; 0 off the deck

The defaults are the north span of the London Millennium Bridge after Strogatz et al. 2005 (Nature 438:43, doi
10.1038/438043a), which could not be opened.  Two programs by others have the same M, B and K, one of them after Marcheggiani
and Lenci 2010.  The program of Belykh et al. 2021 (doi 10.1038/s41467-021-27568-y) has the same M and the frequency, 1.03 Hz.
The length of 81 m and the width of 4 m come from an account of the bridge after Dallard et al. 2001.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.checks import Checked, NotNegative, Positive

State: TypeAlias = tuple[Floats, ...]  # arrays that are integrated together


@dataclass(frozen=True)
class Deck(Checked):
    """One lateral mode of a deck.

    Parameters
    ----------
    mass : kg, modal mass ``M``.
    damping : kg/s, ``B``.
    stiffness : kg/s2, ``K``.
    length : m, ``L``, from one support to the other; x counts from the first.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    mass: Positive = 1.13e5
    damping: NotNegative = 1.10e4
    stiffness: Positive = 4.73e6
    length: Positive = 81.0

    @property
    def frequency(self) -> float:
        """Natural angular frequency [rad/s], ``sqrt(K / M)``."""
        return float(np.sqrt(self.stiffness / self.mass))

    @property
    def damping_ratio(self) -> float:
        """``zeta = B / (2 sqrt(K M))``."""
        return float(self.damping / (2.0 * np.sqrt(self.stiffness * self.mass)))

    def acceleration(self, x: Floats, v: Floats, force: Floats) -> Floats:
        """Return X'' [m/s2] of displacements [m] and velocities [m/s] under a force [N], all of one shape."""
        return (force - self.damping * v - self.stiffness * x) / self.mass

    def shape(self, along: Floats) -> Floats:
        """Return psi at the places ``along`` the deck [m]."""
        share = np.asarray(along, dtype=np.float64) / self.length
        return np.where((share > 0.0) & (share < 1.0), np.sin(np.pi * share), 0.0)

    def amplitude(self, x: Floats, v: Floats) -> Floats:
        """Return A [m] of X = A sin(Psi), X' = omega_0 A cos(Psi)."""
        return np.hypot(x, np.asarray(v) / self.frequency)

    def phase(self, x: Floats, v: Floats) -> Floats:
        """Return Psi [rad] of X = A sin(Psi), X' = omega_0 A cos(Psi)."""
        return np.arctan2(x, np.asarray(v) / self.frequency)


def order_parameter(phase: Floats, counted: Floats | Bools | None = None) -> Floats:
    """Return R = |mean of exp(i theta)| over the last axis: 0 out of step, 1 in step, about 1/sqrt(N) by chance.

    Parameters
    ----------
    phase : (..., N) rad.
    counted : (..., N) weights, 0 for pedestrians to leave out; default all alike.  R of no pedestrians is 0.
    """
    weight = np.ones_like(phase) if counted is None else np.asarray(counted, dtype=np.float64)
    total = weight.sum(axis=-1)
    return np.abs((weight * np.exp(1j * phase)).sum(axis=-1)) / np.where(total > 0.0, total, 1.0)


def runge_kutta_4(rates: Callable[[State], State], state: State, dt: float) -> State:
    """Return the tuple of arrays ``state`` a step ``dt`` [s] later: the classical method of Runge and Kutta, fourth order.

    Kutta 1901; Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, table 1.2.  ``rates`` returns the
    derivatives of such a tuple.
    """

    def moved(by: float, rate: State) -> State:
        return tuple(a + by * b for a, b in zip(state, rate, strict=True))

    first = rates(state)
    second = rates(moved(0.5 * dt, first))
    third = rates(moved(0.5 * dt, second))
    fourth = rates(moved(dt, third))
    mean = tuple((a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(first, second, third, fourth, strict=True))
    return moved(dt, mean)
