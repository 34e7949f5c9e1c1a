"""What every figure of a paper asks of the runs behind it."""

import numpy as np

from crowd_env.simulation.simulation import Simulation


def require_nobody_outside(simulation: Simulation) -> None:
    """Raise FloatingPointError if anyone was found outside of the walkable area: no figure is made of such a run."""
    require_none_escaped(simulation.scheme.info.name, int(np.count_nonzero(simulation.escaped)))


def require_none_escaped(scheme: str, escaped: int) -> None:
    """Raise FloatingPointError if ``escaped`` people were found outside of the walkable area."""
    if escaped:
        raise FloatingPointError(
            f"{scheme}: {escaped} people were outside of the plan at some decision; the run is void"
        )
