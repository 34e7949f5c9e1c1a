"""Walkers that keep their balance at a step time of their own: the coupling ``pendulum``.

    y'' = w^2 (y - p) - psi X''                         body at y over a foot at p, both from the deck; w^2 = g / L
    F = sum_i psi_i m w^2 (p_i - y_i)                   force on the mode
    p <- y + y' / w + s b,   s <- -s                    at every step; b margin, s side of the foot
    sigma = -m w^2 Im(h) / Omega,   N = B / -sigma      damping that one walker adds, and the critical number at mid-span

Model 1 of Belykh, Bocian, Champneys, Daley, Jeter, Macdonald, McRobie 2021 (Nature Communications 12:7223, doi
10.1038/s41467-021-27568-y), after Macdonald 2009; where feet are put is Hof's rule.  Equations and numbers were checked against
the program that goes with the paper.  Steps follow each other at a fixed time: walkers never fall into step.  Their Model 2,
where the time of a step changes too, is not here.

``h`` is the mean response of ``-(y - p)`` to X = exp(i Omega t), over all phases of the steps.  With a step of T and
q = y + y'/w - p, r = y - y'/w - p it is

    q' = w q + f,   q = 0 after a step      r' = -w r - f,   f = Omega^2 exp(i Omega t) / w

which is solved in closed form.  The paper's formula, (36) of its supplement, could not be opened: unchecked.  This one is
derived here, and a test measures it in the motion of the equations above.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import Checked, NotNegative, Positive
from crowd_env.envs.footbridge.deck import Deck, State, runge_kutta_4

_GRAVITY = 9.81  # m/s2


@dataclass(frozen=True)
class Pendulum(Checked):
    """Inverted pendulums that put their feet where they keep their balance.

    Parameters
    ----------
    mass : kg, ``m``.
    height : m, ``L``, length of the pendulum.
    margin : m, ``b``, how far beyond the point of balance a foot is put.
    frequency : 1/s, of strides, two steps each.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    mass: Positive = 76.9
    height: Positive = 1.17
    margin: NotNegative = 0.0157
    frequency: Positive = 0.9

    @property
    def rate(self) -> float:
        """``w`` [1/s]."""
        return float(np.sqrt(_GRAVITY / self.height))

    def damping_per_walker(self, omega: float) -> float:
        """Return sigma [kg/s] at the angular frequency ``omega`` [rad/s] of the deck; below 0 a walker feeds the motion."""
        w, turn, step = self.rate, 1j * omega, 0.5 / self.frequency

        def mean(rate: complex) -> complex:
            """Return the mean of exp((rate - i omega) t) over a step."""
            return (np.exp((rate - turn) * step) - 1.0) / ((rate - turn) * step)

        push, ahead, fall = omega**2 / w, np.exp(turn * step), np.exp(-w * step)
        foot = push * (ahead - np.exp(w * step)) / ((turn - w) * (ahead - 1.0))
        start = foot * (1.0 - fall) / (ahead - fall) - push / (turn + w) - foot
        q = push / (turn - w) * (1.0 - mean(w))
        r = start * mean(-w) - push / (turn + w) * (1.0 - mean(-w))
        return float(self.mass * w**2 * (0.5 * (q + r)).imag / omega)

    def critical_number(self, deck: Deck) -> float:
        """Return the sum of psi_i squared beyond which the deck sways; infinite where walkers damp it."""
        sigma = self.damping_per_walker(deck.frequency)
        return deck.damping / -sigma if sigma < 0.0 else np.inf


class Walkers(NamedTuple):
    """Bodies and feet of N pendulums; arrays are written in place."""

    foot: Floats  # (N,) m, p
    side: Floats  # (N,) 1 or -1
    steps_left: Ints  # (N,) until the next foot comes down
    steps: Ints  # (N,) that a foot stays down

    def phase(self) -> Floats:
        """Return the phase (N,) [rad] of each stride; it advances evenly, whatever the deck does."""
        return np.pi * (1.0 - self.steps_left / self.steps) + np.where(self.side > 0.0, 0.0, np.pi)


def start_walking(coupling: Pendulum, frequency: Floats, dt: float, rng: np.random.Generator) -> tuple[Walkers, State]:
    """Return walkers in their steady gait on a deck at rest, at random phases, and their state: X, X', y (N,), y' (N,).

    ``frequency`` (N,) [1/s] is that of strides; a foot stays down for a whole number of steps ``dt`` [s].
    """
    w, steps = coupling.rate, np.maximum(np.rint(0.5 / (frequency * dt)).astype(np.int64), 1)
    side = rng.choice([-1.0, 1.0], len(frequency))
    left = rng.integers(1, steps + 1)
    down = steps * dt
    foot = side * 0.5 * coupling.margin * (1.0 + np.exp(w * down))
    ahead, behind = foot - side * coupling.margin, -foot * np.tanh(0.5 * w * down)  # y + y'/w, y - y'/w
    since = (steps - left) * dt
    ahead, behind = foot + (ahead - foot) * np.exp(w * since), foot + (behind - foot) * np.exp(-w * since)
    zero = np.zeros(())
    return Walkers(foot, side, left, steps), (zero, zero, 0.5 * (ahead + behind), 0.5 * w * (ahead - behind))


def pendulum_rates(deck: Deck, coupling: Pendulum, foot: Floats, psi: Floats, state: State) -> State:
    """Return the derivatives of ``state``: X (), X' (), y (N,), y' (N,)."""
    x, v, y, y_rate = state
    lean = coupling.rate**2 * (y - foot)
    a = deck.acceleration(x, v, -coupling.mass * (psi * lean).sum(axis=-1))
    return v, a, y_rate, lean - psi * a


def advance_pendulum(
    deck: Deck, coupling: Pendulum, walkers: Walkers, psi: Floats, state: State, dt: float, steps: int = 1
) -> State:
    """Return ``state`` ``steps`` steps of ``dt`` [s] later; feet come down between two steps."""
    foot, side, left, duration = walkers
    for _ in range(steps):
        state = runge_kutta_4(lambda at: pendulum_rates(deck, coupling, foot, psi, at), state, dt)
        left -= 1
        down = left == 0
        if down.any():
            _, _, y, y_rate = state
            side[down] *= -1.0
            foot[down] = (y + y_rate / coupling.rate)[down] + side[down] * coupling.margin
            left[down] = duration[down]
    return state
