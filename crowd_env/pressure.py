"""How hard a crowd presses: on a body, and as a crowd."""

import numpy as np
from numpy.typing import ArrayLike

from crowd_env._jit import kernel
from crowd_env.physics.neighbors import NeighbourList, sort_into_cells
from crowd_env.simulation import Simulation
from crowd_env.state import CrowdState, Floats, Ints


def contact_pressure(impulse: ArrayLike, duration: float, radius: ArrayLike) -> Floats:
    """Return the contact force on each body per circumference [N/m], sum |f_c| / (2 pi r).

    It is the two-dimensional pressure inside the disc: the trace of the virial stress sum (r n) f / (pi r^2), halved.

    Parameters
    ----------
    impulse : (..., N) N s, summed magnitudes of the contact impulses during ``duration``, as in ``Memory.crush``.
    duration : s.
    radius : (N,) m.
    """
    circumference = 2.0 * np.pi * np.asarray(radius, dtype=np.float64)
    return np.asarray(impulse, dtype=np.float64) / (duration * circumference)


def crowd_pressure(simulation: Simulation, radius: float = 1.0) -> Floats:
    """Return density times velocity variance around everyone (P,) [1/s^2]; 0 for those who are out.

    Over the people within ``radius`` [m], oneself included.  The "crowd pressure" of Helbing, Johansson, Al-Abideen 2007, who
    saw turbulence from 0.02 /s^2 on; they weigh by a Gaussian of the distance, here everyone within reach counts the same.
    """
    out = np.zeros(len(simulation.bodies.radius))
    _density_times_variance(simulation.bodies.env_start, simulation.state, simulation.memory.near, radius, out)
    return out


@kernel
def _density_times_variance(
    env_start: Ints, state: CrowdState, near: NeighbourList, radius: float, out: Floats
) -> None:
    position, velocity = state.position, state.velocity
    for e in range(len(state.time)):
        begin, end = env_start[e], env_start[e + 1]
        head, columns, rows = sort_into_cells(e, begin, end, state.active, position, near, radius)
        for i in range(begin, end):
            if not state.active[i]:
                continue
            column, row = near.cell_of[i] % columns, near.cell_of[i] // columns
            count, sum_x, sum_y, squares = 0, 0.0, 0.0, 0.0
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                first = head + r * columns + max(column - 1, 0)
                stop = head + r * columns + min(column + 1, columns - 1)
                for item in range(begin + near.cell_start[first], begin + near.cell_start[stop + 1]):
                    j = near.cell_item[item]
                    dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                    if dx * dx + dy * dy < radius * radius:
                        u, v = velocity[j, 0], velocity[j, 1]
                        count, sum_x, sum_y, squares = count + 1, sum_x + u, sum_y + v, squares + u * u + v * v
            variance = squares / count - (sum_x * sum_x + sum_y * sum_y) / (count * count)
            out[i] = count / (np.pi * radius * radius) * max(variance, 0.0)
