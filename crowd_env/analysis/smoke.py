"""What smoke does to people: how fast they walk in it, and the dose of its gases, computed beside or after a run.

Nothing here acts by itself: give a `SpeedZone` the speed in a smoke of known extinction coefficient, and `dose` the gases on a
pedestrian's way.  A dose stops no one.
"""

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats

_ALPHA, _BETA = 0.706, -0.057  # m/s and m2/s, means of Frantzich and Nilsson
_SLOWEST = 0.1  # of the speed in clear air


def speed_in_smoke(extinction: ArrayLike) -> Floats:
    """Return the walking speed relative to that in clear air by extinction coefficient [1/m], at least a tenth.

    Source: Frantzich, Nilsson 2003, Lund report 3126, measured from 2 to 8 1/m, with the bound of FDS+Evac.
    """
    return np.maximum(1.0 + _BETA / _ALPHA * np.asarray(extinction, dtype=np.float64), _SLOWEST)


def dose(time: ArrayLike, monoxide: ArrayLike, dioxide: ArrayLike, oxygen: ArrayLike) -> Floats:
    """Return the fractional effective dose (T,) at times (T,) [s] in gases of volume fractions (T,); at 1 people cannot go on.

    Each fraction holds until the next time.  The dose is of carbon monoxide and of lack of oxygen; carbon dioxide makes people
    breathe faster.

    Source: Purser, SFPE Handbook of Fire Protection Engineering; ISO 13571 for the exponent of monoxide.
    """
    at, monoxide, dioxide, oxygen = np.broadcast_arrays(*map(np.asarray, (time, monoxide, dioxide, oxygen)))
    faster = np.exp(0.1903 * 100.0 * dioxide + 2.0004) / 7.1
    per_minute = 2.764e-5 * (1e6 * monoxide) ** 1.036 * faster + 1.0 / np.exp(8.13 - 0.54 * (20.9 - 100.0 * oxygen))
    return np.concatenate([[0.0], np.cumsum(per_minute[:-1] * np.diff(at) / 60.0)])
