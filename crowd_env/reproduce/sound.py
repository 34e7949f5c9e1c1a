"""What every figure of a paper asks of the runs behind it."""

import numpy as np

from crowd_env.simulation.simulation import Simulation


def require_nobody_outside(simulation: Simulation) -> None:
    """Raise FloatingPointError if anyone was found outside of the walkable area: no figure is made of such a run."""
    lost = int(np.count_nonzero(simulation.escaped))
    if lost:
        raise FloatingPointError(
            f"{simulation.scheme.info.name}: {lost} people were outside of the plan at some decision; the run is void"
        )
