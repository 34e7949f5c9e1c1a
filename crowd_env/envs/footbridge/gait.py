"""The step frequency of pedestrians at a walking speed.

    f = 0.35 v^3 - 1.59 v^2 + 2.93 v                    f steps a second, v m/s
    Omega = pi f                                        a stride is two steps

Venuti and Bruno's cubic through the treadmill data of Bertram and Ruina 2001 (Bruno, Venuti, Crowd-structure interaction in
footbridges, Journal of Sound and Vibration 323, 2009).  The paper could not be opened; several programs about footbridges have
the same coefficients, one of which halves f for strides.  The cubic rises for all speeds.  It gives 1.9 steps a second at
1.34 m/s, and the 2.06 of the north span of the Millennium Bridge at 1.61 m/s.
"""

import numpy as np

from crowd_env.core.arrays.state import Floats

_NEWTON = 30  # steps; the cubic has no flat part, a dozen are enough from anywhere


def step_frequency(speed: Floats) -> Floats:
    """Return f [1/s] at a walking speed [m/s]."""
    v = np.asarray(speed, dtype=np.float64)
    return ((0.35 * v - 1.59) * v + 2.93) * v


def walking_speed(frequency: Floats) -> Floats:
    """Return the walking speed [m/s] at f [1/s], the inverse of `step_frequency`; 0 for no steps."""
    f = np.maximum(np.asarray(frequency, dtype=np.float64), 0.0)
    v = f / 1.3
    for _ in range(_NEWTON):
        v = v - (step_frequency(v) - f) / ((1.05 * v - 3.18) * v + 2.93)
    return v


def stride_rate(speed: Floats) -> Floats:
    """Return Omega [rad/s] at a walking speed [m/s]."""
    return np.pi * step_frequency(speed)
