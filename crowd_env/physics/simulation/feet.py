"""Where feet and heads of people are who keep their balance: what a camera would see of them."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.physics.balance import GRAVITY
from crowd_env.physics.simulation.simulation import Simulation


def places_of_feet(simulation: Simulation) -> Floats:
    """Return where both feet of everyone are (P, 2, 2) [m], one in the air on its way too; under the body of who walks.

    Raises
    ------
    ValueError
        If people of the simulation have no feet: it has no balance.
    """
    params, state, bodies = simulation.balance, simulation.state, simulation.bodies
    if params is None:
        raise ValueError("people have no feet here: a simulation needs balance='stepping'")
    feet, lands_at, stands = (
        simulation.in_slots(getattr(simulation.history, n)) for n in ("feet", "lands_at", "stands")
    )
    feet = np.where(stands[:, None], feet, np.tile(state.position, 2)).reshape(-1, 2, 2)
    time = np.repeat(state.time, np.diff(bodies.env_start))
    done = np.clip(1.0 - (np.where(stands, lands_at, np.inf) - time) / params.swing, 0.0, 1.0)[:, None]
    ahead = state.position + np.sqrt(params.height / GRAVITY) * state.velocity - feet[:, 0]
    ahead *= np.minimum(1.0, params.step / np.maximum(np.hypot(*ahead.T), 1e-9))[:, None]
    feet[:, 1] += done * (feet[:, 0] + ahead - feet[:, 1])
    return feet


def places_of_heads(simulation: Simulation) -> Floats:
    """Return where everyone's head is (P, 2) [m]: further from the middle of the feet than the body that leans."""
    body, params = simulation.state.position, simulation.balance
    return (
        body.copy() if params is None else body + (params.head - 1.0) * (body - places_of_feet(simulation).mean(axis=1))
    )
